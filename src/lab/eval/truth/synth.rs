//! `truth.json` of `edgecap synth`: everything about everybody.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use serde::Deserialize;

use super::{TruthFrame, TruthPerson, TruthSet};
use crate::lab::eval::{Keypoint, bounding_box};

const VISIBLE: u8 = 1;
/// Hidden by another part of the same body.
const SELF_OCCLUDED: u8 = 2;
/// Hidden by another person or a thing.
const OCCLUDED: u8 = 3;

#[derive(Deserialize)]
pub(super) struct File {
    fps: f64,
    #[serde(default)]
    clip: Option<String>,
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    frame: u64,
    #[serde(default)]
    file: Option<String>,
    people: Vec<Person>,
}

#[derive(Deserialize)]
struct Person {
    id: u64,
    stature: f64,
    joints3d: [[f64; 3]; BODY_JOINTS],
    joints2d: [[f64; 2]; BODY_JOINTS],
    /// 0 outside the picture, 1 visible, 2 hidden by the own body, 3 hidden by another person or a thing.
    visibility: [u8; BODY_JOINTS],
}

/// Fewest evidence joints that can be seen of a person who is asked for; of others less shows than a detector needs.
const LEAST_JOINTS: usize = 4;

pub(super) fn read(file: File) -> TruthSet {
    let person = |p: Person| {
        let labelled = (0..EVIDENCE_JOINTS)
            .filter(|&j| matches!(p.visibility[j], VISIBLE | SELF_OCCLUDED))
            .count();
        let hidden = labelled < LEAST_JOINTS;
        let point = |j: usize, visibility: u8| {
            let [u, v] = p.joints2d[j];
            Keypoint::at(j, u, v, visibility)
        };
        let points = (0..EVIDENCE_JOINTS)
            .map(|j| match p.visibility[j] {
                VISIBLE => point(j, 2),
                SELF_OCCLUDED => point(j, 1),
                // Joints hidden by others are neither asked for nor forbidden; of people who are not asked for at all
                // everything is kept, so that a guess at them is known as one.
                OCCLUDED if hidden => point(j, 1),
                _ => point(j, 0),
            })
            .collect();
        // The size is that of the whole person, hidden parts included: a leg behind a table makes nobody smaller.
        let inside = (0..EVIDENCE_JOINTS).filter(|&j| p.visibility[j] > 0);
        let all: Vec<Keypoint> = inside.map(|j| point(j, 2)).collect();
        let bbox = bounding_box(&all);
        TruthPerson {
            id: Some(p.id),
            area: super::AREA_OF_BOX * bbox[2] * bbox[3],
            bbox,
            crowd: hidden,
            points,
            joints3d: Some(p.joints3d.map(Some)),
            stature: Some(p.stature),
        }
    };
    let video = file.fps > 0.0;
    let clip = file.clip.unwrap_or_default();
    let frame = |f: Frame| TruthFrame {
        source: f.file.unwrap_or_else(|| clip.clone()),
        frame: video.then_some(f.frame),
        people: f.people.into_iter().map(person).collect(),
        ..TruthFrame::default()
    };
    TruthSet {
        frames: file.frames.into_iter().map(frame).collect(),
        single: false,
        video,
    }
}

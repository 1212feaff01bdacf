//! `truth.json` of `edgecap synth`: everything about everybody.

use std::path::Path;

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use serde::Deserialize;

use super::{TruthFrame, TruthPerson, TruthSet};
use crate::lab::eval::{EvalError, Keypoint, bounding_box};
use crate::lab::synth::truth::{FORMAT, VERSION};

const VISIBLE: u8 = 1;
/// Hidden by another part of the same body.
const SELF_OCCLUDED: u8 = 2;
/// Hidden by another person or a thing.
const OCCLUDED: u8 = 3;

#[derive(Deserialize)]
pub(super) struct File {
    fps: f64,
    #[serde(default)]
    width: f64,
    #[serde(default)]
    height: f64,
    #[serde(default)]
    clip: Option<String>,
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    frame: u64,
    #[serde(default)]
    time_ns: Option<u64>,
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
    /// u0, v0, u1, v1 of the whole body, also where it is not in the picture; none where part of it is behind the
    /// camera.
    #[serde(default, rename = "box")]
    bounds: Option<[f64; 4]>,
}

/// Fewest evidence joints that can be seen of a person who is asked for; of others less shows than a detector needs.
const LEAST_JOINTS: usize = 4;

/// Joints nearer to the camera than this, metres, are seen anywhere.
const NEAR: f64 = 0.1;

/// Refuses another format or version, where the file says which it is: what is written otherwise may mean something
/// else, too.
pub(super) fn expect_version(file: &serde_json::Value, name: &str) -> Result<(), EvalError> {
    let (format, version) = (file.get("format"), file.get("version"));
    if format.is_none_or(|f| f == FORMAT) && version.is_none_or(|v| v == VERSION) {
        return Ok(());
    }
    let said = |x: &serde_json::Value| match x {
        serde_json::Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let remedy = match format.is_none_or(|f| f == FORMAT) {
        true => "write it again with this edgecap's `synth`",
        false => "give the file that `synth` calls truth.json",
    };
    let format = format.map_or(FORMAT.to_owned(), said);
    let version = version.map_or("?".to_owned(), said);
    Err(EvalError::format(
        name,
        format!("{FORMAT} version {VERSION}"),
        format!("{format} version {version}; {remedy}"),
    ))
}

/// `folder` is where the file lies, and its pictures beside it, where that is known.
pub(super) fn read(file: File, name: &str, folder: Option<&Path>) -> Result<TruthSet, EvalError> {
    let mut people = file.frames.iter().flat_map(|f| &f.people);
    if let Some(p) = people.find(|p| p.stature <= 0.0) {
        return Err(EvalError::format(
            name,
            "people with a stature above 0",
            format!("{} of person {}; write the file again", p.stature, p.id),
        ));
    }
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
        let box_of = |joints: &dyn Fn(&usize) -> bool| {
            let joints = (0..EVIDENCE_JOINTS).filter(joints);
            bounding_box(&joints.map(|j| point(j, 2)).collect::<Vec<_>>())
        };
        let inside = |j: &usize| p.visibility[*j] > 0;
        let bbox = box_of(&inside);
        // The area is that of the whole person, parts included that are hidden or outside of the picture: neither a leg
        // behind a table nor one below the picture makes anybody smaller.
        let before = (0..EVIDENCE_JOINTS).all(|j| p.joints3d[j][2] > NEAR);
        let whole = if before { box_of(&|_| true) } else { bbox };
        let is_beyond = !(0..EVIDENCE_JOINTS).any(|j| inside(&j));
        // Of somebody without a place in the picture nothing there is within reach.
        let area = match is_beyond {
            true => 0.0,
            false => super::AREA_OF_BOX * whole[2] * whole[3],
        };
        TruthPerson {
            id: Some(p.id),
            area,
            bbox,
            crowd: hidden,
            beyond: p
                .bounds
                .filter(|_| is_beyond)
                .map(|[u0, v0, u1, v1]| [u0, v0, u1 - u0, v1 - v0]),
            points,
            joints3d: Some(p.joints3d.map(Some)),
            stature: Some(p.stature),
            ..TruthPerson::default()
        }
    };
    let video = file.fps > 0.0;
    let size = (file.width > 0.0 && file.height > 0.0).then_some([file.width, file.height]);
    let is_clip = video && file.frames.iter().all(|f| f.file.is_none());
    let clip = file.clip.unwrap_or_default();
    let fps = file.fps;
    let seconds = |f: &Frame| match f.time_ns {
        Some(time) => time as f64 * 1e-9,
        None => f.frame as f64 / fps,
    };
    let beside = |picture: String| match folder {
        Some(folder) => folder.join(picture).to_string_lossy().into_owned(),
        None => picture,
    };
    let frame = |f: Frame| TruthFrame {
        // Pictures of a folder are told by their names: their numbers would go with those of any other folder.
        frame: (video && f.file.is_none()).then_some(f.frame),
        seconds: video.then(|| seconds(&f)),
        source: f.file.map_or_else(|| clip.clone(), beside),
        size,
        people: f.people.into_iter().map(person).collect(),
        ..TruthFrame::default()
    };
    Ok(TruthSet {
        frames: file.frames.into_iter().map(frame).collect(),
        single: false,
        video,
        clip: is_clip,
    })
}

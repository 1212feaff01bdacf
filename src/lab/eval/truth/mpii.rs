//! MPII people as JSON, the way public toolboxes convert them: one entry per person, 16 joints. They keep the people
//! who stand well apart, so that others in a picture may have no label.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::{TruthFrame, TruthPerson, TruthSet};
use crate::lab::eval::{EvalError, Keypoint};

/// Where MATLAB, whose numbers these files keep, has the middle of the first pixel; here it is 0.
const FIRST_PIXEL: f64 = 1.0;

/// Evidence joint of each of MPII's 16: ankles to hips, pelvis, thorax, upper neck, head top, then the arms. The
/// evidence neck lies between MPII's thorax and upper neck, nearer the thorax.
const JOINTS: [Option<usize>; 16] = [
    Some(10),
    Some(9),
    Some(8),
    Some(11),
    Some(12),
    Some(13),
    None,
    Some(1),
    None,
    Some(0),
    Some(4),
    Some(3),
    Some(2),
    Some(5),
    Some(6),
    Some(7),
];

#[derive(Deserialize)]
pub(super) struct Entry {
    image: String,
    joints: Vec<[f64; 2]>,
    joints_vis: Vec<f64>,
}

pub(super) fn read(entries: Vec<Entry>, name: &str) -> Result<TruthSet, EvalError> {
    let mut people: BTreeMap<String, Vec<TruthPerson>> = BTreeMap::new();
    for e in entries {
        let counts = [e.joints.len(), e.joints_vis.len()];
        if counts != [JOINTS.len(); 2] {
            return Err(EvalError::format(
                format!("{name}, {}", e.image),
                "16 joints and as many joints_vis",
                format!("{} and {}; write the file again", counts[0], counts[1]),
            ));
        }
        let labels = JOINTS.iter().zip(e.joints.iter().zip(&e.joints_vis));
        let points = labels
            .filter_map(|(joint, (p, seen))| {
                let visibility = if *seen > 0.0 { 2 } else { 0 };
                let [u, v] = p.map(|x| x - FIRST_PIXEL);
                joint.map(|j| Keypoint::at(j, u, v, visibility))
            })
            .collect();
        people
            .entry(e.image)
            .or_default()
            .push(TruthPerson::of_points(points));
    }
    let frame = |(source, people)| TruthFrame {
        source,
        people,
        partial: true,
        ..TruthFrame::default()
    };
    Ok(TruthSet {
        frames: people.into_iter().map(frame).collect(),
        ..TruthSet::default()
    })
}

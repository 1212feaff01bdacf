//! MPII people as JSON, the way public toolboxes convert them: one entry per person, 16 joints. They keep the people
//! who stand well apart, so that others in a picture may have no label.

use std::collections::BTreeMap;

use edgecap_client::joints::{
    HEAD_TOP, L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, NECK, R_ANKLE, R_ELBOW, R_HIP,
    R_KNEE, R_SHOULDER, R_WRIST,
};
use serde::Deserialize;

use super::{TruthFrame, TruthPerson, TruthSet, head_of_rectangle};
use crate::lab::eval::{EvalError, HeadSize, Keypoint};

/// Where MATLAB, whose numbers these files keep, has the middle of the first pixel; here it is 0.
const FIRST_PIXEL: f64 = 1.0;

/// Evidence joint of each of MPII's 16: ankles to hips, pelvis, thorax, upper neck, head top, then the arms. Of the way
/// from the middle of the shoulders to the head's top the evidence neck lies 0.27 up, as in Leeds Sports Pose, MPII's
/// upper neck 0.18 and its thorax 0.00 (medians).
const JOINTS: [Option<usize>; 16] = [
    Some(R_ANKLE),
    Some(R_KNEE),
    Some(R_HIP),
    Some(L_HIP),
    Some(L_KNEE),
    Some(L_ANKLE),
    None,
    None,
    Some(NECK),
    Some(HEAD_TOP),
    Some(R_WRIST),
    Some(R_ELBOW),
    Some(R_SHOULDER),
    Some(L_SHOULDER),
    Some(L_ELBOW),
    Some(L_WRIST),
];
/// Places of upper neck and head top among them.
const HEAD: [usize; 2] = [8, 9];

#[derive(Deserialize)]
pub(super) struct Entry {
    image: String,
    joints: Vec<[f64; 2]>,
    joints_vis: Vec<f64>,
    /// x, y, x, y of the head's rectangle.
    #[serde(alias = "head_rect")]
    headbox: Option<[f64; 4]>,
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
        let head = match e.headbox {
            Some(rectangle) => Some(head_of_rectangle(
                rectangle,
                format!("{name}, {}", e.image),
            )?),
            None if HEAD.iter().all(|k| e.joints_vis[*k] > 0.0) => {
                let [neck, top] = HEAD.map(|k| e.joints[k]);
                HeadSize::of_joints(neck, top)
            }
            None => None,
        };
        let labels = JOINTS.iter().zip(e.joints.iter().zip(&e.joints_vis));
        let points = labels
            .filter_map(|(joint, (p, seen))| {
                let visibility = if *seen > 0.0 { 2 } else { 0 };
                let [u, v] = p.map(|x| x - FIRST_PIXEL);
                joint.map(|j| Keypoint::at(j, u, v, visibility))
            })
            .collect();
        people.entry(e.image).or_default().push(TruthPerson {
            head,
            ..TruthPerson::of_points(points)
        });
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

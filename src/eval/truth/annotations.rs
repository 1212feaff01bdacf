//! Pictures of one labelled person each: Leeds Sports Pose, and samples of Human3.6M and MPI-INF-3DHP with true 3D joints.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use serde::Deserialize;

use super::{TruthFrame, TruthPerson, TruthSet};
use crate::eval::{EvalError, Keypoint};

#[derive(Deserialize)]
pub(super) struct Person2d {
    file: String,
    #[serde(default)]
    split: String,
    joints: [[f64; 3]; EVIDENCE_JOINTS],
}

pub(super) fn people2d(entries: Vec<Person2d>, split: Option<&str>) -> TruthSet {
    let frame = |e: Person2d| {
        let label = |(j, p): (usize, [f64; 3])| {
            // The set writes 1 for visible and 2 for hidden, COCO the other way round.
            let visibility = match p[2] as u8 {
                0 => 0,
                1 => 2,
                _ => 1,
            };
            Keypoint::at(j, p[0], p[1], visibility)
        };
        let points = e.joints.into_iter().enumerate().map(label).collect();
        TruthFrame {
            source: e.file,
            frame: None,
            people: vec![TruthPerson::of_points(points)],
        }
    };
    let wanted = |e: &Person2d| split.is_none_or(|s| e.split == s);
    TruthSet {
        frames: entries.into_iter().filter(wanted).map(frame).collect(),
        single: true,
        video: false,
    }
}

#[derive(Deserialize)]
pub(super) struct Person3d {
    set: String,
    file: String,
    joints2d: Vec<[f64; 3]>,
    joints3d_camera_m: Vec<[f64; 4]>,
}

/// Body joint of each of Human3.6M's 17 (pelvis, right leg, left leg, spine, thorax, nose, head top, left arm, right arm); the
/// nose is none of ours.
const H36M: [Option<usize>; 17] = [
    Some(14),
    Some(8),
    Some(9),
    Some(10),
    Some(11),
    Some(12),
    Some(13),
    Some(15),
    Some(1),
    None,
    Some(0),
    Some(5),
    Some(6),
    Some(7),
    Some(2),
    Some(3),
    Some(4),
];

pub(super) fn real3d(entries: Vec<Person3d>, name: &str) -> Result<TruthSet, EvalError> {
    let mut frames = Vec::with_capacity(entries.len());
    for e in entries {
        let order: [Option<usize>; 17] = match e.set.as_str() {
            "h36m" => H36M,
            // Its 17 joints are the first 17 of ours.
            "mpi_inf_3dhp" => std::array::from_fn(Some),
            other => {
                return Err(EvalError::format(
                    name,
                    "sets h36m or mpi_inf_3dhp, whose joint orders are known",
                    format!("{other:?}"),
                ));
            }
        };
        if e.joints2d.len() != order.len() || e.joints3d_camera_m.len() != order.len() {
            return Err(EvalError::format(
                format!("{name}, {}", e.file),
                "17 joints in 2D and in 3D",
                format!("{} and {}", e.joints2d.len(), e.joints3d_camera_m.len()),
            ));
        }
        let mut points = Vec::new();
        let mut joints3d = [None; BODY_JOINTS];
        for (joint, (flat, solid)) in order
            .iter()
            .zip(e.joints2d.iter().zip(&e.joints3d_camera_m))
        {
            let Some(j) = *joint else { continue };
            if j < EVIDENCE_JOINTS {
                let visibility = if flat[2] > 0.0 { 2 } else { 0 };
                points.push(Keypoint::at(j, flat[0], flat[1], visibility));
            }
            let [x, y, z, valid] = *solid;
            joints3d[j] = (valid > 0.0).then_some([x, y, z]);
        }
        let mut person = TruthPerson::of_points(points);
        person.joints3d = Some(joints3d);
        frames.push(TruthFrame {
            source: e.file,
            frame: None,
            people: vec![person],
        });
    }
    Ok(TruthSet {
        frames,
        single: true,
        video: false,
    })
}

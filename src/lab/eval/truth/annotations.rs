//! Pictures of one labelled person each: Leeds Sports Pose, and samples of Human3.6M and MPI-INF-3DHP with true 3D
//! joints.

use edgecap_client::joints::EVIDENCE_JOINTS;
use serde::Deserialize;

use super::npz::name_of;
use super::{JointOrder, TruthFrame, TruthPerson, TruthSet};
use crate::lab::eval::{EvalError, Keypoint};

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
            people: vec![TruthPerson::of_points(points)],
            ..TruthFrame::default()
        }
    };
    let wanted = |e: &Person2d| split.is_none_or(|s| e.split == s);
    TruthSet {
        frames: entries.into_iter().filter(wanted).map(frame).collect(),
        single: true,
        ..TruthSet::default()
    }
}

#[derive(Deserialize)]
pub(super) struct Person3d {
    set: JointOrder,
    file: String,
    joints2d: Vec<[f64; 3]>,
    joints3d_camera_m: Vec<[f64; 4]>,
}

pub(super) fn real3d(entries: Vec<Person3d>, name: &str) -> Result<TruthSet, EvalError> {
    let mut frames = Vec::with_capacity(entries.len());
    for e in entries {
        let count = e.joints3d_camera_m.len();
        let order = e.set.body_joints(count);
        let Some(order) = order.filter(|_| e.joints2d.len() == count) else {
            return Err(EvalError::format(
                format!("{name}, {}", e.file),
                format!("as many joints in 2D and in 3D as {} has", name_of(e.set)),
                format!("{} and {count}", e.joints2d.len()),
            ));
        };
        let person = TruthPerson::of_joints(
            &order,
            |k| (e.joints2d[k][2] > 0.0).then(|| [e.joints2d[k][0], e.joints2d[k][1]]),
            |k| {
                let [x, y, z, valid] = e.joints3d_camera_m[k];
                (valid > 0.0).then_some([x, y, z])
            },
        );
        frames.push(TruthFrame {
            source: e.file,
            people: vec![person],
            ..TruthFrame::default()
        });
    }
    Ok(TruthSet {
        frames,
        single: true,
        ..TruthSet::default()
    })
}

//! COCO keypoints, and sets in its format with other keypoints (CrowdPose, OCHuman).

use std::collections::{BTreeMap, BTreeSet};

use edgecap_client::joints::{EVIDENCE_JOINTS, JOINT_NAMES};
use serde::Deserialize;

use super::{AREA_OF_BOX, TruthFrame, TruthPerson, TruthSet};
use crate::lab::eval::{EvalError, Keypoint};

#[derive(Deserialize)]
pub(super) struct File {
    images: Vec<Image>,
    annotations: Vec<Annotation>,
    categories: Vec<Category>,
}

#[derive(Deserialize)]
struct Image {
    id: u64,
    file_name: String,
    #[serde(default)]
    width: f64,
    #[serde(default)]
    height: f64,
}

#[derive(Deserialize)]
struct Category {
    id: u64,
    #[serde(default)]
    keypoints: Vec<String>,
}

#[derive(Deserialize)]
struct Annotation {
    image_id: u64,
    category_id: u64,
    #[serde(default)]
    keypoints: Vec<f64>,
    bbox: [f64; 4],
    area: Option<f64>,
    #[serde(default)]
    iscrowd: u8,
}

/// What COCO names beside joints.
const FACE: [&str; 5] = ["nose", "left_eye", "right_eye", "left_ear", "right_ear"];

/// The evidence joint that a name means, if it means one.
fn meaning(name: &str) -> Option<usize> {
    let ours = match name {
        "head" | "top_head" => "head_top".into(),
        _ => name.replace("left_", "l_").replace("right_", "r_"),
    };
    JOINT_NAMES[..EVIDENCE_JOINTS]
        .iter()
        .position(|n| *n == ours)
}

pub(super) fn read(file: File, name: &str) -> Result<TruthSet, EvalError> {
    // Categories may name keypoints of what no picture of the file shows.
    let shown: BTreeSet<u64> = file.annotations.iter().map(|a| a.category_id).collect();
    let mut keypoints: BTreeMap<u64, Vec<Option<usize>>> = BTreeMap::new();
    let mut unknown = Vec::new();
    for c in file.categories.iter().filter(|c| shown.contains(&c.id)) {
        let joints: Vec<_> = c.keypoints.iter().map(|k| meaning(k)).collect();
        if joints.iter().any(Option::is_some) {
            let of_none = joints.iter().zip(&c.keypoints);
            let of_none =
                of_none.filter(|(joint, k)| joint.is_none() && !FACE.contains(&k.as_str()));
            let of_none: Vec<_> = of_none.map(|(_, k)| k).collect();
            if !of_none.is_empty() {
                tracing::warn!(
                    "{name}: keypoints {of_none:?} are no joint of ours and count with --joints all alone"
                );
            }
            keypoints.insert(c.id, joints);
        } else {
            unknown.extend(&c.keypoints);
        }
    }
    if keypoints.is_empty() && !unknown.is_empty() {
        return Err(EvalError::format(
            name,
            "keypoints of people, named as in COCO or CrowdPose",
            format!("only {unknown:?}; rename those of people to COCO's names"),
        ));
    }
    let mut people: BTreeMap<u64, Vec<TruthPerson>> = BTreeMap::new();
    for a in file.annotations {
        // No keypoint of ours: no person.
        let Some(names) = keypoints.get(&a.category_id) else {
            continue;
        };
        let at = || format!("{name}, image {}", a.image_id);
        // Who is not labelled at all may have none.
        if !a.keypoints.is_empty() && a.keypoints.len() != 3 * names.len() {
            return Err(EvalError::format(
                at(),
                format!("{} numbers of {} keypoints", 3 * names.len(), names.len()),
                format!("{}; write the file again", a.keypoints.len()),
            ));
        }
        let area = a.area.unwrap_or(AREA_OF_BOX * a.bbox[2] * a.bbox[3]);
        let is_labelled = a.keypoints.chunks_exact(3).any(|p| p[2] > 0.0);
        let is_asked = is_labelled && a.iscrowd == 0;
        // Similarity is relative to it.
        if area < 0.0 || (is_asked && area <= 0.0) {
            return Err(EvalError::format(
                at(),
                "people with an area above 0",
                format!("{area}; write the file again"),
            ));
        }
        let points = names
            .iter()
            .enumerate()
            .map(|(k, &joint)| {
                let p = a.keypoints.get(3 * k..).unwrap_or_default();
                let of = |i: usize| p.get(i).copied().unwrap_or_default();
                Keypoint {
                    joint,
                    u: of(0),
                    v: of(1),
                    visibility: of(2) as u8,
                }
            })
            .collect();
        people.entry(a.image_id).or_default().push(TruthPerson {
            points,
            area,
            bbox: a.bbox,
            crowd: a.iscrowd != 0,
            ..TruthPerson::default()
        });
    }
    let frame = |i: Image| TruthFrame {
        people: people.remove(&i.id).unwrap_or_default(),
        size: (i.width > 0.0 && i.height > 0.0).then_some([i.width, i.height]),
        source: i.file_name,
        ..TruthFrame::default()
    };
    Ok(TruthSet {
        frames: file.images.into_iter().map(frame).collect(),
        ..TruthSet::default()
    })
}

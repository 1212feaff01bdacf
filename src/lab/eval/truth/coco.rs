//! COCO keypoints, and sets in its format with other keypoints (CrowdPose, OCHuman).

use std::collections::BTreeMap;

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

/// Evidence joint (if it is one) and COCO's constant of a keypoint, by its name.
fn meaning(name: &str) -> Option<(Option<usize>, f64)> {
    let face = match name {
        "nose" => Some(0.026),
        "left_eye" | "right_eye" => Some(0.025),
        "left_ear" | "right_ear" => Some(0.035),
        _ => None,
    };
    if let Some(sigma) = face {
        return Some((None, sigma));
    }
    let ours = match name {
        "head" | "top_head" => "head_top".into(),
        _ => name.replace("left_", "l_").replace("right_", "r_"),
    };
    let joint = JOINT_NAMES[..EVIDENCE_JOINTS]
        .iter()
        .position(|n| *n == ours)?;
    Some((Some(joint), Keypoint::at(joint, 0.0, 0.0, 0).sigma))
}

pub(super) fn read(file: File, name: &str) -> Result<TruthSet, EvalError> {
    let mut keypoints: BTreeMap<u64, Vec<(Option<usize>, f64)>> = BTreeMap::new();
    for c in &file.categories {
        let all: Option<Vec<_>> = c.keypoints.iter().map(|k| meaning(k)).collect();
        let all = all.ok_or_else(|| {
            EvalError::format(
                name,
                "keypoints named as in COCO or CrowdPose",
                format!("{:?}", c.keypoints),
            )
        })?;
        keypoints.insert(c.id, all);
    }
    let mut people: BTreeMap<u64, Vec<TruthPerson>> = BTreeMap::new();
    for a in file.annotations {
        // Things and animals have no keypoints.
        let named = keypoints.get(&a.category_id).filter(|k| !k.is_empty());
        let Some(names) = named else { continue };
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
            .map(|(k, &(joint, sigma))| {
                let p = a.keypoints.get(3 * k..).unwrap_or_default();
                let of = |i: usize| p.get(i).copied().unwrap_or_default();
                Keypoint {
                    joint,
                    u: of(0),
                    v: of(1),
                    visibility: of(2) as u8,
                    sigma,
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

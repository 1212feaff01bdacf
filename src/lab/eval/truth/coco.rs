//! COCO keypoints, and sets in its format with other keypoints (CrowdPose, OCHuman, MPII).

use std::collections::{BTreeMap, BTreeSet};

use edgecap_client::joints::{EVIDENCE_JOINTS, HEAD_TOP, JOINT_NAMES, NECK};
use serde::Deserialize;

use super::{AREA_OF_BOX, TruthFrame, TruthPerson, TruthSet, head_of_rectangle};
use crate::lab::eval::{EvalError, HeadSize, Keypoint};

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
    /// x, y, x, y of the head's rectangle, where the set is MPII's.
    #[serde(alias = "head_rect")]
    headbox: Option<[f64; 4]>,
}

/// What COCO names beside joints.
const FACE: [&str; 5] = ["nose", "left_eye", "right_eye", "left_ear", "right_ear"];

/// The name that only MPII has.
const UPPER_NECK: &str = "upper_neck";

/// The evidence joint that a name means, if it means one. What converters of MPII call neck beside an upper neck is the
/// thorax.
fn meaning(name: &str, is_mpii: bool) -> Option<usize> {
    let ours = match name {
        "neck" if is_mpii => return None,
        UPPER_NECK => "neck".into(),
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
    let mut mpii = BTreeSet::new();
    for c in file.categories.iter().filter(|c| shown.contains(&c.id)) {
        let is_mpii = c.keypoints.iter().any(|k| k == UPPER_NECK);
        if is_mpii {
            mpii.insert(c.id);
        }
        let joints = c.keypoints.iter().map(|k| meaning(k, is_mpii));
        let joints: Vec<_> = joints.collect();
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
        let points: Vec<Keypoint> = names
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
        let labelled = |joint: usize| {
            let mut of_joint = points.iter().filter(|k| k.joint == Some(joint));
            let k = of_joint.find(|k| k.is_labelled())?;
            Some([k.u, k.v])
        };
        let head = match a.headbox {
            Some(rectangle) => Some(head_of_rectangle(rectangle, at())?),
            None if mpii.contains(&a.category_id) => labelled(NECK)
                .zip(labelled(HEAD_TOP))
                .and_then(|(neck, top)| HeadSize::of_joints(neck, top)),
            None => None,
        };
        people.entry(a.image_id).or_default().push(TruthPerson {
            points,
            area,
            bbox: a.bbox,
            crowd: a.iscrowd != 0,
            head,
            ..TruthPerson::default()
        });
    }
    let frame = |i: Image| TruthFrame {
        people: people.remove(&i.id).unwrap_or_default(),
        size: (i.width > 0.0 && i.height > 0.0).then_some([i.width, i.height]),
        partial: !mpii.is_empty(),
        source: i.file_name,
        ..TruthFrame::default()
    };
    Ok(TruthSet {
        frames: file.images.into_iter().map(frame).collect(),
        ..TruthSet::default()
    })
}

//! Whether the people read from an archive can be people: a wrong unit, joint order or axis gives figures that look
//! like a bad network.

use edgecap_client::joints::{HIPS, KNEES, NECK, PELVIS};

use crate::lab::eval::geometry::{minus, norm};
use crate::lab::eval::{EvalError, TruthPerson, TruthSet};

/// Extent of a person's joints along the longest axis, metres: from a curled child to a tall man with raised arms.
const EXTENT: [f64; 2] = [0.25, 3.5];
/// Farthest that a pelvis lies from the middle of the hips, metres.
const PELVIS_OFF: f64 = 0.2;
/// Greatest difference of both thighs over the longer one.
const THIGHS: f64 = 0.3;
/// Least cosine between the trunk in the picture and the trunk in 3D seen from the front.
const TRUNK: f64 = 0.5;

/// Judges the middle person: single wrong labels are the set's own.
pub(super) fn plausible(set: &TruthSet, name: &str) -> Result<(), EvalError> {
    let people = || set.frames.iter().flat_map(|f| &f.people);
    if let Some(extent) = median(people().filter_map(extent))
        && !(EXTENT[0]..EXTENT[1]).contains(&extent)
    {
        return Err(EvalError::format(
            name,
            format!("people {} to {} m long", EXTENT[0], EXTENT[1]),
            format!("{extent:.3} m as the middle one; say --units mm or --units m"),
        ));
    }
    let shares = people().filter_map(skeleton_fits).map(f64::from);
    if median(shares) == Some(0.0) {
        return Err(EvalError::format(
            name,
            "a pelvis between the hips and thighs of equal length",
            "another skeleton; say another --joint-order",
        ));
    }
    if let Some(cosine) = median(people().filter_map(trunk))
        && cosine < TRUNK
    {
        return Err(EvalError::format(
            name,
            "3D joints in camera axes (x right, y down, z forward) as in the picture",
            "trunks that point elsewhere; add 'camera_pose' or turn the joints",
        ));
    }
    Ok(())
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied()
}

fn extent(person: &TruthPerson) -> Option<f64> {
    let joints = person.joints3d?;
    let along = |i: usize| {
        let values = || joints.iter().flatten().map(|p| p[i]);
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    let longest = along(0).max(along(1)).max(along(2));
    longest.is_finite().then_some(longest)
}

/// 1 if pelvis, hips and knees lie as in a body, 0 if not; `None` where one is missing.
fn skeleton_fits(person: &TruthPerson) -> Option<u8> {
    let joints = person.joints3d?;
    let [r, l] = [joints[HIPS[0]]?, joints[HIPS[1]]?];
    let middle = [0, 1, 2].map(|i| 0.5 * (r[i] + l[i]));
    let off = norm(minus(joints[PELVIS]?, middle));
    let thighs = [
        norm(minus(joints[KNEES[0]]?, r)),
        norm(minus(joints[KNEES[1]]?, l)),
    ];
    let unequal = (thighs[0] - thighs[1]).abs() / thighs[0].max(thighs[1]).max(f64::EPSILON);
    Some(u8::from(off < PELVIS_OFF && unequal < THIGHS))
}

/// Cosine between the trunk in the picture and in 3D.
fn trunk(person: &TruthPerson) -> Option<f64> {
    let joints = person.joints3d?;
    let seen = |j: usize| {
        let mut points = person.points.iter();
        points.find(|k| k.joint == Some(j) && k.is_labelled())
    };
    let [neck, r, l] = [seen(NECK)?, seen(HIPS[0])?, seen(HIPS[1])?];
    let flat = [neck.u - 0.5 * (r.u + l.u), neck.v - 0.5 * (r.v + l.v)];
    let solid = minus(joints[NECK]?, joints[PELVIS]?);
    let lengths = flat[0].hypot(flat[1]) * solid[0].hypot(solid[1]);
    (lengths > 0.0).then(|| (flat[0] * solid[0] + flat[1] * solid[1]) / lengths)
}

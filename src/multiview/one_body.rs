//! Joints in space go in; which of them are in one place comes out.

use glam::DVec3;

use crate::joints::EVIDENCE_JOINTS;

/// No joint of a body is farther from the middle ones, metres: it is where rays of an outlier happen to meet.
const FARTHEST: f64 = 2.0;

/// Of each coordinate the median, of one place at least.
pub fn median(places: &[DVec3]) -> DVec3 {
    let of = |axis: usize| {
        let mut each: Vec<f64> = places.iter().map(|p| p[axis]).collect();
        each.sort_by(f64::total_cmp);
        each[each.len() / 2]
    };
    DVec3::new(of(0), of(1), of(2))
}

/// The joints that are known and near enough to the middle ones to be one body's.
pub fn of_one_body(joints: &[Option<DVec3>; EVIDENCE_JOINTS]) -> impl Iterator<Item = DVec3> {
    let known: Vec<DVec3> = joints.iter().flatten().copied().collect();
    let middle = (!known.is_empty()).then(|| median(&known));
    let is_near = move |p: &DVec3| middle.is_some_and(|m| p.distance(m) < FARTHEST);
    known.into_iter().filter(is_near)
}

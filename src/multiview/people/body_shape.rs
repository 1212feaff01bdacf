//! Joints in space go in; whether they are a body's, and which of them, comes out.

use glam::DVec3;

use super::Joints;

/// Neck to middle of the hips, metres: no body is outside of this.
const TRUNK: [f64; 2] = [0.25, 0.85];
/// The longest bones that are nobody's, metres: upper arm, forearm, thigh, shank.
const BONES: [(usize, usize, f64); 8] = [
    (2, 3, 0.5),
    (5, 6, 0.5),
    (3, 4, 0.45),
    (6, 7, 0.45),
    (8, 9, 0.7),
    (11, 12, 0.7),
    (9, 10, 0.7),
    (12, 13, 0.7),
];
/// No joint of a body is farther from the middle ones, metres: it is where rays of an outlier happen to meet.
const FARTHEST: f64 = 2.0;

/// Whether joints are as far from each other as a body's.
pub fn is_body(joints: &Joints) -> bool {
    let (Some(neck), Some(r), Some(l)) = (joints[1], joints[8], joints[11]) else {
        return false;
    };
    let trunk = neck.distance((r + l) / 2.0);
    let lengths = BONES
        .iter()
        .filter_map(|&(a, b, most)| Some((joints[a]?.distance(joints[b]?), most)));
    let (mut known, mut long) = (0, 0);
    for (length, most) in lengths {
        known += 1;
        long += usize::from(length > most);
    }
    (TRUNK[0]..TRUNK[1]).contains(&trunk) && known >= 3 && 2 * long < known
}

/// Of each coordinate the median, of one place at least.
pub(super) fn median(places: &[DVec3]) -> DVec3 {
    let of = |axis: usize| {
        let mut each: Vec<f64> = places.iter().map(|p| p[axis]).collect();
        each.sort_by(f64::total_cmp);
        each[each.len() / 2]
    };
    DVec3::new(of(0), of(1), of(2))
}

/// The joints that are known and near enough to the middle ones to be one body's.
pub(in crate::multiview) fn of_one_body(joints: &Joints) -> impl Iterator<Item = DVec3> {
    let known: Vec<DVec3> = joints.iter().flatten().copied().collect();
    let middle = (!known.is_empty()).then(|| median(&known));
    let is_near = move |p: &DVec3| middle.is_some_and(|m| p.distance(m) < FARTHEST);
    known.into_iter().filter(is_near)
}

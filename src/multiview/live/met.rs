//! Where the rays of one person's detections meet.

use glam::DVec3;

use super::seen::Seen;
use crate::body::skeleton::Posed;
use crate::camera::View;
use crate::joints::{BODY_JOINTS, PARENTS, PELVIS, ROOT_FIRST};
use crate::multiview::exchange::{self, is_crossed};
use crate::multiview::sight::{LIMB_PAIRS, Sight};
use crate::multiview::triangulate::{Joints3d, triangulate};

/// Joints under which a distance tells nothing.
const LEAST_JOINTS: usize = 8;

/// Heals exchanged limbs of detections of one person so that their rays meet best, and shoulders point the way hips do.
pub fn agree(views: &[View], seen: &mut [Option<Seen>]) {
    let mut sights: Vec<Option<Sight>> = seen
        .iter()
        .map(|s| s.as_ref().map(|s| s.sight.clone()))
        .collect();
    let states = exchange::agree(views, &mut sights);
    let all: Vec<Option<&Sight>> = sights.iter().map(Option::as_ref).collect();
    if is_crossed(&triangulate(views, &all).points) == Some(true) {
        // Views agree about arms and about legs, and not about both: most of them are wrong about one.
        let count = sights.iter().flatten().count() as i64;
        let [arms, legs] = states.map(|s| count - 2 * i64::from(s.count_ones()));
        let right = LIMB_PAIRS[usize::from(legs < arms)];
        for sight in sights.iter_mut().flatten() {
            *sight = sight.exchanged(right);
        }
    }
    for (seen, sight) in seen.iter_mut().zip(sights) {
        if let (Some(seen), Some(sight)) = (seen, sight) {
            seen.sight = sight;
        }
    }
}

/// Where the rays of a person's detections meet.
pub fn meet(views: &[View], seen: &[Option<Seen>]) -> Joints3d {
    let sights: Vec<Option<&Sight>> = seen.iter().map(|s| s.as_ref().map(|s| &s.sight)).collect();
    triangulate(views, &sights)
}

/// Joints relative to the pelvis; those that are not known lie where their bone starts, which leaves a limb as it is.
pub fn relative(joints: &Joints3d, pelvis: DVec3) -> [DVec3; BODY_JOINTS] {
    let mut points = [DVec3::ZERO; BODY_JOINTS];
    for j in ROOT_FIRST {
        let known = joints.points.get(j).copied().flatten();
        points[j] = match known {
            Some(p) => p - pelvis,
            None if j == PELVIS => DVec3::ZERO,
            None => points[PARENTS[j]],
        };
    }
    points
}

/// Mean distance of joints from where rays meet; `None` where too few do.
pub fn mean_distance(joints: &Joints3d, posed: &Posed) -> Option<f64> {
    let each = joints
        .points
        .iter()
        .zip(&posed.joints)
        .filter_map(|(p, q)| Some((*p)?.distance(*q)));
    let (sum, count) = each.fold((0.0, 0), |(s, n), d| (s + d, n + 1));
    (count >= LEAST_JOINTS).then(|| sum / count as f64)
}

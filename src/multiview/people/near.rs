//! How near a detection's rays pass to somebody's joints, and which detection is whose by that.

use glam::DVec3;

use super::Joints;
use crate::assignment::Matcher;
use crate::camera::View;
use crate::joints::EVIDENCE_JOINTS;
use crate::multiview::exchange;
use crate::multiview::sight::{LEAST_SHARED, Sight, distance};

/// Mean distance of a person's rays from their joints beyond which they are somebody else's, metres.
pub(super) const REACH: f64 = 0.35;

/// How well a detection goes with somebody whose joints are known, above 0; 0 where its rays are farther than `reach`
/// from them, metres.
pub fn closeness(view: &View, sight: &Sight, joints: &Joints, reach: f64) -> f32 {
    // A detector may have exchanged all sides.
    let readings = [
        mean_distance(view, sight, joints, reach),
        mean_distance(view, &sight.mirrored(), joints, reach),
    ];
    let least = readings.into_iter().flatten().fold(f64::INFINITY, f64::min);
    (1.0 - least / reach).max(0.0) as f32
}

/// Mean distance of a view's rays from joints, none of which counts more than twice the `reach`, metres; `None` where
/// too few are shared.
pub(super) fn mean_distance(
    view: &View,
    sight: &Sight,
    joints: &Joints,
    reach: f64,
) -> Option<f64> {
    let each: Vec<f64> = sight
        .rays
        .iter()
        .zip(joints)
        .filter_map(|(ray, joint)| {
            Some(distance(view.position, ray.as_ref()?.direction, (*joint)?).min(2.0 * reach))
        })
        .collect();
    (each.len() >= LEAST_SHARED).then(|| each.iter().sum::<f64>() / each.len() as f64)
}

/// The detection whose rays pass nearest to joints, sides exchanged where that is nearer; `None` where none is within
/// reach.
pub fn nearest_sight(
    view: &View,
    detections: &[Sight],
    joints: &[DVec3; EVIDENCE_JOINTS],
) -> Option<Sight> {
    let known = joints.map(Some);
    let each = detections.iter().filter_map(|sight| {
        let mut sight = sight.clone();
        exchange::follow(view, &mut sight, joints);
        Some((mean_distance(view, &sight, &known, REACH)?, sight))
    });
    let near = each.filter(|(d, _)| *d < REACH);
    near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, s)| s)
}

/// The detection of every body in one view, sides exchanged where that is nearer: one detection a body, one body a
/// detection, and `None` where none is within reach. `people`: joints in the world, metres.
pub fn matched(
    view: &View,
    detections: &[Sight],
    people: &[[DVec3; EVIDENCE_JOINTS]],
) -> Vec<Option<Sight>> {
    let pair = |joints: &[DVec3; EVIDENCE_JOINTS], sight: &Sight| {
        let mut sight = sight.clone();
        exchange::follow(view, &mut sight, joints);
        let off = mean_distance(view, &sight, &joints.map(Some), REACH);
        let near = off.map_or(0.0, |off| (1.0 - off / REACH).max(0.0));
        (near as f32, sight)
    };
    let pairs: Vec<(f32, Sight)> = people
        .iter()
        .flat_map(|joints| detections.iter().map(|d| pair(joints, d)))
        .collect();
    let scores: Vec<f32> = pairs.iter().map(|(near, _)| *near).collect();
    let mut matcher = Matcher::default();
    let chosen = matcher.solve(people.len(), detections.len(), &scores);
    let each = chosen.iter().enumerate();
    each.map(|(k, d)| d.map(|d| pairs[k * detections.len() + d].1.clone()))
        .collect()
}

//! What one view saw of somebody, ready for people in the world: rays, Stage II's joints turned to world axes, looks.

use glam::{DMat3, DVec2, DVec3};

use crate::camera::View;
use crate::fit::{Appearance, Bounds, overlap};
use crate::joints::{
    BODY_JOINTS, EVIDENCE_JOINTS, MIRROR_BODY, NECK, PELVIS, R_ANKLE, R_ELBOW, R_FOOT_TIP, R_HAND,
    R_HIP, R_KNEE, R_SHOULDER, R_WRIST,
};
use crate::message::Observation;
use crate::multiview::exchange;
use crate::multiview::sight::Sight;

/// Farthest a joint can be from the pelvis, metres at canonical stature.
const REACH: f64 = 1.6;
/// Joints that change sides together: arms with hands, legs with feet; the right ones.
const SIDES: [&[usize]; 2] = [
    &[R_SHOULDER, R_ELBOW, R_WRIST, R_HAND],
    &[R_HIP, R_KNEE, R_ANKLE, R_FOOT_TIP],
];

/// One detection.
#[derive(Debug, Clone)]
pub struct Seen {
    /// Rays of the evidence joints.
    pub sight: Sight,
    /// Joints relative to the pelvis, world axes, metres at canonical stature; none where they describe nobody.
    pub points3d: Option<[DVec3; BODY_JOINTS]>,
    /// Looks, where the torso was seen.
    pub looks: Option<Appearance>,
    /// Nobody else whom the view sees stands before them, or behind.
    pub alone: bool,
}

impl Seen {
    /// An observation in `view`; joints of less confidence than `least` are not seen. `None` if nothing of it can be
    /// used.
    pub fn new(view: &View, seen: &Observation, least: f64) -> Option<Self> {
        let mut sight = Sight::new(view, seen);
        for ray in &mut sight.rays {
            *ray = ray.filter(|r| r.confidence >= least);
        }
        if sight.rays.iter().all(Option::is_none) {
            return None;
        }
        Some(Self {
            sight,
            points3d: in_world(&view.rotation.transpose(), seen),
            looks: Appearance::new(seen),
            alone: true,
        })
    }

    /// Box round the joints seen, on the plane z = 1.
    fn bounds(&self) -> Bounds {
        let places = self.sight.rays.iter().flatten().map(|r| r.plane);
        let nowhere = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        places.fold(nowhere, |(low, high), p| (low.min(p), high.max(p)))
    }

    /// Heals limbs whose sides were exchanged, by the joints where they are expected. Returns how many of arms and legs
    /// were.
    pub fn follow(&mut self, view: &View, expected: &[DVec3; BODY_JOINTS]) -> usize {
        let evidence: [DVec3; EVIDENCE_JOINTS] = std::array::from_fn(|j| expected[j]);
        if let Some(points) = &mut self.points3d {
            let off = |a: usize, b: usize, points: &[DVec3; BODY_JOINTS]| {
                (expected[a] - expected[PELVIS] - points[b]).length()
            };
            for right in SIDES {
                let pairs = || right.iter().map(|&j| (j, MIRROR_BODY[j]));
                let told: f64 = pairs()
                    .map(|(r, l)| off(r, r, points) + off(l, l, points))
                    .sum();
                let other: f64 = pairs()
                    .map(|(r, l)| off(r, l, points) + off(l, r, points))
                    .sum();
                if other < told {
                    pairs().for_each(|(r, l)| points.swap(r, l));
                }
            }
        }
        exchange::follow(view, &mut self.sight, &evidence)
    }
}

/// Finds out who of those whom one view sees has nobody before them, and nobody behind.
pub fn tell_alone(seen: &mut [Seen]) {
    let boxes: Vec<Bounds> = seen.iter().map(Seen::bounds).collect();
    for (k, seen) in seen.iter_mut().enumerate() {
        let mut others = boxes.iter().enumerate().filter(|(other, _)| *other != k);
        seen.alone = !others.any(|(_, other)| overlap(boxes[k], *other));
    }
}

fn in_world(to_world: &DMat3, seen: &Observation) -> Option<[DVec3; BODY_JOINTS]> {
    let pelvis = DVec3::from(seen.joints3d[PELVIS].map(f64::from));
    let points = seen
        .joints3d
        .map(|p| *to_world * (DVec3::from(p.map(f64::from)) - pelvis));
    let is_near = points.iter().all(|p| p.is_finite() && p.length() < REACH);
    let spread = points[NECK].length().max(points[R_KNEE].length());
    (is_near && spread > 0.1).then_some(points)
}

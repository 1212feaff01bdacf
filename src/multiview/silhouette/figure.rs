//! One person's joints in a picture as bones: how large they are, and how near a pixel is.

use glam::DVec2;

use crate::joints::{EVIDENCE_JOINTS, LIMB_JOINTS, LIMBS};
use crate::multiview::sight::Sight;

/// Length of every bone as part of the stature, of the shipped body at rest; of `LIMB_JOINTS`.
const PARTS: [f64; LIMBS] = [
    0.155, 0.112, 0.143, 0.140, 0.112, 0.143, 0.140, 0.326, 0.237, 0.249, 0.326, 0.237, 0.249,
];
/// By what factor bones go on beyond their joint: forearms to the hands, shanks to the feet, the head to its crown.
const BEYOND: [f64; LIMBS] = [
    1.1, 1.0, 1.0, 1.6, 1.0, 1.0, 1.6, 1.0, 1.0, 1.15, 1.0, 1.0, 1.15,
];
/// Bones under which nobody's size can be told.
const LEAST: usize = 4;
/// Points of a bone by which it is told whether a region covers it.
const STEPS: usize = 5;

/// One person in a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Height that they would have standing upright, pixels.
    pub stature: f64,
    /// Bones from joint to joint.
    bones: Vec<[DVec2; 2]>,
    /// The same, gone on to hands and feet.
    reach: Vec<[DVec2; 2]>,
    /// Upper left and lower right corner of the joints.
    corners: [DVec2; 2],
}

impl Figure {
    /// Of joints in pixels; `None` where too few were seen.
    pub fn new(joints: &[Option<DVec2>; EVIDENCE_JOINTS]) -> Option<Self> {
        let (mut bones, mut reach, mut sizes) = (Vec::new(), Vec::new(), Vec::new());
        for (k, (child, parent)) in LIMB_JOINTS.iter().enumerate() {
            if let (Some(to), Some(from)) = (joints[*child], joints[*parent]) {
                bones.push([from, to]);
                reach.push([from, from + BEYOND[k] * (to - from)]);
                sizes.push(from.distance(to) / PARTS[k]);
            }
        }
        if bones.len() < LEAST {
            return None;
        }
        // Bones that point to the camera are short in the picture: the longer ones tell.
        sizes.sort_by(f64::total_cmp);
        let stature = sizes[3 * sizes.len() / 4];
        let seen = || joints.iter().flatten();
        let least = seen().fold(DVec2::INFINITY, |a, p| a.min(*p));
        let most = seen().fold(DVec2::NEG_INFINITY, |a, p| a.max(*p));
        Some(Self {
            stature,
            bones,
            reach,
            corners: [least, most],
        })
    }

    /// What a view saw.
    pub fn of(sight: &Sight) -> Option<Self> {
        Self::new(&sight.rays.map(|r| r.map(|r| r.pixel)))
    }

    /// The same in a picture `by` times as small.
    pub fn shrunk(&self, by: f64) -> Self {
        // Pixel centres have whole coordinates.
        let at = |p: DVec2| (p + 0.5) / by - 0.5;
        let all = |bones: &[[DVec2; 2]]| bones.iter().map(|b| b.map(at)).collect();
        Self {
            stature: self.stature / by,
            bones: all(&self.bones),
            reach: all(&self.reach),
            corners: self.corners.map(at),
        }
    }

    /// Distance of a pixel from the nearest bone, statures.
    pub fn distance(&self, pixel: DVec2) -> f64 {
        let to = |[a, b]: &[DVec2; 2]| {
            let along = *b - *a;
            let part = (pixel - *a).dot(along) / along.length_squared().max(1e-9);
            pixel.distance_squared(*a + part.clamp(0.0, 1.0) * along)
        };
        let least = self.reach.iter().map(to).fold(f64::INFINITY, f64::min);
        least.sqrt() / self.stature.max(1.0)
    }

    /// Corners of the box that everything within `reach` statures of a bone is in.
    pub fn bounds(&self, reach: f64) -> [DVec2; 2] {
        let by = DVec2::splat(reach * self.stature);
        let ends = || self.reach.iter().flatten();
        let least = ends().fold(DVec2::INFINITY, |a, p| a.min(*p));
        let most = ends().fold(DVec2::NEG_INFINITY, |a, p| a.max(*p));
        [least - by, most + by]
    }

    /// Points on the bones.
    pub fn points(&self) -> impl Iterator<Item = DVec2> {
        let parts = (0..STEPS).map(|k| (k as f64 + 0.5) / STEPS as f64);
        let on = move |[a, b]: &[DVec2; 2]| {
            let (a, b) = (*a, *b);
            parts.clone().map(move |t| a.lerp(b, t))
        };
        self.bones.iter().flat_map(on)
    }

    /// Area of the joints' box, square pixels.
    pub fn area(&self) -> f64 {
        let size = self.corners[1] - self.corners[0];
        size.x * size.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::BodyModel;
    use crate::body::mesh::{MeshBody, PosedTree};
    use crate::multiview::stature;

    #[test]
    fn bones_are_as_long_as_the_shipped_body_s() {
        let body = MeshBody::shipped();
        let mut posed = PosedTree::default();
        body.kinematics(&body.rest_pose(), &body.person(&[]), &mut posed);
        let (joints, stature) = (posed.reported(), stature(body, &[]));
        for (k, (child, parent)) in LIMB_JOINTS.into_iter().enumerate() {
            let part = joints[child].distance(joints[parent]) / stature;
            assert!(
                (part - PARTS[k]).abs() < 0.002,
                "bone {k}: {part:.4} of the stature, not {}",
                PARTS[k]
            );
        }
    }
}

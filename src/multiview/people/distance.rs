//! How far somebody is from a view, and where they are by the one view that still sees them.

use glam::DVec3;

use super::Joints;
use super::live_track::Live;
use crate::camera::View;
use crate::joints::EVIDENCE_JOINTS;
use crate::multiview::one_body::of_one_body;
use crate::multiview::sight::{Ray, Sight};

/// By how much, a second, what a view says of distance is learnt from where two meet, and believed where it is alone.
pub(super) const DISTANCE_LEARNT: f64 = 1.0;
pub(super) const DISTANCE_TAKEN: f64 = 3.0;

impl Live {
    /// Learns how what a view says of their distance goes with where they are.
    pub(super) fn measure(&mut self, view: &View, sight: Option<&Sight>, share: f64) {
        let told = sight.and_then(Sight::depth);
        if let Some((depth, told)) = depth(view, &self.joints).zip(told) {
            // The first time there is nothing to blend with.
            let share = if self.proof.iter().sum::<usize>() < 2 {
                1.0
            } else {
                share.min(1.0)
            };
            self.farther *= (depth / told / self.farther).powf(share);
        }
    }

    /// Where their joints are by the one view that sees them: on its rays, and nearer or farther as it says.
    pub(super) fn followed(&self, view: &View, sight: &Sight, share: f64) -> Joints {
        let Some(depth) = depth(view, &self.joints) else {
            return [None; EVIDENCE_JOINTS];
        };
        let told = sight.depth().map_or(depth, |told| self.farther * told);
        let scale = (told / depth).powf(share.min(1.0));
        let now = |joint: DVec3, ray: &Ray| {
            let along = (joint - view.position).dot(ray.direction);
            view.position + scale * along.max(0.0) * ray.direction
        };
        let each = self.joints.iter().zip(&sight.rays);
        let moved = each.filter_map(|(p, ray)| Some(now((*p)?, ray.as_ref()?) - (*p)?));
        let (sum, count) = moved.fold((DVec3::ZERO, 0), |(s, n), by| (s + by, n + 1));
        if count == 0 {
            return [None; EVIDENCE_JOINTS];
        }
        std::array::from_fn(|j| {
            let own = self.joints[j]?;
            Some(match &sight.rays[j] {
                Some(ray) => now(own, ray),
                None => own + sum / f64::from(count),
            })
        })
    }
}

/// How far from a view joints are on average, metres.
pub(super) fn depth(view: &View, joints: &Joints) -> Option<f64> {
    let each = of_one_body(joints);
    let (sum, count) = each.fold((0.0, 0), |(s, n), p| (s + view.to_camera(p).z, n + 1));
    let depth = sum / f64::from(count);
    (count > 0 && depth > 0.0).then_some(depth)
}

/// The view that shows most joints of somebody, the first of several; `None` where nobody sees them.
pub(super) fn shows_most<'a>(
    views: &'a [View],
    sights: &'a [Option<Sight>],
) -> Option<(&'a View, &'a Sight)> {
    let each = views.iter().zip(sights).rev();
    let seen = each.filter_map(|(v, s)| Some((v, s.as_ref()?)));
    seen.max_by_key(|(_, sight)| sight.rays.iter().flatten().count())
}

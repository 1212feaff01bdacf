//! One person in one frame: what views saw of them, and about where they are.

use glam::DVec3;

use super::fitted::Fitted;
use super::one_body::of_one_body;
use super::points;
use super::sight::Sight;
use super::silhouette::Contour;
use crate::camera::View;
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};

/// What Stage III makes of a person whom one view sees.
#[derive(Debug, Clone)]
pub struct Lifted {
    /// Where all joints are, world axes, metres.
    pub joints: [DVec3; BODY_JOINTS],
    /// Probability that each is within 150 mm, as [bodies](crate::message::Body) have it.
    pub confidence: [f32; BODY_JOINTS],
}

/// One person in one frame.
#[derive(Debug, Clone)]
pub struct Moment {
    /// What every view saw; none where it did not see them.
    pub sights: Vec<Option<Sight>>,
    /// Where the joints are about.
    pub joints: [Option<DVec3>; EVIDENCE_JOINTS],
    /// Exchanged limbs that were healed.
    pub healed: usize,
    /// Stage III's joints, when one view is all there is: evidence beside what it saw.
    pub lifted: Option<Lifted>,
    /// Where masks end, by view; empty without masks.
    pub contours: Vec<Option<Contour>>,
}

impl Moment {
    /// Whether more than one view tells what the person is like: one alone cannot tell somebody small from somebody far
    /// away.
    pub fn tells_size(&self) -> bool {
        self.lifted.is_some() || self.sights.iter().flatten().count() > 1
    }

    /// Takes the joints of a body for those of a person of whom none is known in space.
    pub(super) fn place_by(&mut self, fitted: &Fitted) {
        if self.joints.iter().all(Option::is_none) {
            self.joints = points::evidence(&fitted.posed).map(Some);
        }
    }

    /// How far the person is from a view, metres.
    pub fn depth(&self, view: &View) -> Option<f64> {
        let known: Vec<DVec3> = of_one_body(&self.joints).collect();
        let mean = known.iter().sum::<DVec3>() / known.len().max(1) as f64;
        let z = view.to_camera(mean).z;
        (!known.is_empty() && z > 0.2).then_some(z)
    }

    /// What views saw, as the energy wants it; one weight a view.
    pub fn seen<'a>(&'a self, views: &'a [View], weights: &[f64]) -> Vec<Seen<'a>> {
        let each = views.iter().zip(&self.sights).zip(weights);
        each.filter_map(|((view, sight), &weight)| {
            let sight = sight.as_ref()?;
            (weight > 0.0).then_some(Seen {
                view,
                sight,
                depth: self.depth(view)?,
                weight,
            })
        })
        .collect()
    }
}

/// One view's part.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    /// The camera.
    pub view: &'a View,
    /// What it saw.
    pub sight: &'a Sight,
    /// About how far the person is from it, metres.
    pub depth: f64,
    /// How much it counts.
    pub weight: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::R_WRIST;

    #[test]
    fn one_joint_far_away_does_not_change_how_far_a_person_is() {
        let view = View::around(0.0);
        let mut moment = Moment {
            sights: Vec::new(),
            joints: std::array::from_fn(|j| Some(DVec3::new(0.0, 0.1 * j as f64 - 0.7, 0.0))),
            healed: 0,
            lifted: None,
            contours: Vec::new(),
        };
        let depth = moment.depth(&view).unwrap();
        // Where rays of a joint that is somewhere else meet: sixty metres behind.
        moment.joints[R_WRIST] = Some(60.0 * view.rotation.row(2));
        let other = moment.depth(&view).unwrap();
        assert!(
            (other / depth - 1.0).abs() < 0.02,
            "{other} m, not {depth} m"
        );
        moment.joints = [None; EVIDENCE_JOINTS];
        assert_eq!(moment.depth(&view), None);
    }
}

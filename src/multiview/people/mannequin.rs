//! Somebody to be seen, in tests.

use glam::DVec3;

use super::Joints;
use crate::camera::View;
use crate::message::Observation;
use crate::multiview::sight::Sight;

/// Somebody who stands at the origin, arms hanging, moved by so much.
pub(super) fn standing(by: DVec3) -> Joints {
    let rest = [
        (0.0, -0.75),
        (0.0, -0.5),
        (-0.2, -0.5),
        (-0.25, -0.2),
        (-0.25, 0.05),
        (0.2, -0.5),
        (0.25, -0.2),
        (0.25, 0.05),
        (-0.1, 0.0),
        (-0.1, 0.45),
        (-0.1, 0.85),
        (0.1, 0.0),
        (0.1, 0.45),
        (0.1, 0.85),
    ];
    rest.map(|(x, y)| Some(DVec3::new(x, y, 0.0) + by))
}

/// What a view sees of somebody at these joints, of these alone.
pub(super) fn seen(view: &View, joints: &Joints, shown: std::ops::Range<usize>) -> Sight {
    let mut seen = Observation::default();
    for j in shown {
        let pixel = joints[j].and_then(|p| view.project(p)).expect("in front");
        seen.joints2d[j] = [pixel.x as f32, pixel.y as f32, 0.9];
    }
    Sight::new(view, &seen)
}

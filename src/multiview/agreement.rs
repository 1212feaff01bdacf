//! Which of two readings of the lenses is right: that in which rays meet better.

use super::people::{Detections, track};
use super::sight::distance;
use crate::camera::View;

/// Mean distance of rays from the joints in which they meet, metres, far ones left out; `None` where nobody was found.
pub fn agreement(views: &[View], frames: &[Vec<Detections>], rate: f64) -> Option<f64> {
    /// Beyond this a ray is about something else, metres.
    const FAR: f64 = 0.1;
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for track in track(views, frames, rate) {
        for (_, moment) in &track.moments {
            for (view, sight) in views.iter().zip(&moment.sights) {
                let rays = sight.iter().flat_map(|s| s.rays.iter().zip(&moment.joints));
                for (ray, joint) in rays {
                    if let (Some(ray), Some(joint)) = (ray, joint) {
                        sum += distance(view.position, ray.direction, *joint).min(FAR);
                        count += 1.0;
                    }
                }
            }
        }
    }
    (count > 0.0).then(|| sum / count)
}

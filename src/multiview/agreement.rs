//! Which of two readings of cameras is right: that in which rays meet better, of as many views as there are.

use super::people::{Detections, track};
use super::sight::distance;
use crate::camera::View;

/// How well what views saw goes together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Mean distance of rays from the joints in which they meet, metres, far ones left out.
    pub apart: f64,
    /// Share of all sights that confirm others of the same person, 0–1: one of every person and frame does not.
    pub confirmed: f64,
}

/// Finds everybody and tells how well views agree on them; `None` where nobody was found.
pub fn agreement(views: &[View], frames: &[Vec<Detections>], rate: f64) -> Option<Agreement> {
    /// Beyond this a ray is about something else, metres.
    const FAR: f64 = 0.1;
    let (mut sum, mut count, mut confirmed) = (0.0, 0.0_f64, 0.0);
    for track in track(views, frames, rate) {
        for (_, moment) in &track.moments {
            let sights = moment.sights.iter().flatten().count();
            confirmed += sights.saturating_sub(1) as f64;
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
    let all: usize = frames.iter().flatten().map(Vec::len).sum();
    (count > 0.0).then(|| Agreement {
        apart: sum / count,
        confirmed: confirmed / all.max(1) as f64,
    })
}

//! Which detections of a frame are of people who are known.

use super::live_track::Live;
use super::near::{REACH, closeness};
use super::rejoin::Taken;
use super::{Frame, Joints};
use crate::assignment::Matcher;
use crate::camera::View;

/// How much further a person may have gone for every second that two views have missed them, metres, and at most.
const ROAM: [f64; 2] = [1.5, 0.4];
/// Seconds between frames in which somebody goes no farther than `REACH`, and the most beyond them that count as if
/// they had been missed: what is farther apart, motion must tell.
const STEP: [f64; 2] = [1.0 / 30.0, 0.2];

/// How far from their joints the rays of somebody may pass whom two views have missed for so many seconds, frames being
/// so many seconds apart, metres.
pub(in crate::multiview) fn reach(missed: f64, interval: f64) -> f64 {
    let beyond = (interval - STEP[0]).clamp(0.0, STEP[1]);
    REACH + (ROAM[0] * (missed + beyond)).min(ROAM[1])
}

/// What is asked of everybody known before they take detections.
pub(super) struct Standing {
    pub(super) is_proven: bool,
    /// Whether nobody saw them in the last frame.
    pub(super) is_absent: bool,
    /// How far from their joints rays may pass, metres: as of somebody just seen, and by how long they have been
    /// missed.
    pub(super) reach: [f64; 2],
    /// Where their joints are if they go on as they went.
    pub(super) ahead: Joints,
}

/// What everybody known takes of a frame. Who is proven takes first: a ghost lies on a real person's rays and would go
/// on living from them. But whoever was missed takes what is left by those who were seen, and from farther away what is
/// left by those near by. Nobody knows who stops and who goes on: rays may pass near where they were as well as near
/// where they were going.
pub(super) fn take(
    views: &[View],
    frame: &Frame<'_>,
    live: &[Live],
    standing: &[Standing],
    matcher: &mut Matcher,
) -> Taken {
    let mut taken: Taken = vec![vec![None; views.len()]; live.len()];
    let mut free: Vec<Vec<bool>> = frame.iter().map(|d| vec![true; d.len()]).collect();
    let order = [(false, true), (false, false), (true, true), (true, false)];
    for (far, (absent, proven)) in [0, 1]
        .into_iter()
        .flat_map(|far| order.map(|who| (far, who)))
    {
        for (v, (view, detections)) in views.iter().zip(frame).enumerate() {
            let asks = |t: &usize| {
                let own = &standing[*t];
                (own.is_absent, own.is_proven) == (absent, proven) && taken[*t][v].is_none()
            };
            let people: Vec<usize> = (0..live.len()).filter(asks).collect();
            let near = |t: usize, d: usize| {
                let (own, sight) = (&standing[t], &detections[d]);
                let to = |joints: &Joints| closeness(view, sight, joints, own.reach[far]);
                to(&live[t].joints).max(to(&own.ahead))
            };
            let left: Vec<usize> = (0..detections.len()).filter(|&d| free[v][d]).collect();
            let scores: Vec<f32> = people
                .iter()
                .flat_map(|&t| left.iter().map(move |&d| (t, d)))
                .map(|(t, d)| near(t, d))
                .collect();
            let chosen = matcher.solve(people.len(), left.len(), &scores);
            for (&t, d) in people.iter().zip(chosen) {
                if let Some(d) = d.map(|d| left[d]) {
                    (taken[t][v], free[v][d]) = (Some(d), false);
                }
            }
        }
    }
    taken
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::camera::Brown;
    use crate::message::Observation;
    use crate::multiview::people::mannequin::standing;
    use crate::multiview::sight::Sight;

    #[test]
    fn nobody_is_near_who_is_farther_than_the_reach() {
        let view = View {
            distortion: Brown::default(),
            ..View::around(0.0)
        };
        let joints = standing(DVec3::ZERO);
        let near = |x: f64, reach: f64| {
            let mut seen = Observation::default();
            for (out, joint) in seen.joints2d.iter_mut().zip(standing(x * DVec3::X)) {
                let pixel = joint.and_then(|p| view.project(p)).expect("in front");
                *out = [pixel.x as f32, pixel.y as f32, 0.9];
            }
            closeness(&view, &Sight::new(&view, &seen), &joints, reach)
        };
        for missed in [0.0, 0.1, 0.24, 1.0, 10.0] {
            let reach = reach(missed, STEP[0]);
            assert!(near(0.5 * reach, reach) > 0.3, "{missed} s");
            for x in [1.2 * reach, 1.5, 3.0] {
                assert_eq!(near(x, reach), 0.0, "{missed} s, {x} m");
            }
        }
    }
}

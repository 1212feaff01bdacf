//! People between two frames of one view.

use glam::DVec2;

use super::sight::{Plane, like};
use crate::assignment::Matcher;
use crate::message::Observation;

/// Seconds between frames of a usual rate. In a longer time people go farther, …
const USUAL: f64 = 0.04;
/// … from frame to frame of that rate no farther than this, in sizes of the person in the picture, …
const MOVED: f64 = 0.25;
/// … by so many sizes more in every second beyond, a run, …
const SPEED: f64 = 1.5;
/// … and never farther than this.
const FARTHEST: f64 = 0.8;
/// How much farther than the person one joint may go.
const JOINT: f64 = 1.4;
/// Shared joints under which two detections cannot be compared.
const LEAST_SHARED: usize = 4;
/// So much nearer, as a share, arms or legs on the other side must be to be taken for exchanged: from frame to frame of
/// a usual rate, and where frames are [`FAR`] apart. Limbs of a runner cross in that time.
const EXCHANGED: [f64; 2] = [0.7, 0.35];
/// Seconds between frames that are far apart.
const FAR: f64 = 0.12;

/// What people do at most in the time between two frames.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    /// How far a person goes, in sizes.
    moved: f64,
    /// How much nearer limbs on the other side are at least that a detector has exchanged, as a share.
    exchanged: f64,
}

impl Bounds {
    /// For frames so many seconds apart.
    fn of(seconds: f64) -> Self {
        let more = (seconds - USUAL).max(0.0);
        let far = (more / (FAR - USUAL)).min(1.0);
        Self {
            moved: (MOVED + SPEED * more).min(FARTHEST),
            exchanged: EXCHANGED[0] + far * (EXCHANGED[1] - EXCHANGED[0]),
        }
    }
}

/// People of the nearer frame, `share` of the way towards where the other frame shows them, which is so many `seconds`
/// before or after. Arms and legs that a detector calls by the other side's name in one of the two frames keep the
/// nearer frame's.
pub fn between(
    near: &[Observation],
    far: &[Observation],
    share: f64,
    seconds: f64,
) -> Vec<Observation> {
    let bounds = Bounds::of(seconds);
    let far: Vec<Plane> = far.iter().map(plane).collect();
    let own: Vec<Plane> = near.iter().map(plane).collect();
    let partners = partners(&own, &far, bounds);
    let each = near.iter().zip(&own).zip(partners);
    each.map(|((person, own), partner)| {
        let Some(k) = partner else {
            return *person;
        };
        let other = like(own, &far[k], bounds.exchanged);
        let reach = JOINT * bounds.moved * size(own);
        let mut moved = *person;
        for (j, (own, other)) in own.iter().zip(other).enumerate() {
            let Some((a, b)) = own.zip(other) else {
                continue;
            };
            if a.distance(b) < reach {
                let joint = &mut moved.joints2d[j];
                [joint[0], joint[1]] = a.lerp(b, share).as_vec2().to_array();
            }
        }
        moved
    })
    .collect()
}

/// Who of the other frame everybody is, so that all together go the least: of people side by side who go the same way
/// one comes to where another was.
fn partners(near: &[Plane], far: &[Plane], bounds: Bounds) -> Vec<Option<usize>> {
    let scores = near.iter().flat_map(|own| {
        let reach = bounds.moved * size(own);
        far.iter().map(move |other| {
            match apart(own, &like(own, other, bounds.exchanged)) {
                // Squares: that one stays and another goes twice as far is less likely than that both go.
                Some(d) if d < reach => (1.0 - (d / reach).powi(2)).max(1e-3) as f32,
                _ => 0.0,
            }
        })
    });
    let scores: Vec<f32> = scores.collect();
    let mut matcher = Matcher::default();
    matcher.solve(near.len(), far.len(), &scores).to_vec()
}

/// Where a person's joints are seen, pixels.
fn plane(person: &Observation) -> Plane {
    let seen =
        |[u, v, confidence]: [f32; 3]| (confidence > 0.0).then(|| DVec2::new(u.into(), v.into()));
    person.joints2d.map(seen)
}

/// Mean distance of the joints that both show, pixels.
fn apart(a: &Plane, b: &Plane) -> Option<f64> {
    let shared = a
        .iter()
        .zip(b)
        .filter_map(|(a, b)| Some(a.as_ref()?.distance(*b.as_ref()?)));
    let (sum, count) = shared.fold((0.0, 0), |(s, n), d| (s + d, n + 1));
    (count >= LEAST_SHARED).then(|| sum / count as f64)
}

/// Diagonal of the box round the joints seen, pixels.
fn size(person: &Plane) -> f64 {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for p in person.iter().flatten() {
        (low, high) = (low.min(*p), high.max(*p));
    }
    let size = (high - low).length();
    if size.is_finite() { size } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joints::MIRROR;
    use crate::multiview::sight::LIMB_PAIRS;

    /// Somebody whose joints are at this x, pixels.
    fn person(x: f32) -> Observation {
        Observation {
            joints2d: std::array::from_fn(|j| [x, 40.0 * j as f32, 0.9]),
            ..Observation::default()
        }
    }

    #[test]
    fn whoever_goes_elsewhere_is_somebody_else() {
        let [mut a, mut b] = [0.0, 100.0].map(|x| vec![person(x)]);
        let moved = between(&a, &b, 0.25, USUAL);
        assert_eq!(moved[0].joints2d[2], [25.0, 80.0, 0.9]);
        b[0].joints2d.iter_mut().for_each(|j| j[0] += 400.0);
        assert_eq!(between(&a, &b, 0.25, USUAL), a);
        // A joint that jumps stays where the nearer frame has it.
        b = vec![person(0.0)];
        b[0].joints2d[4][0] = 350.0;
        a[0].joints2d[5][2] = 0.0;
        let moved = between(&a, &b, 0.5, USUAL);
        assert_eq!(moved[0].joints2d[4], [0.0, 160.0, 0.9]);
        assert_eq!(moved[0].joints2d[5], a[0].joints2d[5]);
    }

    #[test]
    fn in_a_longer_time_people_go_farther() {
        // The joints are 520 pixels apart.
        let (near, far) = ([person(0.0)], [person(234.0)]);
        assert_eq!(between(&near, &far, 0.5, 0.04), near);
        let moved = between(&near, &far, 0.5, 0.3);
        for (j, joint) in moved[0].joints2d.iter().enumerate() {
            assert_eq!(*joint, [117.0, 40.0 * j as f32, 0.9]);
        }
        let elsewhere = [person(500.0)];
        assert_eq!(between(&near, &elsewhere, 0.5, 0.4), near);
    }

    #[test]
    fn who_goes_the_same_way_side_by_side_does_not_take_the_others_place() {
        // A fifth of a size apart, and as far gone.
        let step = 104.0;
        let [near, far] = [0.0, step].map(|x| [person(x), person(x + step)]);
        for turned in [false, true] {
            let (mut near, mut far) = (near, far);
            if turned {
                near.reverse();
            }
            for _ in 0..2 {
                let moved = between(&near, &far, 0.5, 0.3);
                for (own, moved) in near.iter().zip(&moved) {
                    let x = own.joints2d[0][0] + 0.5 * step;
                    assert_eq!(moved.joints2d[0], [x, 0.0, 0.9], "{turned}");
                }
                far.reverse();
            }
        }
    }

    #[test]
    fn legs_that_cross_between_frames_far_apart_are_not_exchanged() {
        let legs = |right: f32, left: f32| {
            let mut person = person(0.0);
            (8..11).for_each(|j| person.joints2d[j][0] = right);
            for j in 11..14 {
                person.joints2d[j] = [left, 40.0 * (j - 3) as f32, 0.9];
            }
            [person]
        };
        // Half as far on the other side.
        let (near, far) = (legs(-30.0, 30.0), legs(10.0, -10.0));
        let right_ankle = |seconds| between(&near, &far, 0.5, seconds)[0].joints2d[10][0];
        assert_eq!(right_ankle(0.033), -20.0, "taken for exchanged");
        assert_eq!(right_ankle(0.15), -10.0);
    }

    #[test]
    fn limbs_stay_apart_that_a_detector_exchanges_in_one_frame() {
        let mut near = person(0.0);
        for j in [5, 6, 7, 11, 12, 13] {
            near.joints2d[j] = near.joints2d[MIRROR[j]];
            near.joints2d[j][0] = 60.0;
        }
        let mut far = near;
        far.joints2d.iter_mut().for_each(|j| j[0] += 4.0);
        let expected = between(&[near], &[far], 0.5, USUAL);
        assert_eq!(expected[0].joints2d[10][0], 2.0);
        for right in &LIMB_PAIRS[..2] {
            right.iter().for_each(|&j| far.joints2d.swap(j, MIRROR[j]));
            assert_eq!(between(&[near], &[far], 0.5, USUAL), expected);
        }
    }
}

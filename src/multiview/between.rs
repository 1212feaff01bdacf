//! People between two frames of one view.

use glam::DVec2;

use super::sight::{Plane, like};
use crate::message::Observation;

/// Farthest a person and one joint go between two frames, as a share of the person's size in the picture.
const MOVED: [f64; 2] = [0.25, 0.35];
/// Shared joints under which two detections cannot be compared.
const LEAST_SHARED: usize = 4;
/// So much nearer, as a share, arms or legs on the other side must be to be taken for exchanged: those of a runner
/// cross between frames that are far apart.
const EXCHANGED: f64 = 0.7;

/// People of the nearer frame, `share` of the way towards where the other frame shows them. Arms and legs that a
/// detector calls by the other side's name in one of the two frames keep the nearer frame's.
pub fn between(near: &[Observation], far: &[Observation], share: f64) -> Vec<Observation> {
    let mut free = vec![true; far.len()];
    let far: Vec<Plane> = far.iter().map(plane).collect();
    near.iter()
        .map(|person| {
            let own = plane(person);
            let size = size(&own);
            let each = far.iter().enumerate().filter(|(k, _)| free[*k]);
            let partner = each
                .map(|(k, other)| (k, like(&own, other, EXCHANGED)))
                .filter_map(|(k, other)| Some((k, apart(&own, &other)?, other)))
                .filter(|(_, d, _)| *d < MOVED[0] * size)
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let Some((k, _, other)) = partner else {
                return *person;
            };
            free[k] = false;
            let mut moved = *person;
            for (j, (own, other)) in own.iter().zip(other).enumerate() {
                let Some((a, b)) = own.zip(other) else {
                    continue;
                };
                if a.distance(b) < MOVED[1] * size {
                    let joint = &mut moved.joints2d[j];
                    [joint[0], joint[1]] = a.lerp(b, share).as_vec2().to_array();
                }
            }
            moved
        })
        .collect()
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
        let moved = between(&a, &b, 0.25);
        assert_eq!(moved[0].joints2d[2], [25.0, 80.0, 0.9]);
        b[0].joints2d.iter_mut().for_each(|j| j[0] += 400.0);
        assert_eq!(between(&a, &b, 0.25), a);
        // A joint that jumps stays where the nearer frame has it.
        b = vec![person(0.0)];
        b[0].joints2d[4][0] = 350.0;
        a[0].joints2d[5][2] = 0.0;
        let moved = between(&a, &b, 0.5);
        assert_eq!(moved[0].joints2d[4], [0.0, 160.0, 0.9]);
        assert_eq!(moved[0].joints2d[5], a[0].joints2d[5]);
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
        let expected = between(&[near], &[far], 0.5);
        assert_eq!(expected[0].joints2d[10][0], 2.0);
        for right in &LIMB_PAIRS[..2] {
            right.iter().for_each(|&j| far.joints2d.swap(j, MIRROR[j]));
            assert_eq!(between(&[near], &[far], 0.5), expected);
        }
    }
}

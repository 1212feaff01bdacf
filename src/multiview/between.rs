//! People between two frames of one view.

use glam::DVec2;

use crate::joints::EVIDENCE_JOINTS;
use crate::message::Observation;

/// Farthest a person and one joint go between two frames, as a share of the person's size in the picture.
const MOVED: [f64; 2] = [0.25, 0.35];
/// Shared joints under which two detections cannot be compared.
const LEAST_SHARED: usize = 4;

/// People of the nearer frame, `share` of the way towards where the other frame shows them.
pub fn between(near: &[Observation], far: &[Observation], share: f64) -> Vec<Observation> {
    let mut free = vec![true; far.len()];
    near.iter()
        .map(|person| {
            let size = size(person);
            let partner = far
                .iter()
                .enumerate()
                .filter(|(k, _)| free[*k])
                .filter_map(|(k, other)| Some((k, apart(person, other)?)))
                .filter(|(_, d)| *d < MOVED[0] * size)
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let Some((k, _)) = partner else {
                return *person;
            };
            free[k] = false;
            let mut moved = *person;
            for (joint, other) in moved.joints2d.iter_mut().zip(&far[k].joints2d) {
                let Some([a, b]) = both(joint, other) else {
                    continue;
                };
                if a.distance(b) < MOVED[1] * size {
                    let p = a.lerp(b, share);
                    (joint[0], joint[1]) = (p.x as f32, p.y as f32);
                }
            }
            moved
        })
        .collect()
}

/// A joint in both frames, where both show it.
fn both(a: &[f32; 3], b: &[f32; 3]) -> Option<[DVec2; 2]> {
    let at = |p: &[f32; 3]| DVec2::new(p[0].into(), p[1].into());
    (a[2] > 0.0 && b[2] > 0.0).then(|| [at(a), at(b)])
}

/// Mean distance of the joints that both show, pixels.
fn apart(a: &Observation, b: &Observation) -> Option<f64> {
    let shared = (0..EVIDENCE_JOINTS).filter_map(|j| both(&a.joints2d[j], &b.joints2d[j]));
    let (sum, count) = shared.fold((0.0, 0), |(s, n), [a, b]| (s + a.distance(b), n + 1));
    (count >= LEAST_SHARED).then(|| sum / count as f64)
}

/// Diagonal of the box round the joints seen, pixels.
fn size(person: &Observation) -> f64 {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for [u, v, _] in person.joints2d.iter().filter(|j| j[2] > 0.0) {
        let p = DVec2::new((*u).into(), (*v).into());
        (low, high) = (low.min(p), high.max(p));
    }
    let size = (high - low).length();
    if size.is_finite() { size } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}

//! How two cameras are turned to each other, by how each alone lifts the people that both see: it needs nobody to walk
//! about, and no depth.

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;
use rand::Rng;
use rand::rngs::SmallRng;

use super::consensus::{Search, distinct};
use super::relative::{angle, to_glam, to_nalgebra};
use crate::joints::EVIDENCE_JOINTS;

/// Somebody's evidence joints relative to their pelvis in a camera's axes, metres.
pub type Lifted = [DVec3; EVIDENCE_JOINTS];

const SEARCH: Search = Search {
    samples: 200,
    finalists: 20,
    refinements: 5,
};
/// Figures in a sample.
const SAMPLE: usize = 3;
/// How far lifted joints of one person are from each other in two views, metres.
const SIGMA: f64 = 0.2;
/// Answers that are kept, and how far they are from each other, radians.
const MOST_ANSWERS: usize = 2;
const DIFFERENT: f64 = 0.3;

/// Rotations of the first camera's axes to the second's, the best first; `pairs` are two figures each that may be one
/// person.
pub fn turns(pairs: &[(Lifted, Lifted)], random: &mut SmallRng) -> Vec<DMat3> {
    if pairs.len() < SAMPLE {
        return Vec::new();
    }
    let cost = |turn: &DMat3| -> f64 { pairs.iter().map(|pair| 1.0 - agreement(turn, pair)).sum() };
    let guess = || {
        let sample =
            std::array::from_fn::<_, SAMPLE, _>(|_| &pairs[random.random_range(0..pairs.len())]);
        best(sample.into_iter().map(|pair| (pair, 1.0)))
    };
    let better = |turn: &DMat3| {
        let weight = |pair| agreement(turn, pair).powi(2);
        best(pairs.iter().map(|pair| (pair, weight(pair))))
    };
    let found = SEARCH.run(guess, cost, better).into_iter();
    let is_different = |a: &DMat3, b: &DMat3| angle(a, b) > DIFFERENT;
    distinct(found.map(|(_, turn)| turn), MOST_ANSWERS, is_different)
}

/// How near a figure that is turned comes to the other, 1 where it is the same, a half at [`SIGMA`].
pub fn agreement(turn: &DMat3, (a, b): &(Lifted, Lifted)) -> f64 {
    let each = a
        .iter()
        .zip(b)
        .map(|(p, q)| (*turn * *p - *q).length_squared());
    let apart = each.sum::<f64>() / EVIDENCE_JOINTS as f64;
    1.0 / (1.0 + apart / (SIGMA * SIGMA))
}

/// The rotation of least squares (Kabsch 1976).
fn best<'a>(pairs: impl Iterator<Item = (&'a (Lifted, Lifted), f64)>) -> Option<DMat3> {
    let mut sum = Matrix3::zeros();
    for ((a, b), w) in pairs {
        for (p, q) in a.iter().zip(b) {
            let outer = DMat3::from_cols(*q * p.x, *q * p.y, *q * p.z);
            sum += to_nalgebra(&(w * outer));
        }
    }
    let svd = sum.try_svd(true, true, 1e-14, 200)?;
    let (u, vt) = (svd.u?, svd.v_t?);
    let mut sign = Matrix3::identity();
    let least = svd.singular_values.imin();
    sign[(least, least)] = (u * vt).determinant().signum();
    let turn = to_glam(&(u * sign * vt));
    turn.is_finite().then_some(turn)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn figures_that_go_together_outvote_others() {
        let mut random = SmallRng::seed_from_u64(3);
        let truth = DMat3::from_rotation_y(2.0) * DMat3::from_rotation_x(0.3);
        let mut figure = || -> Lifted {
            std::array::from_fn(|_| {
                DVec3::from_array(std::array::from_fn(|_| random.random_range(-0.8..0.8)))
            })
        };
        let mut pairs: Vec<(Lifted, Lifted)> = (0..40)
            .map(|_| {
                let (a, noise) = (figure(), figure());
                (a, std::array::from_fn(|j| truth * a[j] + 0.1 * noise[j]))
            })
            .collect();
        pairs.extend((0..40).map(|_| (figure(), figure())));
        let found = turns(&pairs, &mut SmallRng::seed_from_u64(1));
        let off = angle(&found[0], &truth).to_degrees();
        assert!(off < 2.0, "{off} degrees off");
        assert!(turns(&pairs[..2], &mut SmallRng::seed_from_u64(1)).is_empty());
    }
}

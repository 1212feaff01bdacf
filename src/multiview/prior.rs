//! Which poses people take: a mixture of Gaussians over the rotations of the tree, of which the nearest counts
//! (max-mixture).
//!
//! `models/body/poses.py` fits it to motion capture.

use std::io::Cursor;
use std::sync::OnceLock;

use glam::{DMat3, DQuat, DVec3};

use crate::body::mesh::{JOINTS, first_turn};
use crate::npz::Archive;
use crate::solve::NormalEquations;

/// Numbers of a pose: three a joint but the root.
pub const SIZE: usize = 3 * (JOINTS - 1);

static SHIPPED: &[u8] = include_bytes!("../../models/body/poses.npz");

/// The mixture.
#[derive(Debug)]
pub struct PosePrior {
    components: Vec<Component>,
    mean: [f64; SIZE],
}

#[derive(Debug)]
struct Component {
    mean: [f64; SIZE],
    /// Row by row up to the diagonal: precision = factorᵀ · factor.
    factor: Vec<f64>,
    precision: Vec<[f64; SIZE]>,
    /// −log of weight and normaliser, the least of all 0.
    offset: f64,
}

impl PosePrior {
    /// The mixture that comes with the program.
    ///
    /// # Panics
    /// If the embedded file is damaged, which the tests rule out.
    pub fn shipped() -> &'static Self {
        static PRIOR: OnceLock<PosePrior> = OnceLock::new();
        PRIOR.get_or_init(|| {
            let mut archive =
                Archive::new(Cursor::new(SHIPPED)).expect("the embedded prior is intact");
            let mut array = |name| {
                archive
                    .numbers(name)
                    .ok()
                    .flatten()
                    .expect("an array of the embedded prior")
                    .data
            };
            let (weights, means, factors) = (array("weights"), array("means"), array("factors"));
            Self::new(&weights, &means, &factors)
        })
    }

    fn new(weights: &[f64], means: &[f64], factors: &[f64]) -> Self {
        let triangle = SIZE * (SIZE + 1) / 2;
        let mut components: Vec<Component> = weights
            .iter()
            .zip(means.chunks_exact(SIZE).zip(factors.chunks_exact(triangle)))
            .map(|(weight, (mean, factor))| {
                let row = |i: usize| &factor[i * (i + 1) / 2..=i * (i + 1) / 2 + i];
                let mut precision = vec![[0.0; SIZE]; SIZE];
                for i in 0..SIZE {
                    for (a, &va) in row(i).iter().enumerate() {
                        for (b, &vb) in row(i).iter().enumerate() {
                            precision[a][b] += va * vb;
                        }
                    }
                }
                let diagonal: f64 = (0..SIZE).map(|i| row(i)[i].ln()).sum();
                Component {
                    mean: std::array::from_fn(|k| mean[k]),
                    factor: factor.to_vec(),
                    precision,
                    offset: -weight.ln() - diagonal,
                }
            })
            .collect();
        let least = components
            .iter()
            .map(|c| c.offset)
            .fold(f64::INFINITY, f64::min);
        let mut mean = [0.0; SIZE];
        for (c, weight) in components.iter_mut().zip(weights) {
            c.offset -= least;
            mean.iter_mut()
                .zip(&c.mean)
                .for_each(|(m, v)| *m += weight * v);
        }
        Self { components, mean }
    }

    /// The mean pose, the root's rotation left to the caller.
    pub fn mean(&self) -> [DQuat; JOINTS] {
        std::array::from_fn(|j| match j {
            0 => DQuat::IDENTITY,
            _ => DQuat::from_scaled_axis(DVec3::from_slice(&self.mean[3 * (j - 1)..])),
        })
    }

    /// Squared Mahalanobis distance to the nearest component, with twice that component's offset.
    pub fn cost(&self, rotations: &[DQuat; JOINTS]) -> f64 {
        2.0 * self.nearest(&vector(rotations)).1
    }

    /// Adds `weight` times the prior at these rotations, whose steps turn them about their parents' axes, to equations
    /// whose rows are the mesh body's degrees of freedom.
    pub fn add(&self, rotations: &[DQuat; JOINTS], weight: f64, out: &mut NormalEquations) {
        let x = vector(rotations);
        let nearest = &self.components[self.nearest(&x).0];
        let off: [f64; SIZE] = std::array::from_fn(|k| x[k] - nearest.mean[k]);
        let jacobians: [DMat3; JOINTS - 1] =
            std::array::from_fn(|j| inverse_left(DVec3::from_slice(&x[3 * j..])));
        // The prior's first rotation is that of the joint after the root.
        let first_row = |k: usize| first_turn(k + 1);
        for (a, ja) in jacobians.iter().enumerate() {
            let rows: [&[f64; SIZE]; 3] = std::array::from_fn(|k| &nearest.precision[3 * a + k]);
            let pull =
                DVec3::from_array(rows.map(|row| row.iter().zip(&off).map(|(p, d)| p * d).sum()));
            let pull = weight * (ja.transpose() * pull);
            for k in 0..3 {
                out.pull(first_row(a) + k, pull[k]);
            }
            for (b, jb) in jacobians[..=a].iter().enumerate() {
                let column = |k: usize| DVec3::from_array(rows.map(|row| row[3 * b + k]));
                let block = DMat3::from_cols(column(0), column(1), column(2));
                let block = weight * (ja.transpose() * block * *jb);
                for k in 0..3 {
                    let most = if a == b { k } else { 2 };
                    for l in 0..=most {
                        out.add(first_row(a) + k, first_row(b) + l, block.col(l)[k]);
                    }
                }
            }
        }
    }

    fn nearest(&self, x: &[f64; SIZE]) -> (usize, f64) {
        let cost = |c: &Component| {
            let mut sum = 0.0;
            let mut at = 0;
            for i in 0..SIZE {
                let row = &c.factor[at..=at + i];
                at += i + 1;
                let z: f64 = row
                    .iter()
                    .zip(x)
                    .zip(&c.mean)
                    .map(|((f, x), m)| f * (x - m))
                    .sum();
                sum += z * z;
            }
            0.5 * sum + c.offset
        };
        let costs = self.components.iter().map(cost).enumerate();
        costs
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .expect("a mixture has components")
    }
}

fn vector(rotations: &[DQuat; JOINTS]) -> [f64; SIZE] {
    let mut x = [0.0; SIZE];
    for (q, out) in rotations[1..].iter().zip(x.chunks_exact_mut(3)) {
        let q = if q.w < 0.0 { -*q } else { *q };
        q.to_scaled_axis().write_to_slice(out);
    }
    x
}

/// How a rotation vector changes with a small turn applied after it: the inverse of the left Jacobian of SO(3).
fn inverse_left(x: DVec3) -> DMat3 {
    let cross = DMat3::from_cols(
        DVec3::new(0.0, x.z, -x.y),
        DVec3::new(-x.z, 0.0, x.x),
        DVec3::new(x.y, -x.x, 0.0),
    );
    let angle = x.length();
    let factor = if angle < 1e-3 {
        1.0 / 12.0
    } else {
        1.0 / (angle * angle) - (1.0 + angle.cos()) / (2.0 * angle * angle.sin())
    };
    DMat3::IDENTITY - 0.5 * cross + factor * (cross * cross)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::BodyModel;
    use crate::body::mesh::{FREEDOM, MeshBody};

    #[test]
    fn derivatives_match_finite_differences() {
        let prior = PosePrior::shipped();
        assert_eq!(prior.components.len(), 8);
        let body = MeshBody::shipped();
        let mut pose = body.rest_pose();
        pose.rotations = prior.mean();
        let step: Vec<f64> = (0..FREEDOM).map(|k| 0.3 * (k as f64 * 1.7).sin()).collect();
        let pose = body.moved(&pose, &step);
        let mut equations = NormalEquations::default();
        equations.reset(&[0; FREEDOM]);
        prior.add(&pose.rotations, 0.7, &mut equations);
        for k in 6..FREEDOM {
            let ahead = |by: f64| {
                let mut step = [0.0; FREEDOM];
                step[k] = by;
                0.7 * prior.cost(&body.moved(&pose, &step).rotations)
            };
            let slope = (ahead(1e-5) - ahead(-1e-5)) / 2e-5;
            let found = 2.0 * equations.gradient()[k];
            assert!(
                (slope - found).abs() < 1e-4 * (1.0 + slope.abs()),
                "{k}: {found}, not {slope}"
            );
        }
    }

    #[test]
    fn ordinary_poses_are_likelier_than_broken_ones() {
        let prior = PosePrior::shipped();
        let mean = prior.mean();
        let mut knee = mean;
        // A left knee bent forward by 60 degrees.
        knee[4] = DQuat::from_rotation_x(-1.05);
        assert!(
            prior.cost(&mean) + 20.0 < prior.cost(&knee),
            "{} {}",
            prior.cost(&mean),
            prior.cost(&knee)
        );
    }
}

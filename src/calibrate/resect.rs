//! One view before points in known places: points and where the view saw them go in, its place comes out.

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{SMatrix, SVector, SymmetricEigen, Vector6};
use rand::rngs::SmallRng;

use super::pose::{Pose, plane_jacobian};
use super::relative::{sample, to_glam, to_nalgebra};

const SAMPLES: usize = 600;
const SAMPLE: usize = 6;
const REFINEMENTS: usize = 30;
/// Guesses that are refined.
const FINALISTS: usize = 6;

/// A point in the world, and where the view saw it on its plane z = 1.
pub type Seen = (DVec3, DVec2);

/// The pose of least robust error, and how many points agree with it. One group for every figure that may be a known
/// person; `sigma` is how exact points on the plane z = 1 are, `guesses` are rotations that other views suggest. `None`
/// for too few.
pub fn resect(
    groups: &[Vec<Seen>],
    guesses: &[DMat3],
    sigma: f64,
    random: &mut SmallRng,
) -> Option<(Pose, usize)> {
    let seen: Vec<Seen> = groups.iter().flatten().copied().collect();
    let seen = &seen[..];
    if seen.len() < 4 * SAMPLE {
        return None;
    }
    let mut all: Vec<(Pose, f64)> = guesses
        .iter()
        .filter_map(|r| placed(*r, seen, sigma))
        .collect();
    for _ in 0..SAMPLES {
        all.extend(six_points(&sample(groups, random)));
    }
    for (pose, c) in &mut all {
        *c = cost(pose, seen, sigma);
    }
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    all.truncate(FINALISTS);
    let refined = all.into_iter().map(|(pose, _)| refine(pose, seen, sigma));
    let best = refined.min_by(|a, b| a.1.total_cmp(&b.1))?;
    let agrees = |s: &&Seen| residual(&best.0, s).is_some_and(|r| r.length() < 3.0 * sigma);
    Some((best.0, seen.iter().filter(agrees).count()))
}

fn residual(pose: &Pose, (point, plane): &Seen) -> Option<DVec2> {
    Some(pose.plane(*point)? - *plane)
}

/// Geman–McClure, from 0 to 1 a point.
fn cost(pose: &Pose, seen: &[Seen], sigma: f64) -> f64 {
    let one = |s| {
        residual(pose, s).map_or(1.0, |r| {
            let e2 = r.length_squared() / (sigma * sigma);
            e2 / (1.0 + e2)
        })
    };
    seen.iter().map(one).sum()
}

/// A camera of known direction: its place by reweighted linear least squares.
fn placed(rotation: DMat3, seen: &[Seen], sigma: f64) -> Option<(Pose, f64)> {
    let mut weights = vec![1.0; seen.len()];
    let mut pose = None;
    for _ in 0..10 {
        // R X + t is along the ray: what of it is across the ray is 0.
        let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
        for ((point, plane), w) in seen.iter().zip(&weights) {
            let d = plane.extend(1.0).normalize();
            let across = *w * (DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z));
            a += across;
            b -= across * (rotation * *point);
        }
        if a.determinant().abs() < 1e-12 {
            return None;
        }
        let found = Pose {
            rotation,
            position: -(rotation.transpose() * (a.inverse() * b)),
        };
        for (s, w) in seen.iter().zip(&mut weights) {
            let e2 =
                residual(&found, s).map_or(f64::INFINITY, |r| r.length_squared() / (sigma * sigma));
            *w = (1.0 / (1.0 + e2)).powi(2);
        }
        pose = Some((found, 0.0));
    }
    pose
}

/// Direct linear transform.
fn six_points(sample: &[Seen; SAMPLE]) -> Option<(Pose, f64)> {
    let mean = sample.iter().map(|(p, _)| *p).sum::<DVec3>() / SAMPLE as f64;
    let scale = sample.iter().map(|(p, _)| p.distance(mean)).sum::<f64>() / SAMPLE as f64;
    if scale < 1e-6 {
        return None;
    }
    let mut normal = SMatrix::<f64, 12, 12>::zeros();
    for (point, plane) in sample {
        let p = ((*point - mean) / scale).extend(1.0);
        for (axis, at) in [plane.x, plane.y].into_iter().enumerate() {
            let row = SVector::<f64, 12>::from_fn(|k, _| match k / 4 {
                g if g == axis => p[k % 4],
                2 => -at * p[k % 4],
                _ => 0.0,
            });
            normal.ger(1.0, &row, &row, 1.0);
        }
    }
    let eigen = SymmetricEigen::try_new(normal, 1e-14, 500)?;
    let v = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .into_owned();
    let m = DMat3::from_cols_array(&std::array::from_fn(|k| v[4 * (k % 3) + k / 3]));
    let t = DVec3::new(v[3], v[7], v[11]);
    let sign = m.determinant().signum();
    let svd = to_nalgebra(&(m * sign)).try_svd(true, true, 1e-14, 200)?;
    let size = svd.singular_values.mean();
    let rotation = to_glam(&(svd.u? * svd.v_t?));
    if !(size > 1e-12 && rotation.determinant() > 0.0) {
        return None;
    }
    // In units of the normalised points: p = R (X − mean) / scale + t, and camera axes scale alike.
    let t = t * sign / size * scale;
    let pose = Pose {
        rotation,
        position: mean - rotation.transpose() * t,
    };
    pose.position.is_finite().then_some((pose, 0.0))
}

/// Levenberg–Marquardt on the robust error.
fn refine(mut pose: Pose, seen: &[Seen], sigma: f64) -> (Pose, f64) {
    let mut least = cost(&pose, seen, sigma);
    let mut damping = 1e-3;
    for _ in 0..REFINEMENTS {
        let mut h = SMatrix::<f64, 6, 6>::zeros();
        let mut g = Vector6::zeros();
        for s in seen {
            let Some(r) = residual(&pose, s) else {
                continue;
            };
            let w = (1.0 / (1.0 + r.length_squared() / (sigma * sigma))).powi(2);
            for (row, off) in rows(&pose, s.0).into_iter().zip([r.x, r.y]) {
                h.ger(w, &row, &row, 1.0);
                g.axpy(w * off, &row, 1.0);
            }
        }
        let mut damped = h;
        for k in 0..6 {
            damped[(k, k)] += damping * h[(k, k)] + 1e-12;
        }
        let Some(step) = damped.cholesky().map(|c| c.solve(&g)) else {
            break;
        };
        let next = pose.moved(
            -DVec3::new(step[0], step[1], step[2]),
            -DVec3::new(step[3], step[4], step[5]),
        );
        let c = cost(&next, seen, sigma);
        if c < least {
            let gain = (least - c) / least;
            (pose, least) = (next, c);
            damping = (damping * 0.2).max(1e-9);
            if gain < 1e-6 {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    (pose, least)
}

/// Derivatives of a point's image by the camera's turn and place.
pub(super) fn rows(pose: &Pose, point: DVec3) -> [Vector6<f64>; 2] {
    let p = pose.to_camera(point);
    plane_jacobian(p).map(|d| {
        let turn = p.cross(d);
        let place = -(pose.rotation.transpose() * d);
        Vector6::new(turn.x, turn.y, turn.z, place.x, place.y, place.z)
    })
}

//! Bundle adjustment: cameras and points are moved together until views agree. Points are eliminated (Schur's
//! complement), so the work grows with them only linearly.

use glam::{DVec2, DVec3};
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector3};

use super::pose::{Pose, plane_jacobian};
use super::resect::rows;

const MOST_STEPS: usize = 40;
const ENOUGH: f64 = 1e-5;

/// What one view saw of one point.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Number of the camera.
    pub camera: usize,
    /// Number of the point.
    pub point: usize,
    /// On the plane z = 1.
    pub plane: DVec2,
    /// How much it counts.
    pub weight: f64,
}

/// Moves `cameras` but the first, and `points`, to the least robust error; beyond `sigma` (in the world's unit, at the
/// point's depth) a view counts little. What is seen of a point lies together in `seen`.
pub fn bundle(cameras: &mut Vec<Pose>, points: &mut Vec<DVec3>, seen: &[Seen], sigma: f64) {
    // Errors are lengths at the point, yet must not shrink by moving points nearer: depths are those at the start.
    let depths: Vec<f64> = seen
        .iter()
        .map(|s| cameras[s.camera].to_camera(points[s.point]).z.max(0.1))
        .collect();
    let mut least = cost(cameras, points, seen, &depths, sigma);
    let mut damping = 1e-4;
    for _ in 0..MOST_STEPS {
        let normal = Normal::at(cameras, points, seen, &depths, sigma);
        let mut gained = None;
        while damping < 1e6 {
            if let Some((c, p)) = normal.step(cameras, points, damping) {
                let now = cost(&c, &p, seen, &depths, sigma);
                if now < least {
                    gained = Some((least - now) / least);
                    (*cameras, *points, least) = (c, p, now);
                    damping = (damping * 0.2).max(1e-9);
                    break;
                }
            }
            damping *= 10.0;
        }
        if gained.is_none_or(|g| g < ENOUGH) {
            break;
        }
    }
}

fn residual(cameras: &[Pose], points: &[DVec3], s: &Seen, depth: f64) -> Option<DVec2> {
    Some(depth * (cameras[s.camera].plane(points[s.point])? - s.plane))
}

fn cost(cameras: &[Pose], points: &[DVec3], seen: &[Seen], depths: &[f64], sigma: f64) -> f64 {
    let one = |(s, depth): (&Seen, &f64)| {
        let robust = residual(cameras, points, s, *depth).map_or(1.0, |r| {
            let e2 = r.length_squared() / (sigma * sigma);
            e2 / (1.0 + e2)
        });
        s.weight * robust
    };
    seen.iter().zip(depths).map(one).sum()
}

type Cross = SMatrix<f64, 6, 3>;

/// One point's part of the normal equations.
struct PointPart {
    square: Matrix3<f64>,
    gradient: Vector3<f64>,
    /// With every camera that saw it.
    cross: Vec<(usize, Cross)>,
}

struct Normal {
    /// Of all cameras but the first, six unknowns each.
    cameras: DMatrix<f64>,
    gradient: DVector<f64>,
    points: Vec<PointPart>,
}

impl Normal {
    fn at(cameras: &[Pose], points: &[DVec3], seen: &[Seen], depths: &[f64], sigma: f64) -> Self {
        let unknowns = 6 * (cameras.len() - 1);
        let empty = || PointPart {
            square: Matrix3::zeros(),
            gradient: Vector3::zeros(),
            cross: Vec::new(),
        };
        let mut normal = Self {
            cameras: DMatrix::zeros(unknowns, unknowns),
            gradient: DVector::zeros(unknowns),
            points: points.iter().map(|_| empty()).collect(),
        };
        for (s, &depth) in seen.iter().zip(depths) {
            let Some(r) = residual(cameras, points, s, depth) else {
                continue;
            };
            let w = s.weight * (1.0 / (1.0 + r.length_squared() / (sigma * sigma))).powi(2)
                / (sigma * sigma);
            let pose = &cameras[s.camera];
            let point = points[s.point];
            let by_point = plane_jacobian(pose.to_camera(point))
                .map(|d| depth * (pose.rotation.transpose() * d));
            let by_camera = rows(pose, point).map(|row| row * depth);
            let part = &mut normal.points[s.point];
            let mut cross = Cross::zeros();
            for ((p, c), off) in by_point.into_iter().zip(by_camera).zip([r.x, r.y]) {
                let p = Vector3::new(p.x, p.y, p.z);
                part.square.ger(w, &p, &p, 1.0);
                part.gradient.axpy(w * off, &p, 1.0);
                cross.ger(w, &c, &p, 1.0);
                if s.camera > 0 {
                    let at = 6 * (s.camera - 1);
                    normal
                        .cameras
                        .fixed_view_mut::<6, 6>(at, at)
                        .ger(w, &c, &c, 1.0);
                    normal
                        .gradient
                        .fixed_rows_mut::<6>(at)
                        .axpy(w * off, &c, 1.0);
                }
            }
            if s.camera > 0 {
                part.cross.push((6 * (s.camera - 1), cross));
            }
        }
        normal
    }

    /// Where a damped step leads.
    fn step(
        &self,
        cameras: &[Pose],
        points: &[DVec3],
        damping: f64,
    ) -> Option<(Vec<Pose>, Vec<DVec3>)> {
        let mut reduced = self.cameras.clone();
        for k in 0..reduced.nrows() {
            reduced[(k, k)] += damping * self.cameras[(k, k)] + 1e-9;
        }
        let mut right = self.gradient.clone();
        let inverses: Vec<Matrix3<f64>> = self
            .points
            .iter()
            .map(|part| {
                let mut square = part.square;
                for k in 0..3 {
                    square[(k, k)] += damping * part.square[(k, k)] + 1e-9;
                }
                square.try_inverse().unwrap_or_else(Matrix3::zeros)
            })
            .collect();
        for (part, inverse) in self.points.iter().zip(&inverses) {
            for (i, a) in &part.cross {
                let scaled = a * inverse;
                right
                    .fixed_rows_mut::<6>(*i)
                    .gemv(-1.0, &scaled, &part.gradient, 1.0);
                for (j, b) in &part.cross {
                    let mut block = reduced.fixed_view_mut::<6, 6>(*i, *j);
                    block -= scaled * b.transpose();
                }
            }
        }
        let step = reduced.cholesky()?.solve(&right);
        let vector = |at: usize| DVec3::new(step[at], step[at + 1], step[at + 2]);
        let moved = cameras.iter().enumerate().map(|(k, pose)| match k {
            0 => *pose,
            k => pose.moved(-vector(6 * (k - 1)), -vector(6 * (k - 1) + 3)),
        });
        let moved: Vec<Pose> = moved.collect();
        let points = points.iter().zip(&self.points).zip(&inverses);
        let points = points.map(|((point, part), inverse)| {
            let mut g = part.gradient;
            for (i, a) in &part.cross {
                g -= a.transpose() * step.fixed_rows::<6>(*i);
            }
            let d = inverse * g;
            *point - DVec3::new(d[0], d[1], d[2])
        });
        Some((moved, points.collect()))
    }
}

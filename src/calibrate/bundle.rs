//! Bundle adjustment: cameras and points are moved together until views agree. Points are eliminated (Schur's
//! complement), so the work grows with them only linearly.

use std::ops::Range;

use glam::{DVec2, DVec3};
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, SVector, Vector3, Vector6};

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

type Square = SMatrix<f64, 6, 6>;
type Cross = SMatrix<f64, 6, 3>;

/// One point's part of the normal equations.
struct PointPart {
    square: Matrix3<f64>,
    gradient: Vector3<f64>,
    /// Which of [`Normal::crosses`] are its own.
    crosses: Range<usize>,
}

/// The normal equations; cameras are numbered without the first one, which stays, and have six unknowns each.
struct Normal {
    cameras: Vec<Square>,
    gradients: Vec<Vector6<f64>>,
    points: Vec<PointPart>,
    /// Parts of points with cameras that saw them; those of a point lie together.
    crosses: Vec<(usize, Cross)>,
}

impl Normal {
    fn at(cameras: &[Pose], points: &[DVec3], seen: &[Seen], depths: &[f64], sigma: f64) -> Self {
        let empty = || PointPart {
            square: Matrix3::zeros(),
            gradient: Vector3::zeros(),
            crosses: 0..0,
        };
        let mut normal = Self {
            cameras: vec![Square::zeros(); cameras.len() - 1],
            gradients: vec![Vector6::zeros(); cameras.len() - 1],
            points: points.iter().map(|_| empty()).collect(),
            crosses: Vec::with_capacity(seen.len()),
        };
        for (s, &depth) in seen.iter().zip(depths) {
            let Some(r) = residual(cameras, points, s, depth) else {
                continue;
            };
            let w = s.weight * (1.0 / (1.0 + r.length_squared() / (sigma * sigma))).powi(2)
                / (sigma * sigma);
            let pose = &cameras[s.camera];
            let point = points[s.point];
            let part = &mut normal.points[s.point];
            let by_point = plane_jacobian(pose.to_camera(point)).map(|d| {
                let d = depth * (pose.rotation.transpose() * d);
                Vector3::new(d.x, d.y, d.z)
            });
            for (p, off) in by_point.iter().zip([r.x, r.y]) {
                add_outer(&mut part.square, w, p, p);
                part.gradient += p * (w * off);
            }
            let Some(camera) = s.camera.checked_sub(1) else {
                continue;
            };
            let mut cross = Cross::zeros();
            let by_camera = rows(pose, point).map(|row| row * depth);
            for ((p, c), off) in by_point.iter().zip(&by_camera).zip([r.x, r.y]) {
                add_outer(&mut cross, w, c, p);
                add_outer(&mut normal.cameras[camera], w, c, c);
                normal.gradients[camera] += c * (w * off);
            }
            let number = normal.crosses.len();
            if part.crosses.is_empty() {
                part.crosses = number..number;
            }
            part.crosses.end = number + 1;
            normal.crosses.push((camera, cross));
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
        let count = self.cameras.len();
        // Blocks of the lower half, row by row: the other half is its image.
        let block = |i: usize, j: usize| i * (i + 1) / 2 + j;
        let mut reduced = vec![Square::zeros(); block(count, 0)];
        for (i, own) in self.cameras.iter().enumerate() {
            let diagonal = &mut reduced[block(i, i)];
            *diagonal = *own;
            for k in 0..6 {
                diagonal[(k, k)] += damping * own[(k, k)] + 1e-9;
            }
        }
        let mut right = self.gradients.clone();
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
            let crosses = &self.crosses[part.crosses.clone()];
            for (i, a) in crosses {
                let scaled = a * inverse;
                for k in 0..3 {
                    right[*i] -= scaled.column(k) * part.gradient[k];
                }
                for (j, b) in crosses.iter().filter(|(j, _)| j <= i) {
                    subtract_outer(&mut reduced[block(*i, *j)], &scaled, b);
                }
            }
        }
        let mut whole = DMatrix::zeros(6 * count, 6 * count);
        for i in 0..count {
            for j in 0..=i {
                let mut part = whole.fixed_view_mut::<6, 6>(6 * i, 6 * j);
                part.copy_from(&reduced[block(i, j)]);
            }
        }
        let right = DVector::from_iterator(6 * count, right.iter().flatten().copied());
        let step = whole.cholesky()?.solve(&right);
        let of_camera = |k: usize| step.fixed_rows::<6>(6 * k);
        let moved = cameras.iter().enumerate().map(|(k, pose)| match k {
            0 => *pose,
            k => {
                let step = of_camera(k - 1);
                let vector = |at: usize| DVec3::new(step[at], step[at + 1], step[at + 2]);
                pose.moved(-vector(0), -vector(3))
            }
        });
        let moved: Vec<Pose> = moved.collect();
        let points = points.iter().zip(&self.points).zip(&inverses);
        let points = points.map(|((point, part), inverse)| {
            let mut g = part.gradient;
            for (i, a) in &self.crosses[part.crosses.clone()] {
                g -= a.transpose() * of_camera(*i);
            }
            let d = inverse * g;
            *point - DVec3::new(d[0], d[1], d[2])
        });
        Some((moved, points.collect()))
    }
}

/// Adds `weight · a · bᵀ`. Loops of constant lengths over arrays, here and below, which compilers unroll; those of
/// nalgebra's views go by strides.
fn add_outer<const R: usize, const C: usize>(
    sum: &mut SMatrix<f64, R, C>,
    weight: f64,
    a: &SVector<f64, R>,
    b: &SVector<f64, C>,
) {
    for c in 0..C {
        let scaled = weight * b.data.0[0][c];
        for r in 0..R {
            sum.data.0[c][r] += scaled * a.data.0[0][r];
        }
    }
}

/// Subtracts `a · bᵀ`.
fn subtract_outer(sum: &mut Square, a: &Cross, b: &Cross) {
    let ([a0, a1, a2], [b0, b1, b2]) = (&a.data.0, &b.data.0);
    for c in 0..6 {
        for r in 0..6 {
            sum.data.0[c][r] -= a0[r] * b0[c] + a1[r] * b1[c] + a2[r] * b2[c];
        }
    }
}

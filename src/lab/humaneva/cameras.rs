//! Points in known places and their pixels go in, the camera that shows them so comes out.

use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::{SMatrix, SVector, SymmetricEigen};

use super::archive::{CAMERAS, HumanEva, HumanEvaError, SIZE};
use crate::camera::{Brown, View};
use crate::solve::{Effort, LeastSquares, NormalEquations, Solver};

/// Focal lengths, principal point, k1, k2, p1, p2, a turn, a place.
const UNKNOWNS: usize = 14;
/// Where in these the lens's coefficients begin, then turn and place.
const LENS: usize = 4;
const TURN: usize = 8;
const PLACE: usize = 11;
/// Frames of a person from which a camera is found, at most; as many others measure it.
const FRAMES: usize = 400;

/// A camera and how well it shows what it should.
#[derive(Debug, Clone)]
pub struct FittedCamera {
    /// Who was filmed with it.
    pub subject: String,
    /// The camera.
    pub view: View,
    /// Root mean square distance in frames that it was not found from, pixels.
    pub rms_px: f64,
}

/// The cameras of every person, found from exact 2D.
///
/// # Errors
/// When points do not tell a camera.
pub fn all(data: &HumanEva) -> Result<Vec<FittedCamera>, HumanEvaError> {
    let mut subjects: Vec<&str> = data.pieces.iter().map(|p| p.subject()).collect();
    subjects.sort_unstable();
    subjects.dedup();
    let mut found = Vec::new();
    for subject in subjects {
        let pieces = || data.pieces.iter().filter(|p| p.subject() == subject);
        let count: usize = pieces().map(|p| p.joints.len()).sum();
        let step = count.div_ceil(2 * FRAMES).max(1);
        for camera in 0..CAMERAS {
            let frames = pieces()
                .flat_map(|p| p.joints.iter().zip(&p.exact))
                .step_by(step);
            let (mut known, mut kept) = (Vec::new(), Vec::new());
            for (k, (joints, pixels)) in frames.enumerate() {
                let pairs = joints.iter().copied().zip(pixels[camera]);
                if k % 2 == 0 { &mut known } else { &mut kept }.extend(pairs);
            }
            let name = format!("{subject} camera {}", camera + 1);
            let view = resect(&name, SIZE, &known);
            let view = view.ok_or(HumanEvaError::Camera(name))?;
            found.push(FittedCamera {
                subject: subject.to_owned(),
                rms_px: rms(&view, if kept.is_empty() { &known } else { &kept }),
                view,
            });
        }
    }
    Ok(found)
}

/// Root mean square distance between points' pixels and where a camera shows them, pixels.
pub fn rms(view: &View, known: &[(DVec3, DVec2)]) -> f64 {
    let off = |(point, pixel): &(DVec3, DVec2)| {
        let shown = view.project(*point).unwrap_or(DVec2::INFINITY);
        shown.distance_squared(*pixel)
    };
    (known.iter().map(off).sum::<f64>() / known.len() as f64).sqrt()
}

/// The camera of least squared error that shows points of the world, metres, at pixels: a direct linear transform, then
/// Levenberg–Marquardt with focal lengths, principal point, k1, k2, p1, p2, direction and place. `None` where points
/// are too few or lie in a plane.
pub fn resect(name: &str, size: [u32; 2], known: &[(DVec3, DVec2)]) -> Option<View> {
    let mut view = linear(name, size, known)?;
    let problem = Problem {
        known,
        envelope: [0; UNKNOWNS],
    };
    let effort = Effort {
        iterations: 200,
        tolerance: 1e-10,
    };
    let mut spare = view.clone();
    Solver::default().solve(&problem, effort, &mut view, &mut spare);
    rms(&view, known).is_finite().then_some(view)
}

/// Direct linear transform, taken apart (Hartley and Zisserman, Multiple View Geometry, 7.1, 6.2.4), without skew.
fn linear(name: &str, size: [u32; 2], known: &[(DVec3, DVec2)]) -> Option<View> {
    if known.len() < 8 {
        return None;
    }
    let n = known.len() as f64;
    let middle = known.iter().map(|(p, _)| *p).sum::<DVec3>() / n;
    let spread = known.iter().map(|(p, _)| p.distance(middle)).sum::<f64>() / n;
    let half = DVec2::new(f64::from(size[0]), f64::from(size[1])) / 2.0;
    let mut normal = SMatrix::<f64, 12, 12>::zeros();
    for (point, pixel) in known {
        let p = ((*point - middle) / spread).extend(1.0);
        let at = (*pixel - half) / half.x;
        for (axis, at) in [at.x, at.y].into_iter().enumerate() {
            let row = SVector::<f64, 12>::from_fn(|k, _| match k / 4 {
                g if g == axis => p[k % 4],
                2 => -at * p[k % 4],
                _ => 0.0,
            });
            normal.ger(1.0, &row, &row, 1.0);
        }
    }
    let eigen = SymmetricEigen::try_new(normal, 1e-15, 1000)?;
    let v = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .into_owned();
    let row = |k: usize| DVec3::new(v[4 * k], v[4 * k + 1], v[4 * k + 2]);
    let m = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let last = DVec3::new(v[3], v[7], v[11]);
    let scale = m.determinant().signum() / row(2).length();
    let [a, b, c] = [0, 1, 2].map(|k| row(k) * scale);
    let centre = DVec2::new(a.dot(c), b.dot(c));
    let focal = DVec2::new(a.cross(c).length(), b.cross(c).length());
    let x = ((a - centre.x * c) / focal.x).try_normalize()?;
    let rotation = DMat3::from_cols(x, c.cross(x), c).transpose();
    let view = View {
        name: name.to_owned(),
        size,
        focal: focal * half.x,
        centre: centre * half.x + half,
        distortion: Brown::default(),
        rotation,
        position: middle - spread * (m.inverse() * last),
    };
    let finite = view.position.is_finite() && view.focal.is_finite() && view.centre.is_finite();
    let before = known.iter().all(|(p, _)| view.to_camera(*p).z > 0.0);
    (finite && before).then_some(view)
}

struct Problem<'a> {
    known: &'a [(DVec3, DVec2)],
    envelope: [usize; UNKNOWNS],
}

impl LeastSquares for Problem<'_> {
    type State = View;

    fn envelope(&self) -> &[usize] {
        &self.envelope
    }

    fn cost(&self, at: &View) -> f64 {
        rms(at, self.known).powi(2) * self.known.len() as f64
    }

    fn linearise(&self, at: &View, out: &mut NormalEquations) {
        let moved: Vec<(View, View, f64)> = (0..UNKNOWNS)
            .map(|k| {
                let by = if k < LENS { 1e-2 } else { 1e-5 };
                let to = |by: f64| {
                    let mut step = [0.0; UNKNOWNS];
                    step[k] = by;
                    moved(at, &step)
                };
                (to(by), to(-by), 2.0 * by)
            })
            .collect();
        for (point, pixel) in self.known {
            let Some(shown) = at.project(*point) else {
                continue;
            };
            let off = shown - *pixel;
            let slopes: Vec<DVec2> = moved
                .iter()
                .map(|(ahead, behind, by)| {
                    let both = ahead.project(*point).zip(behind.project(*point));
                    both.map_or(DVec2::ZERO, |(a, b)| (a - b) / *by)
                })
                .collect();
            for (k, slope) in slopes.iter().enumerate() {
                out.pull(k, slope.dot(off));
                for (l, other) in slopes[..=k].iter().enumerate() {
                    out.add(k, l, slope.dot(*other));
                }
            }
        }
    }

    fn step(&self, from: &View, descent: &[f64], to: &mut View) {
        let step: [f64; UNKNOWNS] = std::array::from_fn(|k| -descent[k]);
        *to = moved(from, &step);
    }
}

fn moved(from: &View, step: &[f64; UNKNOWNS]) -> View {
    let turn = DQuat::from_scaled_axis(DVec3::from_slice(&step[TURN..PLACE]));
    let rotation = DMat3::from_quat(turn) * from.rotation;
    let [k1, k2, k3] = from.distortion.radial;
    let [p1, p2] = from.distortion.tangential;
    View {
        focal: from.focal + DVec2::new(step[0], step[1]),
        centre: from.centre + DVec2::new(step[2], step[3]),
        distortion: Brown {
            radial: [k1 + step[LENS], k2 + step[LENS + 1], k3],
            tangential: [p1 + step[LENS + 2], p2 + step[LENS + 3]],
        },
        // Many small steps must not bend the axes.
        rotation: DMat3::from_quat(DQuat::from_mat3(&rotation).normalize()),
        position: from.position + DVec3::from_slice(&step[PLACE..]),
        ..from.clone()
    }
}

//! In: sums over everybody's feet. Out: the floor that they share, and statures.
//!
//! Whoever is taken for taller or smaller than they are is placed too far or too near in proportion, feet included:
//! they stand on a floor of the same slope at another height, y = a·x + b·z + c / s, where s is their stature as a
//! share of the assumed one. So slopes are shared and everybody has an intercept of their own: a linear mixed model
//! (Laird and Ware 1982), from which the intercepts are eliminated in closed form. One camera cannot tell a room from
//! its model, so the sizes of all together rest on how tall people are: most of them adults, about as tall as assumed,
//! some children.
//!
//! How far away a foot is is known to some percent only, where it is in the picture much better. Such errors move feet
//! along their rays, and a floor through them is more level than the true one. At most they are so large that slopes
//! are those of `most` (least squares with errors in variables); how much of that is true is what the places of feet in
//! the picture say, as instruments that have no such errors. These alone would not do: heights that are wrong, as of
//! feet after the camera was moved, tilt a floor by tens of degrees.

use glam::DVec3;
use nalgebra::{Matrix3, Vector3};

use super::standers::Stander;
use super::{ENOUGH, Floor, FloorEstimate};
use crate::fit::scene::floor_plane::FloorPlane;
use crate::fit::scene::stature_prior::{ADULTS, common_level, expected};

/// Error of a standing ankle, metres. More than the 0.12 it is off by: looks at the same foot do not differ by chance
/// alone.
const SIGMA: f64 = 0.22;
/// What is wrong with a person's feet for as long as they are in view, metres.
const LASTING: f64 = 0.05;
/// Cameras stand nearly upright: spread of the floor's slope across (roll) and along (pitch) the view.
const ROLL: f64 = 0.05;
const PITCH: f64 = 0.4;
/// Greatest error of a foot's distance along its ray, as a share.
const ALONG: f64 = 0.03;
/// Spread in depth of feet, metres, before a floor is believed.
const SPREAD: f64 = 0.25;
/// Looks at somebody's feet before they tell a stature.
const TELLING: f64 = 6.0;
/// Rounds in which people who are no taller or smaller than others tell more about slopes than who is.
const ROUNDS: usize = 4;

impl FloorEstimate {
    pub(super) fn solve(&self) -> Option<Floor> {
        let all: Matrix3<f64> = self.standers.iter().map(|s| s.xx).sum();
        let count = all[(2, 2)];
        if count < ENOUGH {
            return None;
        }
        let mean: Vector3<f64> = all.column(2) / count;
        let spread = (all[(1, 1)] / count - mean.y * mean.y).max(0.0).sqrt();
        if spread < SPREAD {
            return None;
        }
        let mut level = all_intercept(&self.standers);
        let mut variances = vec![(ADULTS * level).powi(2) + LASTING.powi(2); self.standers.len()];
        let mut plane = Vector3::zeros();
        let mut errors = Vec::new();
        let mut pitch_error = PITCH;
        for _ in 0..ROUNDS {
            let (normal, right) = self.equations(&variances, 0.0);
            let solver = normal.cholesky()?;
            plane = self.without_errors_along(solver.solve(&right), &variances);
            let covariance = solver.inverse() * (SIGMA * SIGMA);
            pitch_error = covariance[(1, 1)].sqrt() / (1.0 + plane.y * plane.y);
            // Of an intercept: by the feet, and by slopes over the distance from where most of them stood.
            errors.clear();
            errors.extend(self.standers.iter().map(|s| {
                let mut off = s.middle() - mean;
                off.z = 0.0;
                let own = LASTING.powi(2) + SIGMA * SIGMA / s.count();
                own + (off.transpose() * covariance * off)[0]
            }));
            let own = self.standers.iter().map(|s| s.intercept(&plane).max(0.1));
            let own: Vec<f64> = own.collect();
            let spreads = errors.iter().map(|e| e.sqrt() / level).collect::<Vec<_>>();
            level = common_level(&own, &spreads);
            for (v, c) in variances.iter_mut().zip(&own) {
                *v = ((ADULTS * level).powi(2) + LASTING.powi(2)).max((c - level).powi(2));
            }
        }
        let length = (plane.x * plane.x + plane.y * plane.y + 1.0).sqrt();
        let ground = FloorPlane {
            normal: DVec3::new(plane.x, -1.0, plane.y) / length,
            offset: level / length,
        };
        if !ground.normal.is_finite() || ground.offset <= 0.05 {
            return None;
        }
        let telling = self.standers.iter().zip(&errors);
        let mut statures: Vec<(u32, f64)> = telling
            .filter(|(s, _)| s.count() >= TELLING)
            .map(|(s, e)| {
                let measured = (level / s.intercept(&plane).max(0.1)).ln();
                (s.id, expected(measured, e.sqrt() / level).exp())
            })
            .collect();
        if statures.len() < 2 {
            // Nobody to compare with.
            statures.clear();
        }
        plane.z = level;
        Some(Floor {
            ground,
            statures,
            plane,
            pitch_error,
        })
    }

    /// Normal equations of slopes and common intercept, everybody's own intercept with its variance being eliminated,
    /// and of squares and products of distances what is there by an `error` of them along the rays, a share.
    fn equations(&self, variances: &[f64], error: f64) -> (Matrix3<f64>, Vector3<f64>) {
        let share = 1.0 / (1.0 + error * error);
        let (mut normal, mut right) = (prior(), Vector3::zeros());
        for (s, v) in self.standers.iter().zip(variances) {
            let u = s.xx.column(2) / (s.count() + SIGMA * SIGMA / v);
            let mut xx = s.xx;
            xx.fixed_view_mut::<2, 2>(0, 0).scale_mut(share);
            normal += xx - u * s.xx.row(2);
            right += Vector3::new(share, share, 1.0).component_mul(&s.xy) - u * s.xy.z;
        }
        (normal, right)
    }

    /// Slopes and common intercept by the places of feet in the picture (two-stage least squares), everybody's own
    /// intercept being eliminated as in [`equations`](Self::equations).
    fn by_places_seen(&self, variances: &[f64]) -> Option<Vector3<f64>> {
        let (mut seen, mut seen_x, mut seen_y) =
            (Matrix3::zeros(), Matrix3::zeros(), Vector3::zeros());
        for (s, v) in self.standers.iter().zip(variances) {
            let u = s.seen.column(2) / (s.count() + SIGMA * SIGMA / v);
            seen += s.seen - u * s.seen.row(2);
            seen_x += s.seen_x - u * s.seen_x.row(2);
            seen_y += s.seen_y - u * s.seen_y.z;
        }
        // Whoever stands in one place of the picture is no instrument.
        let least = 1e-6 * self.count();
        seen += Matrix3::from_diagonal(&Vector3::new(least, least, 0.0));
        let explained: Matrix3<f64> = seen.cholesky()?.solve(&seen_x);
        let normal = explained.transpose() * seen_x + prior();
        Some(normal.cholesky()?.solve(&(explained.transpose() * seen_y)))
    }

    /// A floor found by least squares, rid of as much of the greatest error along the rays as places in the picture
    /// say.
    fn without_errors_along(&self, found: Vector3<f64>, variances: &[f64]) -> Vector3<f64> {
        let (normal, right) = self.equations(variances, ALONG);
        let most = normal.cholesky().map(|solver| solver.solve(&right));
        let (Some(most), Some(told)) = (most, self.by_places_seen(variances)) else {
            return found;
        };
        let (apart, part) = (most.y - found.y, told.y - found.y);
        if apart.abs() < 1e-9 {
            return found;
        }
        found + (most - found) * (part / apart).clamp(0.0, 1.0)
    }
}

/// What is known of slopes beforehand.
fn prior() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(
        (SIGMA / ROLL).powi(2),
        (SIGMA / PITCH).powi(2),
        0.0,
    ))
}

/// Mean height of feet below the camera.
fn all_intercept(standers: &[Stander]) -> f64 {
    let count: f64 = standers.iter().map(Stander::count).sum();
    let sum: f64 = standers.iter().map(|s| s.xy.z).sum();
    (sum / count).max(0.1)
}

//! In: the feet of one person. Out: sums over them, which are all that a floor is found from.

use glam::DVec3;
use nalgebra::{Matrix3, Vector3};

/// Sums over the feet of one person: products of (x, z, 1) with themselves and with y, and of their places in the
/// picture, (x/z, y/z, 1), with themselves, with (x, z, 1) and with y.
#[derive(Debug, Clone)]
pub struct Stander {
    pub id: u32,
    pub xx: Matrix3<f64>,
    pub xy: Vector3<f64>,
    pub seen: Matrix3<f64>,
    pub seen_x: Matrix3<f64>,
    pub seen_y: Vector3<f64>,
}

impl Stander {
    /// Of whom no foot was seen yet.
    pub fn new(id: u32) -> Self {
        let (none, zero) = (Matrix3::zeros(), Vector3::zeros());
        Self {
            id,
            xx: none,
            xy: zero,
            seen: none,
            seen_x: none,
            seen_y: zero,
        }
    }

    /// A foot, metres, and what it is worth.
    pub fn add(&mut self, foot: DVec3, weight: f64) {
        let at = Vector3::new(foot.x, foot.z, 1.0);
        let seen = Vector3::new(foot.x / foot.z, foot.y / foot.z, 1.0);
        self.xx += weight * at * at.transpose();
        self.xy += weight * at * foot.y;
        self.seen += weight * seen * seen.transpose();
        self.seen_x += weight * seen * at.transpose();
        self.seen_y += weight * seen * foot.y;
    }

    /// What is left of all feet, a share.
    pub fn fade(&mut self, left: f64) {
        for sum in [&mut self.xx, &mut self.seen, &mut self.seen_x] {
            *sum *= left;
        }
        self.xy *= left;
        self.seen_y *= left;
    }

    /// What all feet are worth.
    pub fn count(&self) -> f64 {
        self.xx[(2, 2)]
    }

    /// Mean of (x, z, 1).
    pub fn middle(&self) -> Vector3<f64> {
        self.xx.column(2) / self.count()
    }

    /// Height of the floor at x = z = 0 under this person, by slopes alone.
    pub fn intercept(&self, plane: &Vector3<f64>) -> f64 {
        let slopes = Vector3::new(plane.x, plane.y, 0.0);
        self.xy.z / self.count() - self.middle().dot(&slopes)
    }
}

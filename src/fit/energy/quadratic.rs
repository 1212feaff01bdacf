//! What is known of one point in space, summed up: a quadratic function of its place.

use glam::{DVec2, DVec3};

/// A quadratic function of a point: matrix M (symmetric) and pull M·r.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadratic {
    xx: f64,
    xy: f64,
    xz: f64,
    yy: f64,
    yz: f64,
    zz: f64,
    /// Matrix times residual.
    pub pull: DVec3,
}

impl Quadratic {
    pub fn add_point(&mut self, weight: f64, residual: DVec3) {
        self.xx += weight;
        self.yy += weight;
        self.zz += weight;
        self.pull += residual * weight;
    }

    pub fn add_projection(&mut self, weight: f64, residual: DVec2, p: DVec3, depth: f64) {
        let s = depth / p.z;
        let u = DVec3::new(s, 0.0, -s * p.x / p.z);
        let v = DVec3::new(0.0, s, -s * p.y / p.z);
        self.xx += weight * u.x * u.x;
        self.xz += weight * u.x * u.z;
        self.yy += weight * v.y * v.y;
        self.yz += weight * v.y * v.z;
        self.zz += weight * (u.z * u.z + v.z * v.z);
        self.pull += (u * residual.x + v * residual.y) * weight;
    }

    pub fn plus(&self, other: &Self) -> Self {
        Self {
            xx: self.xx + other.xx,
            xy: self.xy + other.xy,
            xz: self.xz + other.xz,
            yy: self.yy + other.yy,
            yz: self.yz + other.yz,
            zz: self.zz + other.zz,
            pull: self.pull + other.pull,
        }
    }

    pub fn apply(&self, v: DVec3) -> DVec3 {
        DVec3::new(
            self.xx * v.x + self.xy * v.y + self.xz * v.z,
            self.xy * v.x + self.yy * v.y + self.yz * v.z,
            self.xz * v.x + self.yz * v.y + self.zz * v.z,
        )
    }

    pub fn is_zero(&self) -> bool {
        self.xx == 0.0 && self.yy == 0.0 && self.zz == 0.0
    }
}

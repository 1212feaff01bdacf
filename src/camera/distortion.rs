//! Brown's model of a lens that distorts: the pinhole's point on the plane z = 1 goes in, the point where the lens
//! shows it comes out, and the other way round.

use glam::DVec2;

/// Coefficients as in OpenCV (`k1, k2, p1, p2, k3`), for points on the plane z = 1. All zero: a pinhole.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Brown {
    /// Radial, of r², r⁴ and r⁶.
    pub radial: [f64; 3],
    /// Tangential p1, p2.
    pub tangential: [f64; 2],
}

impl Brown {
    /// Every coefficient times `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            radial: self.radial.map(|k| k * factor),
            tangential: self.tangential.map(|p| p * factor),
        }
    }

    /// Where the lens shows what a pinhole would show at `p`.
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let r2 = p.length_squared();
        let xy = p.x * p.y;
        p * (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)))
            + DVec2::new(
                2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x),
                p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * xy,
            )
    }

    /// Where a pinhole would show what the lens shows at `seen`, by fixed-point iteration: exact to 1e-9 for lenses
    /// that move a point by less than a third of its distance from the axis.
    pub fn undistort(&self, seen: DVec2) -> DVec2 {
        let mut p = seen;
        for _ in 0..10 {
            p += seen - self.distort(p);
        }
        p
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undoing_what_a_lens_does_gives_the_point_back() {
        let lens = Brown {
            radial: [-0.046, 0.14, -0.02],
            tangential: [0.0006, -0.0007],
        };
        for p in [DVec2::ZERO, DVec2::new(0.3, -0.2), DVec2::new(-0.45, 0.1)] {
            assert!((lens.undistort(lens.distort(p)) - p).length() < 1e-9);
        }
        // r = 0.5: 1 − 0.046·0.25 + 0.14·0.0625 − 0.02·0.015625.
        let radial = Brown {
            tangential: [0.0; 2],
            ..lens
        };
        let far = radial.distort(DVec2::new(0.3, 0.4)).length();
        assert!((far - 0.5 * 0.9969375).abs() < 1e-12, "{far}");
    }
}

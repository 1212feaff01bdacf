//! Brown's model of a lens that distorts: the pinhole's point on the plane z = 1 goes in, the point where the lens
//! shows it comes out, and the other way round.

use glam::{DMat2, DVec2};

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

    /// Derivative of [`distort`](Self::distort) by the point, column by column.
    pub fn by_point(&self, p: DVec2) -> DMat2 {
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let r2 = p.length_squared();
        let gain = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let across = 2.0 * (p.x * p.y * slope + p1 * p.x + p2 * p.y);
        DMat2::from_cols(
            DVec2::new(
                gain + 2.0 * p.x * p.x * slope + 2.0 * p1 * p.y + 6.0 * p2 * p.x,
                across,
            ),
            DVec2::new(
                across,
                gain + 2.0 * p.y * p.y * slope + 6.0 * p1 * p.y + 2.0 * p2 * p.x,
            ),
        )
    }

    /// Derivatives of [`distort`](Self::distort) by k1, k2, p1, p2, k3.
    pub fn by_coefficient(p: DVec2) -> [DVec2; 5] {
        let r2 = p.length_squared();
        let xy = 2.0 * p.x * p.y;
        [
            p * r2,
            p * r2 * r2,
            DVec2::new(xy, r2 + 2.0 * p.y * p.y),
            DVec2::new(r2 + 2.0 * p.x * p.x, xy),
            p * r2 * r2 * r2,
        ]
    }

    /// Whether the lens shows anything of what a pinhole would show at `p`. Beyond the fold the model takes farther
    /// points nearer to the middle again, into the picture, where the lens shows something else.
    pub fn shows(&self, p: DVec2) -> bool {
        self.is_upright(p, 0.0)
    }

    /// Whether `p` is within the first fold, and the lens shrinks areas there to no less than this share.
    fn is_upright(&self, p: DVec2, least: f64) -> bool {
        // The matrix is symmetric: it has two eigenvalues, and both have to be positive.
        let slope = self.by_point(p);
        let here = slope.determinant() > least && slope.x_axis.x + slope.y_axis.y > 0.0;
        here && !self.folds_before(p.length_squared())
    }

    /// Whether the lens folds before r² is `end`, where it may have folded back. Tangential coefficients, which hardly
    /// move folds, are left out.
    fn folds_before(&self, end: f64) -> bool {
        let [k1, k2, k3] = self.radial;
        // How much farther out a point is shown that is a little farther out; least where its own slope,
        // 3·k1 + 10·k2·s + 21·k3·s², is 0. Roots that there are not come out as no numbers.
        let slope = |s: f64| 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3));
        let (a, b, c) = (21.0 * k3, 5.0 * k2, 3.0 * k1);
        let q = -(b + (b * b - a * c).sqrt().copysign(b));
        let mut turns = [q / a, c / q].into_iter();
        turns.any(|s| (0.0..end).contains(&s) && slope(s) <= 0.0)
    }

    /// Where a pinhole would show what the lens shows at `seen`, by Newton's method from there, or from nearer to the
    /// middle where the lens pushes outwards and that is beyond its first fold: exact to 1e-12 for every point that the
    /// model takes from within that fold, where it begins to take farther points nearer. Beyond that no point answers,
    /// and this is the nearest that was come by.
    pub fn undistort(&self, seen: DVec2) -> DVec2 {
        let mut starts = (0..HALVINGS).map(|k| seen * 0.5_f64.powi(k));
        let mut p = starts.find(|p| self.is_upright(*p, FLAT)).unwrap_or(seen);
        let mut off = seen - self.distort(p);
        for _ in 0..MOST_STEPS {
            if off.length_squared() < CLOSE * CLOSE {
                break;
            }
            let slope = self.by_point(p);
            // Past the fold the whole step would lead away: half of it, and again half, comes nearer or nothing does.
            let step = if slope.determinant() > FLAT {
                slope.inverse() * off
            } else {
                off
            };
            let nearer = (0..HALVINGS).find_map(|k| {
                let next = p + step * 0.5_f64.powi(k);
                let left = seen - self.distort(next);
                let is_nearer = left.length_squared() < off.length_squared();
                (is_nearer && self.is_upright(next, 0.0)).then_some((next, left))
            });
            let Some((next, left)) = nearer else { break };
            (p, off) = (next, left);
        }
        p
    }
}

/// Newton's steps at most; six suffice for most lenses.
const MOST_STEPS: usize = 30;
/// How near is near enough, on the plane z = 1.
const CLOSE: f64 = 1e-13;
/// A determinant below which the lens maps a neighbourhood to a line.
const FLAT: f64 = 1e-3;
/// How often a start or a step is halved before it counts as leading nowhere.
const HALVINGS: i32 = 10;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_small_steps() {
        let five = [-0.2, 0.14, 0.0006, -0.0007, -0.02];
        let lens = |c: [f64; 5]| Brown {
            radial: [c[0], c[1], c[4]],
            tangential: [c[2], c[3]],
        };
        let (p, step) = (DVec2::new(0.31, -0.24), 1e-6);
        let near = |a: DVec2, b: DVec2| assert!((a - b).length() < 1e-8, "{a} {b}");
        let by_point = lens(five).by_point(p);
        for (axis, column) in [DVec2::X, DVec2::Y]
            .into_iter()
            .zip([by_point.x_axis, by_point.y_axis])
        {
            let [more, less] = [step, -step].map(|s| lens(five).distort(p + s * axis));
            near((more - less) / (2.0 * step), column);
        }
        for (k, column) in Brown::by_coefficient(p).into_iter().enumerate() {
            let moved = |s: f64| {
                let mut c = five;
                c[k] += s;
                lens(c).distort(p)
            };
            near((moved(step) - moved(-step)) / (2.0 * step), column);
        }
    }

    #[test]
    fn undoing_what_a_lens_does_gives_the_point_back() {
        let lens = Brown {
            radial: [-0.046, 0.14, -0.02],
            tangential: [0.0006, -0.0007],
        };
        for p in [DVec2::ZERO, DVec2::new(0.3, -0.2), DVec2::new(-0.45, 0.1)] {
            assert!((lens.undistort(lens.distort(p)) - p).length() < 1e-9);
        }
        // Wide lenses, points at their edge: a barrel that pulls them in by up to 30 %, and a cushion.
        for (k1, far) in [(-0.3, 1.0), (-0.2, 1.15), (0.2, 1.15), (0.4, 1.5)] {
            let wide = Brown {
                radial: [k1, 0.0, 0.0],
                tangential: [0.0006, -0.0007],
            };
            for turn in 0..12 {
                let p = far * DVec2::from_angle(f64::from(turn));
                let back = wide.undistort(wide.distort(p));
                assert!((back - p).length() < 1e-9, "{k1} {p}: {back}");
            }
        }
        // Lenses that push outwards, and show a point where a pinhole would show one beyond the fold.
        for (radial, far) in [
            ([1.0, -1.0, 0.0], 0.83),
            ([0.5, -0.1, 0.0], 1.6),
            ([0.99, 0.544, -0.444], 1.2),
        ] {
            let outwards = Brown {
                radial,
                tangential: [0.0; 2],
            };
            for turn in 0..12 {
                let p = far * DVec2::from_angle(f64::from(turn));
                let back = outwards.undistort(outwards.distort(p));
                assert!((back - p).length() < 1e-9, "{radial:?} {p}: {back}");
            }
        }
        // Nothing is shown beyond the fold: an answer, and not one far away.
        let fold = Brown {
            radial: [-0.3, 0.0, 0.0],
            tangential: [0.0; 2],
        };
        assert!(fold.undistort(DVec2::new(1.5, 0.0)).length() < 2.0);
        // r = 0.5: 1 − 0.046·0.25 + 0.14·0.0625 − 0.02·0.015625.
        let radial = Brown {
            tangential: [0.0; 2],
            ..lens
        };
        let far = radial.distort(DVec2::new(0.3, 0.4)).length();
        assert!((far - 0.5 * 0.9969375).abs() < 1e-12, "{far}");
    }

    #[test]
    fn nothing_is_shown_beyond_the_first_fold() {
        // Radial coefficients, and where r·(1 + k1·r² + k2·r⁴ + k3·r⁶) has its first maximum; the last two rise again
        // farther out.
        for (radial, fold) in [
            ([0.0; 3], f64::INFINITY),
            ([0.2, 0.1, 0.0], f64::INFINITY),
            ([-0.046, 0.14, -0.02], 2.2545),
            ([-0.3, 0.0, 0.0], 1.0541),
            ([-0.5, 0.1, 0.0], 1.0),
            ([-0.4, -0.6, 0.5], 0.7493),
        ] {
            let lens = Brown {
                radial,
                tangential: [0.0; 2],
            };
            for k in 1..40 {
                let far = 0.07 * f64::from(k);
                let p = far * DVec2::from_angle(far);
                assert_eq!(lens.shows(p), far < fold, "{radial:?}: {far}");
            }
        }
        // By tangential coefficients the fold is nearer on one side of the middle.
        let tilted = Brown {
            radial: [-0.3, 0.0, 0.0],
            tangential: [0.0, 0.01],
        };
        assert!(tilted.shows(DVec2::new(1.04, 0.0)) && !tilted.shows(DVec2::new(-1.04, 0.0)));
        // What is sought from beyond another fold is found within the first one.
        let again = Brown {
            radial: [-0.5, 0.1, 0.0],
            tangential: [0.0; 2],
        };
        assert!(again.undistort(DVec2::new(1.5, 0.0)).length() <= 1.0);
    }
}

//! In: joints on the plane z = 1 and the same joints in 3D relative to a root. Out: where the root is in camera space.
//! Closed form.

use glam::{DVec2, DVec3};

/// Least and greatest distance of a root, metres at canonical stature.
pub const DEPTHS: [f64; 2] = [0.4, 150.0];

/// Weighted linear least squares: x·(tz + Z) = tx + X and likewise for y; tx and ty are eliminated by centring. All
/// slices hold one entry a joint; a weight of 0 leaves it out. `None` where the joints do not determine a root within
/// [`DEPTHS`].
pub fn least_squares(plane: &[DVec2], points: &[DVec3], weights: &[f64]) -> Option<DVec3> {
    let (mean_x, mean_a) = means(plane, points, weights)?;
    let (mut xx, mut xa) = (0.0, 0.0);
    for ((x, p), w) in plane.iter().zip(points).zip(weights) {
        let dx = *x - mean_x;
        let da = moment(*x, *p) - mean_a;
        xx += w * dx.length_squared();
        xa += w * dx.dot(da);
    }
    root(mean_x, mean_a, -xa / xx)
}

/// The same root at a distance that is known, metres.
pub fn at_depth(plane: &[DVec2], points: &[DVec3], weights: &[f64], depth: f64) -> Option<DVec3> {
    let (mean_x, mean_a) = means(plane, points, weights)?;
    root(mean_x, mean_a, depth)
}

fn root(mean_x: DVec2, mean_a: DVec2, depth: f64) -> Option<DVec3> {
    let root = (mean_x * depth + mean_a).extend(depth);
    (root.is_finite() && depth > DEPTHS[0] && depth < DEPTHS[1]).then_some(root)
}

/// x·Z − X of a joint.
fn moment(x: DVec2, p: DVec3) -> DVec2 {
    x * p.z - p.truncate()
}

/// Weighted means of x and of the moments.
fn means(plane: &[DVec2], points: &[DVec3], weights: &[f64]) -> Option<(DVec2, DVec2)> {
    let (mut sum, mut x, mut a) = (0.0, DVec2::ZERO, DVec2::ZERO);
    for ((at, p), w) in plane.iter().zip(points).zip(weights) {
        sum += w;
        x += *w * *at;
        a += *w * moment(*at, *p);
    }
    (sum.is_finite() && sum > 1e-9).then(|| (x / sum, a / sum))
}

//! `G w Gᵀ`, in f64 and rounded once.

use crate::winograd::{IN, POINTS};
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

/// A kernel of 3 × 3 at the 36 points.
pub(crate) type Points = [f32; POINTS];

/// `(1, p, p²)` of every point p, divided by the product of its differences from the others.
const G: [[f64; 3]; IN] = [
    [1.0, 0.0, 0.0],
    [-2.0 / 3.0, -2.0 / 3.0 * FRAC_1_SQRT_2, -1.0 / 3.0],
    [-2.0 / 3.0, 2.0 / 3.0 * FRAC_1_SQRT_2, -1.0 / 3.0],
    [1.0 / 6.0, SQRT_2 / 6.0, 1.0 / 3.0],
    [1.0 / 6.0, -SQRT_2 / 6.0, 1.0 / 3.0],
    [0.0, 0.0, 1.0],
];

/// Transforms `[.., 3, 3]`.
pub(crate) fn transform_weights(weights: &[f32]) -> Vec<Points> {
    weights.chunks_exact(9).map(transform).collect()
}

fn transform(kernel: &[f32]) -> Points {
    let mut half = [[0f64; 3]; IN];
    for (row, g) in half.iter_mut().zip(&G) {
        for (x, value) in row.iter_mut().enumerate() {
            *value = (0..3).map(|y| g[y] * f64::from(kernel[y * 3 + x])).sum();
        }
    }
    std::array::from_fn(|i| {
        let (row, g) = (&half[i / IN], &G[i % IN]);
        (row[0] * g[0] + row[1] * g[1] + row[2] * g[2]) as f32
    })
}

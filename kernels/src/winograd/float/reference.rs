//! Winograd in plain f32: the oracle of the other tiers.

use super::{INNER, OUTER, Points};
use crate::winograd::sandwich::sandwich;
use crate::winograd::{IN, OUT, POINTS};

/// Bᵀ.
const B: [[f32; IN]; IN] = [
    [1.0, 0.0, -2.5, 0.0, 1.0, 0.0],
    [0.0, -2.0 * INNER, -2.0, INNER, 1.0, 0.0],
    [0.0, 2.0 * INNER, -2.0, -INNER, 1.0, 0.0],
    [0.0, -0.5 * OUTER, -0.5, OUTER, 1.0, 0.0],
    [0.0, 0.5 * OUTER, -0.5, -OUTER, 1.0, 0.0],
    [0.0, 1.0, 0.0, -2.5, 0.0, 1.0],
];

/// Aᵀ.
const A: [[f32; IN]; OUT] = [
    [1.0, 1.0, 1.0, 1.0, 1.0, 0.0],
    [0.0, INNER, -INNER, OUTER, -OUTER, 0.0],
    [0.0, 0.5, 0.5, 2.0, 2.0, 0.0],
    [
        0.0,
        0.5 * INNER,
        -0.5 * INNER,
        2.0 * OUTER,
        -2.0 * OUTER,
        1.0,
    ],
];

/// `Bᵀ d B`.
pub(crate) fn input(d: &Points) -> Points {
    let mut points = [0.0; POINTS];
    sandwich(&B, d, &mut points, |sum, a, b| sum + a * b);
    points
}

/// Y of one tile and output channel, without bias; `v` holds the transformed input of every channel of the group, `u`
/// the channel's weights.
pub(crate) fn tile(u: &[Points], v: &[Points]) -> [f32; OUT * OUT] {
    let mut m = [0.0; POINTS];
    for (u, v) in u.iter().zip(v) {
        for i in 0..POINTS {
            m[i] += u[i] * v[i];
        }
    }
    let mut values = [0.0; OUT * OUT];
    sandwich(&A, &m, &mut values, |sum, a, b| sum + a * b);
    values
}

#[cfg(test)]
mod tests {
    use super::super::transform_weights;
    use super::*;

    /// In steps of the last bit of what is summed: of a single channel, where nothing averages out.
    #[test]
    #[cfg_attr(miri, ignore = "accuracy, not memory")]
    fn is_close_to_the_definition() {
        let mut most = 0f64;
        for seed in 0..400 {
            let number = |i: usize| ((i * i * 37 + i * 11 + seed * 77) % 255) as f32 / 127.0 - 1.0;
            let kernel: [f32; 9] = std::array::from_fn(|i| number(i + 50));
            let d: Points = std::array::from_fn(number);
            let y = tile(&transform_weights(&kernel), &[input(&d)]);
            for (i, &value) in y.iter().enumerate() {
                let products = (0..9).map(|k| {
                    let x = d[(i / OUT + k / 3) * IN + i % OUT + k % 3];
                    f64::from(x) * f64::from(kernel[k])
                });
                let (sum, size) = products.fold((0.0, 0.0), |(s, m), p| (s + p, m + p.abs()));
                most = most.max((f64::from(value) - sum).abs() / size);
            }
        }
        assert!(most < 2e-6, "{most}");
    }
}

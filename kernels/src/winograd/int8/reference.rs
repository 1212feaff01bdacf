//! Winograd in plain integers: the specification of the algorithm's numerics.

use super::{BIAS_POINT, TransformedWeights};
use crate::winograd::sandwich::sandwich;
use crate::winograd::{IN, OUT, POINTS};

/// Bᵀ.
const B: [[i32; IN]; IN] = [
    [4, 0, -5, 0, 1, 0],
    [0, -4, -4, 1, 1, 0],
    [0, 4, -4, -1, 1, 0],
    [0, -2, -1, 2, 1, 0],
    [0, 2, -1, -2, 1, 0],
    [0, 4, 0, -5, 0, 1],
];

/// Aᵀ.
const A: [[i32; IN]; OUT] = [
    [1, 1, 1, 1, 1, 0],
    [0, 1, -1, 2, -2, 0],
    [0, 1, 1, 4, 4, 0],
    [0, 1, -1, 8, -8, 1],
];

/// `sum + a · b`, modulo 2³².
fn add(sum: i32, a: i32, b: i32) -> i32 {
    sum.wrapping_add(a.wrapping_mul(b))
}

/// `Bᵀ d B`.
pub(crate) fn input(d: &[i32; POINTS]) -> [i32; POINTS] {
    let mut points = [0; POINTS];
    sandwich(&B, d, &mut points, add);
    points
}

/// Y of one tile and output channel; `v` holds the transformed input of every channel of the group.
pub(crate) fn tile(
    weights: &TransformedWeights,
    oc: usize,
    v: &[[i32; POINTS]],
) -> [i32; OUT * OUT] {
    let mut m: [i32; POINTS] = std::array::from_fn(|point| weights.rounding(point));
    m[BIAS_POINT] = weights.bias[oc];
    for (ic, points) in v.iter().enumerate() {
        let u = &weights.weights[(oc * v.len() + ic) * POINTS..][..POINTS];
        for i in 0..POINTS {
            m[i] = add(m[i], i32::from(u[i]), points[i]);
        }
    }
    for (m, shift) in m.iter_mut().zip(&weights.shift) {
        *m >>= shift;
    }
    let mut values = [0; OUT * OUT];
    sandwich(&A, &m, &mut values, add);
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ConvDims, ConvShape};

    /// The worst that rounding of weights can do to a sum of a few channels, in units of the definition's accumulator.
    #[test]
    fn is_close_to_the_definition() {
        let depth = 8;
        let kernels: Vec<i8> = (0..depth * 9)
            .map(|i| ((i * i * 37 + i * 11) % 255 - 127) as i8)
            .collect();
        let shape = ConvShape::new(ConvDims {
            in_channels: depth as usize,
            kernel: 3,
            padding: 1,
            ..ConvDims::default()
        })
        .unwrap();
        let weights = TransformedWeights::new(&shape, &kernels, &[7], 127);
        assert!(weights.shift.iter().any(|&shift| shift > 0));
        let d: Vec<[i32; POINTS]> = (0..depth as usize)
            .map(|c| std::array::from_fn(|i| ((i * i * 7 + i * c * 13 + c) % 128) as i32))
            .collect();
        let v: Vec<_> = d.iter().map(input).collect();
        let y = tile(&weights, 0, &v);
        for (i, &value) in y.iter().enumerate() {
            let acc: i32 = 7
                + (0..9 * depth as usize)
                    .map(|j| {
                        let (c, k) = (j / 9, j % 9);
                        i32::from(kernels[j]) * d[c][(i / OUT + k / 3) * IN + i % OUT + k % 3]
                    })
                    .sum::<i32>();
            let error = f64::from(value) / f64::from(weights.factor[0]) - f64::from(acc);
            // The rounding of i8 weights themselves: ½ · activation, 9 products a channel, at random.
            let of_i8 = 0.29 * 64.0 * (9.0 * depth as f64).sqrt();
            assert!(error.abs() < of_i8 / 2.0, "output {i}: {error}, {of_i8}");
        }
        assert_eq!(
            tile(&weights, 0, &vec![[0; POINTS]; depth as usize]),
            [7 * weights.factor[0]; OUT * OUT]
        );
    }
}

//! `t · G w Gᵀ` rounded to i16.

use super::BIAS_POINT;
use crate::ConvShape;
use crate::winograd::{IN, POINTS};

/// 24 · G.
const G24: [[i64; 3]; IN] = [
    [6, 0, 0],
    [-4, -4, -4],
    [-4, 4, -4],
    [1, 2, 4],
    [1, -2, 4],
    [0, 0, 24],
];

/// Greatest `Σ |A| ρ` over output rows, where ρ are the row sums of |Bᵀ|: (1 + 1 + 8 + 8 + 1 as in Aᵀ's last row) ·
/// (10, 10, 6, 6, 10).
const REACH: i64 = 10 + 10 + 8 * 6 + 8 * 6 + 10;

/// Most bits by which a point's weights are finer than t.
const MAX_SHIFT: u32 = 6;

/// Transformed weights of a convolution: `U = round(576 · G w Gᵀ · t · 2^shift / 576)`, with one t per output channel
/// and one shift per point.
///
/// Points differ in the size of their weights and in how much their products weigh in the output, so each has as many
/// bits as i16 and its sums allow; products lose the shift again after they are summed.
#[derive(Debug, Clone)]
pub(crate) struct TransformedWeights {
    /// `[out_channels, in_channels / groups, 36]`.
    pub weights: Vec<i16>,
    /// t, per output channel.
    pub factor: Vec<i32>,
    /// Per point.
    pub shift: [u32; POINTS],
    /// `t · 2^shift · bias`, shift of the bias point, and its [`rounding`](Self::rounding): where that point's sum
    /// begins.
    pub bias: Vec<i32>,
}

impl TransformedWeights {
    /// Transforms `[out_channels, depth, 3, 3]`. The sums of the definition fit i32 (checked by the caller).
    pub fn new(shape: &ConvShape, weights: &[i8], bias: &[i32], input_max: u8) -> Self {
        let depth = shape.group_in();
        let exact: Vec<[i32; POINTS]> = weights.chunks_exact(9).map(transform).collect();
        let largest = largest_inputs(input_max);
        let mut factor = Vec::with_capacity(shape.out_channels());
        let mut shift = [MAX_SHIFT; POINTS];
        for (oc, &bias) in bias.iter().enumerate() {
            let points = &exact[oc * depth..(oc + 1) * depth];
            let (mut most, mut sum) = ([0i64; POINTS], [0i64; POINTS]);
            for kernel in points {
                for i in 0..POINTS {
                    let magnitude = i64::from(kernel[i].abs());
                    most[i] = most[i].max(magnitude);
                    sum[i] += magnitude;
                }
            }
            let t = greatest_factor(
                &weights[oc * depth * 9..(oc + 1) * depth * 9],
                bias,
                input_max,
                most.into_iter().max().unwrap_or(0),
                depth as i64,
            );
            for i in 0..POINTS {
                let fits = |shift: u32| {
                    let factor = t << shift;
                    // Rounding adds at most ½ to every weight; the initial value is the bias and half a unit.
                    let start = if i == BIAS_POINT {
                        i64::from(bias).abs() * factor
                    } else {
                        0
                    };
                    let sum = (sum[i] * factor / 576 + depth as i64) * largest[i];
                    most[i] * factor / 576 < i64::from(i16::MAX)
                        && sum + start + (1 << shift) <= i64::from(i32::MAX)
                };
                // Without a shift the sum may wrap: then only Y must fit.
                while shift[i] > 0 && !fits(shift[i]) {
                    shift[i] -= 1;
                }
            }
            factor.push(t as i32);
        }
        let mut result = Self {
            weights: Vec::with_capacity(exact.len() * POINTS),
            bias: Vec::with_capacity(shape.out_channels()),
            factor,
            shift,
        };
        for (oc, &bias) in bias.iter().enumerate() {
            let t = i64::from(result.factor[oc]);
            for kernel in &exact[oc * depth..(oc + 1) * depth] {
                let points = (0..POINTS).map(|i| {
                    round_576(f64::from(kernel[i]) * (t << result.shift[i]) as f64) as i16
                });
                result.weights.extend(points);
            }
            let start = i64::from(bias) * (t << shift[BIAS_POINT]);
            // Wraps only where the point has no shift.
            result
                .bias
                .push((start as i32).wrapping_add(result.rounding(BIAS_POINT)));
        }
        result
    }

    /// Half a unit of a point's shift.
    pub fn rounding(&self, point: usize) -> i32 {
        (1 << self.shift[point]) >> 1
    }
}

/// Bᵀ's rows as (Σ positive, Σ negative) parts.
const B_PARTS: [(i64, i64); IN] = [(5, 5), (2, 8), (5, 5), (3, 3), (3, 3), (5, 5)];

/// Greatest |V| of every point for inputs in 0..=`input_max`.
fn largest_inputs(input_max: u8) -> [i64; POINTS] {
    let max = i64::from(input_max);
    std::array::from_fn(|i| {
        let (positive, negative) = B_PARTS[i / IN];
        let (high, low) = (positive * max, -negative * max);
        let (positive, negative) = B_PARTS[i % IN];
        (positive * high - negative * low).max(negative * high - positive * low)
    })
}

/// 576 · G w Gᵀ of one 3 × 3 kernel.
fn transform(kernel: &[i8]) -> [i32; POINTS] {
    let mut half = [[0i64; 3]; IN];
    for (row, g) in half.iter_mut().zip(&G24) {
        for (x, value) in row.iter_mut().enumerate() {
            *value = (0..3).map(|y| g[y] * i64::from(kernel[y * 3 + x])).sum();
        }
    }
    let mut points = [0; POINTS];
    for (i, point) in points.iter_mut().enumerate() {
        let (row, g) = (&half[i / IN], &G24[i % IN]);
        *point = (row[0] * g[0] + row[1] * g[1] + row[2] * g[2]) as i32;
    }
    points
}

/// The greatest t for which U fits i16 without a shift and every Y fits i32.
///
/// With U exact, Y would be t · acc. Rounding moves each U by at most ½, which moves Y by at most
/// `½ · depth · input_max · REACH²`; rounding of shifted sums by at most `½ · REACH²`.
fn greatest_factor(weights: &[i8], bias: i32, input_max: u8, most: i64, depth: i64) -> i64 {
    let max = i64::from(input_max);
    let sum: i64 = weights.iter().map(|&w| i64::from(w).abs()).sum();
    let worst = (sum * max + i64::from(bias).abs()).max(1);
    let slack = (depth * max + 1) * REACH * REACH / 2 + 1;
    let by_sum = (i64::from(i32::MAX) - slack) / worst;
    let by_weight = (i64::from(i16::MAX) - 1) * 576 / most.max(1);
    by_sum.min(by_weight).min(i64::from(i16::MAX)).max(0)
}

/// `value / 576` of an integer below 2^40, ties away from zero.
///
/// In f64, because compilers turn that into vectors, and not i64 division; start-up waits for millions of them. It is
/// exact: a quotient is a multiple of 1/576, so it is either an integer or too far from one to be rounded to it.
/// Quotients fit i32, whose cast is an instruction where `floor` is a call.
fn round_576(value: f64) -> f64 {
    f64::from(((value.abs() + 288.0) / 576.0) as i32).copysign(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transform_of_a_unit_kernel_is_the_outer_product_of_columns_of_g() {
        let mut kernel = [0i8; 9];
        kernel[5] = 3; // row 1, column 2
        let points = transform(&kernel);
        for (i, &point) in points.iter().enumerate() {
            assert_eq!(i64::from(point), 3 * G24[i / IN][1] * G24[i % IN][2]);
        }
    }

    #[test]
    fn rounding_is_to_nearest() {
        assert_eq!(
            [0, 287, 288, 576, 863, 864, -288, -287].map(|v| round_576(f64::from(v)) as i16),
            [0, 0, 1, 1, 1, 2, -1, 0]
        );
        let large = 576.0 * 32_766.0 * 4096.0;
        assert_eq!(round_576(large + 287.0), large / 576.0);
        assert_eq!(round_576(large + 288.0), large / 576.0 + 1.0);
    }
}

//! A convolution by its definition, one output element after the other: what the scalar tiers run and the others must
//! equal.

use crate::phase::Phase;
use crate::{ConvShape, Layout, Part};

/// Which convolution, and which share of its output.
pub(crate) struct Walk<'a> {
    pub shape: &'a ConvShape,
    pub phases: &'a [Phase],
    pub part: &'a Part,
    pub in_layout: &'a Layout,
    pub out_width: usize,
}

/// Sums every output element of the part with `add(sum, input, weight)`, starting at its bias, in the order of taps and
/// channels, and hands it to `finish(row, column, channel, sum)`. `bias` has one per output channel, or as many for
/// each phase in turn.
///
/// # Safety
/// `input` is the start of a buffer that holds `in_layout` with a halo of `shape.input_halo()`; nobody writes it
/// meanwhile.
#[inline(always)]
pub(crate) unsafe fn convolve<X: Copy, W: Copy, S: Copy>(
    walk: &Walk,
    input: *const X,
    weights: &[W],
    bias: &[S],
    add: impl Fn(S, X, W) -> S,
    mut finish: impl FnMut(usize, usize, usize, S),
) {
    let Walk {
        shape,
        phases,
        part,
        in_layout,
        out_width,
    } = *walk;
    let depth = shape.group_in();
    let out_per_group = shape.group_out();
    let channels = part.groups.start * out_per_group..part.groups.end * out_per_group;
    for (p, phase) in phases.iter().enumerate() {
        let bias = &bias[p * shape.out_channels() % bias.len()..];
        let rows = part.rows.clone();
        for oy in rows.filter(|row| row % phase.out_step == phase.first_row) {
            let y = (oy / phase.out_step * phase.in_step) as isize;
            for ox in (phase.first_column..out_width).step_by(phase.out_step) {
                let x = (ox / phase.out_step * phase.in_step) as isize;
                for oc in channels.clone() {
                    let first = oc / out_per_group * depth;
                    let mut sum = bias[oc];
                    for tap in &phase.taps {
                        let at = in_layout.index(y + tap.dy, x + tap.dx) + first;
                        for ic in 0..depth {
                            // SAFETY: taps reach at most `input_halo()` pixels beyond the tensor, which the caller's
                            // buffer holds; first + ic < in_channels.
                            let value = unsafe { *input.add(at + ic) };
                            let row = (oc * depth + ic) * shape.kernel() + tap.ky;
                            sum = add(sum, value, weights[row * shape.kernel() + tap.kx]);
                        }
                    }
                    finish(oy, ox, oc, sum);
                }
            }
        }
    }
}

//! Winograd one tile and output channel after the other: what the scalar tiers run and the others must equal.

use super::{IN, OUT, POINTS};
use crate::naive::Walk;

/// Transforms the inputs of every tile of the part by `transform`, hands those of all channels of a group to
/// `tile(output channel, inputs)`, and what it returns to `finish(row, column, channel, value)`.
///
/// # Safety
/// `input` is the start of a buffer that holds the walk's input with a halo of its padding; nobody writes it meanwhile.
pub(crate) unsafe fn walk<X: Copy + Default, V: Copy, Y: Copy>(
    walk: &Walk,
    input: *const X,
    transform: impl Fn(&[X; POINTS]) -> [V; POINTS],
    tile: impl Fn(usize, &[[V; POINTS]]) -> [Y; OUT * OUT],
    mut finish: impl FnMut(usize, usize, usize, Y),
) {
    let Walk {
        shape,
        part,
        in_layout,
        out_width,
        ..
    } = *walk;
    let padding = shape.padding() as isize;
    let height = in_layout.height() as isize + padding;
    let width = in_layout.width() as isize + padding;
    let (depth, outs) = (shape.group_in(), shape.group_out());
    let mut inputs = Vec::with_capacity(depth);
    for group in part.groups.clone() {
        for ty in part.rows.start / OUT..part.rows.end.div_ceil(OUT) {
            for tx in 0..out_width.div_ceil(OUT) {
                inputs.clear();
                inputs.extend((0..depth).map(|ic| {
                    transform(&std::array::from_fn(|i| {
                        let y = (ty * OUT + i / IN) as isize - padding;
                        let x = (tx * OUT + i % IN) as isize - padding;
                        if y >= height || x >= width {
                            return X::default();
                        }
                        let at = in_layout.index(y, x) + group * depth + ic;
                        // SAFETY: -padding <= y < height + padding and the same for x, which the caller's buffer holds;
                        // group · depth + ic < in_channels.
                        unsafe { *input.add(at) }
                    }))
                }));
                for oc in group * outs..(group + 1) * outs {
                    for (i, &value) in tile(oc, &inputs).iter().enumerate() {
                        let (oy, ox) = (ty * OUT + i / OUT, tx * OUT + i % OUT);
                        if part.rows.contains(&oy) && ox < out_width {
                            finish(oy, ox, oc, value);
                        }
                    }
                }
            }
        }
    }
}

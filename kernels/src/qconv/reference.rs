//! The scalar int8 convolution: the specification that every other tier must equal bit for bit.

use super::QConv;
use super::epilogue::Output;
use super::run::Run;
use crate::Layout;
use crate::naive::{Walk, convolve};
use crate::winograd::{IN, OUT, POINTS, TransformedWeights, reference};

impl QConv {
    /// # Safety
    /// As [`QConv::run_part`].
    pub(super) unsafe fn run_reference(&self, weights: &[i8], bias: &[i32], run: &Run) {
        let walk = Walk {
            shape: &self.shape,
            phases: &self.phases,
            part: run.part,
            in_layout: run.in_layout,
            out_width: run.out_layout.width(),
        };
        let add = |sum, value: u8, weight: i8| sum + i32::from(value) * i32::from(weight);
        // SAFETY: (oy, ox, oc) lies in the output.
        let finish = |oy, ox, oc, sum| unsafe { self.finish(run, oy, ox, oc, sum) };
        // SAFETY: `check` proved that the input with its halo lies in the buffer.
        unsafe { convolve(&walk, run.input, weights, bias, add, finish) }
    }

    /// # Safety
    /// As [`QConv::run_part`].
    pub(super) unsafe fn run_winograd_reference(&self, weights: &TransformedWeights, run: &Run) {
        let (height, width) = (run.in_layout.height(), run.in_layout.width());
        let depth = self.shape.group_in();
        let out_per_group = self.shape.group_out();
        let padding = self.shape.padding() as isize;
        let mut v = vec![[0; POINTS]; depth];
        let tile_rows = run.part.rows.start / OUT..run.part.rows.end.div_ceil(OUT);
        for group in run.part.groups.clone() {
            for ty in tile_rows.clone() {
                for tx in 0..run.out_layout.width().div_ceil(OUT) {
                    for (ic, points) in v.iter_mut().enumerate() {
                        *points = reference::input(&std::array::from_fn(|i| {
                            let y = (ty * OUT + i / IN) as isize - padding;
                            let x = (tx * OUT + i % IN) as isize - padding;
                            let inside =
                                y < height as isize + padding && x < width as isize + padding;
                            if inside {
                                let at = run.in_layout.index(y, x) + group * depth + ic;
                                // SAFETY: (y, x) is at most `padding` pixels outside the input, which is checked to be
                                // readable.
                                i32::from(unsafe { *run.input.add(at) })
                            } else {
                                0
                            }
                        }));
                    }
                    for oc in group * out_per_group..(group + 1) * out_per_group {
                        let values = reference::tile(weights, oc, &v);
                        for (i, &value) in values.iter().enumerate() {
                            let (oy, ox) = (ty * OUT + i / OUT, tx * OUT + i % OUT);
                            if run.part.rows.contains(&oy) && ox < run.out_layout.width() {
                                // SAFETY: (oy, ox, oc) lies in the output.
                                unsafe { self.finish(run, oy, ox, oc, value) };
                            }
                        }
                    }
                }
            }
        }
    }

    /// Applies the epilogue to one accumulator.
    ///
    /// # Safety
    /// (oy, ox, oc) lies in the output, which this run owns.
    unsafe fn finish(&self, run: &Run, oy: usize, ox: usize, oc: usize, acc: i32) {
        let at = |layout: &Layout| layout.index(oy as isize, ox as isize) + oc;
        let added = match run.residual {
            // SAFETY: the residual has the output's size.
            Some((pointer, layout)) => unsafe { *pointer.add(at(layout)) },
            None => 0,
        };
        let to = at(run.out_layout);
        // SAFETY: the caller's contract.
        unsafe {
            match run.output {
                Output::U8(data) => *data.add(to) = self.epilogue.to_u8(oc, acc, added),
                Output::F32(data) => *data.add(to) = self.epilogue.to_f32(oc, acc),
            }
        }
    }
}

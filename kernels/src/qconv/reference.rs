//! The scalar int8 convolution: the specification that every other tier must equal bit for bit.

use super::QConv;
use super::epilogue::Output;
use super::run::Run;
use crate::Layout;
use crate::naive::{Walk, convolve};
use crate::winograd::int8::{TransformedWeights, reference};
use crate::winograd::walk;

impl QConv {
    fn walk<'a>(&'a self, run: &'a Run) -> Walk<'a> {
        Walk {
            shape: &self.shape,
            phases: &self.phases,
            part: run.part,
            in_layout: run.in_layout,
            out_width: run.out_layout.width(),
        }
    }

    /// # Safety
    /// As [`QConv::run_part`].
    pub(super) unsafe fn run_reference(&self, weights: &[i8], bias: &[i32], run: &Run) {
        let add = |sum, value: u8, weight: i8| sum + i32::from(value) * i32::from(weight);
        // SAFETY: the walk gives rows of `part`, ox < out_width and oc < out_channels; `check` put these in the buffer.
        let finish = |oy, ox, oc, sum| unsafe { self.finish(run, oy, ox, oc, sum) };
        // SAFETY: `check` proved that the input with its halo lies in the buffer.
        unsafe { convolve(&self.walk(run), run.input, weights, bias, add, finish) }
    }

    /// # Safety
    /// As [`QConv::run_part`].
    pub(super) unsafe fn run_winograd_reference(&self, weights: &TransformedWeights, run: &Run) {
        let transform = |d: &[u8; _]| reference::input(&d.map(i32::from));
        let tile = |oc, v: &[_]| reference::tile(weights, oc, v);
        // SAFETY: the walk gives rows of `part`, ox < out_width and oc < out_channels; `check` put these in the buffer.
        let finish = |oy, ox, oc, sum| unsafe { self.finish(run, oy, ox, oc, sum) };
        // SAFETY: `check` proved that the input with its halo lies in the buffer.
        unsafe { walk(&self.walk(run), run.input, transform, tile, finish) }
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

//! The scalar f32 convolutions, the oracles of the other tiers: the definition, summed in f32 in the order of taps and
//! channels, and Winograd.

use super::{FConv, Run};
use crate::Layout;
use crate::naive::{Walk, convolve};
use crate::winograd::float::{Points, reference};
use crate::winograd::walk;

impl FConv {
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
    /// As [`FConv::run_part`].
    pub(super) unsafe fn run_reference(&self, weights: &[f32], bias: &[f32], run: &Run) {
        let add = |sum, value: f32, weight: f32| sum + value * weight;
        // SAFETY: the walk gives rows of `part`, ox < out_width and oc < out_channels; `check` put these in the buffer.
        let finish = |oy, ox, oc, sum| unsafe { self.finish(run, oy, ox, oc, sum) };
        // SAFETY: `check` proved that the input with its halo lies in the buffer.
        unsafe { convolve(&self.walk(run), run.input, weights, bias, add, finish) }
    }

    /// # Safety
    /// As [`FConv::run_part`].
    pub(super) unsafe fn run_winograd_reference(
        &self,
        weights: &[Points],
        bias: &[f32],
        run: &Run,
    ) {
        let tile = |oc: usize, v: &[Points]| reference::tile(&weights[oc * v.len()..], v);
        // SAFETY: the walk gives rows of `part`, ox < out_width and oc < out_channels; `check` put these in the buffer.
        let finish =
            |oy, ox, oc: usize, sum| unsafe { self.finish(run, oy, ox, oc, sum + bias[oc]) };
        // SAFETY: `check` proved that the input with its halo lies in the buffer.
        unsafe { walk(&self.walk(run), run.input, reference::input, tile, finish) }
    }

    /// What becomes of one sum.
    ///
    /// # Safety
    /// (oy, ox, oc) lies in the output, which this run owns.
    unsafe fn finish(&self, run: &Run, oy: usize, ox: usize, oc: usize, mut sum: f32) {
        let at = |layout: &Layout| layout.index(oy as isize, ox as isize) + oc;
        if let Some((pointer, layout)) = run.residual {
            // SAFETY: the residual has the output's size.
            sum += unsafe { *pointer.add(at(layout)) };
        }
        if self.relu {
            sum = sum.max(0.0);
        }
        // SAFETY: the caller's contract.
        unsafe { *run.output.add(at(run.out_layout)) = sum };
    }
}

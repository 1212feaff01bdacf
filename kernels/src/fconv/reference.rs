//! The scalar f32 convolution, summed in f32 in the order of taps and channels: the oracle of the other tiers.

use super::{FConv, Run};
use crate::Layout;
use crate::naive::{Walk, convolve};

impl FConv {
    /// # Safety
    /// As [`FConv::run_part`].
    pub(super) unsafe fn run_reference(&self, weights: &[f32], bias: &[f32], run: &Run) {
        let walk = Walk {
            shape: &self.shape,
            phases: &self.phases,
            part: run.part,
            in_layout: run.in_layout,
            out_width: run.out_layout.width(),
        };
        let add = |sum, value: f32, weight: f32| sum + value * weight;
        let finish = |oy, ox, oc, mut sum: f32| {
            let at = |layout: &Layout| layout.index(oy as isize, ox as isize) + oc;
            if let Some((pointer, layout)) = run.residual {
                // SAFETY: (oy, ox, oc) lies in the residual, which has the output's size.
                sum += unsafe { *pointer.add(at(layout)) };
            }
            if self.relu {
                sum = sum.max(0.0);
            }
            // SAFETY: (oy, ox, oc) lies in the output.
            unsafe { *run.output.add(at(run.out_layout)) = sum };
        };
        // SAFETY: `check` proved that the input with its halo lies in the buffer.
        unsafe { convolve(&walk, run.input, weights, bias, add, finish) }
    }
}

//! The scalar f32 convolution, summed in f32 in the order of taps and channels: the oracle of the other tiers.

use super::{FConv, Run};
use crate::Layout;

impl FConv {
    /// # Safety
    /// As [`FConv::run_part`].
    pub(super) unsafe fn run_reference(&self, weights: &[f32], bias: &[f32], run: &Run) {
        let &Run {
            input,
            in_layout,
            residual,
            output,
            out_layout,
            part,
        } = run;
        let shape = &self.shape;
        let depth = shape.in_channels / shape.groups;
        let out_per_group = shape.out_channels / shape.groups;
        for phase in &self.phases {
            let rows = part
                .rows
                .clone()
                .filter(|row| row % phase.out_step == phase.first_row);
            for oy in rows {
                let y = (oy / phase.out_step * phase.in_step) as isize;
                for ox in (phase.first_column..out_layout.width).step_by(phase.out_step) {
                    let x = (ox / phase.out_step * phase.in_step) as isize;
                    let channels =
                        part.groups.start * out_per_group..part.groups.end * out_per_group;
                    for oc in channels {
                        let first = oc / out_per_group * depth;
                        let mut acc = bias[oc];
                        for tap in &phase.taps {
                            let at = in_layout.index(y + tap.dy, x + tap.dx) + first;
                            for ic in 0..depth {
                                // SAFETY: `check` proved that the input with its halo lies in the buffer, and taps reach
                                // at most `input_halo()` pixels beyond the tensor; first + ic < in_channels.
                                let value = unsafe { *input.add(at + ic) };
                                acc += value
                                    * weights[((oc * depth + ic) * shape.kernel + tap.ky)
                                        * shape.kernel
                                        + tap.kx];
                            }
                        }
                        let at = |layout: &Layout| layout.index(oy as isize, ox as isize) + oc;
                        if let Some((pointer, layout)) = residual {
                            // SAFETY: (oy, ox, oc) lies in the residual, which has the output's size.
                            acc += unsafe { *pointer.add(at(layout)) };
                        }
                        if self.relu {
                            acc = acc.max(0.0);
                        }
                        // SAFETY: (oy, ox, oc) lies in the output.
                        unsafe { *output.add(at(out_layout)) = acc };
                    }
                }
            }
        }
    }
}

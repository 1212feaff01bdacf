//! The scalar int8 convolution: the specification that every other tier must equal bit for bit.

use super::QConv;
use super::epilogue::Output;
use super::kernel::Run;
use crate::Layout;

impl QConv {
    /// # Safety
    /// As [`QConv::run_part`].
    pub(super) unsafe fn run_reference(&self, weights: &[i8], bias: &[i32], run: &Run) {
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
                                let weight = weights[((oc * depth + ic) * shape.kernel + tap.ky)
                                    * shape.kernel
                                    + tap.kx];
                                acc += i32::from(value) * i32::from(weight);
                            }
                        }
                        let at = |layout: &Layout| layout.index(oy as isize, ox as isize) + oc;
                        let added = match residual {
                            // SAFETY: (oy, ox, oc) lies in the residual, which has the output's size.
                            Some((pointer, layout)) => unsafe { *pointer.add(at(layout)) },
                            None => 0,
                        };
                        let to = at(out_layout);
                        // SAFETY: (oy, ox, oc) lies in the output.
                        unsafe {
                            match output {
                                Output::U8(data) => {
                                    *data.add(to) = self.epilogue.to_u8(oc, acc, added);
                                }
                                Output::F32(data) => *data.add(to) = self.epilogue.to_f32(oc, acc),
                            }
                        }
                    }
                }
            }
        }
    }
}

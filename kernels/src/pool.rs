//! Max-pool, u8 or f32, over a tensor whose halo holds the padding value.

use crate::tensor::{Element, Expected};
use crate::{Isa, KernelError, Layout, Part, Tensor, TensorMut};

/// A max-pool with a square window. Padding takes part with the halo's value: after ReLU that is 0, which never wins wrongly.
#[derive(Debug, Clone)]
pub struct MaxPool {
    isa: Isa,
    kernel: usize,
    stride: usize,
    padding: usize,
}

/// Element type that can be pooled.
pub trait PoolElement: Element + PartialOrd {}
impl PoolElement for u8 {}
impl PoolElement for f32 {}

impl MaxPool {
    /// A pool of `kernel` × `kernel` with this stride and padding.
    ///
    /// # Errors
    /// When the CPU lacks `isa`, or the numbers do not fit together.
    pub fn new(
        isa: Isa,
        kernel: usize,
        stride: usize,
        padding: usize,
    ) -> Result<Self, KernelError> {
        if !isa.is_available() {
            return Err(KernelError::Unsupported(isa));
        }
        if kernel == 0 || stride == 0 || padding >= kernel {
            return Err(KernelError::Shape(format!(
                "expected pool window > padding and stride > 0, found window {kernel}, padding {padding}, stride {stride}; correct the channel table"
            )));
        }
        Ok(Self {
            isa,
            kernel,
            stride,
            padding,
        })
    }

    /// The tier it was built for.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Output rows or columns for `n` input rows or columns.
    pub fn output_len(&self, n: usize) -> usize {
        (n + 2 * self.padding - self.kernel) / self.stride + 1
    }

    /// Share `index` of `count` of the work.
    ///
    /// # Panics
    /// Unless `index < count`.
    pub fn part(&self, out_height: usize, index: usize, count: usize) -> Part {
        Part::share(out_height, 1, 1, index, count)
    }

    /// Checks layouts and buffer lengths (elements) for a run.
    ///
    /// # Errors
    /// When a tensor does not fit.
    pub fn check(
        &self,
        input: (&Layout, usize),
        output: (&Layout, usize),
    ) -> Result<(), KernelError> {
        let Layout {
            height,
            width,
            channels,
            ..
        } = *input.0;
        if height.min(width) + 2 * self.padding < self.kernel {
            return Err(KernelError::Tensor(format!(
                "input: expected at least {} rows and columns with padding, found {height}x{width}; use a larger picture",
                self.kernel
            )));
        }
        Expected {
            role: "input",
            height,
            width,
            channels,
            halo: self.padding,
        }
        .check(input.0, input.1)?;
        Expected {
            role: "output",
            height: self.output_len(height),
            width: self.output_len(width),
            channels,
            halo: 0,
        }
        .check(output.0, output.1)
    }

    /// Runs over separate buffers.
    ///
    /// # Errors
    /// When a tensor does not fit.
    pub fn run<T: PoolElement>(
        &self,
        input: Tensor<T>,
        output: TensorMut<T>,
    ) -> Result<(), KernelError> {
        self.check(
            (&input.layout, input.data.len()),
            (&output.layout, output.data.len()),
        )?;
        let part = Part::whole(output.layout.height, 1);
        // SAFETY: both layouts lie within their slices (checked above), which the borrows keep separate.
        unsafe {
            self.run_part(
                input.data.as_ptr(),
                &input.layout,
                output.data.as_mut_ptr(),
                &output.layout,
                &part,
            );
        }
        Ok(())
    }

    /// Runs one share. Allocates nothing.
    ///
    /// # Safety
    /// The contract of [`QConv::run_part`](crate::QConv::run_part), with [`check`](Self::check) of this type.
    pub unsafe fn run_part<T: PoolElement>(
        &self,
        input: *const T,
        in_layout: &Layout,
        output: *mut T,
        out_layout: &Layout,
        part: &Part,
    ) {
        for oy in part.rows.clone() {
            for ox in 0..out_layout.width {
                let to = out_layout.index(oy as isize, ox as isize);
                for tap in 0..self.kernel * self.kernel {
                    let y = (oy * self.stride + tap / self.kernel) as isize - self.padding as isize;
                    let x = (ox * self.stride + tap % self.kernel) as isize - self.padding as isize;
                    let from = in_layout.index(y, x);
                    for channel in 0..out_layout.channels {
                        // SAFETY: (y, x) lies within `padding` pixels of the input, which `check` proved readable, and
                        // (oy, ox) within the output; channel < channels of both.
                        unsafe {
                            let value = *input.add(from + channel);
                            let best = output.add(to + channel);
                            if tap == 0 || value > *best {
                                *best = value;
                            }
                        }
                    }
                }
            }
        }
    }
}

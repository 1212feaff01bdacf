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
        let job = Job {
            kernel: self.kernel,
            stride: self.stride,
            padding: self.padding,
            input,
            in_layout,
            output,
            out_layout,
            part,
        };
        // SAFETY: the caller's contract; `new` checked that the CPU has the tier.
        unsafe {
            match self.isa {
                #[cfg(target_arch = "x86_64")]
                Isa::Avx2 | Isa::AvxVnni => pool_avx2(&job),
                #[cfg(target_arch = "x86_64")]
                Isa::Avx512 | Isa::Avx512Vnni => pool_avx512(&job),
                _ => pool(&job),
            }
        }
    }
}

/// Tensors of one run.
struct Job<'a, T> {
    kernel: usize,
    stride: usize,
    padding: usize,
    input: *const T,
    in_layout: &'a Layout,
    output: *mut T,
    out_layout: &'a Layout,
    part: &'a Part,
}

/// Channels taken together: one vector of u8.
const LANES: usize = 64;

/// # Safety
/// As [`MaxPool::run_part`]; AVX2 is there.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn pool_avx2<T: PoolElement>(job: &Job<T>) {
    // SAFETY: the caller's contract.
    unsafe { pool(job) }
}

/// # Safety
/// As [`MaxPool::run_part`]; AVX-512 F, BW and VL are there.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512vl")]
unsafe fn pool_avx512<T: PoolElement>(job: &Job<T>) {
    // SAFETY: the caller's contract.
    unsafe { pool(job) }
}

/// The pool in plain loops, which the compiler turns into vectors of the tier.
///
/// # Safety
/// As [`MaxPool::run_part`].
#[inline(always)]
unsafe fn pool<T: PoolElement>(job: &Job<T>) {
    let channels = job.out_layout.channels;
    for oy in job.part.rows.clone() {
        for ox in 0..job.out_layout.width {
            let to = job.out_layout.index(oy as isize, ox as isize);
            let y = (oy * job.stride) as isize - job.padding as isize;
            let x = (ox * job.stride) as isize - job.padding as isize;
            let from = |tap: usize| {
                let (ky, kx) = ((tap / job.kernel) as isize, (tap % job.kernel) as isize);
                job.in_layout.index(y + ky, x + kx)
            };
            let taps = job.kernel * job.kernel;
            let mut first = 0;
            // SAFETY: taps lie within `padding` pixels of the input, which `check` proved readable, and (oy, ox) within the
            // output; first + n <= channels of both.
            unsafe {
                while first + LANES <= channels {
                    let mut best = [T::default(); LANES];
                    let load =
                        |tap| std::slice::from_raw_parts(job.input.add(from(tap) + first), LANES);
                    best.copy_from_slice(load(0));
                    for tap in 1..taps {
                        for (best, &value) in best.iter_mut().zip(load(tap)) {
                            *best = if value > *best { value } else { *best };
                        }
                    }
                    let output = job.output.add(to + first);
                    std::ptr::copy_nonoverlapping(best.as_ptr(), output, LANES);
                    first += LANES;
                }
                for channel in first..channels {
                    let mut best = *job.input.add(from(0) + channel);
                    for tap in 1..taps {
                        let value = *job.input.add(from(tap) + channel);
                        best = if value > best { value } else { best };
                    }
                    *job.output.add(to + channel) = best;
                }
            }
        }
    }
}

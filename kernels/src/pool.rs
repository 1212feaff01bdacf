//! Max-pool, u8 or f32, over a tensor whose halo holds the padding value.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::kernel::{Pool, Ready, Tier};
use crate::tensor::{Element, Expected};
use crate::{Isa, KernelError, Layout, Part, PoolShape, Tensor, TensorMut};

/// A max-pool with a square window. Padding takes part with the halo's value: after ReLU that is 0, which never wins wrongly.
///
/// ```
/// use edgecap_kernels::{Isa, Layout, MaxPool, PoolShape, Tensor, TensorMut};
///
/// let pool = MaxPool::new(Isa::detect()?, PoolShape::new(2, 2, 0)?)?;
/// let (from, to) = (Layout::dense(2, 4, 1, 0)?, Layout::dense(1, 2, 1, 0)?);
/// let mut output = [0u8; 2];
/// pool.run(Tensor::new(&[1, 2, 3, 4, 8, 7, 6, 5], from), TensorMut::new(&mut output, to))?;
/// assert_eq!(output, [8, 6]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct MaxPool {
    isa: Isa,
    /// The tier's own; plain loops without one.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    tier: Option<Ready<Pool>>,
    shape: PoolShape,
}

/// Element type that can be pooled.
pub trait PoolElement: Element + PartialOrd + sealed::Leaf {}
impl PoolElement for u8 {}
impl PoolElement for f32 {}

mod sealed {
    use super::Job;
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    use super::Pool;

    /// Which of a tier's functions pools this type.
    pub trait Leaf: Sized {
        #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
        #[allow(private_interfaces)]
        fn of(pool: &Pool) -> unsafe fn(&Job<'_, Self>);
    }

    impl Leaf for u8 {
        #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
        #[allow(private_interfaces)]
        fn of(pool: &Pool) -> unsafe fn(&Job<'_, Self>) {
            pool.u8
        }
    }

    impl Leaf for f32 {
        #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
        #[allow(private_interfaces)]
        fn of(pool: &Pool) -> unsafe fn(&Job<'_, Self>) {
            pool.f32
        }
    }
}

impl MaxPool {
    /// A pool of this shape.
    ///
    /// # Errors
    /// When the CPU lacks `isa`.
    pub fn new(isa: Isa, shape: PoolShape) -> Result<Self, KernelError> {
        if !isa.is_available() {
            return Err(KernelError::Unsupported(isa));
        }
        Ok(Self {
            isa,
            #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
            tier: Tier::of(isa).and_then(|tier| Ready::new(tier.pool)),
            shape,
        })
    }

    /// Its window.
    pub fn shape(&self) -> PoolShape {
        self.shape
    }

    /// The kernel's name, for logs and benches.
    pub fn name(&self) -> &'static str {
        #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
        if let Some(tier) = &self.tier {
            return tier.name;
        }
        "maxpool__scalar"
    }

    /// The tier it was built for.
    pub fn isa(&self) -> Isa {
        self.isa
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
        let (height, width) = (input.0.height(), input.0.width());
        let channels = input.0.channels();
        if self.shape.output_len(height.min(width)) == 0 {
            return Err(KernelError::Tensor(format!(
                "input: expected at least {} rows and columns with padding, found {height}x{width}; use a larger picture",
                self.shape.kernel()
            )));
        }
        Expected {
            role: "input",
            height,
            width,
            channels,
            halo: self.shape.padding(),
        }
        .check(input.0, input.1)?;
        Expected {
            role: "output",
            height: self.shape.output_len(height),
            width: self.shape.output_len(width),
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
        let part = Part::whole(output.layout.height(), 1);
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
            kernel: self.shape.kernel(),
            stride: self.shape.stride(),
            padding: self.shape.padding(),
            input,
            in_layout,
            output,
            out_layout,
            part,
        };
        // SAFETY: the caller's contract; `Ready` proves that the CPU has the leaf's features.
        unsafe {
            #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
            if let Some(tier) = &self.tier {
                return T::of(tier)(&job);
            }
            pool(&job);
        }
    }
}

/// Tensors of one run.
pub(crate) struct Job<'a, T> {
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

/// The pool in plain loops, which the compiler turns into vectors of the tier.
///
/// # Safety
/// As [`MaxPool::run_part`].
#[inline(always)]
pub(crate) unsafe fn pool<T: PoolElement>(job: &Job<T>) {
    let channels = job.out_layout.channels();
    for oy in job.part.rows.clone() {
        for ox in 0..job.out_layout.width() {
            let to = job.out_layout.index(oy as isize, ox as isize);
            let y = (oy * job.stride) as isize - job.padding as isize;
            let x = (ox * job.stride) as isize - job.padding as isize;
            let from = |tap: usize| {
                let (ky, kx) = ((tap / job.kernel) as isize, (tap % job.kernel) as isize);
                job.in_layout.index(y + ky, x + kx)
            };
            let taps = job.kernel * job.kernel;
            let mut first = 0;
            // SAFETY: row y + ky <= (out_height - 1) · stride + kernel - 1 - padding <= height - 1 + padding, columns likewise, and
            // both are >= -padding: `check` proved padding <= halo and the halo readable. (oy, ox) lies in the output (the part
            // lies within its rows, caller). first + LANES <= channels of both, and channel < channels.
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

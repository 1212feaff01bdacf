//! Max-pool, u8 or f32, over a tensor whose halo holds the padding value.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::kernel::{Pool, Ready, Tier};
use crate::pool::{Job, pool};
use crate::tensor::{Element, Expected};
use crate::{Isa, KernelError, Layout, Part, PoolShape, Tensor, TensorMut};

/// A max-pool with a square window. Padding takes part with the halo's value: after ReLU that is 0, which never wins
/// wrongly.
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
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    use super::Pool;
    use crate::pool::Job;

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

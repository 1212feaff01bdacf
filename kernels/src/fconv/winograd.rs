//! f32 convolution with the Winograd kernels of this architecture.

use super::{FConvParams, Run};
use crate::kernel::{FloatWinograd, Ready, Tier};
use crate::winograd::POINTS;
use crate::winograd::float::Points;
use crate::winograd::generic::{Floats, Prepared};
use crate::writers::Biased;
use crate::{Isa, Scratch};

/// Transformed weights and bias in a Winograd kernel's order.
#[derive(Debug, Clone)]
pub(super) struct Winograd {
    prepared: Prepared<Floats>,
    bias: Vec<f32>,
    kernel: Ready<FloatWinograd>,
}

impl Winograd {
    /// Packs transformed `weights` for `isa`, or `None` where only the reference can run the shape.
    pub fn new(isa: Isa, params: &FConvParams, weights: &[Points]) -> Option<Self> {
        let kernel = Ready::new(Tier::of(isa)?.float_winograd)?;
        let weight = |i: usize| weights[i / POINTS][i % POINTS].to_le_bytes();
        let prepared = Prepared::new(&params.shape, kernel.blocking, kernel.plan, weight)?;
        Some(Self {
            bias: prepared.packed().per_channel(params.bias),
            prepared,
            kernel,
        })
    }

    pub fn name(&self) -> &'static str {
        self.kernel.name
    }

    pub fn scratch_bytes(&self) -> usize {
        self.prepared.scratch_bytes()
    }

    /// # Safety
    /// As `FConv::run_part`.
    pub unsafe fn run(&self, relu: bool, run: &Run, scratch: &mut Scratch) {
        let writer = Biased {
            bias: self.bias.as_ptr(),
            to: run.writer(relu),
        };
        let input = (run.input, run.in_layout);
        let job = self
            .prepared
            .job((), input, run.out_layout, run.part, scratch);
        // SAFETY: `Ready` proves that the CPU has the features, `FConv::check` that the tensors fit (caller).
        unsafe { (self.kernel.run)(&job, &writer) };
    }
}

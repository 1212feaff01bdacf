//! f32 convolution with the direct kernels of this architecture.

use super::{FConvParams, Run};
use crate::Isa;
use crate::direct::Job;
use crate::kernel::{FloatDirect, Ready, Tier};
use crate::packed::Packed;

/// Weights and bias in a direct kernel's order.
#[derive(Debug, Clone)]
pub(super) struct Direct {
    packed: Packed,
    bias: Vec<f32>,
    kernel: Ready<FloatDirect>,
}

impl Direct {
    /// Packs for `isa`, or `None` where only the reference can run the shape.
    pub fn new(isa: Isa, params: &FConvParams) -> Option<Self> {
        let kernel = Ready::new(Tier::of(isa)?.float)?;
        let shape = &params.shape;
        let depth = shape.group_in();
        let packed = Packed::new(shape, kernel.blocking, |oc, ic, tap| {
            let at = ((oc * depth + ic) * shape.kernel() + tap.ky) * shape.kernel() + tap.kx;
            params.weights[at].to_le_bytes()
        })?;
        Some(Self {
            bias: packed.per_channel(params.bias),
            packed,
            kernel,
        })
    }

    pub fn name(&self) -> &'static str {
        self.kernel.name
    }

    /// # Safety
    /// As `FConv::run_part`.
    pub unsafe fn run(&self, relu: bool, run: &Run) {
        let writer = run.writer(relu);
        // SAFETY: `Ready` proves that the CPU has the features, `FConv::check` that the tensors fit (caller).
        unsafe {
            let job = Job::new(
                &self.packed,
                &self.bias,
                run.input,
                run.in_layout,
                run.out_layout,
                run.part,
            );
            (self.kernel.run)(&job, &writer);
        }
    }
}

//! f32 convolution with the direct kernels of this architecture.

use super::{FConvParams, Run};
use crate::direct::Job;
use crate::packed::Packed;
use crate::writers::Float;
use crate::{Isa, arch};

/// Weights and bias in a direct kernel's order.
#[derive(Debug, Clone)]
pub(super) struct Direct {
    packed: Packed,
    bias: Vec<f32>,
    isa: Isa,
}

impl Direct {
    /// Packs for `isa`, or `None` where only the reference can run the shape.
    pub fn new(isa: Isa, params: &FConvParams) -> Option<Self> {
        if isa == Isa::Scalar {
            return None;
        }
        let shape = &params.shape;
        let depth = shape.in_channels / shape.groups;
        let packed = Packed::new(shape, arch::f32_grain(isa), |oc, ic, tap| {
            let at = ((oc * depth + ic) * shape.kernel + tap.ky) * shape.kernel + tap.kx;
            params.weights[at].to_le_bytes()
        })?;
        Some(Self {
            bias: packed.per_channel(params.bias),
            packed,
            isa,
        })
    }

    pub fn name(&self) -> &'static str {
        arch::f32_name(self.isa)
    }

    /// # Safety
    /// As `FConv::run_part`.
    pub unsafe fn run(&self, relu: bool, run: &Run) {
        let writer = Float {
            relu,
            residual: run.residual,
            output: run.output,
            layout: run.out_layout,
        };
        // SAFETY: `FConv::new` checked that the CPU has the tier, `FConv::check` that the tensors fit.
        unsafe {
            let job = Job::new(
                &self.packed,
                None,
                &self.bias,
                run.input,
                run.in_layout,
                run.out_layout,
                run.part,
            );
            arch::f32(self.isa, &job, &writer);
        }
    }
}

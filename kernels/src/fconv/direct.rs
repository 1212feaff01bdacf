//! f32 convolution with the direct kernels of the x86 tiers.

use super::{FConvParams, Run};
use crate::direct::Job;
use crate::packed::{Grain, Packed};
use crate::simd::{avx2, avx512};
use crate::writers::Float;
use crate::{Isa, x86};

/// Weights and bias in a direct kernel's order.
#[derive(Debug, Clone)]
pub(super) struct Direct {
    packed: Packed,
    bias: Vec<f32>,
    wide: bool,
}

impl Direct {
    /// Packs for `isa`, or `None` where only the reference can run the shape.
    pub fn new(isa: Isa, params: &FConvParams) -> Option<Self> {
        let (wide, grain) = match isa {
            Isa::Scalar => return None,
            Isa::Avx2 | Isa::AvxVnni => (false, Grain::of::<avx2::F32>()),
            Isa::Avx512 | Isa::Avx512Vnni => (true, Grain::of::<avx512::F32>()),
        };
        let shape = &params.shape;
        let depth = shape.in_channels / shape.groups;
        let packed = Packed::new(shape, grain, |oc, ic, tap| {
            let at = ((oc * depth + ic) * shape.kernel + tap.ky) * shape.kernel + tap.kx;
            params.weights[at].to_le_bytes()
        })?;
        Some(Self {
            bias: packed.per_channel(params.bias),
            packed,
            wide,
        })
    }

    pub fn name(&self) -> &'static str {
        if self.wide {
            "f32_direct_8x48__avx512"
        } else {
            "f32_direct_4x24__avx2"
        }
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
            if self.wide {
                x86::f32_direct_avx512(&job, &writer);
            } else {
                x86::f32_direct_avx2(&job, &writer);
            }
        }
    }
}

//! int8 convolution with the vector kernels of this architecture.

use super::epilogue::Output;
use super::kernel::Run;
use super::{Epilogue, QConvParams};
use crate::arch::{self, Sum};
use crate::direct;
use crate::packed::Packed;
use crate::segments::Segments;
use crate::winograd::generic::{self as winograd, Plan};
use crate::winograd::{POINTS, TransformedWeights};
use crate::writers::{Residual, ToF32, ToU8};
use crate::{ConvShape, Isa, Scratch};

/// Weights and per-channel constants in a kernel's order.
#[derive(Debug, Clone)]
pub(super) struct Vector {
    isa: Isa,
    packed: Packed,
    bias: Vec<i32>,
    scale: Vec<f32>,
    narrow: bool,
    method: Method,
}

#[derive(Debug, Clone)]
enum Method {
    /// The definition; segments where the tier sums in i16.
    Direct(Sum, Option<Segments>),
    /// F(4×4, 3×3) in i16.
    Winograd(Winograd),
}

#[derive(Debug, Clone)]
struct Winograd {
    plan: Plan,
    zeros: Vec<u8>,
    padding: usize,
    shift: [u32; POINTS],
}

impl Vector {
    /// Packs a direct convolution for `isa`, or `None` where only the reference can run the shape.
    pub fn direct(isa: Isa, params: &QConvParams) -> Option<Self> {
        if isa == Isa::Scalar {
            return None;
        }
        let pack = |sum: Sum| {
            let shape = &params.shape;
            let depth = shape.in_channels / shape.groups;
            Packed::new(shape, arch::int8_grain(isa, sum), |oc, ic, tap| {
                let at = ((oc * depth + ic) * shape.kernel + tap.ky) * shape.kernel + tap.kx;
                [params.weights[at] as u8]
            })
        };
        let mut sum = arch::int8_sum(isa, params.input_max);
        let mut packed = pack(sum)?;
        let mut segments = None;
        if sum == Sum::Short && arch::is_segmented(isa) {
            segments = Segments::new(&packed, params.input_max);
            if segments.is_none() {
                sum = Sum::Wide;
                packed = pack(sum)?;
            }
        }
        Some(Self {
            isa,
            bias: packed.per_channel(params.bias),
            scale: packed.per_channel(params.epilogue.scale()),
            packed,
            narrow: params.epilogue.is_narrow(),
            method: Method::Direct(sum, segments),
        })
    }

    /// Packs transformed weights for `isa`, or `None` where only the reference can run the shape. `epilogue` is for Y.
    pub fn winograd(
        isa: Isa,
        shape: &ConvShape,
        weights: &TransformedWeights,
        epilogue: &Epilogue,
    ) -> Option<Self> {
        if isa == Isa::Scalar {
            return None;
        }
        let depth = shape.in_channels / shape.groups;
        // The 36 points take the place of kernel elements.
        let points = ConvShape {
            kernel: 6,
            ..*shape
        };
        let packed = Packed::new(&points, arch::winograd_grain(isa), |oc, ic, tap| {
            let at = (oc * depth + ic) * POINTS + tap.ky * points.kernel + tap.kx;
            weights.weights[at].to_le_bytes()
        })?;
        let winograd = Winograd {
            plan: arch::winograd_plan(isa, depth),
            zeros: vec![0; depth],
            padding: shape.padding,
            shift: weights.shift,
        };
        Some(Self {
            isa,
            bias: packed.per_channel(&weights.bias),
            scale: packed.per_channel(epilogue.scale()),
            packed,
            narrow: epilogue.is_narrow(),
            method: Method::Winograd(winograd),
        })
    }

    pub fn name(&self) -> &'static str {
        match &self.method {
            Method::Direct(sum, _) => arch::int8_name(self.isa, *sum),
            Method::Winograd(_) => arch::winograd_name(self.isa),
        }
    }

    pub fn scratch_bytes(&self) -> usize {
        match &self.method {
            Method::Winograd(winograd) => winograd.plan.bytes(),
            Method::Direct(..) => 0,
        }
    }

    /// # Safety
    /// As `QConv::run_part`; `writer` writes the run's output.
    unsafe fn run_with<W: arch::IntWriter>(&self, run: &Run, scratch: &mut Scratch, writer: &W) {
        // SAFETY: `QConv::new` checked that the CPU has the tier, `QConv::check` that the tensors fit, `QConv::run_part` that
        // the scratch does.
        unsafe {
            match &self.method {
                Method::Direct(sum, segments) => {
                    let job = direct::Job::new(
                        &self.packed,
                        segments.as_ref(),
                        &self.bias,
                        run.input,
                        run.in_layout,
                        run.out_layout,
                        run.part,
                    );
                    arch::int8(self.isa, *sum, &job, writer);
                }
                Method::Winograd(winograd) => {
                    let job = winograd::Job {
                        packed: &self.packed,
                        bias: self.bias.as_ptr(),
                        shift: &winograd.shift,
                        channels: winograd.zeros.len(),
                        input: run.input,
                        in_layout: run.in_layout,
                        padding: winograd.padding,
                        zeros: winograd.zeros.as_ptr(),
                        out_layout: run.out_layout,
                        part: run.part,
                        plan: winograd.plan,
                        scratch: scratch.as_mut_bytes().as_mut_ptr(),
                    };
                    arch::winograd(self.isa, &job, writer);
                }
            }
        }
    }

    /// # Safety
    /// As `QConv::run_part`.
    pub unsafe fn run(&self, epilogue: &Epilogue, run: &Run, scratch: &mut Scratch) {
        let (scale, layout) = (self.scale.as_ptr(), run.out_layout);
        // SAFETY: the caller's contract.
        unsafe {
            match (epilogue, run.output) {
                (
                    &Epilogue::U8 {
                        max,
                        residual_scale,
                        ..
                    },
                    Output::U8(output),
                ) => {
                    let residual = run.residual.zip(residual_scale);
                    let writer = ToU8 {
                        scale,
                        max: f32::from(max),
                        narrow: self.narrow,
                        residual: residual.map(|((data, layout), scale)| Residual {
                            data,
                            layout,
                            scale,
                        }),
                        output,
                        layout,
                    };
                    self.run_with(run, scratch, &writer);
                }
                (Epilogue::F32 { .. }, Output::F32(output)) => {
                    let writer = ToF32 {
                        scale,
                        output,
                        layout,
                    };
                    self.run_with(run, scratch, &writer);
                }
                _ => unreachable!("the element type was checked"),
            }
        }
    }
}

//! int8 convolution with the vector kernels of this architecture.

use super::epilogue::Output;
use super::run::Run;
use super::{Epilogue, QConvParams};
use crate::direct::Job;
use crate::kernel::{Direct, DotProduct, Ready, Tier, Winograd};
use crate::packed::{Blocking, Packed, Panels};
use crate::segments::SegmentedPacked;
use crate::winograd::POINTS;
use crate::winograd::generic::{Integers, Prepared, Shift, Sums};
use crate::winograd::int8::TransformedWeights;
use crate::writers::{Residual, ToF32, ToU8};
use crate::{ConvShape, Isa, Scratch};

/// Weights and per-channel constants in a kernel's order.
#[derive(Debug, Clone)]
pub(super) struct Vector {
    bias: Vec<i32>,
    scale: Vec<f32>,
    narrow: bool,
    method: Method,
}

/// A kernel with the weights in the form that it reads.
#[derive(Debug, Clone)]
enum Method {
    /// The definition.
    Plain(Ready<Direct<Packed>>, Packed),
    /// The definition, summed in i16 segments.
    Segmented(Ready<Direct<SegmentedPacked>>, SegmentedPacked),
    /// F(4×4, 3×3) in i16.
    Winograd(Ready<Winograd>, Prepared<Integers>, Box<[Shift; POINTS]>),
}

impl Method {
    fn packed(&self) -> &Packed {
        match self {
            Method::Plain(_, packed) => packed,
            Method::Winograd(_, prepared, _) => prepared.packed(),
            Method::Segmented(_, segmented) => segmented.packed(),
        }
    }
}

impl Vector {
    /// Packs a direct convolution for `isa`, or `None` where only the reference can run the shape.
    pub fn direct(isa: Isa, params: &QConvParams) -> Option<Self> {
        let tier = Tier::of(isa)?;
        let pack = |blocking: Blocking| {
            let shape = &params.shape;
            let (depth, kernel) = (shape.group_in(), shape.kernel());
            Packed::new(shape, blocking, |oc, ic, tap| {
                let at = ((oc * depth + ic) * kernel + tap.ky) * kernel + tap.kx;
                [params.weights[at] as u8]
            })
        };
        let fast = match tier.dot {
            DotProduct::Plain { kernel, input_max } if params.input_max <= input_max => {
                let kernel = Ready::new(kernel)?;
                Some(Method::Plain(kernel, pack(kernel.blocking)?))
            }
            DotProduct::Plain { .. } => None,
            DotProduct::Choice {
                takes,
                kernel,
                otherwise,
            } => {
                let kernel = Ready::new(if takes(&params.shape) {
                    kernel
                } else {
                    otherwise
                })?;
                Some(Method::Plain(kernel, pack(kernel.blocking)?))
            }
            DotProduct::Segmented(kernel) => {
                let kernel = Ready::new(kernel)?;
                SegmentedPacked::new(pack(kernel.blocking)?, params.input_max)
                    .map(|segmented| Method::Segmented(kernel, segmented))
            }
        };
        let method = match fast {
            Some(method) => method,
            None => {
                let kernel = Ready::new(tier.widening)?;
                Method::Plain(kernel, pack(kernel.blocking)?)
            }
        };
        Some(Self::new(method, params.bias, &params.epilogue))
    }

    /// Packs transformed weights for `isa`, or `None` where only the reference can run the shape. `epilogue` is for Y.
    pub fn winograd(
        isa: Isa,
        shape: &ConvShape,
        weights: &TransformedWeights,
        epilogue: &Epilogue,
    ) -> Option<Self> {
        let kernel = Ready::new(Tier::of(isa)?.winograd)?;
        let weight = |i: usize| weights.weights[i].to_le_bytes();
        let prepared = Prepared::new(shape, kernel.blocking, kernel.plan, weight)?;
        let shifts = Box::new(weights.shift.map(Shift::new));
        let method = Method::Winograd(kernel, prepared, shifts);
        Some(Self::new(method, &weights.bias, epilogue))
    }

    fn new(method: Method, bias: &[i32], epilogue: &Epilogue) -> Self {
        let mut bias = method.packed().per_channel(bias);
        if let Method::Segmented(_, segmented) = &method {
            segmented.take_off_offsets(&mut bias);
        }
        Self {
            bias,
            scale: method.packed().per_channel(epilogue.scale()),
            narrow: epilogue.is_narrow(),
            method,
        }
    }

    pub fn name(&self) -> &'static str {
        match &self.method {
            Method::Plain(kernel, _) => kernel.name,
            Method::Segmented(kernel, _) => kernel.name,
            Method::Winograd(kernel, ..) => kernel.name,
        }
    }

    pub fn scratch_bytes(&self) -> usize {
        match &self.method {
            Method::Winograd(_, prepared, _) => prepared.scratch_bytes(),
            Method::Plain(..) | Method::Segmented(..) => 0,
        }
    }

    /// # Safety
    /// As `QConv::run_part`.
    unsafe fn job<'a, P: Panels>(&'a self, panels: &'a P, run: &'a Run) -> Job<'a, P> {
        // SAFETY: `input` is the start of the buffer that `in_layout` was checked for (caller).
        unsafe {
            Job::new(
                panels,
                &self.bias,
                run.input,
                run.in_layout,
                run.out_layout,
                run.part,
            )
        }
    }

    /// # Safety
    /// As `QConv::run_part`: among others `scratch.len() >= self.scratch_bytes()`, so that the plan's regions lie
    /// within.
    pub unsafe fn run(&self, epilogue: &Epilogue, run: &Run, scratch: &mut Scratch) {
        let writer = self.writer(epilogue, run);
        // SAFETY: `Ready` proves that the CPU has the kernel's features; tensors, part and scratch are as the caller
        // promises.
        unsafe {
            match (&self.method, &writer) {
                (Method::Plain(kernel, panels), Writer::U8(writer)) => {
                    (kernel.to_u8)(&self.job(panels, run), writer);
                }
                (Method::Plain(kernel, panels), Writer::F32(writer)) => {
                    (kernel.to_f32)(&self.job(panels, run), writer);
                }
                (Method::Segmented(kernel, panels), Writer::U8(writer)) => {
                    (kernel.to_u8)(&self.job(panels, run), writer);
                }
                (Method::Segmented(kernel, panels), Writer::F32(writer)) => {
                    (kernel.to_f32)(&self.job(panels, run), writer);
                }
                (Method::Winograd(kernel, prepared, shifts), writer) => {
                    let sums = Sums {
                        bias: self.bias.as_ptr(),
                        shifts,
                    };
                    let input = (run.input, run.in_layout);
                    let job = prepared.job(sums, input, run.out_layout, run.part, scratch);
                    match writer {
                        Writer::U8(writer) => (kernel.to_u8)(&job, writer),
                        Writer::F32(writer) => (kernel.to_f32)(&job, writer),
                    }
                }
            }
        }
    }

    /// What becomes of this run's accumulators.
    fn writer<'a>(&self, epilogue: &Epilogue, run: &Run<'a>) -> Writer<'a> {
        let (scale, layout) = (self.scale.as_ptr(), run.out_layout);
        match (epilogue, run.output) {
            (
                &Epilogue::U8 {
                    max,
                    residual_scale,
                    ..
                },
                Output::U8(output),
            ) => Writer::U8(ToU8 {
                scale,
                max: f32::from(max),
                narrow: self.narrow,
                residual: run
                    .residual
                    .zip(residual_scale)
                    .map(|((data, layout), scale)| Residual {
                        data,
                        layout,
                        scale,
                    }),
                output,
                layout,
            }),
            (Epilogue::F32 { .. }, Output::F32(output)) => Writer::F32(ToF32 {
                scale,
                output,
                layout,
            }),
            _ => unreachable!("the element type was checked"),
        }
    }
}

/// A writer for the run's element type.
enum Writer<'a> {
    U8(ToU8<'a>),
    F32(ToF32<'a>),
}

//! int8 convolution with the vector kernels of the x86 tiers.

use super::epilogue::Output;
use super::kernel::Run;
use super::{Epilogue, QConvParams};
use crate::direct::{self, Write};
use crate::packed::{Grain, Packed};
use crate::segments::Segments;
use crate::simd::{Simd, avx2, avx512};
use crate::winograd::generic::{self as winograd, Plan};
use crate::winograd::{POINTS, TransformedWeights};
use crate::writers::{Residual, ToF32, ToU8};
use crate::{ConvShape, Isa, Scratch, x86};

/// Weights and per-channel constants in a kernel's order.
#[derive(Debug, Clone)]
pub(super) struct Vector {
    packed: Packed,
    bias: Vec<i32>,
    scale: Vec<f32>,
    narrow: bool,
    method: Method,
}

#[derive(Debug, Clone)]
enum Method {
    /// `vpdpbusd`.
    Avx512Vnni,
    AvxVnni,
    /// i16 segments proved from the weights.
    Avx512(Segments),
    Avx2(Segments),
    /// i16 halves: a pair of products can leave i16.
    Avx512Wide,
    Avx2Wide,
    /// F(4×4, 3×3) in i16.
    Winograd(Isa, Winograd),
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
        let pack = |grain: Grain| {
            let shape = &params.shape;
            let depth = shape.in_channels / shape.groups;
            Packed::new(shape, grain, |oc, ic, tap| {
                let at = ((oc * depth + ic) * shape.kernel + tap.ky) * shape.kernel + tap.kx;
                [params.weights[at] as u8]
            })
        };
        let segments = |packed: &Packed| Segments::new(packed, params.input_max);
        let (packed, method) = match isa {
            Isa::Scalar => return None,
            Isa::AvxVnni => (pack(Grain::of::<avx2::U8Vnni>())?, Method::AvxVnni),
            Isa::Avx512Vnni => (pack(Grain::of::<avx512::U8Vnni>())?, Method::Avx512Vnni),
            Isa::Avx2 => {
                let packed = pack(Grain::of::<avx2::U8Segmented>())?;
                match segments(&packed) {
                    Some(segments) => (packed, Method::Avx2(segments)),
                    None => (pack(Grain::of::<avx2::U8Wide>())?, Method::Avx2Wide),
                }
            }
            Isa::Avx512 => {
                let packed = pack(Grain::of::<avx512::U8Segmented>())?;
                match segments(&packed) {
                    Some(segments) => (packed, Method::Avx512(segments)),
                    None => (pack(Grain::of::<avx512::U8Wide>())?, Method::Avx512Wide),
                }
            }
        };
        Some(Self {
            bias: packed.per_channel(params.bias),
            scale: packed.per_channel(params.epilogue.scale()),
            packed,
            narrow: params.epilogue.is_narrow(),
            method,
        })
    }

    /// Packs transformed weights for `isa`, or `None` where only the reference can run the shape. `epilogue` is for Y.
    pub fn winograd(
        isa: Isa,
        shape: &ConvShape,
        weights: &TransformedWeights,
        epilogue: &Epilogue,
    ) -> Option<Self> {
        let depth = shape.in_channels / shape.groups;
        let (grain, plan) = match isa {
            Isa::Scalar => return None,
            Isa::Avx2 => (Grain::of::<avx2::I16>(), Plan::new::<avx2::I16>(depth)),
            Isa::AvxVnni => (
                Grain::of::<avx2::I16Vnni>(),
                Plan::new::<avx2::I16Vnni>(depth),
            ),
            Isa::Avx512 => (Grain::of::<avx512::I16>(), Plan::new::<avx512::I16>(depth)),
            Isa::Avx512Vnni => (
                Grain::of::<avx512::I16Vnni>(),
                Plan::new::<avx512::I16Vnni>(depth),
            ),
        };
        // The 36 points take the place of kernel elements.
        let points = ConvShape {
            kernel: 6,
            ..*shape
        };
        let packed = Packed::new(&points, grain, |oc, ic, tap| {
            let at = (oc * depth + ic) * POINTS + tap.ky * points.kernel + tap.kx;
            weights.weights[at].to_le_bytes()
        })?;
        let winograd = Winograd {
            plan,
            zeros: vec![0; depth],
            padding: shape.padding,
            shift: weights.shift,
        };
        Some(Self {
            bias: packed.per_channel(&weights.bias),
            scale: packed.per_channel(epilogue.scale()),
            packed,
            narrow: epilogue.is_narrow(),
            method: Method::Winograd(isa, winograd),
        })
    }

    pub fn name(&self) -> &'static str {
        match &self.method {
            Method::Avx512Vnni => "qs8_direct_8x48c4__avx512vnni",
            Method::AvxVnni => "qs8_direct_4x24c4__avxvnni",
            Method::Avx512(_) => "qs8_direct_4x48c4__avx512",
            Method::Avx2(_) => "qs8_direct_4x16c4__avx2",
            Method::Avx512Wide => "qs8_wide_8x32c4__avx512",
            Method::Avx2Wide => "qs8_wide_4x8c4__avx2",
            Method::Winograd(Isa::Avx512Vnni, _) => "qs8_winograd4_8x48c2__avx512vnni",
            Method::Winograd(Isa::Avx512, _) => "qs8_winograd4_8x48c2__avx512",
            Method::Winograd(Isa::AvxVnni, _) => "qs8_winograd4_4x24c2__avxvnni",
            Method::Winograd(..) => "qs8_winograd4_4x16c2__avx2",
        }
    }

    pub fn scratch_bytes(&self) -> usize {
        match &self.method {
            Method::Winograd(_, winograd) => winograd.plan.bytes(),
            _ => 0,
        }
    }

    /// # Safety
    /// As `QConv::run_part`; `writer` writes the run's output.
    unsafe fn run_with<W>(&self, run: &Run, scratch: &mut Scratch, writer: &W)
    where
        W: Write<avx512::Avx512, <avx512::Avx512 as Simd>::I>
            + Write<avx2::Avx2, <avx2::Avx2 as Simd>::I>,
    {
        let segments = match &self.method {
            Method::Avx512(segments) | Method::Avx2(segments) => Some(segments),
            _ => None,
        };
        // SAFETY: `QConv::new` checked that the CPU has the tier, `QConv::check` that the tensors fit, `QConv::run_part` that
        // the scratch does.
        unsafe {
            let job = direct::Job::new(
                &self.packed,
                segments,
                &self.bias,
                run.input,
                run.in_layout,
                run.out_layout,
                run.part,
            );
            match &self.method {
                Method::Avx512Vnni => x86::qs8_direct_avx512vnni(&job, writer),
                Method::AvxVnni => x86::qs8_direct_avxvnni(&job, writer),
                Method::Avx512(_) => x86::qs8_direct_avx512(&job, writer),
                Method::Avx2(_) => x86::qs8_direct_avx2(&job, writer),
                Method::Avx512Wide => x86::qs8_wide_avx512(&job, writer),
                Method::Avx2Wide => x86::qs8_wide_avx2(&job, writer),
                Method::Winograd(isa, winograd) => {
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
                    match isa {
                        Isa::Avx512Vnni => x86::qs8_winograd4_avx512vnni(&job, writer),
                        Isa::Avx512 => x86::qs8_winograd4_avx512(&job, writer),
                        Isa::AvxVnni => x86::qs8_winograd4_avxvnni(&job, writer),
                        _ => x86::qs8_winograd4_avx2(&job, writer),
                    }
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

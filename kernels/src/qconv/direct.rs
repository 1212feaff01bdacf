//! int8 convolution with the direct kernels of the x86 tiers.

use super::epilogue::Output;
use super::kernel::Run;
use super::{Epilogue, QConvParams};
use crate::direct::{Job, Write};
use crate::packed::{Grain, Packed};
use crate::segments::Segments;
use crate::simd::{Simd, avx2, avx512};
use crate::writers::{Residual, ToF32, ToU8};
use crate::{Isa, x86};

/// Weights and per-channel constants in a direct kernel's order.
#[derive(Debug, Clone)]
pub(crate) struct Direct {
    packed: Packed,
    bias: Vec<i32>,
    scale: Vec<f32>,
    chain: Chain,
    segments: Option<Segments>,
    narrow: bool,
}

/// How products are summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Chain {
    /// `vpdpbusd` on 512 bits.
    Avx512Vnni,
    /// i16 segments proved from the weights.
    Avx512,
    /// i16 halves: a pair of products can leave i16.
    Avx512Wide,
    /// `vpdpbusd` on 256 bits.
    AvxVnni,
    Avx2,
    Avx2Wide,
}

impl Chain {
    fn grain(self) -> Grain {
        match self {
            Chain::Avx512Vnni => Grain::of::<avx512::U8Vnni>(),
            Chain::Avx512 => Grain::of::<avx512::U8Segmented>(),
            Chain::Avx512Wide => Grain::of::<avx512::U8Wide>(),
            Chain::AvxVnni => Grain::of::<avx2::U8Vnni>(),
            Chain::Avx2 => Grain::of::<avx2::U8Segmented>(),
            Chain::Avx2Wide => Grain::of::<avx2::U8Wide>(),
        }
    }
}

impl Direct {
    /// Packs for `isa`, or `None` where only the reference can run the shape.
    pub fn new(isa: Isa, params: &QConvParams) -> Option<Self> {
        let pack = |chain: Chain| {
            let shape = &params.shape;
            let depth = shape.in_channels / shape.groups;
            Packed::new(shape, chain.grain(), |oc, ic, tap| {
                let at = ((oc * depth + ic) * shape.kernel + tap.ky) * shape.kernel + tap.kx;
                [params.weights[at] as u8]
            })
        };
        let (mut chain, wide) = match isa {
            Isa::Scalar => return None,
            Isa::Avx2 => (Chain::Avx2, Some(Chain::Avx2Wide)),
            Isa::AvxVnni => (Chain::AvxVnni, None),
            Isa::Avx512 => (Chain::Avx512, Some(Chain::Avx512Wide)),
            Isa::Avx512Vnni => (Chain::Avx512Vnni, None),
        };
        let mut packed = pack(chain)?;
        let mut segments = None;
        if let Some(wide) = wide {
            segments = Segments::new(&packed, params.input_max);
            if segments.is_none() {
                chain = wide;
                packed = pack(chain)?;
            }
        }
        Some(Self {
            bias: packed.per_channel(params.bias),
            scale: packed.per_channel(params.epilogue.scale()),
            packed,
            chain,
            segments,
            narrow: params.epilogue.is_narrow(),
        })
    }

    pub fn name(&self) -> &'static str {
        match self.chain {
            Chain::Avx512Vnni => "qs8_direct_8x48c4__avx512vnni",
            Chain::Avx512 => "qs8_direct_8x48c4__avx512",
            Chain::Avx512Wide => "qs8_wide_8x32c4__avx512",
            Chain::AvxVnni => "qs8_direct_4x24c4__avxvnni",
            Chain::Avx2 => "qs8_direct_4x16c4__avx2",
            Chain::Avx2Wide => "qs8_wide_4x8c4__avx2",
        }
    }

    /// # Safety
    /// As `QConv::run_part`; `writer` writes the run's output.
    unsafe fn run_with<W>(&self, run: &Run, writer: &W)
    where
        W: Write<avx512::Avx512, <avx512::Avx512 as Simd>::I>
            + Write<avx2::Avx2, <avx2::Avx2 as Simd>::I>,
    {
        // SAFETY: `QConv::new` checked that the CPU has the tier, `QConv::check` that the tensors fit.
        unsafe {
            let job = Job::new(
                &self.packed,
                self.segments.as_ref(),
                &self.bias,
                run.input,
                run.in_layout,
                run.out_layout,
                run.part,
            );
            match self.chain {
                Chain::Avx512Vnni => x86::qs8_direct_avx512vnni(&job, writer),
                Chain::Avx512 => x86::qs8_direct_avx512(&job, writer),
                Chain::Avx512Wide => x86::qs8_wide_avx512(&job, writer),
                Chain::AvxVnni => x86::qs8_direct_avxvnni(&job, writer),
                Chain::Avx2 => x86::qs8_direct_avx2(&job, writer),
                Chain::Avx2Wide => x86::qs8_wide_avx2(&job, writer),
            }
        }
    }

    /// # Safety
    /// As `QConv::run_part`.
    pub unsafe fn run(&self, epilogue: &Epilogue, run: &Run) {
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
                    self.run_with(run, &writer);
                }
                (Epilogue::F32 { .. }, Output::F32(output)) => {
                    let writer = ToF32 {
                        scale,
                        output,
                        layout,
                    };
                    self.run_with(run, &writer);
                }
                _ => unreachable!("the element type was checked"),
            }
        }
    }
}

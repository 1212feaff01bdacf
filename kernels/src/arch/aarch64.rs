//! aarch64: the tiers, and every kernel of theirs. Names say type, family, tile (pixels × outputs), channels in a
//! 32-bit group, set.

mod i8mm;
mod neon;

use super::{chain, direct_f32, direct_int8, max_pool, winograd_f32, winograd_int8};
use crate::Isa;
use crate::direct::Plain;
use crate::kernel::{
    Direct, DotProduct, FloatDirect, FloatWinograd, PeakChain, Pool, Tier, Winograd,
};
use crate::packed::Packed;
use crate::peak::{dots, products};
use std::arch::is_aarch64_feature_detected as has;

/// Every tier, slowest first. Without i8mm products are signed: exact for inputs of 7 bits.
pub(crate) static TIERS: [Tier; 3] = [
    Tier {
        isa: Isa::Neon,
        dot: DotProduct::Plain {
            kernel: &DIRECT_NEON,
            input_max: 127,
        },
        widening: &WIDE_NEON,
        winograd: &WINOGRAD_NEON,
        float: &F32_NEON,
        float_winograd: &WINOGRAD_F32_NEON,
        pool: &POOL_NEON,
        peak_int8: &WIDEN,
        peak_f32: &FMA,
    },
    Tier {
        isa: Isa::NeonDot,
        dot: DotProduct::Plain {
            kernel: &DIRECT_NEONDOT,
            input_max: 127,
        },
        widening: &WIDE_NEON,
        winograd: &WINOGRAD_NEON,
        float: &F32_NEON,
        float_winograd: &WINOGRAD_F32_NEON,
        pool: &POOL_NEON,
        peak_int8: &SDOT,
        peak_f32: &FMA,
    },
    Tier {
        isa: Isa::NeonI8mm,
        dot: DotProduct::Choice {
            takes: i8mm::fits,
            kernel: &DIRECT_NEONI8MM,
            otherwise: &DOT_NEONI8MM,
        },
        widening: &WIDE_NEON,
        winograd: &WINOGRAD_NEON,
        float: &F32_NEON,
        float_winograd: &WINOGRAD_F32_NEON,
        pool: &POOL_NEON,
        peak_int8: &USMMLA,
        peak_f32: &FMA,
    },
];

direct_int8!(DIRECT_NEON: Packed = "qs8_direct_4x8c4__neon", ["neon"], neon::Pairs);
direct_int8!(WIDE_NEON: Packed = "qs8_wide_4x4c4__neon", ["neon"], Plain<neon::U8Wide>);
winograd_int8!(
    WINOGRAD_NEON = "qs8_winograd4_8x8c2__neon",
    ["neon"],
    neon::I16
);
direct_f32!(
    F32_NEON = "f32_direct_8x12__neon",
    ["neon"],
    Plain<neon::F32>
);
winograd_f32!(
    WINOGRAD_F32_NEON = "f32_winograd4_8x12__neon",
    ["neon"],
    neon::F32
);
max_pool!(POOL_NEON = "maxpool__neon", ["neon"]);
chain!(WIDEN = "smull + saddlp", ["neon"], products::<neon::U7>);
chain!(FMA = "fmla", ["neon"], dots::<neon::F32>);

direct_int8!(DIRECT_NEONDOT: Packed = "qs8_direct_8x12c4__neondot", ["neon", "dotprod"], Plain<neon::U7Dot>);
chain!(SDOT = "sdot", ["neon", "dotprod"], dots::<neon::U7Dot>);

direct_int8!(DIRECT_NEONI8MM: Packed = "qs8_direct_8x12c8__neoni8mm", ["neon", "i8mm"], i8mm::Squares);
direct_int8!(DOT_NEONI8MM: Packed = "qs8_direct_8x12c4__neoni8mm", ["neon", "i8mm"], Plain<i8mm::U8Dot>);
chain!(USMMLA = "usmmla", ["neon", "i8mm"], dots::<i8mm::U8Square>);

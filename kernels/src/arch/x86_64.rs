//! x86-64: the tiers, and every kernel of theirs. Names say type, family, tile (pixels × outputs), channels in a 32-bit
//! group, set.

pub(crate) mod amx;
mod avx2;
pub(crate) mod avx512;
mod sse41;

use super::{chain, direct_f32, direct_int8, max_pool, winograd_f32, winograd_int8};
use crate::Isa;
use crate::direct::{Plain, Segmented};
use crate::kernel::{
    Direct, DotProduct, FloatDirect, FloatWinograd, Kernel, PeakChain, Pool, Tier, Winograd,
};
use crate::packed::Packed;
use crate::peak::{dots, products, sums};
use crate::segments::SegmentedPacked;
use std::arch::is_x86_feature_detected as has;

/// Every tier, slowest first.
pub(crate) static TIERS: [Tier; 6] = [
    Tier {
        isa: Isa::Sse41,
        dot: DotProduct::Segmented(&DIRECT_SSE41),
        widening: &WIDE_SSE41,
        winograd: &WINOGRAD_SSE41,
        float: &F32_SSE41,
        float_winograd: &WINOGRAD_F32_SSE41,
        pool: &POOL_SSE41,
        peak_int8: &MADDUBS_128,
        peak_f32: &MULTIPLY_ADD_128,
    },
    Tier {
        isa: Isa::Avx2,
        dot: DotProduct::Segmented(&DIRECT_AVX2),
        widening: &WIDE_AVX2,
        winograd: &WINOGRAD_AVX2,
        float: &F32_AVX2,
        float_winograd: &WINOGRAD_F32_AVX2,
        pool: &POOL_AVX2,
        peak_int8: &MADDUBS_256,
        peak_f32: &FMA_256,
    },
    Tier {
        isa: Isa::AvxVnni,
        dot: DotProduct::Plain {
            kernel: &DIRECT_AVXVNNI,
            input_max: 255,
        },
        widening: &WIDE_AVX2,
        winograd: &WINOGRAD_AVXVNNI,
        float: &F32_AVX2,
        float_winograd: &WINOGRAD_F32_AVX2,
        pool: &POOL_AVX2,
        peak_int8: &VNNI_256,
        peak_f32: &FMA_256,
    },
    Tier {
        isa: Isa::Avx512,
        dot: DotProduct::Segmented(&DIRECT_AVX512),
        widening: &WIDE_AVX512,
        winograd: &WINOGRAD_AVX512,
        float: &F32_AVX512,
        float_winograd: &WINOGRAD_F32_AVX512,
        pool: &POOL_AVX512,
        peak_int8: &MADDUBS_512,
        peak_f32: &FMA_512,
    },
    Tier {
        isa: Isa::Avx512Vnni,
        dot: DotProduct::Plain {
            kernel: &DIRECT_AVX512VNNI,
            input_max: 255,
        },
        widening: &WIDE_AVX512,
        winograd: &WINOGRAD_AVX512VNNI,
        float: &F32_AVX512,
        float_winograd: &WINOGRAD_F32_AVX512,
        pool: &POOL_AVX512,
        peak_int8: &VNNI_512,
        peak_f32: &FMA_512,
    },
    Tier {
        isa: Isa::Amx,
        dot: DotProduct::Choice {
            takes: crate::direct::tiles::pay,
            kernel: &DIRECT_AMX,
            otherwise: &DIRECT_AVX512VNNI,
        },
        widening: &WIDE_AVX512,
        winograd: &WINOGRAD_AVX512VNNI,
        float: &F32_AVX512,
        float_winograd: &WINOGRAD_F32_AVX512,
        pool: &POOL_AVX512,
        peak_int8: &TILES,
        peak_f32: &FMA_512,
    },
];

// SSSE3 and SSE4.1: CPUs without AVX2.
direct_int8!(DIRECT_SSE41: SegmentedPacked = "qs8_direct_4x8c4__sse41", ["sse4.1", "ssse3"], Segmented<sse41::U8Segmented>);
direct_int8!(WIDE_SSE41: Packed = "qs8_wide_4x4c4__sse41", ["sse4.1", "ssse3"], Plain<sse41::U8Wide>);
winograd_int8!(
    WINOGRAD_SSE41 = "qs8_winograd4_4x8c2__sse41",
    ["sse4.1", "ssse3"],
    sse41::I16
);
direct_f32!(
    F32_SSE41 = "f32_direct_4x8__sse41",
    ["sse4.1", "ssse3"],
    Plain<sse41::F32>
);
winograd_f32!(
    WINOGRAD_F32_SSE41 = "f32_winograd4_4x8__sse41",
    ["sse4.1", "ssse3"],
    sse41::F32
);
max_pool!(POOL_SSE41 = "maxpool__sse41", ["sse4.1", "ssse3"]);
chain!(
    MADDUBS_128 = "pmaddubsw + paddw",
    ["sse4.1", "ssse3"],
    sums::<sse41::U8Segmented>
);
chain!(
    MULTIPLY_ADD_128 = "mulps + addps",
    ["sse4.1", "ssse3"],
    products::<sse41::F32>
);

// AVX2 and FMA.
direct_int8!(DIRECT_AVX2: SegmentedPacked = "qs8_direct_4x16c4__avx2", ["avx2", "fma"], Segmented<avx2::U8Segmented>);
direct_int8!(WIDE_AVX2: Packed = "qs8_wide_4x8c4__avx2", ["avx2", "fma"], Plain<avx2::U8Wide>);
winograd_int8!(
    WINOGRAD_AVX2 = "qs8_winograd4_4x16c2__avx2",
    ["avx2", "fma"],
    avx2::I16
);
direct_f32!(
    F32_AVX2 = "f32_direct_6x16__avx2",
    ["avx2", "fma"],
    Plain<avx2::F32>
);
winograd_f32!(
    WINOGRAD_F32_AVX2 = "f32_winograd4_6x16__avx2",
    ["avx2", "fma"],
    avx2::F32
);
max_pool!(POOL_AVX2 = "maxpool__avx2", ["avx2", "fma"]);
chain!(
    MADDUBS_256 = "vpmaddubsw + vpaddw",
    ["avx2", "fma"],
    sums::<avx2::U8Segmented>
);
chain!(FMA_256 = "vfmadd", ["avx2", "fma"], dots::<avx2::F32>);

// AVX-VNNI: `vpdpbusd` on 256 bits.
direct_int8!(DIRECT_AVXVNNI: Packed = "qs8_direct_6x16c4__avxvnni", ["avx2", "fma", "avxvnni"], Plain<avx2::U8Vnni>);
winograd_int8!(
    WINOGRAD_AVXVNNI = "qs8_winograd4_6x16c2__avxvnni",
    ["avx2", "fma", "avxvnni"],
    avx2::I16Vnni
);
chain!(
    VNNI_256 = "vpdpbusd",
    ["avx2", "fma", "avxvnni"],
    dots::<avx2::U8Vnni>
);

// AVX-512 F, BW and VL.
direct_int8!(DIRECT_AVX512: SegmentedPacked = "qs8_direct_4x48c4__avx512",
    ["avx512f", "avx512bw", "avx512vl", "avx2", "fma"], Segmented<avx512::U8Segmented>);
direct_int8!(WIDE_AVX512: Packed = "qs8_wide_8x32c4__avx512",
    ["avx512f", "avx512bw", "avx512vl", "avx2", "fma"], Plain<avx512::U8Wide>);
winograd_int8!(
    WINOGRAD_AVX512 = "qs8_winograd4_8x48c2__avx512",
    ["avx512f", "avx512bw", "avx512vl", "avx2", "fma"],
    avx512::I16
);
direct_f32!(
    F32_AVX512 = "f32_direct_8x48__avx512",
    ["avx512f", "avx512bw", "avx512vl", "avx2", "fma"],
    Plain<avx512::F32>
);
winograd_f32!(
    WINOGRAD_F32_AVX512 = "f32_winograd4_8x48__avx512",
    ["avx512f", "avx512bw", "avx512vl", "avx2", "fma"],
    avx512::F32
);
max_pool!(
    POOL_AVX512 = "maxpool__avx512",
    ["avx512f", "avx512bw", "avx512vl"]
);
chain!(
    MADDUBS_512 = "vpmaddubsw + vpaddw",
    ["avx512f", "avx512bw", "avx512vl", "avx2", "fma"],
    sums::<avx512::U8Segmented>
);
chain!(
    FMA_512 = "vfmadd",
    ["avx512f", "avx512bw", "avx512vl", "avx2", "fma"],
    dots::<avx512::F32>
);

// AVX-512-VNNI: `vpdpbusd` on 512 bits.
direct_int8!(DIRECT_AVX512VNNI: Packed = "qs8_direct_8x48c4__avx512vnni",
    ["avx512f", "avx512bw", "avx512vl", "avx512vnni", "avx2", "fma"], Plain<avx512::U8Vnni>);
winograd_int8!(
    WINOGRAD_AVX512VNNI = "qs8_winograd4_8x48c2__avx512vnni",
    [
        "avx512f",
        "avx512bw",
        "avx512vl",
        "avx512vnni",
        "avx2",
        "fma"
    ],
    avx512::I16Vnni
);
chain!(
    VNNI_512 = "vpdpbusd",
    [
        "avx512f",
        "avx512bw",
        "avx512vl",
        "avx512vnni",
        "avx2",
        "fma"
    ],
    dots::<avx512::U8Vnni>
);

// AMX with int8: sums in tiles, everything else with AVX-512. Features that the compiler does not know are granted by
// the system, not only had by the CPU.
static DIRECT_AMX: Direct<Packed> = {
    use crate::direct::{self, tiles};
    use crate::{arch::leaf, writers};
    leaf!(["avx512f", "avx512bw", "avx512vl", "avx512vnni", "avx2", "fma"],
        fn to_u8(job: &direct::Job<'_, Packed>, writer: &writers::ToU8<'_>) = tiles::run(job, writer));
    leaf!(["avx512f", "avx512bw", "avx512vl", "avx512vnni", "avx2", "fma"],
        fn to_f32(job: &direct::Job<'_, Packed>, writer: &writers::ToF32<'_>) = tiles::run(job, writer));
    Direct {
        name: "qs8_direct_32x32c4__amx",
        available: || DIRECT_AVX512VNNI.is_available() && amx::is_granted(),
        blocking: tiles::BLOCKING,
        to_u8,
        to_f32,
    }
};
static TILES: PeakChain = PeakChain {
    name: "tdpbusd",
    available: amx::is_granted,
    run: amx::products,
};

//! x86-64: which kernel a tier runs, and the thin functions that switch its features on.

use crate::Isa;
use crate::direct::{self, Job, Plain, Segmented, Write};
use crate::packed::Grain;
use crate::simd::Simd;
use crate::simd::avx2::{self, Avx2};
use crate::simd::avx512::{self, Avx512};
use crate::winograd::generic::{self as winograd, Plan};

/// A writer of i32 accumulators for every tier.
pub(crate) trait IntWriter:
    Write<Avx512, <Avx512 as Simd>::I> + Write<Avx2, <Avx2 as Simd>::I>
{
}
impl<W: Write<Avx512, <Avx512 as Simd>::I> + Write<Avx2, <Avx2 as Simd>::I>> IntWriter for W {}

/// A writer of f32 accumulators for every tier.
pub(crate) trait FloatWriter:
    Write<Avx512, <Avx512 as Simd>::F> + Write<Avx2, <Avx2 as Simd>::F>
{
}
impl<W: Write<Avx512, <Avx512 as Simd>::F> + Write<Avx2, <Avx2 as Simd>::F>> FloatWriter for W {}

/// How an int8 kernel sums products.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sum {
    /// The tier's own chain.
    Short,
    /// i16 halves: where a pair of products can leave i16.
    Wide,
}

/// How `isa` sums inputs up to `input_max`, as far as the weights allow.
pub(crate) fn int8_sum(_isa: Isa, _input_max: u8) -> Sum {
    Sum::Short
}

/// Whether the short chain sums in i16 segments, which have to be proved from the weights.
pub(crate) fn is_segmented(isa: Isa) -> bool {
    matches!(isa, Isa::Avx2 | Isa::Avx512)
}

/// Whether the tier has vectors of 512 bits.
fn is_wide(isa: Isa) -> bool {
    matches!(isa, Isa::Avx512 | Isa::Avx512Vnni)
}

pub(crate) fn int8_grain(isa: Isa, sum: Sum) -> Grain {
    match (sum, isa) {
        (Sum::Wide, isa) if is_wide(isa) => Grain::of::<avx512::U8Wide>(),
        (Sum::Wide, _) => Grain::of::<avx2::U8Wide>(),
        (Sum::Short, Isa::Avx512Vnni) => Grain::of::<avx512::U8Vnni>(),
        (Sum::Short, Isa::Avx512) => Grain::of::<avx512::U8Segmented>(),
        (Sum::Short, Isa::AvxVnni) => Grain::of::<avx2::U8Vnni>(),
        (Sum::Short, _) => Grain::of::<avx2::U8Segmented>(),
    }
}

pub(crate) fn int8_name(isa: Isa, sum: Sum) -> &'static str {
    match (sum, isa) {
        (Sum::Wide, isa) if is_wide(isa) => "qs8_wide_8x32c4__avx512",
        (Sum::Wide, _) => "qs8_wide_4x8c4__avx2",
        (Sum::Short, Isa::Avx512Vnni) => "qs8_direct_8x48c4__avx512vnni",
        (Sum::Short, Isa::Avx512) => "qs8_direct_4x48c4__avx512",
        (Sum::Short, Isa::AvxVnni) => "qs8_direct_4x24c4__avxvnni",
        (Sum::Short, _) => "qs8_direct_4x16c4__avx2",
    }
}

pub(crate) fn f32_grain(isa: Isa) -> Grain {
    if is_wide(isa) {
        Grain::of::<avx512::F32>()
    } else {
        Grain::of::<avx2::F32>()
    }
}

pub(crate) fn f32_name(isa: Isa) -> &'static str {
    if is_wide(isa) {
        "f32_direct_8x48__avx512"
    } else {
        "f32_direct_4x24__avx2"
    }
}

pub(crate) fn winograd_grain(isa: Isa) -> Grain {
    match isa {
        Isa::Avx512Vnni => Grain::of::<avx512::I16Vnni>(),
        Isa::Avx512 => Grain::of::<avx512::I16>(),
        Isa::AvxVnni => Grain::of::<avx2::I16Vnni>(),
        _ => Grain::of::<avx2::I16>(),
    }
}

pub(crate) fn winograd_plan(isa: Isa, channels: usize) -> Plan {
    match isa {
        Isa::Avx512Vnni => Plan::new::<avx512::I16Vnni>(channels),
        Isa::Avx512 => Plan::new::<avx512::I16>(channels),
        Isa::AvxVnni => Plan::new::<avx2::I16Vnni>(channels),
        _ => Plan::new::<avx2::I16>(channels),
    }
}

pub(crate) fn winograd_name(isa: Isa) -> &'static str {
    match isa {
        Isa::Avx512Vnni => "qs8_winograd4_8x48c2__avx512vnni",
        Isa::Avx512 => "qs8_winograd4_8x48c2__avx512",
        Isa::AvxVnni => "qs8_winograd4_4x24c2__avxvnni",
        _ => "qs8_winograd4_4x16c2__avx2",
    }
}

/// # Safety
/// The CPU has `isa`; the contract of [`direct::run`]; the job is packed with this sum's grain.
pub(crate) unsafe fn int8<W: IntWriter>(isa: Isa, sum: Sum, job: &Job, writer: &W) {
    // SAFETY: the caller's contract.
    unsafe {
        match (sum, isa) {
            (Sum::Wide, isa) if is_wide(isa) => qs8_wide_avx512(job, writer),
            (Sum::Wide, _) => qs8_wide_avx2(job, writer),
            (Sum::Short, Isa::Avx512Vnni) => qs8_direct_avx512vnni(job, writer),
            (Sum::Short, Isa::Avx512) => qs8_direct_avx512(job, writer),
            (Sum::Short, Isa::AvxVnni) => qs8_direct_avxvnni(job, writer),
            (Sum::Short, _) => qs8_direct_avx2(job, writer),
        }
    }
}

/// # Safety
/// The CPU has `isa`; the contract of [`direct::run`]; the job is packed with `f32_grain`.
pub(crate) unsafe fn f32<W: FloatWriter>(isa: Isa, job: &Job, writer: &W) {
    // SAFETY: the caller's contract.
    unsafe {
        if is_wide(isa) {
            f32_direct_avx512(job, writer);
        } else {
            f32_direct_avx2(job, writer);
        }
    }
}

/// # Safety
/// The CPU has `isa`; the contract of [`winograd::run`]; the job is packed with `winograd_grain`.
pub(crate) unsafe fn winograd<W: IntWriter>(isa: Isa, job: &winograd::Job, writer: &W) {
    // SAFETY: the caller's contract.
    unsafe {
        match isa {
            Isa::Avx512Vnni => qs8_winograd4_avx512vnni(job, writer),
            Isa::Avx512 => qs8_winograd4_avx512(job, writer),
            Isa::AvxVnni => qs8_winograd4_avxvnni(job, writer),
            _ => qs8_winograd4_avx2(job, writer),
        }
    }
}

/// Leaves: the generic core of a family (`direct`, `winograd`) with one tier's features.
macro_rules! leaves {
    ($($(#[$doc:meta])* $name:ident, $features:literal, $family:ident::<$core:ty>, $simd:ty, $acc:ident;)*) => {$(
        $(#[$doc])*
        ///
        /// # Safety
        /// The CPU has the features; the contract of the family's `run`.
        #[target_feature(enable = $features)]
        unsafe fn $name<W: Write<$simd, <$simd as Simd>::$acc>>(job: &$family::Job, writer: &W) {
            // SAFETY: the caller's contract.
            unsafe { $family::run::<$core, W>(job, writer) }
        }
    )*};
}

leaves! {
    /// u8 · i8, AVX-512-VNNI.
    qs8_direct_avx512vnni, "avx512f,avx512bw,avx512vl,avx512vnni,avx2,fma",
        direct::<Plain<avx512::U8Vnni>>, Avx512, I;
    /// u8 · i8 in i16 segments, AVX-512BW.
    qs8_direct_avx512, "avx512f,avx512bw,avx512vl,avx2,fma",
        direct::<Segmented<avx512::U8Segmented>>, Avx512, I;
    /// u8 · i8 of any range, AVX-512BW.
    qs8_wide_avx512, "avx512f,avx512bw,avx512vl,avx2,fma",
        direct::<Plain<avx512::U8Wide>>, Avx512, I;
    /// f32, AVX-512F.
    f32_direct_avx512, "avx512f,avx512bw,avx512vl,avx2,fma",
        direct::<Plain<avx512::F32>>, Avx512, F;
    /// u8 · i8, AVX-VNNI.
    qs8_direct_avxvnni, "avx2,fma,avxvnni", direct::<Plain<avx2::U8Vnni>>, Avx2, I;
    /// u8 · i8 in i16 segments, AVX2.
    qs8_direct_avx2, "avx2,fma", direct::<Segmented<avx2::U8Segmented>>, Avx2, I;
    /// u8 · i8 of any range, AVX2.
    qs8_wide_avx2, "avx2,fma", direct::<Plain<avx2::U8Wide>>, Avx2, I;
    /// f32, AVX2 and FMA.
    f32_direct_avx2, "avx2,fma", direct::<Plain<avx2::F32>>, Avx2, F;
    /// i16 · i16, AVX-512-VNNI.
    qs8_winograd4_avx512vnni, "avx512f,avx512bw,avx512vl,avx512vnni,avx2,fma",
        winograd::<avx512::I16Vnni>, Avx512, I;
    /// i16 · i16, AVX-512BW.
    qs8_winograd4_avx512, "avx512f,avx512bw,avx512vl,avx2,fma",
        winograd::<avx512::I16>, Avx512, I;
    /// i16 · i16, AVX-VNNI.
    qs8_winograd4_avxvnni, "avx2,fma,avxvnni", winograd::<avx2::I16Vnni>, Avx2, I;
    /// i16 · i16, AVX2.
    qs8_winograd4_avx2, "avx2,fma", winograd::<avx2::I16>, Avx2, I;
}

//! aarch64: which kernel a tier runs, and the thin functions that switch its features on.

use crate::Isa;
use crate::direct::{self, Job, Plain, Write};
use crate::packed::Grain;
use crate::simd::Simd;
use crate::simd::neon::{self, Neon};
use crate::winograd::generic::{self as winograd, Plan};

/// A writer of i32 accumulators for every tier.
pub(crate) trait IntWriter: Write<Neon, <Neon as Simd>::I> {}
impl<W: Write<Neon, <Neon as Simd>::I>> IntWriter for W {}

/// A writer of f32 accumulators for every tier.
pub(crate) trait FloatWriter: Write<Neon, <Neon as Simd>::F> {}
impl<W: Write<Neon, <Neon as Simd>::F>> FloatWriter for W {}

/// How an int8 kernel sums products.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sum {
    /// The tier's own chain.
    Short,
    /// i16 halves: exact for inputs of 8 bits.
    Wide,
}

/// How `isa` sums inputs up to `input_max`, whether i16 segments have to be proved, and what to do when they cannot.
pub(crate) fn int8_sum(_isa: Isa, input_max: u8) -> Sum {
    if input_max <= 127 {
        Sum::Short
    } else {
        Sum::Wide
    }
}

/// Whether the short chain sums in i16 segments.
pub(crate) fn is_segmented(_isa: Isa) -> bool {
    false
}

pub(crate) fn int8_grain(isa: Isa, sum: Sum) -> Grain {
    match (sum, isa) {
        (Sum::Wide, _) => Grain::of::<neon::U8Wide>(),
        (Sum::Short, Isa::NeonDot) => Grain::of::<neon::U7Dot>(),
        (Sum::Short, _) => Grain::of::<neon::U7>(),
    }
}

pub(crate) fn int8_name(isa: Isa, sum: Sum) -> &'static str {
    match (sum, isa) {
        (Sum::Wide, _) => "qs8_wide_8x4c4__neon",
        (Sum::Short, Isa::NeonDot) => "qs8_direct_8x12c4__neondot",
        (Sum::Short, _) => "qs8_direct_8x8c4__neon",
    }
}

pub(crate) fn f32_grain(_isa: Isa) -> Grain {
    Grain::of::<neon::F32>()
}

pub(crate) fn f32_name(_isa: Isa) -> &'static str {
    "f32_direct_8x12__neon"
}

pub(crate) fn winograd_grain(_isa: Isa) -> Grain {
    Grain::of::<neon::I16>()
}

pub(crate) fn winograd_plan(_isa: Isa, channels: usize) -> Plan {
    Plan::new::<neon::I16>(channels)
}

pub(crate) fn winograd_name(_isa: Isa) -> &'static str {
    "qs8_winograd4_8x8c2__neon"
}

/// # Safety
/// The CPU has `isa`; the contract of [`direct::run`]; the job is packed with this sum's grain.
pub(crate) unsafe fn int8<W: IntWriter>(isa: Isa, sum: Sum, job: &Job, writer: &W) {
    // SAFETY: the caller's contract.
    unsafe {
        match (sum, isa) {
            (Sum::Wide, _) => direct::run::<Plain<neon::U8Wide>, W>(job, writer),
            (Sum::Short, Isa::NeonDot) => int8_dot(job, writer),
            (Sum::Short, _) => direct::run::<Plain<neon::U7>, W>(job, writer),
        }
    }
}

/// # Safety
/// The CPU has dotprod; the contract of [`direct::run`].
#[target_feature(enable = "neon,dotprod")]
unsafe fn int8_dot<W: IntWriter>(job: &Job, writer: &W) {
    // SAFETY: the caller's contract.
    unsafe { direct::run::<Plain<neon::U7Dot>, W>(job, writer) }
}

/// # Safety
/// The contract of [`direct::run`]; the job is packed with `f32_grain`.
pub(crate) unsafe fn f32<W: FloatWriter>(_isa: Isa, job: &Job, writer: &W) {
    // SAFETY: the caller's contract; NEON is part of aarch64.
    unsafe { direct::run::<Plain<neon::F32>, W>(job, writer) }
}

/// # Safety
/// The contract of [`winograd::run`]; the job is packed with `winograd_grain`.
pub(crate) unsafe fn winograd<W: IntWriter>(_isa: Isa, job: &winograd::Job, writer: &W) {
    // SAFETY: the caller's contract; NEON is part of aarch64.
    unsafe { winograd::run::<neon::I16, W>(job, writer) }
}

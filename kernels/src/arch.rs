//! What differs between instruction sets: vectors, dot products, and the static descriptors of the kernels made of
//! them.
//!
//! Every macro writes one kernel: a thin function per use with the tier's features on, into which the generic core is
//! inlined, and the descriptor. The list of features is given once and serves both the compiler and the check of the
//! CPU.

use crate::simd::{Dot, Simd};

#[cfg(target_arch = "aarch64")]
mod aarch64;
#[cfg(target_arch = "x86_64")]
pub(crate) mod x86_64;

#[cfg(target_arch = "aarch64")]
pub(crate) use aarch64::TIERS;
#[cfg(target_arch = "x86_64")]
pub(crate) use x86_64::TIERS;

/// Asks for the cache line of `at`, wherever that points: a hint, which reads nothing.
#[inline(always)]
pub(crate) fn prefetch(at: *const u8) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: every x86-64 CPU has `prefetcht1`, and it never faults.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T1 }>(at.cast());
    }
    #[cfg(target_arch = "aarch64")]
    // SAFETY: `prfm` is a hint, and never faults.
    unsafe {
        std::arch::asm!("prfm pldl2keep, [{at}]", at = in(reg) at, options(nostack, readonly, preserves_flags));
    }
}

/// Whether a kernel's name says the tile of `D`: pixels, `x`, output channels. Which tile is compiled can be seen
/// nowhere else but in the time it takes.
pub(crate) const fn names_tile<D: Dot>(name: &str) -> bool {
    let bytes = name.as_bytes();
    let (mut numbers, mut found, mut at) = ([0usize; 2], 0, 0);
    while at < bytes.len() {
        match bytes[at] {
            digit @ b'0'..=b'9' => {
                numbers[found] = numbers[found] * 10 + (digit - b'0') as usize;
            }
            b'x' if found == 0 && numbers[0] > 0 => found = 1,
            _ if found == 1 => break,
            _ => numbers[0] = 0,
        }
        at += 1;
    }
    numbers[0] == D::MAX_MR && numbers[1] == D::MAX_NV * D::S::LANES
}

/// A thin function: `fn name(arguments) = body` with these features.
macro_rules! leaf {
    ([$($feature:tt),*], fn $name:ident($($arg:ident: $type:ty),*) $(-> $ret:ty)? = $body:expr) => {
        /// # Safety
        /// The CPU has the features; the contract of the core.
        $(#[target_feature(enable = $feature)])*
        unsafe fn $name($($arg: $type),*) $(-> $ret)? {
            // SAFETY: the caller's contract.
            unsafe { $body }
        }
    };
}

/// A direct int8 kernel around a chain.
macro_rules! direct_int8 {
    ($static:ident: $panels:ty = $name:literal, [$($feature:tt),*], $chain:ty) => {
        static $static: Direct<$panels> = {
            use crate::{arch::leaf, direct, writers};
            const { assert!(crate::arch::names_tile::<<$chain as direct::Chain>::D>($name)) };
            leaf!([$($feature),*], fn to_u8(job: &direct::Job<'_, $panels>, writer: &writers::ToU8<'_>) =
                direct::run::<$chain, _>(job, writer));
            leaf!([$($feature),*], fn to_f32(job: &direct::Job<'_, $panels>, writer: &writers::ToF32<'_>) =
                direct::run::<$chain, _>(job, writer));
            Direct {
                name: $name,
                available: || true $(&& has!($feature))*,
                blocking: crate::packed::Blocking::of::<<$chain as direct::Chain>::D>(),
                to_u8,
                to_f32,
            }
        };
    };
}

/// A Winograd int8 kernel around a dot product of i16.
macro_rules! winograd_int8 {
    ($static:ident = $name:literal, [$($feature:tt),*], $dot:ty) => {
        static $static: Winograd = {
            use crate::{arch::leaf, winograd::generic, writers};
            const { assert!(crate::arch::names_tile::<$dot>($name)) };
            leaf!([$($feature),*], fn to_u8(job: &generic::Job<'_, generic::Integers>, writer: &writers::ToU8<'_>) =
                generic::run::<generic::Integers, $dot, _>(job, writer));
            leaf!([$($feature),*], fn to_f32(job: &generic::Job<'_, generic::Integers>, writer: &writers::ToF32<'_>) =
                generic::run::<generic::Integers, $dot, _>(job, writer));
            Winograd {
                name: $name,
                available: || true $(&& has!($feature))*,
                blocking: crate::packed::Blocking::of::<$dot>(),
                plan: generic::Plan::new::<generic::Integers, $dot>,
                to_u8,
                to_f32,
            }
        };
    };
}

/// A direct f32 kernel around a chain.
macro_rules! direct_f32 {
    ($static:ident = $name:literal, [$($feature:tt),*], $chain:ty) => {
        static $static: FloatDirect = {
            use crate::{arch::leaf, direct, writers};
            const { assert!(crate::arch::names_tile::<<$chain as direct::Chain>::D>($name)) };
            leaf!([$($feature),*], fn run(job: &direct::Job<'_, Packed>, writer: &writers::Float<'_>) =
                direct::run::<$chain, _>(job, writer));
            FloatDirect {
                name: $name,
                available: || true $(&& has!($feature))*,
                blocking: crate::packed::Blocking::of::<<$chain as direct::Chain>::D>(),
                run,
            }
        };
    };
}

/// A Winograd f32 kernel around a product.
macro_rules! winograd_f32 {
    ($static:ident = $name:literal, [$($feature:tt),*], $dot:ty) => {
        static $static: FloatWinograd = {
            use crate::{arch::leaf, winograd::generic, writers};
            const { assert!(crate::arch::names_tile::<$dot>($name)) };
            leaf!([$($feature),*], fn run(job: &generic::Job<'_, generic::Floats>, writer: &writers::Biased<'_>) =
                generic::run::<generic::Floats, $dot, _>(job, writer));
            FloatWinograd {
                name: $name,
                available: || true $(&& has!($feature))*,
                blocking: crate::packed::Blocking::of::<$dot>(),
                plan: generic::Plan::new::<generic::Floats, $dot>,
                run,
            }
        };
    };
}

/// A max-pool: plain loops, compiled for the tier.
macro_rules! max_pool {
    ($static:ident = $name:literal, [$($feature:tt),*]) => {
        static $static: Pool = {
            use crate::{arch::leaf, pool};
            leaf!([$($feature),*], fn u8(job: &pool::Job<'_, u8>) = pool::pool(job));
            leaf!([$($feature),*], fn f32(job: &pool::Job<'_, f32>) = pool::pool(job));
            Pool { name: $name, available: || true $(&& has!($feature))*, u8, f32 }
        };
    };
}

/// A chain of multiply-accumulates.
macro_rules! chain {
    ($static:ident = $name:literal, [$($feature:tt),*], $core:ident::<$dot:ty>) => {
        static $static: PeakChain = {
            use crate::arch::leaf;
            leaf!([$($feature),*], fn run(steps: u64) -> u64 = $core::<$dot>(steps));
            PeakChain { name: $name, available: || true $(&& has!($feature))*, run }
        };
    };
}

pub(crate) use {chain, direct_f32, direct_int8, leaf, max_pool, winograd_f32, winograd_int8};

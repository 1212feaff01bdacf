//! This machine's own peak: register-only chains of the instructions that the kernels are made of.

use std::time::{Duration, Instant};

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::kernel::{PeakChain, Ready, Tier};
#[cfg(target_arch = "x86_64")]
use crate::simd::SegmentedDot;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::simd::{Dot, Simd};
use crate::{Isa, KernelError};

/// Multiply-accumulates per second of one thread, in units of 10⁹.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// u8 · i8: `tdpbusd` with AMX, `vpdpbusd` with VNNI, `usmmla` with i8mm, `sdot` with dotprod; on other x86 CPUs
    /// `vpmaddubsw` + `vpaddw` (the shortest exact chain).
    pub int8: f64,
    /// f32 fused multiply-add.
    pub f32: f64,
}

impl Peak {
    /// Measures `isa` on the calling thread for about `duration`, and takes the best of many short runs.
    ///
    /// # Errors
    /// When the CPU lacks `isa`.
    pub fn measure(isa: Isa, duration: Duration) -> Result<Peak, KernelError> {
        let half = duration / 2;
        if isa == Isa::Scalar {
            return Ok(Peak {
                int8: best(half, scalar_int8),
                f32: best(half, scalar_f32),
            });
        }
        let (int8, f32) = chains(isa, half).ok_or(KernelError::Unsupported(isa))?;
        Ok(Peak { int8, f32 })
    }
}

/// What the chains of a vector tier reach, or `None` where this CPU lacks it.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
fn chains(isa: Isa, duration: Duration) -> Option<(f64, f64)> {
    let tier = Tier::of(isa)?;
    let measure = |chain: &'static PeakChain| {
        let chain = Ready::new(chain)?;
        // SAFETY: `Ready` proves that the CPU has the chain's features.
        Some(best(duration, |steps| unsafe { (chain.run)(steps) }))
    };
    Some((measure(tier.peak_int8)?, measure(tier.peak_f32)?))
}

/// This architecture has the scalar tier only.
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn chains(_isa: Isa, _duration: Duration) -> Option<(f64, f64)> {
    None
}

/// Steps per timed run.
const STEPS: u64 = 20_000;

/// Runs `chain(STEPS)`, which returns its multiply-accumulates, until `duration` is over; the best rate in 10⁹ per
/// second.
fn best(duration: Duration, chain: impl Fn(u64) -> u64) -> f64 {
    let begin = Instant::now();
    let mut best = 0.0f64;
    loop {
        let start = Instant::now();
        let macs = chain(STEPS);
        best = best.max(macs as f64 / start.elapsed().as_nanos() as f64);
        if begin.elapsed() >= duration {
            return best;
        }
    }
}

fn scalar_int8(steps: u64) -> u64 {
    let (x, w) = (
        std::hint::black_box([3u8; 8]),
        std::hint::black_box([5i8; 8]),
    );
    let mut acc = [0i32; 8];
    for _ in 0..steps {
        for i in 0..8 {
            acc[i] = std::hint::black_box(acc[i] + i32::from(x[i]) * i32::from(w[i]));
        }
    }
    std::hint::black_box(acc);
    steps * 8
}

fn scalar_f32(steps: u64) -> u64 {
    let (x, w) = (
        std::hint::black_box([0.5f32; 8]),
        std::hint::black_box([0.25f32; 8]),
    );
    let mut acc = [0f32; 8];
    for _ in 0..steps {
        for i in 0..8 {
            acc[i] = std::hint::black_box(acc[i] + x[i] * w[i]);
        }
    }
    std::hint::black_box(acc);
    steps * 8
}

/// Independent chains: latency × throughput of the CPUs at hand is at most 10. Each starts from memory of its own, or
/// the compiler would see that they are the same.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
const CHAINS: usize = 10;

/// # Safety
/// The features of `D` are on.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[inline(always)]
pub(crate) unsafe fn dots<D: Dot>(steps: u64) -> u64 {
    let numbers = std::hint::black_box([1u8; 64 * CHAINS]);
    // SAFETY: 64 bytes are at least one vector; the features are on.
    unsafe {
        let at = numbers.as_ptr();
        let (x, w) = (D::splat(at), D::weights(at));
        let mut acc = [D::load_acc(at); CHAINS];
        for (i, chain) in acc.iter_mut().enumerate() {
            *chain = D::load_acc(at.add(i * 64));
        }
        for _ in 0..steps {
            for chain in &mut acc {
                *chain = D::dot(*chain, x, w);
            }
        }
        std::hint::black_box(acc);
    }
    steps * (CHAINS * D::S::LANES * D::PACK * D::TOGETHER) as u64
}

/// Chains where a product and its sum are two instructions. Each reads weights of its own, and both are read anew in
/// every step, or the compiler would compute the product once for all.
///
/// # Safety
/// The features of `D` are on.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[inline(always)]
pub(crate) unsafe fn products<D: Dot>(steps: u64) -> u64 {
    let mut numbers = std::hint::black_box([1u8; 64 * CHAINS]);
    let at: *mut u8 = std::hint::black_box(numbers.as_mut_ptr());
    // SAFETY: CHAINS times 64 bytes, each at least one vector; the features are on.
    unsafe {
        let mut acc = [D::load_acc(at); CHAINS];
        for (i, chain) in acc.iter_mut().enumerate() {
            *chain = D::load_acc(at.add(i * 64));
        }
        for _ in 0..steps {
            // The numbers may have changed as far as the compiler knows.
            std::arch::asm!("", options(nostack, preserves_flags));
            let x = D::splat(at);
            for (i, chain) in acc.iter_mut().enumerate() {
                *chain = D::dot(*chain, x, D::weights(at.add(i * 64)));
            }
        }
        std::hint::black_box(acc);
    }
    steps * (CHAINS * D::S::LANES * D::PACK * D::TOGETHER) as u64
}

/// Chains of a sum in i16: each has weights of its own, or the compiler would share the product.
#[cfg(target_arch = "x86_64")]
const SUMS: usize = 6;

/// # Safety
/// The features of `D` are on.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) unsafe fn sums<D: SegmentedDot>(steps: u64) -> u64 {
    let mut numbers = std::hint::black_box([1u8; 64 * SUMS]);
    let at: *mut u8 = std::hint::black_box(numbers.as_mut_ptr());
    // SAFETY: 64 bytes are at least one vector; the features are on.
    unsafe {
        let mut w = [D::weights(at); SUMS];
        for (i, w) in w.iter_mut().enumerate() {
            *w = D::weights(at.add(i * 64));
        }
        let mut acc = w;
        for _ in 0..steps {
            // The input may have changed as far as the compiler knows, so that the products are computed again.
            std::arch::asm!("", options(nostack, preserves_flags));
            let x = D::splat(at);
            for (chain, &w) in acc.iter_mut().zip(&w) {
                *chain = D::more(*chain, x, w);
            }
        }
        std::hint::black_box(acc);
    }
    steps * (SUMS * D::S::LANES * D::PACK) as u64
}

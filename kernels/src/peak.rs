//! This machine's own peak: register-only chains of the instructions that the kernels are made of.

use std::cell::Cell;
use std::panic::resume_unwind;
use std::thread::Builder;
use std::time::{Duration, Instant};

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::kernel::{PeakChain, Ready, Tier};
#[cfg(target_arch = "x86_64")]
use crate::simd::SegmentedDot;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
use crate::simd::{Dot, Simd};
use crate::{Isa, KernelError};

/// Multiply-accumulates per second, in units of 10⁹.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// u8 · i8: `tdpbusd` with AMX, `vpdpbusd` with VNNI, `usmmla` with i8mm, `sdot` with dotprod; on other x86 CPUs
    /// `vpmaddubsw` + `vpaddw` (the shortest exact chain).
    pub int8: f64,
    /// f32 fused multiply-add.
    pub f32: f64,
    /// Threads that were measured: at most those asked for.
    pub threads: usize,
}

impl Peak {
    /// Measures `isa` on the calling thread for about `duration`, and takes the best of many short runs.
    ///
    /// # Errors
    /// When the CPU lacks `isa`.
    pub fn measure(isa: Isa, duration: Duration) -> Result<Peak, KernelError> {
        rates(isa, 1, &|chain| best(duration / 2, chain))
    }

    /// Measures `isa` on `threads` threads at once for about `duration`: what all of them do within the same short
    /// window, in the best window. Best runs of single threads need not coincide and must not be added up. Where the
    /// system has no room for so many threads, those that there can be are measured.
    ///
    /// # Errors
    /// When the CPU lacks `isa`.
    pub fn together(isa: Isa, threads: usize, duration: Duration) -> Result<Peak, KernelError> {
        Self::with(Builder::new, isa, threads, duration)
    }

    fn with(
        thread: impl Fn() -> Builder,
        isa: Isa,
        threads: usize,
        duration: Duration,
    ) -> Result<Peak, KernelError> {
        let mut threads = threads.max(1);
        loop {
            let least = Cell::new(threads);
            let peak = rates(isa, threads, &|chain| {
                let (rate, measured) = best_together(&thread, threads, duration / 2, chain);
                least.set(least.get().min(measured));
                rate
            })?;
            if least.get() == threads {
                return Ok(peak);
            }
            // Both chains are to have run on as many threads.
            threads = least.get();
        }
    }
}

/// Runs so many steps and returns its multiply-accumulates.
type Chain<'a> = dyn Fn(u64) -> u64 + Sync + 'a;
/// Measures a chain: 10⁹ multiply-accumulates per second.
type Rate<'a> = dyn Fn(&Chain<'_>) -> f64 + 'a;

fn rates(isa: Isa, threads: usize, rate: &Rate<'_>) -> Result<Peak, KernelError> {
    let (int8, f32) = match isa {
        Isa::Scalar => (rate(&scalar_int8), rate(&scalar_f32)),
        _ => chains(isa, rate).ok_or(KernelError::Unsupported(isa))?,
    };
    Ok(Peak { int8, f32, threads })
}

/// What the chains of a vector tier reach, or `None` where this CPU lacks it.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
fn chains(isa: Isa, rate: &Rate<'_>) -> Option<(f64, f64)> {
    let tier = Tier::of(isa)?;
    let measure = |chain: &'static PeakChain| {
        let chain = Ready::new(chain)?;
        // SAFETY: `Ready` proves that the CPU has the chain's features.
        Some(rate(&|steps| unsafe { (chain.run)(steps) }))
    };
    Some((measure(tier.peak_int8)?, measure(tier.peak_f32)?))
}

/// This architecture has the scalar tier only.
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn chains(_isa: Isa, _rate: &Rate<'_>) -> Option<(f64, f64)> {
    None
}

/// Steps per timed run.
const STEPS: u64 = 20_000;

/// Runs `chain(STEPS)`, which returns its multiply-accumulates, until `duration` is over; the best rate in 10⁹ per
/// second.
fn best(duration: Duration, chain: &Chain<'_>) -> f64 {
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

/// In which all threads are counted together: long beside a run, short beside what disturbs one.
const WINDOW: Duration = Duration::from_millis(20);

/// Runs `chain` on `threads` threads, or as many of them as the system has room for, until `duration` is over: the rate
/// of all in their best window, in 10⁹ per second, and how many there were.
fn best_together(
    thread: impl Fn() -> Builder,
    threads: usize,
    duration: Duration,
    chain: &Chain<'_>,
) -> (f64, usize) {
    let windows = (duration.as_nanos() / WINDOW.as_nanos()).max(1) as usize;
    let begin = Instant::now();
    let count = || {
        let mut done = vec![0.0; windows];
        loop {
            let start = begin.elapsed();
            if start >= WINDOW * windows as u32 {
                return done;
            }
            let macs = chain(STEPS);
            share(&mut done, start, begin.elapsed(), macs as f64);
        }
    };
    let all = std::thread::scope(|scope| {
        let others = (1..threads).map_while(|_| thread().spawn_scoped(scope, count).ok());
        let others: Vec<_> = others.collect();
        let mut all = vec![count()];
        for other in others {
            all.push(other.join().unwrap_or_else(|panic| resume_unwind(panic)));
        }
        all
    });
    (busiest(&all) / WINDOW.as_nanos() as f64, all.len())
}

/// Adds what was done from `start` to `end` to the windows, by the time that fell into each.
fn share(windows: &mut [f64], start: Duration, end: Duration, macs: f64) {
    let whole = end.saturating_sub(start).as_secs_f64().max(1e-9);
    let first = (start.as_nanos() / WINDOW.as_nanos()) as usize;
    for (k, window) in windows.iter_mut().enumerate().skip(first) {
        let from = WINDOW * k as u32;
        if from >= end {
            break;
        }
        let inside = end.min(from + WINDOW).saturating_sub(start.max(from));
        *window += macs * inside.as_secs_f64() / whole;
    }
}

/// What all threads did in the window in which they did most.
fn busiest(all: &[Vec<f64>]) -> f64 {
    let windows = all.iter().map(Vec::len).min().unwrap_or(0);
    let sum = |k: usize| all.iter().map(|done| done[k]).sum::<f64>();
    (0..windows).map(sum).fold(0.0, f64::max)
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

/// As many independent chains as a kernel's tile has accumulators. Latency × throughput of the CPUs at hand is at most
/// 10, but not every product finds the port that is free: with 10 chains Emerald Rapids reached 333 of the
/// 384 GMAC/s that it has at 3.0 GHz.
///
/// # Safety
/// The features of `D` are on.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[inline(always)]
pub(crate) unsafe fn dots<D: Dot>(steps: u64) -> u64 {
    // SAFETY: the caller's contract.
    unsafe {
        match D::MAX_MR * D::MAX_NV {
            24.. => dot_chains::<D, 24>(steps),
            12.. => dot_chains::<D, 12>(steps),
            _ => dot_chains::<D, 10>(steps),
        }
    }
}

/// Each chain starts from memory of its own, or the compiler would see that they are the same.
///
/// # Safety
/// The features of `D` are on.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[inline(always)]
unsafe fn dot_chains<D: Dot, const CHAINS: usize>(steps: u64) -> u64 {
    let numbers = std::hint::black_box([[1u8; 64]; CHAINS]);
    // SAFETY: i < CHAINS, so that 64 · i + 64 <= the length of `numbers`; a vector is at most 64 bytes. The features
    // are on (caller).
    unsafe {
        let at: *const u8 = numbers.as_ptr().cast();
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

/// Chains of two instructions, of which the second is short.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
const CHAINS: usize = 10;

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
    // SAFETY: i < CHAINS, so that 64 · i + 64 <= the length of `numbers`; a vector is at most 64 bytes. The features
    // are on (caller).
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
    // SAFETY: i < SUMS, so that 64 · i + 64 <= the length of `numbers`; a vector is at most 64 bytes. The features are
    // on (caller).
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_belongs_to_the_windows_in_which_it_was_done() {
        let mut windows = vec![0.0; 3];
        share(&mut windows, WINDOW / 2, WINDOW * 2, 30.0);
        assert!((windows[0] - 10.0).abs() < 1e-9 && (windows[1] - 20.0).abs() < 1e-9);
        // What goes on after the end is not counted.
        share(&mut windows, WINDOW * 5 / 2, WINDOW * 7 / 2, 8.0);
        assert!((windows[2] - 4.0).abs() < 1e-9, "{windows:?}");
    }

    #[test]
    fn threads_that_take_turns_are_not_added_up() {
        assert_eq!(busiest(&[vec![10.0, 0.0], vec![0.0, 10.0]]), 10.0);
        assert_eq!(busiest(&[vec![10.0, 9.0], vec![0.0, 9.0]]), 18.0);
    }

    /// A stack that no machine has room for stands in for a system that starts no more threads.
    #[test]
    #[cfg_attr(miri, ignore = "Miri starts a thread whatever its stack")]
    fn threads_that_cannot_be_had_are_not_measured() {
        let none = || Builder::new().stack_size(1 << 60);
        assert!(none().spawn(|| ()).is_err());
        // The first chain finds room for two more threads, the second for one.
        let asked = Cell::new(0);
        let few = || {
            asked.set(asked.get() + 1);
            match asked.get() {
                1 | 2 | 4 | 6.. => Builder::new(),
                _ => none(),
            }
        };
        let one = Peak::with(none, Isa::Scalar, 4, 10 * WINDOW).unwrap();
        let two = Peak::with(few, Isa::Scalar, 4, 10 * WINDOW).unwrap();
        for (peak, threads) in [(one, 1), (two, 2)] {
            assert_eq!(peak.threads, threads);
            assert!(peak.int8 > 0.0 && peak.f32 > 0.0, "{peak:?}");
        }
    }
}

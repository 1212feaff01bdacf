//! AVX2 with FMA: 8 lanes. `vpdpbusd` and `vpdpwssd` with AVX-VNNI; `vpmaddubsw`, `vpmaddwd` and adds without.

use std::arch::asm;
use std::arch::x86_64::*;
use std::mem::MaybeUninit;

use crate::simd::{Dot, SegmentedDot, Simd, ops};

/// 256-bit vectors; needs AVX2 and FMA.
#[derive(Clone, Copy)]
pub(crate) struct Avx2;

/// Zero, made anew at every use: with 12 accumulators the compiler would keep it in one of 16 registers across the loop
/// of products, and an accumulator on the stack.
#[inline]
#[target_feature(enable = "avx2")]
fn zero() -> __m256i {
    if cfg!(miri) {
        return _mm256_setzero_si256();
    }
    let zero;
    // SAFETY: registers only; the feature is on.
    unsafe {
        asm!(
            "vpxor {0:x}, {0:x}, {0:x}",
            out(ymm_reg) zero,
            options(nomem, nostack, preserves_flags)
        );
    }
    zero
}

/// All ones in the first `n` of 8 lanes.
///
/// # Safety
/// AVX2 is on.
#[inline(always)]
unsafe fn lane_mask(n: usize) -> __m256i {
    debug_assert!(n <= 8);
    // SAFETY: the caller has AVX2 on.
    unsafe {
        let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        _mm256_cmpgt_epi32(_mm256_set1_epi32(n as i32), lanes)
    }
}

/// The first `n` of 16 bytes, zeros behind them.
///
/// # Safety
/// `n <= 16`, and `n` bytes are readable at `at`.
#[inline(always)]
unsafe fn load_bytes(at: *const u8, n: usize) -> __m128i {
    debug_assert!(n <= 16);
    // SAFETY: n <= 16 bytes are readable at `at` (caller) and fit `bytes`.
    unsafe {
        if n == 16 {
            return _mm_loadu_si128(at.cast());
        }
        if n == 8 {
            return _mm_loadl_epi64(at.cast());
        }
        let mut bytes = MaybeUninit::<[u8; 16]>::uninit();
        let to: *mut u8 = bytes.as_mut_ptr().cast();
        _mm_storeu_si128(to.cast(), _mm256_castsi256_si128(zero()));
        std::ptr::copy_nonoverlapping(at, to, n);
        _mm_loadu_si128(to.cast())
    }
}

// SAFETY: 8 lanes of 32 bits; partial accesses touch the first n lanes only.
unsafe impl Simd for Avx2 {
    const LANES: usize = 8;
    type F = __m256;
    type I = __m256i;
    type H = __m256i;

    ops! {
        fn zero_f() -> __m256 = _mm256_castsi256_ps(zero());
        fn splat_f(value: f32) -> __m256 = _mm256_set1_ps(value);
        fn load_f(at: *const f32) -> __m256 = _mm256_loadu_ps(at);
        fn load_f_part(at: *const f32, n: usize) -> __m256 =
            if n == 8 { _mm256_loadu_ps(at) } else { _mm256_maskload_ps(at, lane_mask(n)) };
        // AMD's CPUs take a masked store apart into dozens of operations.
        fn store_f_part(value: __m256, at: *mut f32, n: usize) =
            if n == 8 { _mm256_storeu_ps(at, value) } else { _mm256_maskstore_ps(at, lane_mask(n), value) };
        fn add_f(a: __m256, b: __m256) -> __m256 = _mm256_add_ps(a, b);
        fn sub_f(a: __m256, b: __m256) -> __m256 = _mm256_sub_ps(a, b);
        fn mul_f(a: __m256, b: __m256) -> __m256 = _mm256_mul_ps(a, b);
        fn mul_add_f(a: __m256, b: __m256, c: __m256) -> __m256 = _mm256_fmadd_ps(a, b, c);
        fn mul_sub_f(a: __m256, b: __m256, c: __m256) -> __m256 = _mm256_fnmadd_ps(a, b, c);
        fn max_f(a: __m256, b: __m256) -> __m256 = _mm256_max_ps(a, b);
        fn min_f(a: __m256, b: __m256) -> __m256 = _mm256_min_ps(a, b);
        fn f_from_i(value: __m256i) -> __m256 = _mm256_cvtepi32_ps(value);
        fn store_u8_part(value: __m256, at: *mut u8, n: usize) = {
            let whole = _mm256_cvtps_epi32(value);
            let words = _mm_packus_epi32(_mm256_castsi256_si128(whole), _mm256_extracti128_si256::<1>(whole));
            let bytes = _mm_packus_epi16(words, words);
            if n == 8 {
                _mm_storel_epi64(at.cast(), bytes);
            } else {
                let all = _mm_cvtsi128_si64(bytes).to_le_bytes();
                std::ptr::copy_nonoverlapping(all.as_ptr(), at, n);
            }
        };
        fn store_u7_part(value: __m256, at: *mut u8, n: usize) = {
            let whole = _mm256_cvtps_epi32(value);
            let words = _mm_packs_epi32(_mm256_castsi256_si128(whole), _mm256_extracti128_si256::<1>(whole));
            let bytes = _mm_max_epi8(_mm_packs_epi16(words, words), _mm256_castsi256_si128(zero()));
            if n == 8 {
                _mm_storel_epi64(at.cast(), bytes);
            } else {
                let all = _mm_cvtsi128_si64(bytes).to_le_bytes();
                std::ptr::copy_nonoverlapping(all.as_ptr(), at, n);
            }
        };
        fn store_u7_4(values: [__m256; 4], at: *mut u8, step: usize) = {
            let words = _mm256_packs_epi32(_mm256_cvtps_epi32(values[0]), _mm256_cvtps_epi32(values[1]));
            let more = _mm256_packs_epi32(_mm256_cvtps_epi32(values[2]), _mm256_cvtps_epi32(values[3]));
            // Lane i of 128 bits holds lanes 4i..4i + 4 of every value.
            let bytes = _mm256_max_epi8(_mm256_packs_epi16(words, more), zero());
            let bytes = _mm256_permutevar8x32_epi32(bytes, _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7));
            let (low, high) = (_mm256_castsi256_si128(bytes), _mm256_extracti128_si256::<1>(bytes));
            _mm_storel_epi64(at.cast(), low);
            _mm_storel_epi64(at.add(step).cast(), _mm_unpackhi_epi64(low, low));
            _mm_storel_epi64(at.add(2 * step).cast(), high);
            _mm_storel_epi64(at.add(3 * step).cast(), _mm_unpackhi_epi64(high, high));
        };
        fn load_u8_part(at: *const u8, n: usize) -> __m256 = {
            let bytes = if n == 8 { _mm_loadl_epi64(at.cast()) } else { load_bytes(at, n) };
            _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes))
        };
        fn load_i(at: *const i32) -> __m256i = _mm256_loadu_si256(at.cast());
        fn store_i(value: __m256i, at: *mut i32) = _mm256_storeu_si256(at.cast(), value);
        fn add_i(a: __m256i, b: __m256i) -> __m256i = _mm256_add_epi32(a, b);
        fn sub_i(a: __m256i, b: __m256i) -> __m256i = _mm256_sub_epi32(a, b);
        fn shr_i(a: __m256i, bits: __m256i) -> __m256i = _mm256_srav_epi32(a, bits);
        fn shl_i<const BITS: u32>(a: __m256i) -> __m256i = _mm256_sll_epi32(a, _mm_cvtsi32_si128(BITS as i32));
        fn load_u8_h(at: *const u8, n: usize) -> __m256i = _mm256_cvtepu8_epi16(load_bytes(at, n));
        fn store_h(value: __m256i, at: *mut i16) = _mm256_storeu_si256(at.cast(), value);
        fn add_h(a: __m256i, b: __m256i) -> __m256i = _mm256_add_epi16(a, b);
        fn sub_h(a: __m256i, b: __m256i) -> __m256i = _mm256_sub_epi16(a, b);
        fn shl_h<const BITS: u32>(a: __m256i) -> __m256i = _mm256_sll_epi16(a, _mm_cvtsi32_si128(BITS as i32));
        fn zero_h() -> __m256i = _mm256_setzero_si256();
    }
}

/// f32 fused multiply-add.
#[derive(Clone, Copy)]
pub(crate) struct F32;

// SAFETY: loads 32 bytes of weights and 4 of input.
unsafe impl Dot for F32 {
    type S = Avx2;
    type Acc = __m256;
    type V = __m256;
    // 12 accumulators, 2 weights, an input. With a third vector of weights the compiler keeps an accumulator on the
    // stack.
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 6;
    const PACK: usize = 1;

    ops! {
        fn load_acc(at: *const u8) -> __m256 = _mm256_loadu_ps(at.cast());
        fn weights(at: *const u8) -> __m256 = _mm256_loadu_ps(at.cast());
        fn splat(at: *const u8) -> __m256 = _mm256_set1_ps(at.cast::<f32>().read_unaligned());
        fn dot(acc: __m256, x: __m256, w: __m256) -> __m256 = _mm256_fmadd_ps(x, w, acc);
    }
}

/// Four u8 · i8 products with `vpdpbusd`; needs AVX-VNNI.
#[derive(Clone, Copy)]
pub(crate) struct U8Vnni;

// SAFETY: loads 32 bytes of weights and 4 of input.
unsafe impl Dot for U8Vnni {
    type S = Avx2;
    type Acc = __m256i;
    type V = __m256i;
    // 12 accumulators, 2 weights, an input. A product takes 5 cycles, and two begin in each: 8 accumulators leave a
    // fifth of the cycles without one.
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 6;
    const PACK: usize = 4;

    ops! {
        fn load_acc(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn weights(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn splat(at: *const u8) -> __m256i = _mm256_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m256i, x: __m256i, w: __m256i) -> __m256i = _mm256_dpbusd_avx_epi32(acc, x, w);
    }
}

/// `vpdpwssd`. LLVM splits the intrinsic into `vpmaddwd` and `vpaddd`, which takes twice the slots.
#[inline]
#[target_feature(enable = "avx2,avxvnni")]
fn dpwssd(acc: __m256i, x: __m256i, w: __m256i) -> __m256i {
    if cfg!(miri) {
        return _mm256_add_epi32(acc, _mm256_madd_epi16(x, w));
    }
    let mut acc = acc;
    // SAFETY: registers only; the features are on.
    unsafe {
        asm!(
            "{{vex}} vpdpwssd {0}, {1}, {2}",
            inout(ymm_reg) acc, in(ymm_reg) x, in(ymm_reg) w,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    acc
}

/// Two i16 · i16 products with `vpdpwssd`; needs AVX-VNNI.
#[derive(Clone, Copy)]
pub(crate) struct I16Vnni;

// SAFETY: loads 32 bytes of weights and 4 of input.
unsafe impl Dot for I16Vnni {
    type S = Avx2;
    type Acc = __m256i;
    type V = __m256i;
    // 12 accumulators, 2 weights, an input. A product takes 5 cycles, and two begin in each: 8 accumulators leave a
    // fifth of the cycles without one.
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 6;
    const PACK: usize = 2;

    ops! {
        fn load_acc(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn weights(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn splat(at: *const u8) -> __m256i = _mm256_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m256i, x: __m256i, w: __m256i) -> __m256i = dpwssd(acc, x, w);
    }
}

/// Two i16 · i16 products with `vpmaddwd` and an add.
#[derive(Clone, Copy)]
pub(crate) struct I16;

// SAFETY: loads 32 bytes of weights and 4 of input.
unsafe impl Dot for I16 {
    type S = Avx2;
    type Acc = __m256i;
    type V = __m256i;
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 4;
    const PACK: usize = 2;

    ops! {
        fn load_acc(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn weights(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn splat(at: *const u8) -> __m256i = _mm256_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m256i, x: __m256i, w: __m256i) -> __m256i =
            _mm256_add_epi32(acc, _mm256_madd_epi16(x, w));
    }
}

/// Four u8 · i8 products with `vpmaddubsw`, summed in i16.
#[derive(Clone, Copy)]
pub(crate) struct U8Segmented;

// SAFETY: loads 32 bytes of weights and 4 of input.
unsafe impl Dot for U8Segmented {
    type S = Avx2;
    type Acc = __m256i;
    type V = __m256i;
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 4;
    const PACK: usize = 4;

    ops! {
        fn load_acc(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn weights(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn splat(at: *const u8) -> __m256i = _mm256_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m256i, x: __m256i, w: __m256i) -> __m256i =
            Self::spill(acc, _mm256_maddubs_epi16(x, w), Avx2::zero_h());
    }
}

// SAFETY: no memory is touched.
unsafe impl SegmentedDot for U8Segmented {
    ops! {
        fn first(x: __m256i, w: __m256i) -> __m256i = _mm256_maddubs_epi16(x, w);
        fn more(sum: __m256i, x: __m256i, w: __m256i) -> __m256i =
            _mm256_add_epi16(sum, _mm256_maddubs_epi16(x, w));
        fn spill(acc: __m256i, sum: __m256i, offset: __m256i) -> __m256i = {
            let sum = _mm256_add_epi16(sum, offset);
            _mm256_add_epi32(acc, _mm256_madd_epi16(sum, _mm256_set1_epi16(1)))
        };
    }
}

/// Four u8 · i8 products by way of i16 halves: exact for every input, for layers whose pairs could leave i16.
#[derive(Clone, Copy)]
pub(crate) struct U8Wide;

// SAFETY: loads 32 bytes of weights and 4 of input.
unsafe impl Dot for U8Wide {
    type S = Avx2;
    type Acc = __m256i;
    type V = __m256i;
    const MAX_NV: usize = 1;
    const MAX_MR: usize = 4;
    const PACK: usize = 4;

    ops! {
        fn load_acc(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn weights(at: *const u8) -> __m256i = _mm256_loadu_si256(at.cast());
        fn splat(at: *const u8) -> __m256i = _mm256_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m256i, x: __m256i, w: __m256i) -> __m256i = {
            let even_x = _mm256_and_si256(x, _mm256_set1_epi16(0xff));
            let odd_x = _mm256_srli_epi16::<8>(x);
            let even_w = _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(w));
            let odd_w = _mm256_srai_epi16::<8>(w);
            let even = _mm256_madd_epi16(even_x, even_w);
            let odd = _mm256_madd_epi16(odd_x, odd_w);
            _mm256_add_epi32(acc, _mm256_add_epi32(even, odd))
        };
    }
}

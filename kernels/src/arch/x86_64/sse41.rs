//! SSE4.1 with SSSE3: 4 lanes. `pmaddubsw`, `pmaddwd` and adds; no fused multiply-add.

use std::arch::x86_64::*;

use crate::simd::{Dot, SegmentedDot, Simd, ops};

/// 128-bit vectors; needs SSE4.1 and SSSE3.
#[derive(Clone, Copy)]
pub(crate) struct Sse41;

/// The first `n` of N numbers, zeros behind them.
///
/// # Safety
/// `n <= N` numbers are readable.
#[inline(always)]
unsafe fn load_part<T: Copy + Default, const N: usize>(at: *const T, n: usize) -> [T; N] {
    debug_assert!(n <= N);
    let mut part = [T::default(); N];
    // SAFETY: n <= N numbers are readable at `at` and fit `part`.
    unsafe { std::ptr::copy_nonoverlapping(at, part.as_mut_ptr(), n) };
    part
}

/// Stores the first `n` of four bytes.
///
/// # Safety
/// `n <= 4` bytes are writable.
#[inline(always)]
unsafe fn store_bytes(bytes: __m128i, at: *mut u8, n: usize) {
    debug_assert!(n <= 4);
    // SAFETY: n <= 4 bytes are writable at `at`; the caller has SSE2 on.
    unsafe {
        let four = _mm_cvtsi128_si32(bytes).to_le_bytes();
        if n == 4 {
            at.cast::<[u8; 4]>().write_unaligned(four);
        } else {
            std::ptr::copy_nonoverlapping(four.as_ptr(), at, n);
        }
    }
}

// SAFETY: 4 lanes of 32 bits; partial accesses touch the first n lanes only.
unsafe impl Simd for Sse41 {
    const LANES: usize = 4;
    type F = __m128;
    type I = __m128i;
    type H = __m128i;

    ops! {
        fn zero_f() -> __m128 = _mm_setzero_ps();
        fn splat_f(value: f32) -> __m128 = _mm_set1_ps(value);
        fn load_f(at: *const f32) -> __m128 = _mm_loadu_ps(at);
        fn load_f_part(at: *const f32, n: usize) -> __m128 = _mm_loadu_ps(load_part::<f32, 4>(at, n).as_ptr());
        fn store_f_part(value: __m128, at: *mut f32, n: usize) = {
            if n == 4 {
                _mm_storeu_ps(at, value);
            } else {
                let mut all = [0.0f32; 4];
                _mm_storeu_ps(all.as_mut_ptr(), value);
                std::ptr::copy_nonoverlapping(all.as_ptr(), at, n);
            }
        };
        fn add_f(a: __m128, b: __m128) -> __m128 = _mm_add_ps(a, b);
        fn sub_f(a: __m128, b: __m128) -> __m128 = _mm_sub_ps(a, b);
        fn mul_f(a: __m128, b: __m128) -> __m128 = _mm_mul_ps(a, b);
        fn mul_add_f(a: __m128, b: __m128, c: __m128) -> __m128 = _mm_add_ps(c, _mm_mul_ps(a, b));
        fn mul_sub_f(a: __m128, b: __m128, c: __m128) -> __m128 = _mm_sub_ps(c, _mm_mul_ps(a, b));
        fn max_f(a: __m128, b: __m128) -> __m128 = _mm_max_ps(a, b);
        fn min_f(a: __m128, b: __m128) -> __m128 = _mm_min_ps(a, b);
        fn f_from_i(value: __m128i) -> __m128 = _mm_cvtepi32_ps(value);
        fn store_u8_part(value: __m128, at: *mut u8, n: usize) = {
            let whole = _mm_cvtps_epi32(value);
            let words = _mm_packus_epi32(whole, whole);
            store_bytes(_mm_packus_epi16(words, words), at, n);
        };
        fn store_u7_part(value: __m128, at: *mut u8, n: usize) = {
            let whole = _mm_cvtps_epi32(value);
            let words = _mm_packs_epi32(whole, whole);
            let bytes = _mm_max_epi8(_mm_packs_epi16(words, words), _mm_setzero_si128());
            store_bytes(bytes, at, n);
        };
        fn store_u7_4(values: [__m128; 4], at: *mut u8, step: usize) = {
            let words = _mm_packs_epi32(_mm_cvtps_epi32(values[0]), _mm_cvtps_epi32(values[1]));
            let more = _mm_packs_epi32(_mm_cvtps_epi32(values[2]), _mm_cvtps_epi32(values[3]));
            let bytes = _mm_max_epi8(_mm_packs_epi16(words, more), _mm_setzero_si128());
            at.cast::<i32>().write_unaligned(_mm_cvtsi128_si32(bytes));
            at.add(step).cast::<i32>().write_unaligned(_mm_extract_epi32::<1>(bytes));
            at.add(2 * step).cast::<i32>().write_unaligned(_mm_extract_epi32::<2>(bytes));
            at.add(3 * step).cast::<i32>().write_unaligned(_mm_extract_epi32::<3>(bytes));
        };
        fn load_u8_part(at: *const u8, n: usize) -> __m128 = {
            let bytes = if n == 4 {
                at.cast::<i32>().read_unaligned()
            } else {
                i32::from_le_bytes(load_part::<u8, 4>(at, n))
            };
            _mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_cvtsi32_si128(bytes)))
        };
        fn load_i(at: *const i32) -> __m128i = _mm_loadu_si128(at.cast());
        fn store_i(value: __m128i, at: *mut i32) = _mm_storeu_si128(at.cast(), value);
        fn add_i(a: __m128i, b: __m128i) -> __m128i = _mm_add_epi32(a, b);
        fn sub_i(a: __m128i, b: __m128i) -> __m128i = _mm_sub_epi32(a, b);
        fn shr_i(a: __m128i, bits: __m128i) -> __m128i = _mm_sra_epi32(a, _mm_srli_si128::<12>(bits));
        fn shl_i<const BITS: u32>(a: __m128i) -> __m128i = _mm_sll_epi32(a, _mm_cvtsi32_si128(BITS as i32));
        fn load_u8_h(at: *const u8, n: usize) -> __m128i =
            if n == 8 {
                _mm_cvtepu8_epi16(_mm_loadl_epi64(at.cast()))
            } else {
                _mm_cvtepu8_epi16(_mm_loadl_epi64(load_part::<u8, 8>(at, n).as_ptr().cast()))
            };
        fn store_h(value: __m128i, at: *mut i16) = _mm_storeu_si128(at.cast(), value);
        fn add_h(a: __m128i, b: __m128i) -> __m128i = _mm_add_epi16(a, b);
        fn sub_h(a: __m128i, b: __m128i) -> __m128i = _mm_sub_epi16(a, b);
        fn shl_h<const BITS: u32>(a: __m128i) -> __m128i = _mm_sll_epi16(a, _mm_cvtsi32_si128(BITS as i32));
        fn zero_h() -> __m128i = _mm_setzero_si128();
    }
}

/// f32 multiply and add.
#[derive(Clone, Copy)]
pub(crate) struct F32;

// SAFETY: loads 16 bytes of weights and 4 of input.
unsafe impl Dot for F32 {
    type S = Sse41;
    type Acc = __m128;
    type V = __m128;
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 4;
    const PACK: usize = 1;

    ops! {
        fn load_acc(at: *const u8) -> __m128 = _mm_loadu_ps(at.cast());
        fn weights(at: *const u8) -> __m128 = _mm_loadu_ps(at.cast());
        fn splat(at: *const u8) -> __m128 = _mm_set1_ps(at.cast::<f32>().read_unaligned());
        fn dot(acc: __m128, x: __m128, w: __m128) -> __m128 = _mm_add_ps(acc, _mm_mul_ps(x, w));
    }
}

/// Two i16 · i16 products with `pmaddwd` and an add.
#[derive(Clone, Copy)]
pub(crate) struct I16;

// SAFETY: loads 16 bytes of weights and 4 of input.
unsafe impl Dot for I16 {
    type S = Sse41;
    type Acc = __m128i;
    type V = __m128i;
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 4;
    const PACK: usize = 2;

    ops! {
        fn load_acc(at: *const u8) -> __m128i = _mm_loadu_si128(at.cast());
        fn weights(at: *const u8) -> __m128i = _mm_loadu_si128(at.cast());
        fn splat(at: *const u8) -> __m128i = _mm_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m128i, x: __m128i, w: __m128i) -> __m128i = _mm_add_epi32(acc, _mm_madd_epi16(x, w));
    }
}

/// Four u8 · i8 products with `pmaddubsw`, summed in i16.
#[derive(Clone, Copy)]
pub(crate) struct U8Segmented;

// SAFETY: loads 16 bytes of weights and 4 of input.
unsafe impl Dot for U8Segmented {
    type S = Sse41;
    type Acc = __m128i;
    type V = __m128i;
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 4;
    const PACK: usize = 4;

    ops! {
        fn load_acc(at: *const u8) -> __m128i = _mm_loadu_si128(at.cast());
        fn weights(at: *const u8) -> __m128i = _mm_loadu_si128(at.cast());
        fn splat(at: *const u8) -> __m128i = _mm_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m128i, x: __m128i, w: __m128i) -> __m128i =
            Self::spill(acc, _mm_maddubs_epi16(x, w), Sse41::zero_h());
    }
}

// SAFETY: no memory is touched.
unsafe impl SegmentedDot for U8Segmented {
    ops! {
        fn first(x: __m128i, w: __m128i) -> __m128i = _mm_maddubs_epi16(x, w);
        fn more(sum: __m128i, x: __m128i, w: __m128i) -> __m128i = _mm_add_epi16(sum, _mm_maddubs_epi16(x, w));
        fn spill(acc: __m128i, sum: __m128i, offset: __m128i) -> __m128i = {
            let sum = _mm_add_epi16(sum, offset);
            _mm_add_epi32(acc, _mm_madd_epi16(sum, _mm_set1_epi16(1)))
        };
    }
}

/// Four u8 · i8 products by way of i16 halves: exact for every input, for layers whose pairs could leave i16.
#[derive(Clone, Copy)]
pub(crate) struct U8Wide;

// SAFETY: loads 16 bytes of weights and 4 of input.
unsafe impl Dot for U8Wide {
    type S = Sse41;
    type Acc = __m128i;
    type V = __m128i;
    const MAX_NV: usize = 1;
    const MAX_MR: usize = 4;
    const PACK: usize = 4;

    ops! {
        fn load_acc(at: *const u8) -> __m128i = _mm_loadu_si128(at.cast());
        fn weights(at: *const u8) -> __m128i = _mm_loadu_si128(at.cast());
        fn splat(at: *const u8) -> __m128i = _mm_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m128i, x: __m128i, w: __m128i) -> __m128i = {
            let even_x = _mm_and_si128(x, _mm_set1_epi16(0xff));
            let odd_x = _mm_srli_epi16::<8>(x);
            let even_w = _mm_srai_epi16::<8>(_mm_slli_epi16::<8>(w));
            let odd_w = _mm_srai_epi16::<8>(w);
            let even = _mm_madd_epi16(even_x, even_w);
            let odd = _mm_madd_epi16(odd_x, odd_w);
            _mm_add_epi32(acc, _mm_add_epi32(even, odd))
        };
    }
}

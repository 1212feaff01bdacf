//! AVX-512: 16 lanes. `vpdpbusd` and `vpdpwssd` with VNNI; `vpmaddubsw`, `vpmaddwd` and adds without.

use std::arch::asm;
use std::arch::x86_64::*;

use crate::simd::{Dot, SegmentedDot, Simd, ops};

/// 512-bit vectors; needs AVX-512 F, BW and VL.
#[derive(Clone, Copy)]
pub(crate) struct Avx512;

#[inline(always)]
fn mask16(n: usize) -> __mmask16 {
    debug_assert!(n <= 16);
    ((1u32 << n) - 1) as __mmask16
}

#[inline(always)]
fn mask32(n: usize) -> __mmask32 {
    debug_assert!(n <= 32);
    ((1u64 << n) - 1) as __mmask32
}

/// `vpermd`. Where parts of what the intrinsic returns are stored, LLVM permutes once for each of them.
#[inline]
#[target_feature(enable = "avx512f")]
fn permute(value: __m512i, order: __m512i) -> __m512i {
    let mut value = value;
    // SAFETY: registers only; the features are on.
    unsafe {
        asm!(
            "vpermd {0}, {1}, {0}",
            inout(zmm_reg) value, in(zmm_reg) order,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    value
}

// SAFETY: 16 lanes of 32 bits; masked accesses touch the first n lanes only.
unsafe impl Simd for Avx512 {
    const LANES: usize = 16;
    type F = __m512;
    type I = __m512i;
    type H = __m512i;

    ops! {
        fn zero_f() -> __m512 = _mm512_setzero_ps();
        fn splat_f(value: f32) -> __m512 = _mm512_set1_ps(value);
        fn load_f(at: *const f32) -> __m512 = _mm512_loadu_ps(at);
        fn load_f_part(at: *const f32, n: usize) -> __m512 = _mm512_maskz_loadu_ps(mask16(n), at);
        fn store_f_part(value: __m512, at: *mut f32, n: usize) = _mm512_mask_storeu_ps(at, mask16(n), value);
        fn add_f(a: __m512, b: __m512) -> __m512 = _mm512_add_ps(a, b);
        fn sub_f(a: __m512, b: __m512) -> __m512 = _mm512_sub_ps(a, b);
        fn mul_f(a: __m512, b: __m512) -> __m512 = _mm512_mul_ps(a, b);
        fn mul_add_f(a: __m512, b: __m512, c: __m512) -> __m512 = _mm512_fmadd_ps(a, b, c);
        fn mul_sub_f(a: __m512, b: __m512, c: __m512) -> __m512 = _mm512_fnmadd_ps(a, b, c);
        fn max_f(a: __m512, b: __m512) -> __m512 = _mm512_max_ps(a, b);
        fn min_f(a: __m512, b: __m512) -> __m512 = _mm512_min_ps(a, b);
        fn f_from_i(value: __m512i) -> __m512 = _mm512_cvtepi32_ps(value);
        fn store_u8_part(value: __m512, at: *mut u8, n: usize) = {
            let bytes = _mm512_cvtepi32_epi8(_mm512_cvtps_epi32(value));
            if n == 16 {
                _mm_storeu_si128(at.cast(), bytes);
            } else {
                _mm_mask_storeu_epi8(at.cast(), mask16(n), bytes);
            }
        };
        fn store_u7_part(value: __m512, at: *mut u8, n: usize) = {
            let bytes = _mm512_cvtsepi32_epi8(_mm512_cvtps_epi32(value));
            let bytes = _mm_max_epi8(bytes, _mm_setzero_si128());
            if n == 16 {
                _mm_storeu_si128(at.cast(), bytes);
            } else {
                _mm_mask_storeu_epi8(at.cast(), mask16(n), bytes);
            }
        };
        fn store_u7_4(values: [__m512; 4], at: *mut u8, step: usize) = {
            let words = _mm512_packs_epi32(_mm512_cvtps_epi32(values[0]), _mm512_cvtps_epi32(values[1]));
            let more = _mm512_packs_epi32(_mm512_cvtps_epi32(values[2]), _mm512_cvtps_epi32(values[3]));
            // Lane i of 128 bits holds lanes 4i..4i + 4 of every value.
            let bytes = _mm512_max_epi8(_mm512_packs_epi16(words, more), _mm512_setzero_si512());
            let order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
            let bytes = permute(bytes, order);
            _mm_storeu_si128(at.cast(), _mm512_castsi512_si128(bytes));
            _mm_storeu_si128(at.add(step).cast(), _mm512_extracti32x4_epi32::<1>(bytes));
            _mm_storeu_si128(at.add(2 * step).cast(), _mm512_extracti32x4_epi32::<2>(bytes));
            _mm_storeu_si128(at.add(3 * step).cast(), _mm512_extracti32x4_epi32::<3>(bytes));
        };
        fn load_u8_part(at: *const u8, n: usize) -> __m512 = {
            let bytes = if n == 16 {
                _mm_loadu_si128(at.cast())
            } else {
                _mm_maskz_loadu_epi8(mask16(n), at.cast())
            };
            _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(bytes))
        };
        fn load_i(at: *const i32) -> __m512i = _mm512_loadu_si512(at.cast());
        fn store_i(value: __m512i, at: *mut i32) = _mm512_storeu_si512(at.cast(), value);
        fn add_i(a: __m512i, b: __m512i) -> __m512i = _mm512_add_epi32(a, b);
        fn sub_i(a: __m512i, b: __m512i) -> __m512i = _mm512_sub_epi32(a, b);
        fn shr_i(a: __m512i, bits: __m512i) -> __m512i = _mm512_srav_epi32(a, bits);
        fn shl_i<const BITS: u32>(a: __m512i) -> __m512i = _mm512_slli_epi32::<BITS>(a);
        fn load_u8_h(at: *const u8, n: usize) -> __m512i =
            if n == 32 {
                _mm512_cvtepu8_epi16(_mm256_loadu_si256(at.cast()))
            } else {
                _mm512_cvtepu8_epi16(_mm256_maskz_loadu_epi8(mask32(n), at.cast()))
            };
        fn store_h(value: __m512i, at: *mut i16) = _mm512_storeu_si512(at.cast(), value);
        fn add_h(a: __m512i, b: __m512i) -> __m512i = _mm512_add_epi16(a, b);
        fn sub_h(a: __m512i, b: __m512i) -> __m512i = _mm512_sub_epi16(a, b);
        fn shl_h<const BITS: u32>(a: __m512i) -> __m512i = _mm512_slli_epi16::<BITS>(a);
        fn zero_h() -> __m512i = _mm512_setzero_si512();
    }
}

/// f32 fused multiply-add.
#[derive(Clone, Copy)]
pub(crate) struct F32;

// SAFETY: loads 64 bytes of weights and 4 of input.
unsafe impl Dot for F32 {
    type S = Avx512;
    type Acc = __m512;
    type V = __m512;
    const MAX_NV: usize = 3;
    const MAX_MR: usize = 8;
    const PACK: usize = 1;

    ops! {
        fn load_acc(at: *const u8) -> __m512 = _mm512_loadu_ps(at.cast());
        fn weights(at: *const u8) -> __m512 = _mm512_loadu_ps(at.cast());
        fn splat(at: *const u8) -> __m512 = _mm512_set1_ps(at.cast::<f32>().read_unaligned());
        fn dot(acc: __m512, x: __m512, w: __m512) -> __m512 = _mm512_fmadd_ps(x, w, acc);
    }
}

/// Four u8 · i8 products with `vpdpbusd`; needs VNNI.
#[derive(Clone, Copy)]
pub(crate) struct U8Vnni;

// SAFETY: loads 64 bytes of weights and 4 of input.
unsafe impl Dot for U8Vnni {
    type S = Avx512;
    type Acc = __m512i;
    type V = __m512i;
    const MAX_NV: usize = 3;
    const MAX_MR: usize = 8;
    const PACK: usize = 4;

    ops! {
        fn load_acc(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn weights(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn splat(at: *const u8) -> __m512i = _mm512_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m512i, x: __m512i, w: __m512i) -> __m512i = _mm512_dpbusd_epi32(acc, x, w);
    }
}

/// `vpdpwssd`. LLVM splits the intrinsic into `vpmaddwd` and `vpaddd`, which takes twice the slots.
#[inline]
#[target_feature(enable = "avx512f,avx512vnni")]
fn dpwssd(acc: __m512i, x: __m512i, w: __m512i) -> __m512i {
    let mut acc = acc;
    // SAFETY: registers only; the features are on.
    unsafe {
        asm!(
            "vpdpwssd {0}, {1}, {2}",
            inout(zmm_reg) acc, in(zmm_reg) x, in(zmm_reg) w,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    acc
}

/// Two i16 · i16 products with `vpdpwssd`; needs VNNI.
#[derive(Clone, Copy)]
pub(crate) struct I16Vnni;

// SAFETY: loads 64 bytes of weights and 4 of input.
unsafe impl Dot for I16Vnni {
    type S = Avx512;
    type Acc = __m512i;
    type V = __m512i;
    const MAX_NV: usize = 3;
    const MAX_MR: usize = 8;
    const PACK: usize = 2;

    ops! {
        fn load_acc(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn weights(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn splat(at: *const u8) -> __m512i = _mm512_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m512i, x: __m512i, w: __m512i) -> __m512i = dpwssd(acc, x, w);
    }
}

/// Two i16 · i16 products with `vpmaddwd` and an add.
#[derive(Clone, Copy)]
pub(crate) struct I16;

// SAFETY: loads 64 bytes of weights and 4 of input.
unsafe impl Dot for I16 {
    type S = Avx512;
    type Acc = __m512i;
    type V = __m512i;
    const MAX_NV: usize = 3;
    const MAX_MR: usize = 8;
    const PACK: usize = 2;

    ops! {
        fn load_acc(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn weights(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn splat(at: *const u8) -> __m512i = _mm512_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m512i, x: __m512i, w: __m512i) -> __m512i =
            _mm512_add_epi32(acc, _mm512_madd_epi16(x, w));
    }
}

/// Four u8 · i8 products with `vpmaddubsw`, summed in i16.
#[derive(Clone, Copy)]
pub(crate) struct U8Segmented;

// SAFETY: loads 64 bytes of weights and 4 of input.
unsafe impl Dot for U8Segmented {
    type S = Avx512;
    type Acc = __m512i;
    type V = __m512i;
    const MAX_NV: usize = 3;
    const MAX_MR: usize = 4;
    const PACK: usize = 4;

    ops! {
        fn load_acc(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn weights(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn splat(at: *const u8) -> __m512i = _mm512_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m512i, x: __m512i, w: __m512i) -> __m512i =
            Self::spill(acc, _mm512_maddubs_epi16(x, w), Avx512::zero_h());
    }
}

// SAFETY: no memory is touched.
unsafe impl SegmentedDot for U8Segmented {
    ops! {
        fn first(x: __m512i, w: __m512i) -> __m512i = _mm512_maddubs_epi16(x, w);
        fn more(sum: __m512i, x: __m512i, w: __m512i) -> __m512i =
            _mm512_add_epi16(sum, _mm512_maddubs_epi16(x, w));
        fn spill(acc: __m512i, sum: __m512i, offset: __m512i) -> __m512i = {
            let sum = _mm512_add_epi16(sum, offset);
            _mm512_add_epi32(acc, _mm512_madd_epi16(sum, _mm512_set1_epi16(1)))
        };
    }
}

/// Four u8 · i8 products by way of i16 halves: exact for every input, for layers whose pairs could leave i16.
#[derive(Clone, Copy)]
pub(crate) struct U8Wide;

// SAFETY: loads 64 bytes of weights and 4 of input.
unsafe impl Dot for U8Wide {
    type S = Avx512;
    type Acc = __m512i;
    type V = __m512i;
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 8;
    const PACK: usize = 4;

    ops! {
        fn load_acc(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn weights(at: *const u8) -> __m512i = _mm512_loadu_si512(at.cast());
        fn splat(at: *const u8) -> __m512i = _mm512_set1_epi32(at.cast::<i32>().read_unaligned());
        fn dot(acc: __m512i, x: __m512i, w: __m512i) -> __m512i = {
            let even_x = _mm512_and_si512(x, _mm512_set1_epi16(0xff));
            let odd_x = _mm512_srli_epi16::<8>(x);
            let even_w = _mm512_srai_epi16::<8>(_mm512_slli_epi16::<8>(w));
            let odd_w = _mm512_srai_epi16::<8>(w);
            let even = _mm512_madd_epi16(even_x, even_w);
            let odd = _mm512_madd_epi16(odd_x, odd_w);
            _mm512_add_epi32(acc, _mm512_add_epi32(even, odd))
        };
    }
}

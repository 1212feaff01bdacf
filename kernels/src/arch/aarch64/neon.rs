//! NEON: 4 lanes. `sdot` where the CPU has it (activations of 7 bits are the same signed or unsigned), widening
//! products elsewhere.

use std::arch::aarch64::*;
use std::arch::asm;

use crate::direct::{Chain, Tile};
use crate::packed::Packed;
use crate::simd::{Dot, Simd, ops};

/// 128-bit vectors.
#[derive(Clone, Copy)]
pub(crate) struct Neon;

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

// SAFETY: 4 lanes of 32 bits; partial accesses touch the first n lanes only.
unsafe impl Simd for Neon {
    const LANES: usize = 4;
    type F = float32x4_t;
    type I = int32x4_t;
    type H = int16x8_t;

    ops! {
        fn zero_f() -> float32x4_t = vdupq_n_f32(0.0);
        fn splat_f(value: f32) -> float32x4_t = vdupq_n_f32(value);
        fn load_f(at: *const f32) -> float32x4_t = vld1q_f32(at);
        fn load_f_part(at: *const f32, n: usize) -> float32x4_t = vld1q_f32(load_part::<f32, 4>(at, n).as_ptr());
        fn store_f_part(value: float32x4_t, at: *mut f32, n: usize) = {
            if n == 4 {
                vst1q_f32(at, value);
            } else {
                let mut all = [0.0f32; 4];
                vst1q_f32(all.as_mut_ptr(), value);
                std::ptr::copy_nonoverlapping(all.as_ptr(), at, n);
            }
        };
        fn add_f(a: float32x4_t, b: float32x4_t) -> float32x4_t = vaddq_f32(a, b);
        fn sub_f(a: float32x4_t, b: float32x4_t) -> float32x4_t = vsubq_f32(a, b);
        fn mul_f(a: float32x4_t, b: float32x4_t) -> float32x4_t = vmulq_f32(a, b);
        fn mul_add_f(a: float32x4_t, b: float32x4_t, c: float32x4_t) -> float32x4_t = vfmaq_f32(c, a, b);
        fn mul_sub_f(a: float32x4_t, b: float32x4_t, c: float32x4_t) -> float32x4_t = vfmsq_f32(c, a, b);
        // `fmaxnm`, not `fmax`: where one is no number, the other.
        fn max_f(a: float32x4_t, b: float32x4_t) -> float32x4_t = vmaxnmq_f32(a, b);
        fn min_f(a: float32x4_t, b: float32x4_t) -> float32x4_t = vminnmq_f32(a, b);
        fn f_from_i(value: int32x4_t) -> float32x4_t = vcvtq_f32_s32(value);
        fn store_u8_part(value: float32x4_t, at: *mut u8, n: usize) = {
            let words = vqmovun_s32(vcvtnq_s32_f32(value));
            let bytes = vqmovn_u16(vcombine_u16(words, words));
            let all = vget_lane_u32::<0>(vreinterpret_u32_u8(bytes)).to_le_bytes();
            std::ptr::copy_nonoverlapping(all.as_ptr(), at, n);
        };
        fn store_u7_part(value: float32x4_t, at: *mut u8, n: usize) = {
            let words = vqmovn_s32(vcvtnq_s32_f32(value));
            let bytes = vmax_s8(vqmovn_s16(vcombine_s16(words, words)), vdup_n_s8(0));
            let all = vget_lane_u32::<0>(vreinterpret_u32_s8(bytes)).to_le_bytes();
            std::ptr::copy_nonoverlapping(all.as_ptr(), at, n);
        };
        fn store_u7_4(values: [float32x4_t; 4], at: *mut u8, step: usize) = {
            let words = |a, b| {
                vcombine_s16(vqmovn_s32(vcvtnq_s32_f32(a)), vqmovn_s32(vcvtnq_s32_f32(b)))
            };
            let low = vqmovn_s16(words(values[0], values[1]));
            let high = vqmovn_s16(words(values[2], values[3]));
            let bytes = vmaxq_s8(vcombine_s8(low, high), vdupq_n_s8(0));
            let pixels = vreinterpretq_u32_s8(bytes);
            at.cast::<u32>().write_unaligned(vgetq_lane_u32::<0>(pixels));
            at.add(step).cast::<u32>().write_unaligned(vgetq_lane_u32::<1>(pixels));
            at.add(2 * step).cast::<u32>().write_unaligned(vgetq_lane_u32::<2>(pixels));
            at.add(3 * step).cast::<u32>().write_unaligned(vgetq_lane_u32::<3>(pixels));
        };
        fn load_u8_part(at: *const u8, n: usize) -> float32x4_t = {
            let bytes = vld1_u8(load_part::<u8, 8>(at, n).as_ptr());
            vcvtq_f32_u32(vmovl_u16(vget_low_u16(vmovl_u8(bytes))))
        };
        fn load_i(at: *const i32) -> int32x4_t = vld1q_s32(at);
        fn store_i(value: int32x4_t, at: *mut i32) = vst1q_s32(at, value);
        fn add_i(a: int32x4_t, b: int32x4_t) -> int32x4_t = vaddq_s32(a, b);
        fn sub_i(a: int32x4_t, b: int32x4_t) -> int32x4_t = vsubq_s32(a, b);
        fn shr_i(a: int32x4_t, bits: int32x4_t) -> int32x4_t = vshlq_s32(a, vnegq_s32(bits));
        fn shl_i<const BITS: u32>(a: int32x4_t) -> int32x4_t = vshlq_s32(a, vdupq_n_s32(BITS as i32));
        fn load_u8_h(at: *const u8, n: usize) -> int16x8_t = {
            let bytes = if n == 8 {
                vld1_u8(at)
            } else {
                vld1_u8(load_part::<u8, 8>(at, n).as_ptr())
            };
            vreinterpretq_s16_u16(vmovl_u8(bytes))
        };
        fn store_h(value: int16x8_t, at: *mut i16) = vst1q_s16(at, value);
        fn add_h(a: int16x8_t, b: int16x8_t) -> int16x8_t = vaddq_s16(a, b);
        fn sub_h(a: int16x8_t, b: int16x8_t) -> int16x8_t = vsubq_s16(a, b);
        fn shl_h<const BITS: u32>(a: int16x8_t) -> int16x8_t = vshlq_s16(a, vdupq_n_s16(BITS as i16));
        fn zero_h() -> int16x8_t = vdupq_n_s16(0);
    }
}

/// f32 fused multiply-add.
#[derive(Clone, Copy)]
pub(crate) struct F32;

// SAFETY: loads 16 bytes of weights and 4 of input.
unsafe impl Dot for F32 {
    type S = Neon;
    type Acc = float32x4_t;
    type V = float32x4_t;
    const MAX_NV: usize = 3;
    const MAX_MR: usize = 8;
    const PACK: usize = 1;

    ops! {
        fn load_acc(at: *const u8) -> float32x4_t = vld1q_f32(at.cast());
        fn weights(at: *const u8) -> float32x4_t = vld1q_f32(at.cast());
        fn splat(at: *const u8) -> float32x4_t = vdupq_n_f32(at.cast::<f32>().read_unaligned());
        fn dot(acc: float32x4_t, x: float32x4_t, w: float32x4_t) -> float32x4_t = vfmaq_f32(acc, x, w);
    }
}

/// Products of bytes, four to a 32-bit group, with the expression for `acc + x · w`.
macro_rules! byte_dot {
    (
        $(#[$doc:meta])*
        $name:ident: $mr:literal pixels, $nv:literal vectors, $together:literal together;
        |$acc:ident, $x:ident, $w:ident| $dot:expr
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy)]
        pub(crate) struct $name;

        // SAFETY: loads 16 bytes of weights and 4 of input.
        unsafe impl Dot for $name {
            type S = Neon;
            type Acc = int32x4_t;
            type V = int8x16_t;
            const MAX_NV: usize = $nv;
            const MAX_MR: usize = $mr;
            const PACK: usize = 4;
            const TOGETHER: usize = $together;

            ops! {
                fn load_acc(at: *const u8) -> int32x4_t = vld1q_s32(at.cast());
                fn weights(at: *const u8) -> int8x16_t = vld1q_s8(at.cast());
                fn splat(at: *const u8) -> int8x16_t =
                    vreinterpretq_s8_s32(vdupq_n_s32(at.cast::<i32>().read_unaligned()));
                fn dot($acc: int32x4_t, $x: int8x16_t, $w: int8x16_t) -> int32x4_t = $dot;
            }
        }
    };
}
pub(super) use byte_dot;

/// `sdot`, whose intrinsic is not stable.
#[inline]
#[target_feature(enable = "neon,dotprod")]
fn sdot(acc: int32x4_t, x: int8x16_t, w: int8x16_t) -> int32x4_t {
    let mut acc = acc;
    // SAFETY: registers only; the feature is on.
    unsafe {
        asm!(
            "sdot {0:v}.4s, {1:v}.16b, {2:v}.16b",
            inout(vreg) acc, in(vreg) x, in(vreg) w,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    acc
}

byte_dot! {
    /// Four i8 · i8 products with `sdot`; inputs of 7 bits.
    U7Dot: 8 pixels, 3 vectors, 1 together;
    |acc, x, w| sdot(acc, x, w)
}

byte_dot! {
    /// Four i8 · i8 products widened to i16 and added in pairs; inputs of 7 bits.
    U7: 4 pixels, 2 vectors, 1 together;
    |acc, x, w| {
        let low = vpaddlq_s16(vmull_s8(vget_low_s8(x), vget_low_s8(w)));
        let high = vpaddlq_s16(vmull_high_s8(x, w));
        vaddq_s32(acc, vpaddq_s32(low, high))
    }
}

/// The products of the high halves, of the first of two groups and added for the second. From intrinsics the compiler
/// makes products of low halves, as `x` is the same in both, and keeps the weights' high halves in registers that it
/// has not: sums went through the stack.
#[inline]
#[target_feature(enable = "neon")]
fn high_products(xa: int8x16_t, wa: int8x16_t, xb: int8x16_t, wb: int8x16_t) -> int16x8_t {
    let sum: int16x8_t;
    // SAFETY: registers only; every aarch64 CPU has NEON.
    unsafe {
        asm!(
            "smull2 {0:v}.8h, {1:v}.16b, {2:v}.16b",
            "smlal2 {0:v}.8h, {3:v}.16b, {4:v}.16b",
            out(vreg) sum, in(vreg) xa, in(vreg) wa, in(vreg) xb, in(vreg) wb,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    sum
}

/// Sums the products of [`U7`] two groups at a time: two of them fit i16, as 2 · 127² < 2¹⁵, and are added to sums of
/// pairs, which become one number an output at the end. Three instructions for what takes [`U7::dot`] six.
pub(crate) struct Pairs;

// SAFETY: reads weights front to back, 16 · NV bytes per group, and 4 bytes per pixel and group.
unsafe impl Chain for Pairs {
    type D = U7;
    type Panels = Packed;

    /// # Safety
    /// As [`Chain::sum`].
    #[inline(always)]
    unsafe fn sum<const MR: usize, const NV: usize>(
        mut acc: [[int32x4_t; NV]; MR],
        tile: &Tile,
    ) -> [[int32x4_t; NV]; MR] {
        let mut w = tile.weights;
        // SAFETY: the features are on. The tile's pixels at this tap have 4 · depth readable bytes each (caller); the
        // panel holds taps · depth · NV vectors (`Packed`), of which every group reads the next NV.
        unsafe {
            // Of outputs 0 and 1, and of 2 and 3.
            let mut low = [[vdupq_n_s32(0); NV]; MR];
            let mut high = low;
            for &tap in tile.taps {
                let mut x = tile.x.offset(tap);
                for _ in 0..tile.depth / 2 {
                    let mut weights = [[U7::weights(w); 2]; NV];
                    for (n, weights) in weights.iter_mut().enumerate() {
                        *weights = [n, NV + n].map(|v| U7::weights(w.add(v * 16)));
                    }
                    for m in 0..MR {
                        let pixel = x.add(m * tile.x_step);
                        let (a, b) = (U7::splat(pixel), U7::splat(pixel.add(4)));
                        for (n, &[wa, wb]) in weights.iter().enumerate() {
                            let sum = vmull_s8(vget_low_s8(a), vget_low_s8(wa));
                            let sum = vmlal_s8(sum, vget_low_s8(b), vget_low_s8(wb));
                            low[m][n] = vpadalq_s16(low[m][n], sum);
                            high[m][n] = vpadalq_s16(high[m][n], high_products(a, wa, b, wb));
                        }
                    }
                    x = x.add(8);
                    w = w.add(2 * NV * 16);
                }
                if !tile.depth.is_multiple_of(2) {
                    for m in 0..MR {
                        let a = U7::splat(x.add(m * tile.x_step));
                        for n in 0..NV {
                            let weights = U7::weights(w.add(n * 16));
                            acc[m][n] = U7::dot(acc[m][n], a, weights);
                        }
                    }
                    w = w.add(NV * 16);
                }
            }
            for m in 0..MR {
                for n in 0..NV {
                    acc[m][n] = vaddq_s32(acc[m][n], vpaddq_s32(low[m][n], high[m][n]));
                }
            }
        }
        acc
    }
}

byte_dot! {
    /// Four u8 · i8 products by way of i16: exact for every input.
    U8Wide: 4 pixels, 1 vectors, 1 together;
    |acc, x, w| {
        // Every group of x is the same: its low half serves both halves of w.
        let x = vreinterpretq_s16_u16(vmovl_u8(vget_low_u8(vreinterpretq_u8_s8(x))));
        let (low, high) = (vmovl_s8(vget_low_s8(w)), vmovl_high_s8(w));
        let groups = |w| vpaddq_s32(vmull_s16(vget_low_s16(x), vget_low_s16(w)), vmull_high_s16(x, w));
        vaddq_s32(acc, vpaddq_s32(groups(low), groups(high)))
    }
}

/// `acc` + the products of the low half of `w` with the first number of `x` + those of the high half with the second.
/// From intrinsics the compiler makes vectors of the first number, four instructions each.
#[inline]
#[target_feature(enable = "neon")]
fn two_products(acc: int32x4_t, x: int16x8_t, w: int16x8_t) -> int32x4_t {
    let mut acc = acc;
    // SAFETY: registers only; every aarch64 CPU has NEON.
    unsafe {
        asm!(
            "smlal {0:v}.4s, {1:v}.4h, {2:v}.h[0]",
            "smlal2 {0:v}.4s, {1:v}.8h, {2:v}.h[1]",
            inout(vreg) acc, in(vreg) w, in(vreg_low16) x,
            options(pure, nomem, nostack, preserves_flags)
        );
    }
    acc
}

/// Two i16 · i16 products, widened: those of all lanes' first numbers, then those of their second ones.
#[derive(Clone, Copy)]
pub(crate) struct I16;

// SAFETY: loads 16 bytes of weights and 4 of input.
unsafe impl Dot for I16 {
    type S = Neon;
    type Acc = int32x4_t;
    type V = int16x8_t;
    const MAX_NV: usize = 2;
    const MAX_MR: usize = 8;
    const PACK: usize = 2;
    const APART: bool = true;

    ops! {
        fn load_acc(at: *const u8) -> int32x4_t = vld1q_s32(at.cast());
        fn weights(at: *const u8) -> int16x8_t = vld1q_s16(at.cast());
        fn splat(at: *const u8) -> int16x8_t = vreinterpretq_s16_s32(vdupq_n_s32(at.cast::<i32>().read_unaligned()));
        fn dot(acc: int32x4_t, x: int16x8_t, w: int16x8_t) -> int32x4_t = two_products(acc, x, w);
    }
}

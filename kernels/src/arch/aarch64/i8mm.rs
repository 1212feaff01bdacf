//! NEON with i8mm. `usmmla` multiplies 2 pixels × 8 channels of u8 by 2 outputs × 8 channels of i8: 32 products an
//! instruction where `sdot` has 16, and exact for every input, as `usdot` is.

use std::arch::aarch64::*;
use std::arch::asm;

use super::neon::{Neon, byte_dot};
use crate::ConvShape;
use crate::direct::{Chain, Tile};
use crate::packed::Packed;
use crate::simd::{Dot, ops};

/// Declares an instruction of i8mm, whose intrinsic is not stable.
macro_rules! instruction {
    ($name:ident = $text:literal) => {
        #[inline]
        #[target_feature(enable = "neon,i8mm")]
        fn $name(acc: int32x4_t, x: uint8x16_t, w: int8x16_t) -> int32x4_t {
            let mut acc = acc;
            // SAFETY: registers only; the feature is on.
            unsafe {
                asm!(
                    concat!($text, " {0:v}.4s, {1:v}.16b, {2:v}.16b"),
                    inout(vreg) acc, in(vreg) x, in(vreg) w,
                    options(pure, nomem, nostack, preserves_flags)
                );
            }
            acc
        }
    };
}
instruction!(usdot = "usdot");
instruction!(usmmla = "usmmla");

byte_dot! {
    /// Four u8 · i8 products.
    U8Dot: 8 pixels, 3 vectors, 1 together;
    |acc, x, w| usdot(acc, vreinterpretq_u8_s8(x), w)
}

byte_dot! {
    /// Two pixels × two outputs, eight u8 · i8 products each.
    U8Square: 8 pixels, 3 vectors, 2 together;
    |acc, x, w| usmmla(acc, vreinterpretq_u8_s8(x), w)
}

/// Whether [`Squares`] can sum `shape`: channels of a group come in eights.
pub(crate) fn fits(shape: &ConvShape) -> bool {
    shape
        .group_in()
        .is_multiple_of(U8Square::PACK * U8Square::TOGETHER)
}

/// Sums with [`U8Square::dot`].
pub(crate) struct Squares;

/// Most pairs of pixels in a tile.
const PAIRS: usize = U8Square::MAX_MR / 2;

/// The low halves of two vectors, or the high ones.
#[inline]
#[target_feature(enable = "neon")]
fn halves(a: int32x4_t, b: int32x4_t) -> [int32x4_t; 2] {
    let (a, b) = (vreinterpretq_s64_s32(a), vreinterpretq_s64_s32(b));
    [
        vreinterpretq_s32_s64(vtrn1q_s64(a, b)),
        vreinterpretq_s32_s64(vtrn2q_s64(a, b)),
    ]
}

// SAFETY: reads weights front to back, 2 · 16 · NV bytes for two groups, and 8 bytes per pixel and two groups; panels
// have whole pairs of groups (`Packed`).
unsafe impl Chain for Squares {
    type D = U8Square;
    type Panels = Packed;

    /// # Safety
    /// As [`Chain::sum`]; the depth is even, as `Packed` has whole pairs of groups (`TOGETHER` is 2).
    #[inline(always)]
    unsafe fn sum<const MR: usize, const NV: usize>(
        mut acc: [[int32x4_t; NV]; MR],
        tile: &Tile,
    ) -> [[int32x4_t; NV]; MR] {
        let pairs = MR.div_ceil(2);
        // A pixel alone is summed twice.
        let second = |pair: usize| (2 * pair + 1).min(MR - 1);
        // SAFETY: the features are on. The tile's pixels at this tap have 4 · depth readable bytes each (caller), and
        // depth is even; the panel holds taps · depth · NV vectors (`Packed`), of which every step reads the next
        // 2 · NV.
        unsafe {
            // Outside a vector is one pixel's four outputs; here it is two pixels' two: the first two, and the others.
            let mut sums = [[halves(acc[0][0], acc[0][0]); NV]; PAIRS];
            for (pair, sums) in sums.iter_mut().enumerate().take(pairs) {
                for (n, sum) in sums.iter_mut().enumerate() {
                    *sum = halves(acc[2 * pair][n], acc[second(pair)][n]);
                }
            }
            let mut w = tile.weights;
            for &tap in tile.taps {
                let mut x = tile.x.offset(tap);
                for _ in 0..tile.depth / 2 {
                    let mut pixels = [vdupq_n_u8(0); PAIRS];
                    for (pair, pixels) in pixels.iter_mut().enumerate().take(pairs) {
                        let first = vld1_u8(x.add(2 * pair * tile.x_step));
                        *pixels = vcombine_u8(first, vld1_u8(x.add(second(pair) * tile.x_step)));
                    }
                    for n in 0..NV {
                        for half in 0..2 {
                            let weights = vld1q_s8(w.add((2 * n + half) * 16).cast());
                            for pair in 0..pairs {
                                sums[pair][n][half] =
                                    usmmla(sums[pair][n][half], pixels[pair], weights);
                            }
                        }
                    }
                    x = x.add(8);
                    w = w.add(2 * NV * 16);
                }
            }
            for pair in 0..pairs {
                for n in 0..NV {
                    let [low, high] = sums[pair][n];
                    let [a, b] = halves(low, high);
                    acc[second(pair)][n] = b;
                    acc[2 * pair][n] = a;
                }
            }
        }
        acc
    }
}

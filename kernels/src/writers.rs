//! Epilogues on vectors: accumulators in, stored elements out.

use crate::Layout;
use crate::direct::Write;
use crate::simd::Simd;

/// i32 accumulators → u8, as `Epilogue::U8`.
pub(crate) struct ToU8<'a> {
    /// Padded, one per lane.
    pub scale: *const f32,
    pub max: f32,
    /// `max` is 127 and no value can leave ±2³¹: the narrowing instruction clamps.
    pub narrow: bool,
    pub residual: Option<Residual<'a>>,
    pub output: *mut u8,
    pub layout: &'a Layout,
}

/// A u8 tensor that is added before rounding.
pub(crate) struct Residual<'a> {
    pub data: *const u8,
    pub layout: &'a Layout,
    pub scale: f32,
}

// SAFETY: touches `n` elements of the pixel in the output and in the residual, and a whole vector of padded scales.
unsafe impl<S: Simd> Write<S, S::I> for ToU8<'_> {
    #[inline(always)]
    unsafe fn write(&self, acc: S::I, lane: usize, channel: usize, n: usize, y: usize, x: usize) {
        let (y, x) = (y as isize, x as isize);
        // SAFETY: (y, x) and channel..channel + n lie in the checked layouts.
        unsafe {
            let mut value = S::mul_f(S::f_from_i(acc), S::load_f(self.scale.add(lane)));
            if let Some(residual) = &self.residual {
                let at = residual.data.add(residual.layout.index(y, x) + channel);
                let added = S::mul_f(S::load_u8_part(at, n), S::splat_f(residual.scale));
                value = S::add_f(value, added);
            }
            let at = self.output.add(self.layout.index(y, x) + channel);
            if self.narrow {
                S::store_u7_part(value, at, n);
            } else {
                let value = S::min_f(S::max_f(value, S::splat_f(0.0)), S::splat_f(self.max));
                S::store_u8_part(value, at, n);
            }
        }
    }
}

/// i32 accumulators → f32, as `Epilogue::F32`.
pub(crate) struct ToF32<'a> {
    /// Padded, one per lane.
    pub scale: *const f32,
    pub output: *mut f32,
    pub layout: &'a Layout,
}

// SAFETY: touches `n` elements of the pixel, and a whole vector of padded scales.
unsafe impl<S: Simd> Write<S, S::I> for ToF32<'_> {
    #[inline(always)]
    unsafe fn write(&self, acc: S::I, lane: usize, channel: usize, n: usize, y: usize, x: usize) {
        // SAFETY: (y, x) and channel..channel + n lie in the checked layout.
        unsafe {
            let value = S::mul_f(S::f_from_i(acc), S::load_f(self.scale.add(lane)));
            let at = self.layout.index(y as isize, x as isize) + channel;
            S::store_f_part(value, self.output.add(at), n);
        }
    }
}

/// f32 accumulators → f32 with optional residual and ReLU.
pub(crate) struct Float<'a> {
    pub relu: bool,
    pub residual: Option<(*const f32, &'a Layout)>,
    pub output: *mut f32,
    pub layout: &'a Layout,
}

// SAFETY: touches `n` elements of the pixel in the output and in the residual.
unsafe impl<S: Simd> Write<S, S::F> for Float<'_> {
    #[inline(always)]
    unsafe fn write(&self, acc: S::F, _lane: usize, channel: usize, n: usize, y: usize, x: usize) {
        let (y, x) = (y as isize, x as isize);
        // SAFETY: (y, x) and channel..channel + n lie in the checked layouts.
        unsafe {
            let mut value = acc;
            if let Some((data, layout)) = self.residual {
                value = S::add_f(
                    value,
                    S::load_f_part(data.add(layout.index(y, x) + channel), n),
                );
            }
            if self.relu {
                value = S::max_f(value, S::splat_f(0.0));
            }
            let at = self.layout.index(y, x) + channel;
            S::store_f_part(value, self.output.add(at), n);
        }
    }
}

//! Epilogues on vectors: accumulators in, stored elements out.

use crate::Layout;
use crate::direct::{Place, Write};
use crate::simd::Simd;

/// i32 accumulators → u8, as `Epilogue::U8`.
pub(crate) struct ToU8<'a> {
    /// Padded, one per lane.
    pub scale: *const f32,
    pub max: f32,
    /// `max` is 127 and no value can leave ±2³¹: the narrowing instructions clamp.
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

impl Place {
    /// Index of the first pixel's first element, and elements to the next pixel.
    #[inline(always)]
    fn index(&self, layout: &Layout) -> (usize, usize) {
        let at = layout.index(self.y as isize, self.x as isize) + self.channel;
        (at, layout.pixel_stride() * self.step)
    }
}

// SAFETY: touches `n` elements of every pixel in the output and in the residual, and a whole vector of padded scales.
unsafe impl<S: Simd> Write<S, S::I> for ToU8<'_> {
    /// # Safety
    /// As [`Write::write`].
    #[inline(always)]
    unsafe fn write<const M: usize>(&self, acc: [S::I; M], place: Place) {
        // SAFETY: y < height, x + (M - 1) · step < width and channel + n <= channels (caller) in layouts that `check`
        // proved to lie in their buffers; lane + LANES <= padded lanes, each with a scale (caller).
        unsafe {
            let scale = S::load_f(self.scale.add(place.lane));
            let mut values = [scale; M];
            for m in 0..M {
                values[m] = S::mul_f(S::f_from_i(acc[m]), scale);
            }
            if let Some(residual) = &self.residual {
                let (at, step) = place.index(residual.layout);
                let scale = S::splat_f(residual.scale);
                for m in 0..M {
                    let added = S::load_u8_part(residual.data.add(at + m * step), place.n);
                    values[m] = S::add_f(values[m], S::mul_f(added, scale));
                }
            }
            let (at, step) = place.index(self.layout);
            let at = self.output.add(at);
            if self.narrow {
                let mut m = 0;
                if place.n == S::LANES {
                    while m + 4 <= M {
                        let four = [values[m], values[m + 1], values[m + 2], values[m + 3]];
                        S::store_u7_4(four, at.add(m * step), step);
                        m += 4;
                    }
                }
                while m < M {
                    S::store_u7_part(values[m], at.add(m * step), place.n);
                    m += 1;
                }
            } else {
                let (least, most) = (S::zero_f(), S::splat_f(self.max));
                for m in 0..M {
                    let value = S::min_f(S::max_f(values[m], least), most);
                    S::store_u8_part(value, at.add(m * step), place.n);
                }
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

// SAFETY: touches `n` elements of every pixel, and a whole vector of padded scales.
unsafe impl<S: Simd> Write<S, S::I> for ToF32<'_> {
    /// # Safety
    /// As [`Write::write`].
    #[inline(always)]
    unsafe fn write<const M: usize>(&self, acc: [S::I; M], place: Place) {
        // SAFETY: y < height, x + (M - 1) · step < width and channel + n <= channels (caller) in a layout that `check`
        // proved to lie in its buffer; lane + LANES <= padded lanes, each with a scale (caller).
        unsafe {
            let scale = S::load_f(self.scale.add(place.lane));
            let (at, step) = place.index(self.layout);
            for m in 0..M {
                let value = S::mul_f(S::f_from_i(acc[m]), scale);
                S::store_f_part(value, self.output.add(at + m * step), place.n);
            }
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

// SAFETY: touches `n` elements of every pixel in the output and in the residual.
unsafe impl<S: Simd> Write<S, S::F> for Float<'_> {
    /// # Safety
    /// As [`Write::write`].
    #[inline(always)]
    unsafe fn write<const M: usize>(&self, acc: [S::F; M], place: Place) {
        // SAFETY: y < height, x + (M - 1) · step < width and channel + n <= channels (caller) in layouts that `check`
        // proved to lie in their buffers.
        unsafe {
            let mut values = acc;
            if let Some((data, layout)) = self.residual {
                let (at, step) = place.index(layout);
                for m in 0..M {
                    let added = S::load_f_part(data.add(at + m * step), place.n);
                    values[m] = S::add_f(values[m], added);
                }
            }
            if self.relu {
                for value in &mut values {
                    *value = S::max_f(*value, S::zero_f());
                }
            }
            let (at, step) = place.index(self.layout);
            for m in 0..M {
                S::store_f_part(values[m], self.output.add(at + m * step), place.n);
            }
        }
    }
}

/// f32 sums without their bias → as [`Float`].
pub(crate) struct Biased<'a> {
    /// Padded, one per lane.
    pub bias: *const f32,
    pub to: Float<'a>,
}

// SAFETY: as for `Float`, and a whole vector of padded biases.
unsafe impl<S: Simd> Write<S, S::F> for Biased<'_> {
    /// # Safety
    /// As [`Write::write`].
    #[inline(always)]
    unsafe fn write<const M: usize>(&self, acc: [S::F; M], place: Place) {
        // SAFETY: lane + LANES <= padded lanes, each with a bias (caller); the rest is this function's own condition.
        unsafe {
            let bias = S::load_f(self.bias.add(place.lane));
            let mut values = acc;
            for value in &mut values {
                *value = S::add_f(*value, bias);
            }
            Write::<S, S::F>::write(&self.to, values, place);
        }
    }
}

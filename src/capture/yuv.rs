//! Luma and chroma, as cameras and films give them, → RGB.
//!
//! One arithmetic for all layouts, 16-bit throughout so that compilers vectorise it on any machine: samples are scaled
//! by 2⁷, coefficients by 2¹³, their product loses 16 bits, so that sums carry 4 fractional bits. The result is within
//! 1 of the exact value (the tests compare all of them).

/// How luma and chroma make up colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Matrix {
    /// ITU-R BT.601: cameras, JPEG, standard definition.
    #[default]
    Bt601,
    /// ITU-R BT.709: films of 720 lines and more.
    Bt709,
}

/// Which samples mean black and white.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Range {
    /// Luma 16–235, chroma 16–240.
    #[default]
    Limited,
    /// 0–255.
    Full,
}

/// Fixed-point coefficients of one matrix and range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct YuvToRgb {
    black: i16,
    luma: i16,
    red_v: i16,
    green_u: i16,
    green_v: i16,
    blue_u: i16,
}

impl YuvToRgb {
    /// Works out the coefficients.
    pub fn new(matrix: Matrix, range: Range) -> Self {
        let (kr, kb) = match matrix {
            Matrix::Bt601 => (0.299, 0.114),
            Matrix::Bt709 => (0.2126, 0.0722),
        };
        let kg = 1.0 - kr - kb;
        let (black, luma, chroma) = match range {
            Range::Limited => (16, 255.0 / 219.0, 255.0 / 224.0),
            Range::Full => (0, 1.0, 1.0),
        };
        // The largest, 2 · (1 − 0.0722) · 255 / 224 · 2^13 = 17305, fits i16.
        let fixed = |v: f64| (v * 8192.0).round() as i16;
        Self {
            black,
            luma: fixed(luma),
            red_v: fixed(2.0 * (1.0 - kr) * chroma),
            green_u: fixed(-2.0 * kb * (1.0 - kb) / kg * chroma),
            green_v: fixed(-2.0 * kr * (1.0 - kr) / kg * chroma),
            blue_u: fixed(2.0 * (1.0 - kb) * chroma),
        }
    }

    /// Up to [`BLOCK`] pixels whose luma and chroma lie side by side: plain loops over arrays, which vectorise.
    #[inline(always)]
    fn block(self, samples: &Samples, rgb: &mut [u8]) {
        let (mut red, mut green, mut blue) = ([0u8; BLOCK], [0u8; BLOCK], [0u8; BLOCK]);
        for i in 0..BLOCK {
            // |sample| · 128 < 2^15 in all three, so that no shift overflows; sums stay below 2^14.
            let y = high((i16::from(samples.y[i]) - self.black) << 7, self.luma);
            let u = (i16::from(samples.u[i]) - 128) << 7;
            let v = (i16::from(samples.v[i]) - 128) << 7;
            red[i] = to_byte(y + high(v, self.red_v));
            green[i] = to_byte(y + high(u, self.green_u) + high(v, self.green_v));
            blue[i] = to_byte(y + high(u, self.blue_u));
        }
        let colours = red.iter().zip(&green).zip(&blue);
        for (o, ((r, g), b)) in rgb.chunks_exact_mut(3).zip(colours) {
            o[0] = *r;
            o[1] = *g;
            o[2] = *b;
        }
    }

    /// `Y U Y V`, two pixels in four bytes, rows of `stride` bytes; `rgb` has `3 * width` bytes a row.
    ///
    /// # Panics
    /// When `stride < 4 * ceil(width / 2)`, or `data` is shorter than the rows in `rgb` need.
    pub fn yuyv(self, data: &[u8], stride: usize, width: usize, rgb: &mut [u8]) {
        self.packed::<0>(data, stride, width, rgb);
    }

    /// `U Y V Y`, otherwise as [`yuyv`](Self::yuyv).
    ///
    /// # Panics
    /// As [`yuyv`](Self::yuyv).
    pub fn uyvy(self, data: &[u8], stride: usize, width: usize, rgb: &mut [u8]) {
        self.packed::<1>(data, stride, width, rgb);
    }

    /// Two pixels in four bytes, luma at `LUMA` and two later.
    fn packed<const LUMA: usize>(self, data: &[u8], stride: usize, width: usize, rgb: &mut [u8]) {
        let chroma = 1 - LUMA;
        let mut samples = Samples::default();
        for (k, out) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let row = &data[k * stride..][..4 * width.div_ceil(2)];
            for (out, part) in out.chunks_mut(3 * BLOCK).zip(row.chunks(2 * BLOCK)) {
                let pairs = samples.y.chunks_exact_mut(2);
                let pairs = pairs.zip(samples.u.chunks_exact_mut(2));
                let pairs = pairs.zip(samples.v.chunks_exact_mut(2));
                for (((y, u), v), p) in pairs.zip(part.chunks_exact(4)) {
                    (y[0], y[1]) = (p[LUMA], p[LUMA + 2]);
                    u.fill(p[chroma]);
                    v.fill(p[chroma + 2]);
                }
                self.block(&samples, out);
            }
        }
    }

    /// A plane of luma, then one of `U V` pairs at half the size, both with rows of `stride` bytes.
    ///
    /// # Panics
    /// When `stride < 2 * ceil(width / 2)` or a plane is shorter than the rows in `rgb` need.
    pub fn nv12(self, luma: &[u8], chroma: &[u8], stride: usize, width: usize, rgb: &mut [u8]) {
        let mut samples = Samples::default();
        for (k, out) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let luma = &luma[k * stride..][..width];
            let chroma = &chroma[k / 2 * stride..][..width.div_ceil(2) * 2];
            let parts = luma.chunks(BLOCK).zip(chroma.chunks(BLOCK));
            for (out, (luma, chroma)) in out.chunks_mut(3 * BLOCK).zip(parts) {
                samples.y[..luma.len()].copy_from_slice(luma);
                let pairs = samples.u.chunks_exact_mut(2);
                let pairs = pairs.zip(samples.v.chunks_exact_mut(2));
                for ((u, v), c) in pairs.zip(chroma.chunks_exact(2)) {
                    u.fill(c[0]);
                    v.fill(c[1]);
                }
                self.block(&samples, out);
            }
        }
    }

    /// Three planes; chroma is `1 << shift.0` times narrower and `1 << shift.1` times lower, rounded up; shifts are 0
    /// or 1. Rows of luma are `strides[0]` bytes apart, rows of chroma `strides[1]`.
    ///
    /// # Panics
    /// When a stride is shorter than a row, or a plane than the rows in `rgb` need.
    pub fn planar(
        self,
        planes: [&[u8]; 3],
        strides: [usize; 2],
        shift: (u32, u32),
        width: usize,
        rgb: &mut [u8],
    ) {
        let mut samples = Samples::default();
        let chroma_width = width.div_ceil(1 << shift.0);
        let step = BLOCK >> shift.0;
        for (k, out) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let luma = &planes[0][k * strides[0]..][..width];
            let at = (k >> shift.1) * strides[1];
            let us = &planes[1][at..][..chroma_width];
            let vs = &planes[2][at..][..chroma_width];
            let parts = luma.chunks(BLOCK).zip(us.chunks(step).zip(vs.chunks(step)));
            for (out, (luma, (us, vs))) in out.chunks_mut(3 * BLOCK).zip(parts) {
                samples.y[..luma.len()].copy_from_slice(luma);
                spread(us, shift.0, &mut samples.u);
                spread(vs, shift.0, &mut samples.v);
                self.block(&samples, out);
            }
        }
    }

    /// A plane of luma alone → grey.
    pub fn grey(self, luma: &[u8], rgb: &mut [u8]) {
        let mut samples = Samples::default();
        for (out, luma) in rgb.chunks_mut(3 * BLOCK).zip(luma.chunks(BLOCK)) {
            samples.y[..luma.len()].copy_from_slice(luma);
            self.block(&samples, out);
        }
    }
}

/// Pixels that are worked on at once: four vectors of 16 bytes.
const BLOCK: usize = 64;

/// Samples of a block, one of each for every pixel.
struct Samples {
    y: [u8; BLOCK],
    u: [u8; BLOCK],
    v: [u8; BLOCK],
}

impl Default for Samples {
    /// Without colour.
    fn default() -> Self {
        Self {
            y: [0; BLOCK],
            u: [128; BLOCK],
            v: [128; BLOCK],
        }
    }
}

/// Chroma of a block, once for every pixel.
#[inline(always)]
fn spread(chroma: &[u8], shift: u32, out: &mut [u8; BLOCK]) {
    if shift == 0 {
        out[..chroma.len()].copy_from_slice(chroma);
    } else {
        for (o, c) in out.chunks_exact_mut(2).zip(chroma) {
            o.fill(*c);
        }
    }
}

/// 4 fractional bits → a byte, rounded.
#[inline(always)]
fn to_byte(c: i16) -> u8 {
    ((c + 8) >> 4).clamp(0, 255) as u8
}

/// The upper half of a 32-bit product.
#[inline(always)]
fn high(a: i16, b: i16) -> i16 {
    ((i32::from(a) * i32::from(b)) >> 16) as i16
}

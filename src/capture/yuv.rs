//! Luma and chroma, as cameras and films give them, → RGB.
//!
//! One arithmetic for all layouts, 16-bit throughout so that compilers vectorise it on any machine: samples are scaled by 2⁷,
//! coefficients by 2¹³, their product loses 16 bits, so that sums carry 4 fractional bits. The result is within 1 of the exact
//! value (the tests compare all of them).

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

    /// One pixel.
    #[inline(always)]
    fn pixel(self, y: u8, u: u8, v: u8) -> [u8; 3] {
        // |sample| · 128 < 2^15 in all three, so that no shift overflows; sums stay below 2^14.
        let y = high(((y as i16) - self.black) << 7, self.luma);
        let u = (i16::from(u) - 128) << 7;
        let v = (i16::from(v) - 128) << 7;
        let r = y + high(v, self.red_v);
        let g = y + high(u, self.green_u) + high(v, self.green_v);
        let b = y + high(u, self.blue_u);
        [r, g, b].map(|c| ((c + 8) >> 4).clamp(0, 255) as u8)
    }

    /// `Y U Y V`, two pixels in four bytes, rows of `stride` bytes; `rgb` has `3 * width` bytes a row.
    ///
    /// # Panics
    /// When `stride < 4 * ceil(width / 2)`, or `data` is shorter than the rows in `rgb` need.
    pub fn yuyv(self, data: &[u8], stride: usize, width: usize, rgb: &mut [u8]) {
        for (row, out) in data.chunks(stride).zip(rgb.chunks_exact_mut(3 * width)) {
            let mut pairs = out.chunks_exact_mut(6);
            for (o, p) in pairs.by_ref().zip(row.chunks_exact(4)) {
                o[..3].copy_from_slice(&self.pixel(p[0], p[1], p[3]));
                o[3..].copy_from_slice(&self.pixel(p[2], p[1], p[3]));
            }
            if let [r, g, b] = pairs.into_remainder() {
                let p = &row[2 * (width - 1)..][..4];
                [*r, *g, *b] = self.pixel(p[0], p[1], p[3]);
            }
        }
    }

    /// A plane of luma, then one of `U V` pairs at half the size, both with rows of `stride` bytes.
    ///
    /// # Panics
    /// When `stride < 2 * ceil(width / 2)` or a plane is shorter than the rows in `rgb` need.
    pub fn nv12(self, luma: &[u8], chroma: &[u8], stride: usize, width: usize, rgb: &mut [u8]) {
        for (y, out) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let luma = &luma[y * stride..][..width];
            let chroma = &chroma[y / 2 * stride..][..width.div_ceil(2) * 2];
            let pairs = out.chunks_mut(6).zip(luma.chunks(2));
            for ((o, l), c) in pairs.zip(chroma.chunks_exact(2)) {
                for (o, l) in o.chunks_exact_mut(3).zip(l) {
                    o.copy_from_slice(&self.pixel(*l, c[0], c[1]));
                }
            }
        }
    }

    /// Three planes; chroma is `1 << shift_x` times narrower and `1 << shift_y` times lower, rounded up.
    ///
    /// # Panics
    /// When a plane is shorter than the rows in `rgb` need.
    pub fn planar(self, planes: [&[u8]; 3], shift: (u32, u32), width: usize, rgb: &mut [u8]) {
        let chroma_width = width.div_ceil(1 << shift.0);
        for (y, out) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let luma = &planes[0][y * width..][..width];
            let at = (y >> shift.1) * chroma_width;
            let us = &planes[1][at..][..chroma_width];
            let vs = &planes[2][at..][..chroma_width];
            let step = 1 << shift.0;
            let groups = out.chunks_mut(3 * step).zip(luma.chunks(step));
            for ((o, l), (u, v)) in groups.zip(us.iter().zip(vs)) {
                for (o, l) in o.chunks_exact_mut(3).zip(l) {
                    o.copy_from_slice(&self.pixel(*l, *u, *v));
                }
            }
        }
    }

    /// A plane of luma alone → grey.
    pub fn grey(self, luma: &[u8], rgb: &mut [u8]) {
        for (o, l) in rgb.chunks_exact_mut(3).zip(luma) {
            o.copy_from_slice(&self.pixel(*l, 128, 128));
        }
    }
}

/// The upper half of a 32-bit product.
#[inline(always)]
fn high(a: i16, b: i16) -> i16 {
    ((i32::from(a) * i32::from(b)) >> 16) as i16
}

//! Pictures made small enough to keep many of them.

/// Longest side of what is kept, pixels.
const LONGEST: u32 = 960;

/// A picture whose pixels are means of squares of another's; RGB, 8 bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Small {
    /// Pixels across and down.
    pub size: [usize; 2],
    /// Row by row.
    pub rgb: Vec<[u8; 3]>,
}

/// Side of the squares for pictures of `size` pixels.
pub fn squares(size: [u32; 2]) -> usize {
    size[0].max(size[1]).div_ceil(LONGEST).max(1) as usize
}

impl Small {
    /// Of a picture of `size` pixels, three bytes each; a last square that is not whole counts as far as it goes.
    ///
    /// # Panics
    /// When there are fewer bytes than the size says.
    pub fn new(size: [u32; 2], rgb: &[u8]) -> Self {
        let by = squares(size);
        let [w, h] = size.map(|s| s as usize);
        let small = [w.div_ceil(by), h.div_ceil(by)];
        let pixel = |x: usize, y: usize| {
            let (mut sum, mut count) = ([0_u32; 3], 0);
            for row in y * by..((y + 1) * by).min(h) {
                let cells = &rgb[3 * (row * w + x * by)..3 * (row * w + ((x + 1) * by).min(w))];
                for cell in cells.chunks_exact(3) {
                    count += 1;
                    for (sum, c) in sum.iter_mut().zip(cell) {
                        *sum += u32::from(*c);
                    }
                }
            }
            sum.map(|s| ((s + count / 2) / count) as u8)
        };
        let each = (0..small[1]).flat_map(|y| (0..small[0]).map(move |x| (x, y)));
        Self {
            size: small,
            rgb: each.map(|(x, y)| pixel(x, y)).collect(),
        }
    }
}

//! A picture's brightness at several scales.

use super::plane::Plane;
use crate::capture::Frame;

/// The finest scale has about so many pixels along the longer side: finer ones show the camera's noise.
const FINEST: u32 = 640;
/// Scales, each half as large as the one before.
const SCALES: usize = 4;
/// A coarser scale has at least so many pixels along the shorter side.
const LEAST: usize = 16;

/// A picture's brightness at falling scales.
#[derive(Debug, Clone, Default)]
pub struct Pyramid {
    scales: Vec<Plane>,
    /// Pixels of the picture along a pixel of the finest scale.
    shrink: usize,
    /// What columns of some rows sum up to. A picture has at most 16,384 pixels a side, so that 26 rows and three
    /// colours add up to less than 2^16.
    sums: Vec<u16>,
}

impl Pyramid {
    /// Fills this pyramid with a picture of at least one pixel.
    pub fn fill(&mut self, frame: &Frame) {
        let long = frame.width.max(frame.height);
        let shrink = ((long + FINEST / 2) / FINEST).max(1) as usize;
        self.shrink = shrink;
        self.scales.resize_with(SCALES, Plane::default);
        let (width, height) = (
            (frame.width as usize / shrink).max(1),
            (frame.height as usize / shrink).max(1),
        );
        let finest = &mut self.scales[0];
        finest.resize(width, height);
        let stride = 3 * frame.width as usize;
        let used = 3 * shrink.min(frame.width as usize);
        let rows = finest.values.chunks_exact_mut(width);
        for (row, out) in rows.enumerate() {
            let of = frame.rgb[row * shrink * stride..].chunks_exact(stride);
            let rows = add_up(of.take(shrink), used * width, &mut self.sums);
            let share = ((rows * used) as f32).recip();
            add_colours(&mut self.sums);
            match used / 3 {
                1 => means::<1>(&self.sums, share, out),
                2 => means::<2>(&self.sums, share, out),
                3 => means::<3>(&self.sums, share, out),
                columns => means_of(columns, &self.sums, share, out),
            }
        }
        for k in 1..SCALES {
            let (finer, coarser) = self.scales.split_at_mut(k);
            let finer = &finer[k - 1];
            if finer.width.min(finer.height) < 2 * LEAST {
                self.scales.truncate(k);
                break;
            }
            coarser[0].halve(finer);
        }
    }

    /// The scales, finest first.
    pub(super) fn scales(&self) -> &[Plane] {
        &self.scales
    }

    /// Pixels of the picture along a pixel of the finest scale.
    pub fn shrink(&self) -> f32 {
        self.shrink as f32
    }
}

/// Adds up the first `width` bytes of every row, column by column, and returns how many rows there were.
fn add_up<'a>(rows: impl Iterator<Item = &'a [u8]>, width: usize, sums: &mut Vec<u16>) -> usize {
    sums.clear();
    sums.resize(width, 0);
    let mut count = 0;
    for bytes in rows {
        count += 1;
        for (sum, byte) in sums.iter_mut().zip(bytes) {
            *sum += u16::from(*byte);
        }
    }
    count
}

/// Adds to every sum the next two: what the colours of a pixel sum up to stands at its first.
fn add_colours(sums: &mut [u16]) {
    for i in 2..sums.len() {
        sums[i - 2] += sums[i - 1] + sums[i];
    }
}

/// [`means_of`] N columns: a loop of a length that the compiler knows.
fn means<const N: usize>(sums: &[u16], share: f32, out: &mut [f32]) {
    means_of(N, sums, share, out);
}

/// `share` of what so many columns of pixels sum up to, in turn.
#[inline(always)]
fn means_of(columns: usize, sums: &[u16], share: f32, out: &mut [f32]) {
    for (out, sums) in out.iter_mut().zip(sums.chunks_exact(3 * columns)) {
        let mut total = 0;
        for column in 0..columns {
            total += u32::from(sums[3 * column]);
        }
        *out = share * total as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(width: u32, height: u32) -> Frame {
        let rgb = (0..3 * width * height).map(|i| (i / 3 % width % 251) as u8);
        Frame {
            width,
            height,
            rgb: rgb.collect(),
            ..Frame::default()
        }
    }

    #[test]
    fn large_pictures_are_shrunk_and_small_ones_have_fewer_scales() {
        let mut pyramid = Pyramid::default();
        for (size, finest, scales) in [
            ((1280, 720), (640, 360), 4),
            ((1080, 1920), (360, 640), 4),
            ((641, 361), (641, 361), 4),
            ((100, 40), (100, 40), 2),
            ((3, 1), (3, 1), 1),
            ((5000, 2), (625, 1), 1),
        ] {
            pyramid.fill(&frame(size.0, size.1));
            let first = &pyramid.scales()[0];
            assert_eq!((first.width, first.height), finest, "{size:?}");
            assert_eq!(pyramid.scales().len(), scales, "{size:?}");
            let all = pyramid.scales().iter();
            assert!(
                all.flat_map(|p| &p.values)
                    .all(|v| (0.0..=255.0).contains(v))
            );
        }
    }

    #[test]
    fn a_pixel_of_the_finest_scale_is_the_mean_of_those_it_covers() {
        let mut pyramid = Pyramid::default();
        pyramid.fill(&frame(1280, 720));
        let first = &pyramid.scales()[0];
        for x in [0, 7, 100] {
            assert_eq!(first.values[640 * 9 + x], 2.0 * x as f32 + 0.5);
        }
    }

    #[test]
    fn a_mean_is_of_all_colours_and_pixels_however_many_they_are() {
        for (width, height) in [
            (5, 3),
            (1300, 9),
            (1930, 7),
            (2600, 8),
            (5000, 20),
            (1, 1300),
            (2, 2000),
        ] {
            let mut pyramid = Pyramid::default();
            let rgb = (0..3 * width * height).map(|i| (i * 37 % 256) as u8);
            let frame = Frame {
                width: width as u32,
                height: height as u32,
                rgb: rgb.collect(),
                ..Frame::default()
            };
            // Of the picture before nothing is left.
            pyramid.fill(&Frame {
                rgb: vec![255; 3 * 700 * 700],
                width: 700,
                height: 700,
                ..Frame::default()
            });
            pyramid.fill(&frame);
            let (first, shrink) = (&pyramid.scales()[0], pyramid.shrink() as usize);
            for (i, value) in first.values.iter().enumerate() {
                let (top, left) = (i / first.width * shrink, i % first.width * shrink);
                let rows = top..(top + shrink).min(height);
                let of: Vec<u8> = rows
                    .flat_map(|y| {
                        let start = 3 * (y * width + left);
                        &frame.rgb[start..(start + 3 * shrink).min(3 * (y + 1) * width)]
                    })
                    .copied()
                    .collect();
                let mean = of.iter().map(|v| f32::from(*v)).sum::<f32>() / of.len() as f32;
                assert!(
                    (value - mean).abs() < 1e-3,
                    "{width}x{height}: {i}: {value}, {mean}"
                );
            }
        }
    }
}

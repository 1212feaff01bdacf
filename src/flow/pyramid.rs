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
    /// What every byte column of some rows sums up to.
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
        let (used, block) = (3 * shrink.min(frame.width as usize), shrink);
        let rows = finest.values.chunks_exact_mut(width);
        for (row, out) in rows.enumerate() {
            self.sums.clear();
            self.sums.resize(used * width, 0);
            let of = frame.rgb[row * block * stride..].chunks_exact(stride);
            let mut count = 0;
            for bytes in of.take(block) {
                count += used;
                for (sum, byte) in self.sums.iter_mut().zip(bytes) {
                    *sum += u16::from(*byte);
                }
            }
            let share = (count as f32).recip();
            for (out, sums) in out.iter_mut().zip(self.sums.chunks_exact(used)) {
                *out = share * sums.iter().map(|s| u32::from(*s)).sum::<u32>() as f32;
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
}

//! Pictures of a camera that stands still go in, what it shows where nobody is comes out, and what of a picture differs
//! from that.
//!
//! Medians over time of pixels that nobody covers, as far as detections tell; scales are medians of distances from
//! them. Shadows darken and keep the colour (Horprasert, Harwood and Davis, 1999): what is only darker is background.

use glam::{DVec2, Vec3};

use super::figure::Figure;
use super::picture::Small;

/// Statures round the bones in which a picture tells nothing of the background.
const COVERED: f64 = 0.17;
/// Pictures that a pixel must be free in to be known.
const LEAST: usize = 5;
/// Least scale of a pixel, levels: what a quiet sensor's noise and compression leave.
const QUIET: f32 = 3.0;
/// Scales from which on a pixel differs.
const DIFFERENT: f32 = 5.0;
/// Scales within which a colour is that of the background, brighter or darker.
const SAME_COLOUR: f32 = 2.5;
/// How dark a shadow is, and how bright a reflection, as parts of the background.
const SHADED: [f32; 2] = [0.5, 1.15];
/// Share of pixels away from people that may differ in a picture of the same light.
const LIGHT: f64 = 0.25;
/// Every so many pixels tell a picture's exposure.
const STRIDE: usize = 7;

/// What a pixel is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pixel {
    /// As where nobody is.
    Background,
    /// Something else.
    Foreground,
    /// The background there was never seen.
    Unknown,
}

/// What a camera shows where nobody is.
#[derive(Debug, Clone, PartialEq)]
pub struct Background {
    size: [usize; 2],
    /// Colour and scale, levels; none where it was not seen often enough.
    pixels: Vec<Option<(Vec3, f32)>>,
}

impl Background {
    /// Of pictures spread over a film, of one size, each with who was seen in it, in its pixels.
    pub fn learn(samples: &[(Small, Vec<Figure>)]) -> Self {
        let size = samples.first().map_or([0; 2], |(s, _)| s.size);
        let covered: Vec<Vec<bool>> = samples
            .iter()
            .map(|(_, f)| near(size, f, COVERED))
            .collect();
        let mut values: [Vec<u8>; 3] = Default::default();
        let pixel = |k: usize| {
            values.iter_mut().for_each(Vec::clear);
            for ((small, _), covered) in samples.iter().zip(&covered) {
                if !covered[k] {
                    for (values, c) in values.iter_mut().zip(small.rgb[k]) {
                        values.push(c);
                    }
                }
            }
            if values[0].len() < LEAST {
                return None;
            }
            let (mut colour, mut scale) = ([0.0; 3], QUIET);
            for (values, colour) in values.iter_mut().zip(&mut colour) {
                let middle = median(values);
                *colour = f32::from(middle);
                values.iter_mut().for_each(|v| *v = v.abs_diff(middle));
                // The scale of a normal distribution of this median distance.
                scale = scale.max(1.4826 * f32::from(median(values)));
            }
            Some((Vec3::from(colour), scale))
        };
        Self {
            size,
            pixels: (0..size[0] * size[1]).map(pixel).collect(),
        }
    }

    /// What of a picture differs, row by row. `None` where most of it does, away from people too: the light has
    /// changed, or the camera was moved.
    pub fn differs(&self, picture: &Small, people: &[Figure]) -> Option<Vec<Pixel>> {
        if picture.size != self.size {
            return None;
        }
        let covered = near(self.size, people, COVERED);
        let gain = self.gain(picture, &covered);
        let (mut free, mut changed) = (0_usize, 0_usize);
        let each = self.pixels.iter().zip(&picture.rgb).zip(&covered);
        let pixels = each.map(|((known, rgb), covered)| {
            let Some((colour, scale)) = known else {
                return Pixel::Unknown;
            };
            let seen = Vec3::from(rgb.map(f32::from));
            let different = differs(seen / gain, *colour, *scale);
            if !covered {
                free += 1;
                changed += usize::from(different);
            }
            if different {
                Pixel::Foreground
            } else {
                Pixel::Background
            }
        });
        let pixels = pixels.collect();
        (changed as f64 <= LIGHT * free as f64).then_some(pixels)
    }

    /// By how much a picture is brighter than the background, by channel.
    fn gain(&self, picture: &Small, covered: &[bool]) -> Vec3 {
        let mut ratios: [Vec<f32>; 3] = Default::default();
        for k in (0..self.pixels.len()).step_by(STRIDE) {
            if let (Some((colour, _)), false) = (&self.pixels[k], covered[k]) {
                for c in 0..3 {
                    // Dark and burnt pixels tell no ratio.
                    if (30.0..225.0).contains(&colour[c]) {
                        ratios[c].push(f32::from(picture.rgb[k][c]) / colour[c]);
                    }
                }
            }
        }
        Vec3::from(ratios.map(|mut all| {
            let middle = all.len() / 2;
            match all.len() {
                0..20 => 1.0,
                _ => all
                    .select_nth_unstable_by(middle, f32::total_cmp)
                    .1
                    .clamp(0.5, 2.0),
            }
        }))
    }
}

fn differs(seen: Vec3, colour: Vec3, scale: f32) -> bool {
    if seen.distance(colour) <= DIFFERENT * scale {
        return false;
    }
    let part = seen.dot(colour) / colour.length_squared().max(1.0);
    let off = seen.distance(part * colour);
    !(SHADED[0]..SHADED[1]).contains(&part) || off > SAME_COLOUR * scale
}

/// Which pixels are within so many statures of somebody.
pub fn near(size: [usize; 2], people: &[Figure], reach: f64) -> Vec<bool> {
    let mut found = vec![false; size[0] * size[1]];
    for figure in people {
        let [low, high] = figure.bounds(reach);
        let most = DVec2::new(size[0] as f64, size[1] as f64);
        let (low, high) = (low.clamp(DVec2::ZERO, most), high.clamp(DVec2::ZERO, most));
        for y in low.y as usize..high.y.ceil() as usize {
            for x in low.x as usize..high.x.ceil() as usize {
                let pixel = DVec2::new(x as f64, y as f64);
                found[y * size[0] + x] |= figure.distance(pixel) < reach;
            }
        }
    }
    found
}

fn median(values: &mut [u8]) -> u8 {
    let middle = values.len() / 2;
    *values.select_nth_unstable(middle).1
}

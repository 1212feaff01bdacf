//! Which inputs of the network a source's pictures take, by what the user wants.

use serde::{Deserialize, Serialize};

use super::size::InputSize;

/// How much time a picture may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// One look at 384x240, or as large in the picture's shape
    Fast,
    /// One look at 512x320, or as large in the picture's shape
    Balanced,
    /// Two looks, at 384x240 and 768x480: those near and those far
    Best,
}

/// The inputs of a source's pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Inputs {
    /// This one, pixels across and down.
    Fixed((usize, usize)),
    /// One of [`super::zoom::SHARES`] from this one on, as small as suits the people in view.
    Following(usize),
    /// One or two, shares of the whole size in the picture's shape: first those of pictures that are not upright, then
    /// of upright ones.
    Looks([&'static [f32]; 2]),
}

/// The whole size: what a picture fits into, by its shape. A square one that fitted into 512×320 would have less than
/// two thirds of the pixels that others have, and who is small in it would be missed.
const LANDSCAPE: (usize, usize) = (512, 320);
const SQUARE: (usize, usize) = (368, 368);
const UPRIGHT: (usize, usize) = (LANDSCAPE.1, LANDSCAPE.0);

/// Near and far: what other pairs found is in models/train/RUNS.md.
const TWO_LOOKS: &[f32] = &[0.75, 1.5];
/// Upright photos show people who fill them, and these are seen better by a smaller input.
const ONE_LOOK: [&[f32]; 2] = [&[1.0], &[0.8]];
const QUICK_LOOK: [&[f32]; 2] = [&[0.75], &[0.6]];

impl Inputs {
    /// For a `film` (or camera), whose pictures follow each other, or for photos.
    pub fn new(size: Option<InputSize>, quality: Option<Quality>, film: bool) -> Self {
        match (size, quality) {
            (Some(InputSize::Fixed(w, h)), _) => Self::Fixed((w, h)),
            (_, Some(Quality::Fast)) if film => Self::Following(1),
            (_, Some(Quality::Balanced) | None) if film => Self::Following(0),
            (_, quality) => Self::Looks(shares(quality.unwrap_or(Quality::Best))),
        }
    }
}

/// The shares at which a photo is looked at: one that is not upright, and one that is (more than 1.15 times as high as
/// wide).
fn shares(quality: Quality) -> [&'static [f32]; 2] {
    match quality {
        Quality::Fast => QUICK_LOOK,
        Quality::Balanced => ONE_LOOK,
        Quality::Best => [TWO_LOOKS; 2],
    }
}

/// The inputs of the looks at a photo, all pixels across and down.
pub fn photo_inputs(photo: (usize, usize), quality: Quality) -> Vec<(usize, usize)> {
    inputs_of(photo, shares(quality))
}

/// The inputs of the looks at a `picture` by [`Inputs::Looks`], all pixels across and down.
pub fn inputs_of(picture: (usize, usize), shares: [&[f32]; 2]) -> Vec<(usize, usize)> {
    let is_upright = scale_into(picture, UPRIGHT) > scale_into(picture, SQUARE);
    let shares = shares[usize::from(is_upright)];
    shares.iter().map(|&s| fitted(picture, s)).collect()
}

/// The input that shows a `picture` (pixels across and down) at this `share` of the whole size: multiples of 16.
pub fn fitted(picture: (usize, usize), share: f32) -> (usize, usize) {
    let scale = share * whole_scale(picture);
    let side = |pixels: usize| ((pixels as f32 * scale / 16.0).round() as usize * 16).max(64);
    (side(picture.0), side(picture.1))
}

/// Pixels of the input for a pixel of the `picture` (pixels across and down) at the whole size.
pub fn whole_scale(picture: (usize, usize)) -> f32 {
    let scales = [LANDSCAPE, SQUARE, UPRIGHT].map(|whole| scale_into(picture, whole));
    scales.into_iter().fold(0.0, f32::max)
}

fn scale_into(picture: (usize, usize), (across, down): (usize, usize)) -> f32 {
    let (w, h) = (picture.0.max(1) as f32, picture.1.max(1) as f32);
    (across as f32 / w).min(down as f32 / h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_are_looked_at_twice_and_films_follow() {
        let of = |quality, film| Inputs::new(None, quality, film);
        assert_eq!(of(None, false), Inputs::Looks([&[0.75, 1.5]; 2]));
        assert_eq!(of(Some(Quality::Best), true), of(None, false));
        assert_eq!(of(Some(Quality::Balanced), false), Inputs::Looks(ONE_LOOK));
        assert_eq!(of(None, true), Inputs::Following(0));
        assert_eq!(of(Some(Quality::Fast), true), Inputs::Following(1));
        let fixed = Some(InputSize::Fixed(64, 96));
        for film in [false, true] {
            assert_eq!(Inputs::new(fixed, None, film), Inputs::Fixed((64, 96)));
            let auto = Inputs::new(Some(InputSize::Auto), None, film);
            assert_eq!(auto, of(None, film));
        }
    }

    #[test]
    fn upright_photos_have_shares_of_their_own() {
        let inputs = |w, h, quality| photo_inputs((w, h), quality);
        assert_eq!(inputs(640, 480, Quality::Best), [(320, 240), (640, 480)]);
        assert_eq!(inputs(640, 480, Quality::Balanced), [(432, 320)]);
        assert_eq!(inputs(480, 720, Quality::Balanced), [(256, 384)]);
        assert_eq!(inputs(480, 720, Quality::Best), [(240, 368), (480, 720)]);
        assert_eq!(inputs(720, 720, Quality::Balanced), [(368, 368)]);
        assert_eq!(inputs(700, 720, Quality::Balanced), [(352, 368)]);
    }

    #[test]
    fn inputs_have_the_shape_of_the_picture() {
        assert_eq!(fitted((1920, 1080), 1.0), (512, 288));
        assert_eq!(fitted((640, 480), 1.0), (432, 320));
        assert_eq!(fitted((640, 480), 0.75), (320, 240));
        assert_eq!(fitted((416, 416), 1.0), (368, 368));
        assert_eq!(fitted((416, 416), 1.5), (560, 560));
        assert_eq!(fitted((480, 720), 0.8), (256, 384));
        assert_eq!(fitted((5000, 10), 1.5), (768, 64));
        assert_eq!(fitted((0, 0), 1.0), (64, 64));
    }
}

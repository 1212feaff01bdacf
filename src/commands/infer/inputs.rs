//! Which inputs of the network a source's pictures take, by what the user wants.

use serde::{Deserialize, Serialize};

use super::engine_args::InputSize;
use super::zoom::INPUTS;

/// How much time a picture may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    /// One look at 384x240
    Fast,
    /// One look at 512x320
    Balanced,
    /// Two looks, at 384x240 and 768x480: those near and those far
    Best,
}

/// The inputs of a source's pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Inputs {
    /// This one, pixels across and down.
    Fixed((usize, usize)),
    /// One of [`INPUTS`] from this one on, as small as suits the people in view.
    Following(usize),
    /// One or two, shares of 512×320 in the shape of the picture: of landscape pictures, and of upright ones.
    Looks([&'static [f32]; 2]),
}

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

/// The shares at which a photo is looked at: a landscape one, and an upright one.
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
    let shares = shares[usize::from(picture.1 > picture.0)];
    shares.iter().map(|&s| fitted(picture, s)).collect()
}

/// The input that shows a `picture` (pixels across and down) at this `share` of the size at which it fits into 512×320,
/// or 320×512 if it is upright: multiples of 16.
pub fn fitted(picture: (usize, usize), share: f32) -> (usize, usize) {
    let (w, h) = (picture.0.max(1) as f32, picture.1.max(1) as f32);
    let (across, down) = turned(INPUTS[0], h > w);
    let scale = share * (across as f32 / w).min(down as f32 / h);
    let side = |pixels: f32| ((pixels * scale / 16.0).round() as usize * 16).max(64);
    (side(w), side(h))
}

/// A size for landscape pictures, turned for portrait ones if `upright`.
pub fn turned((w, h): (usize, usize), upright: bool) -> (usize, usize) {
    if upright { (h, w) } else { (w, h) }
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
    }

    #[test]
    fn inputs_have_the_shape_of_the_picture() {
        assert_eq!(fitted((1920, 1080), 1.0), (512, 288));
        assert_eq!(fitted((640, 480), 1.0), (432, 320));
        assert_eq!(fitted((640, 480), 0.75), (320, 240));
        assert_eq!(fitted((416, 416), 1.5), (480, 480));
        assert_eq!(fitted((480, 720), 0.8), (256, 384));
        assert_eq!(fitted((5000, 10), 1.5), (768, 64));
        assert_eq!(fitted((0, 0), 1.0), (320, 320));
    }
}

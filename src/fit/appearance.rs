//! In: torso histograms. Out: how alike two people look, and what is remembered of a person. XNect §5.1.

use crate::message::{APPEARANCE_BINS, Observation};

/// Bins of saturation, up to a tenth, in which hue is that of the light, …
const GREY_BINS: usize = 3;
/// … and the share of a torso in them from which it has no colour: all of it before a camera without colours, of grey
/// and white clothes before others nearly all.
const GREY: f32 = 0.9;

/// Hue and saturation of a torso, each summing to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Appearance {
    hue: [f32; APPEARANCE_BINS],
    saturation: [f32; APPEARANCE_BINS],
}

impl Appearance {
    /// From an observation; `None` where the torso was not seen.
    pub fn new(seen: &Observation) -> Option<Self> {
        Some(Self {
            hue: normalised(&seen.hue)?,
            saturation: normalised(&seen.saturation)?,
        })
    }

    /// Hellinger distance of the histograms, hue counting twice: 0 alike, 1 nothing in common. Hue is circular and
    /// lighting shifts it, so both are compared after blurring over the neighbouring bins.
    pub fn distance(&self, other: &Self) -> f64 {
        let hue = hellinger(&blurred(&self.hue, true), &blurred(&other.hue, true));
        let saturation = hellinger(
            &blurred(&self.saturation, false),
            &blurred(&other.saturation, false),
        );
        (2.0 * hue + saturation) / 3.0
    }

    /// Difference to somebody's looks as a share of the `most` that one person has; `None` where looks tell nothing.
    pub fn unlike(&self, other: &Self, most: f64) -> Option<f64> {
        let unlike = self.distance(other) / most.max(1e-6);
        // Without colours everybody looks alike.
        (unlike > 1.0 || self.has_colour() || other.has_colour()).then_some(unlike)
    }

    /// Whether there is any colour to tell people apart by.
    pub fn has_colour(&self) -> bool {
        self.saturation[..GREY_BINS].iter().sum::<f32>() < GREY
    }

    /// Moves this memory towards what is seen now.
    pub fn blend(&mut self, now: &Self, share: f32) {
        for (a, b) in self.hue.iter_mut().zip(&now.hue) {
            *a += share * (b - *a);
        }
        for (a, b) in self.saturation.iter_mut().zip(&now.saturation) {
            *a += share * (b - *a);
        }
    }
}

fn normalised(bins: &[f32; APPEARANCE_BINS]) -> Option<[f32; APPEARANCE_BINS]> {
    if bins.iter().any(|b| !b.is_finite() || *b < 0.0) {
        return None;
    }
    let sum: f32 = bins.iter().sum();
    (sum > 1e-6 && sum.is_finite()).then(|| bins.map(|b| b / sum))
}

fn blurred(bins: &[f32; APPEARANCE_BINS], circular: bool) -> [f32; APPEARANCE_BINS] {
    const N: usize = APPEARANCE_BINS;
    std::array::from_fn(|i| {
        let at = |d: isize| {
            let k = i as isize + d;
            let k = if circular {
                k.rem_euclid(N as isize)
            } else {
                k.clamp(0, N as isize - 1)
            };
            bins[k as usize]
        };
        0.25 * at(-1) + 0.5 * at(0) + 0.25 * at(1)
    })
}

fn hellinger(a: &[f32; APPEARANCE_BINS], b: &[f32; APPEARANCE_BINS]) -> f64 {
    let overlap: f32 = a.iter().zip(b).map(|(a, b)| (a * b).sqrt()).sum();
    f64::from((1.0 - overlap).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peaked(hue: usize, saturation: usize) -> Appearance {
        let mut seen = Observation::default();
        seen.hue[hue] = 2.0;
        seen.saturation[saturation] = 1.0;
        Appearance::new(&seen).unwrap()
    }

    #[test]
    fn distance_orders_people() {
        let a = peaked(29, 10);
        assert!(a.distance(&a) < 1e-3);
        let near = a.distance(&peaked(0, 10));
        let far = a.distance(&peaked(15, 10));
        assert!(near < 0.6 && far > near + 0.05, "{near} {far}");
        assert!(a.distance(&peaked(15, 20)) > 0.99);
        let mut b = peaked(15, 20);
        b.blend(&a, 1.0);
        assert!(b.distance(&a) < 1e-3);
    }

    #[test]
    fn grey_is_no_colour() {
        assert!(peaked(29, 3).has_colour() && !peaked(29, 2).has_colour());
        let mut seen = Observation {
            hue: [1.0; APPEARANCE_BINS],
            ..Observation::default()
        };
        seen.saturation[0] = 0.88;
        seen.saturation[20] = 0.12;
        assert!(Appearance::new(&seen).unwrap().has_colour());
        seen.saturation[20] = 0.05;
        assert!(!Appearance::new(&seen).unwrap().has_colour());
    }

    #[test]
    fn unusable_histograms_are_unknown() {
        assert!(Appearance::new(&Observation::default()).is_none());
        let mut seen = Observation::default();
        seen.hue[0] = f32::NAN;
        seen.saturation[0] = 1.0;
        assert!(Appearance::new(&seen).is_none());
    }
}

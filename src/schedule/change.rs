//! Whether anything in a picture has changed against another one of the same place.
//!
//! Cells are compared after the change that they have in common is taken out: exposure and flicker make everything
//! brighter or darker by the same factor. Noise is what most cells still differ by; somebody differs by more, and in
//! several cells. Whoever fills most of the picture cannot pass for noise, because noise of so many pixels is never
//! that large.

use std::ops::Range;

use crate::capture::Brightness;

/// What counts as a change.
#[derive(Debug, Clone, Copy)]
struct Sense {
    /// Least difference of a cell, grey levels.
    least: f32,
    /// Cells that must differ.
    cells: usize,
}

/// Somebody dressed like the wall behind. Fewer cells are a lamp on a device, and smaller than anybody whom the network
/// could see.
const ANYTHING: Sense = Sense {
    least: 2.0,
    cells: 2,
};
/// Not the shadows of those who are there, nor their reflections in the floor. Whoever is missed is seen when all of
/// the picture is looked at next.
const SOMEBODY: Sense = Sense {
    least: 8.0,
    cells: 4,
};
/// Cells differ by noise if most differ by no more than this, grey levels.
const MOST_NOISE: f32 = 1.2;
/// So many times what most cells differ by is no noise: five standard deviations.
const BEYOND_NOISE: f32 = 8.0;
/// How much lighter or darker a whole picture may become by itself.
const MOST_GAIN: f32 = 1.3;

/// What pictures are compared with, and scratch memory.
#[derive(Debug, Default)]
pub struct Change {
    reference: Option<Brightness>,
    values: Vec<f32>,
}

impl Change {
    /// Pictures are compared with this one from now on; with none everything is new.
    pub fn compare_with(&mut self, reference: Option<Brightness>) {
        self.reference = reference;
    }

    /// Whether the picture differs from the reference. Cheap, and rather once too often than once too seldom.
    pub fn is_in(&mut self, picture: &Brightness) -> bool {
        self.is_where(picture, ANYTHING, |_, _| true)
    }

    /// Whether the picture shows somebody outside of these columns and rows whom the reference does not show there.
    pub fn is_beside(
        &mut self,
        picture: &Brightness,
        columns: Range<usize>,
        rows: Range<usize>,
    ) -> bool {
        let is_outside = |c, r| !(columns.contains(&c) && rows.contains(&r));
        self.is_where(picture, SOMEBODY, is_outside)
    }

    /// Whether the picture differs from the reference in the cells, by column and row, that count.
    fn is_where(
        &mut self,
        picture: &Brightness,
        sense: Sense,
        counts: impl Fn(usize, usize) -> bool,
    ) -> bool {
        let Some(reference) = &self.reference else {
            return true;
        };
        if (reference.columns, reference.rows) != (picture.columns, picture.rows) {
            return true;
        }
        let columns = picture.columns.max(1);
        let pairs = || {
            let all = picture.cells.iter().zip(&reference.cells).enumerate();
            all.filter(|(i, _)| counts(i % columns, i / columns))
                .map(|(_, pair)| pair)
        };
        self.values.clear();
        // One level more than there is, so that black divides by something.
        let ratio = pairs().map(|(now, then)| (now + 1.0) / (then + 1.0));
        self.values.extend(ratio);
        let gain = median(&mut self.values).unwrap_or(1.0);
        if !(1.0 / MOST_GAIN..=MOST_GAIN).contains(&gain) {
            return true;
        }
        let difference = |(now, then): (&f32, &f32)| (now + 1.0 - gain * (then + 1.0)).abs();
        self.values.clear();
        self.values.extend(pairs().map(difference));
        let noise = median(&mut self.values).unwrap_or(0.0);
        let least = sense.least.max(BEYOND_NOISE * noise);
        // Which order they are in does not matter any more.
        let beyond = self.values.iter().filter(|d| **d > least);
        noise > MOST_NOISE || beyond.count() >= sense.cells
    }
}

/// The middle value; the order is lost.
fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    values.get(middle)?;
    Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 640;
    const HEIGHT: usize = 360;

    /// Repeatable noise, about Gaussian, standard deviation 1.
    struct Noise(u64);

    impl Noise {
        fn next(&mut self) -> f32 {
            let mut uniform = || {
                self.0 = self
                    .0
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 40) as f32 / (1 << 24) as f32
            };
            // Twelve uniform ones: variance 1.
            (0..12).map(|_| uniform()).sum::<f32>() - 6.0
        }
    }

    /// A room with a floor, a wall and a window, in light `gain`, as a camera with noise `sigma` sees it; somebody of
    /// `person` pixels (left, top, width, height) and `contrast` against what is behind.
    fn room(gain: f32, sigma: f32, seed: u64, person: Option<([usize; 4], f32)>) -> Brightness {
        let mut noise = Noise(seed);
        let mut plane = vec![0u8; WIDTH * HEIGHT];
        for (i, out) in plane.iter_mut().enumerate() {
            let (x, y) = (i % WIDTH, i / WIDTH);
            let mut light = 60.0 + 0.1 * x as f32;
            if y > 250 {
                light = 40.0 + 8.0 * ((x / 37 + y / 19) % 2) as f32;
            } else if (400..520).contains(&x) && (40..180).contains(&y) {
                light = 170.0;
            }
            if let Some(([left, top, w, h], contrast)) = person
                && (left..left + w).contains(&x)
                && (top..top + h).contains(&y)
            {
                light += contrast;
            }
            *out = (light * gain + sigma * noise.next())
                .round()
                .clamp(0.0, 255.0) as u8;
        }
        let mut b = Brightness::default();
        b.measure(&plane, [WIDTH, HEIGHT], WIDTH, 1);
        b
    }

    fn changed(before: Brightness, now: &Brightness) -> bool {
        let mut change = Change::default();
        change.compare_with(Some(before));
        change.is_in(now)
    }

    #[test]
    fn noise_and_light_change_nothing() {
        for sigma in [0.5, 3.0, 8.0] {
            for seed in 2..14 {
                let gain = 1.0 + 0.01 * (seed % 16) as f32;
                let now = room(gain, sigma, seed, None);
                assert!(!changed(room(1.0, sigma, 1, None), &now), "{sigma} {seed}");
            }
        }
    }

    #[test]
    fn somebody_changes_it_far_away_or_filling_the_picture() {
        // 18 × 50 pixels of 640 × 360 are 40 rows of the network's largest input.
        for person in [[100, 200, 18, 50], [300, 100, 80, 250], [0, 0, 600, 360]] {
            for contrast in [-20.0, -8.0, 8.0, 60.0] {
                for (gain, sigma) in [(1.0, 3.0), (1.15, 3.0), (0.9, 5.0)] {
                    let now = room(gain, sigma, 7, Some((person, contrast)));
                    assert!(
                        changed(room(1.0, sigma, 1, None), &now),
                        "{person:?} {contrast} {gain} {sigma}"
                    );
                }
            }
        }
    }

    #[test]
    fn who_comes_in_ever_so_slowly_is_noticed_before_half_of_them_shows() {
        let mut change = Change::default();
        change.compare_with(Some(room(1.0, 3.0, 1, None)));
        let noticed = (1..=40usize).find(|width| {
            let person = ([0, 120, *width, 180], -25.0);
            change.is_in(&room(1.0, 3.0, 10 + *width as u64, Some(person)))
        });
        assert!(noticed.is_some_and(|w| w < 20), "{noticed:?}");
    }

    #[test]
    fn another_light_or_shape_is_new() {
        let before = || room(1.0, 2.0, 1, None);
        assert!(changed(before(), &room(1.5, 2.0, 2, None)));
        assert!(changed(before(), &room(0.5, 2.0, 2, None)));
        let mut small = Brightness::default();
        small.measure(&[0; 64], [8, 8], 8, 1);
        assert!(changed(before(), &small));
        assert!(
            Change::default().is_in(&before()),
            "nothing to compare with"
        );
    }
}

//! Points of one picture go in, where they are in another one comes out.

use super::plane::Plane;
use super::pyramid::Pyramid;

/// Window's radius, pixels of every scale.
const RADIUS: std::ops::RangeInclusive<f32> = 3.0..=15.0;
/// Steps towards the best place at every scale.
const STEPS: usize = 10;
/// A step as short as this is the last, pixels of the scale.
const SHORT: f32 = 0.03;
/// Least mean square of brightness's slope along its weakest direction, grey levels per pixel: less is noise, or an
/// edge along which a point may be anywhere.
const LEAST_SLOPE: f32 = 1.0;
/// Whoever is followed there and back must come back as near as this: pixels of the finest scale, and beside them a
/// share of the window's radius.
const ASTRAY: (f32, f32) = (0.5, 0.5);
/// Most mean square of what differs in the end, share of the variance of what was looked for: of noise it is twice as
/// much, of what something else has come before no less.
const MOST_LEFT: f32 = 0.5;
/// How much brighter or darker light may make all of a window from one picture to the next, as under lamps on the
/// mains.
const GAIN: std::ops::RangeInclusive<f32> = 0.6..=1.6;
/// Grey levels that may differ whatever was looked for, mean square: of cameras' noise in plain places.
const NOISE: f32 = 4.0;
/// Sums that are made side by side.
const LANES: usize = 8;

/// Follows points by the brightness in a window round them. Buffers are kept.
#[derive(Debug, Clone, Default)]
pub struct LucasKanade {
    window: Window,
}

impl LucasKanade {
    /// Where the point that is `at` (u, v) in the picture `from` is in the picture `to`, both of one size, by a window
    /// of `radius`: all pixels of the pictures. `None` where the window tells no place, or where the way back leads
    /// somewhere else.
    pub fn follow(
        &mut self,
        from: &Pyramid,
        to: &Pyramid,
        at: [f32; 2],
        radius: f32,
    ) -> Option<[f32; 2]> {
        let shrink = from.shrink();
        let radius = (radius / shrink).clamp(*RADIUS.start(), *RADIUS.end());
        // The centre of a block of pixels is the centre of the finest scale's pixel.
        let start = at.map(|c| (c + 0.5) / shrink - 0.5);
        let end = self.window.walk(from, to, start, radius)?;
        let back = self.window.walk(to, from, end, radius)?;
        let astray = (back[0] - start[0]).hypot(back[1] - start[1]);
        let is_back = astray <= ASTRAY.0 + ASTRAY.1 * radius;
        is_back.then(|| end.map(|c| (c + 0.5) * shrink - 0.5))
    }
}

/// What is looked for, and scratch memory.
#[derive(Debug, Clone, Default)]
struct Window {
    /// With a pixel more on every side.
    wide: Vec<f32>,
    wanted: Vec<f32>,
    /// Sum of what is looked for.
    brightness: f32,
    across: Vec<f32>,
    down: Vec<f32>,
    found: Vec<f32>,
}

impl Window {
    /// Follows a point from coarse to fine, pixels of the finest scale.
    fn walk(
        &mut self,
        from: &Pyramid,
        to: &Pyramid,
        start: [f32; 2],
        radius: f32,
    ) -> Option<[f32; 2]> {
        let radius = radius as usize;
        let near = 2 * radius;
        let finest = from.scales().first()?;
        let is_near = |c: f32, size: usize| c > -(near as f32) && c < (size + near) as f32;
        if !is_near(start[0], finest.width) || !is_near(start[1], finest.height) {
            return None;
        }
        let mut way = [0.0f32; 2];
        let scales = from.scales().iter().zip(to.scales()).enumerate();
        for (k, (a, b)) in scales.rev() {
            way = way.map(|w| 2.0 * w);
            let share = (1usize << k) as f32;
            let at = start.map(|c| (c + 0.5) / share - 0.5);
            let Some(slopes) = self.take(a, at, radius) else {
                // Coarser scales only help.
                if k == 0 {
                    return None;
                }
                continue;
            };
            way = self.step(b, at, radius, slopes, way);
        }
        if !self.is_found() {
            return None;
        }
        let end = [start[0] + way[0], start[1] + way[1]];
        end.iter().all(|c| c.is_finite()).then_some(end)
    }

    /// Takes what is round a point; sums of the products of its slopes (across², across·down, down²), unless it tells
    /// no place.
    fn take(&mut self, plane: &Plane, at: [f32; 2], radius: usize) -> Option<[f32; 3]> {
        let (side, reach) = (2 * radius + 1, radius as f32 + 1.0);
        let wide = side + 2;
        plane.patch(at[0] - reach, at[1] - reach, wide, &mut self.wide);
        self.wanted.clear();
        self.across.clear();
        self.down.clear();
        for rows in self.wide.windows(3 * wide).step_by(wide) {
            let (above, rest) = rows.split_at(wide);
            let (row, below) = rest.split_at(wide);
            self.wanted.extend_from_slice(&row[1..=side]);
            let across = row.windows(3).map(|w| 0.5 * (w[2] - w[0]));
            self.across.extend(across);
            let down = above.iter().zip(below).map(|(a, b)| 0.5 * (b - a));
            self.down.extend(down.skip(1).take(side));
        }
        // As the light is taken to be what makes the means equal, it takes its part of every slope.
        self.brightness = sum(&self.wanted);
        for slope in [&mut self.across, &mut self.down] {
            let share = sum(slope) / self.brightness.max(1.0);
            for (slope, wanted) in slope.iter_mut().zip(&self.wanted) {
                *slope -= share * wanted;
            }
        }
        let slopes = [
            dot(&self.across, &self.across),
            dot(&self.across, &self.down),
            dot(&self.down, &self.down),
        ];
        let [xx, xy, yy] = slopes.map(|s| s / (side * side) as f32);
        let weakest = 0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt());
        (weakest >= LEAST_SLOPE).then_some(slopes)
    }

    /// Whether the last step showed what was looked for.
    fn is_found(&self) -> bool {
        let share = (self.wanted.len().max(1) as f32).recip();
        let mean = share * self.brightness;
        let variance = share * dot(&self.wanted, &self.wanted) - mean * mean;
        share * dot(&self.found, &self.found) <= NOISE + MOST_LEFT * variance
    }

    /// Goes from the guess `way` to where `plane` shows what was taken.
    fn step(
        &mut self,
        plane: &Plane,
        at: [f32; 2],
        radius: usize,
        [xx, xy, yy]: [f32; 3],
        mut way: [f32; 2],
    ) -> [f32; 2] {
        let (side, reach) = (2 * radius + 1, radius as f32);
        let determinant = xx * yy - xy * xy;
        for _ in 0..STEPS {
            let [left, top] = [0, 1].map(|k| at[k] + way[k] - reach);
            plane.patch(left, top, side, &mut self.found);
            let gain =
                (self.brightness / sum(&self.found).max(1.0)).clamp(*GAIN.start(), *GAIN.end());
            for (found, wanted) in self.found.iter_mut().zip(&self.wanted) {
                *found = wanted - gain * *found;
            }
            let (across, down) = (dot(&self.found, &self.across), dot(&self.found, &self.down));
            let step = [
                (yy * across - xy * down) / determinant,
                (xx * down - xy * across) / determinant,
            ];
            way = [way[0] + step[0], way[1] + step[1]];
            if step[0].hypot(step[1]) < SHORT {
                break;
            }
        }
        way
    }
}

/// Sum of a list.
fn sum(a: &[f32]) -> f32 {
    let mut sums = [0.0f32; LANES];
    let a = a.chunks_exact(LANES);
    let rest: f32 = a.remainder().iter().sum();
    for a in a {
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum += a[k];
        }
    }
    sums.iter().sum::<f32>() + rest
}

/// Sum of the products of two lists.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; LANES];
    let (a, b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest = a.remainder().iter().zip(b.remainder());
    let rest: f32 = rest.map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum += a[k] * b[k];
        }
    }
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::capture::Frame;

    /// A picture of smooth spots, all of it moved by `way` pixels.
    fn spots(width: u32, height: u32, way: [f32; 2]) -> Frame {
        let rgb = (0..width * height).flat_map(|i| {
            let (x, y) = ((i % width) as f32 - way[0], (i / width) as f32 - way[1]);
            // Long waves are the higher ones, as in photos.
            let wave = |across: f32, down: f32| {
                (across * x + down * y).sin() * (0.08 / across.hypot(down)).min(0.6)
            };
            let sum = wave(0.021, 0.017)
                + wave(-0.019, 0.034)
                + wave(0.061, -0.052)
                + wave(0.11, 0.09)
                + wave(-0.13, 0.21);
            [(128.0 + 45.0 * sum) as u8; 3]
        });
        Frame {
            width,
            height,
            rgb: rgb.collect(),
            ..Frame::default()
        }
    }

    fn pyramid(frame: &Frame) -> Pyramid {
        let mut pyramid = Pyramid::default();
        pyramid.fill(frame);
        pyramid
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(24) })]
        #[test]
        fn points_of_a_moved_picture_are_found(
            u in 60.0f32..260.0, v in 60.0f32..180.0, du in -14.0f32..14.0, dv in -14.0f32..14.0, double in any::<bool>(),
        ) {
            let share = if double { 4 } else { 1 };
            let (before, now) = (spots(320 * share, 240 * share, [0.0; 2]), spots(320 * share, 240 * share, [du, dv]));
            let found = LucasKanade::default().follow(&pyramid(&before), &pyramid(&now), [u, v], 14.0);
            let [x, y] = found.expect("a place");
            prop_assert!((x - u - du).abs() < 0.3 && (y - v - dv).abs() < 0.3, "{x} {y}");
        }
    }

    #[test]
    fn light_that_changes_moves_nothing() {
        let before = pyramid(&spots(320, 240, [0.0; 2]));
        for gain in [0.8, 0.9, 1.1, 1.25] {
            let mut lit = spots(320, 240, [3.0, -2.0]);
            for byte in &mut lit.rgb {
                *byte = (f32::from(*byte) * gain) as u8;
            }
            let now = pyramid(&lit);
            for at in [[70.0, 60.0], [150.0, 120.0], [250.0, 170.0]] {
                let found = LucasKanade::default().follow(&before, &now, at, 14.0);
                let [x, y] = found.expect("a place");
                let off = (x - at[0] - 3.0).hypot(y - at[1] + 2.0);
                assert!(off < 0.4, "{gain} {at:?}: {x} {y}");
            }
        }
    }

    #[test]
    fn nothing_to_see_and_what_has_gone_tell_no_place() {
        let grey = pyramid(&Frame {
            rgb: vec![90; 3 * 320 * 240],
            ..spots(320, 240, [0.0; 2])
        });
        let seen = pyramid(&spots(320, 240, [0.0; 2]));
        let mut flow = LucasKanade::default();
        assert_eq!(flow.follow(&grey, &grey, [100.0, 90.0], 10.0), None);
        assert_eq!(flow.follow(&seen, &grey, [100.0, 90.0], 10.0), None);
        assert_eq!(flow.follow(&seen, &seen, [-500.0, 90.0], 10.0), None);
        assert_eq!(flow.follow(&seen, &seen, [f32::NAN, 90.0], 10.0), None);
    }

    #[test]
    fn at_the_edge_of_a_picture_points_are_followed_too() {
        let (before, now) = (spots(320, 240, [0.0; 2]), spots(320, 240, [2.0, -1.0]));
        let found =
            LucasKanade::default().follow(&pyramid(&before), &pyramid(&now), [318.0, 120.0], 10.0);
        let [x, y] = found.expect("a place");
        assert!(
            (x - 320.0).abs() < 0.7 && (y - 119.0).abs() < 0.7,
            "{x} {y}"
        );
    }
}

//! A picture and a person's joints go in, colour histograms of the torso come out; XNect §5.1.

use edgecap_client::joints::{EVIDENCE_JOINTS, HIPS, NECK, SHOULDERS};
use edgecap_client::message::APPEARANCE_BINS;

use crate::capture::Frame;

/// Hue and saturation histograms.
pub(crate) type Histograms = ([f32; APPEARANCE_BINS], [f32; APPEARANCE_BINS]);

/// Shorter side of the box over the longer: a torso seen from the side has shoulders and hips on one line.
const LEAST_SIDE: f32 = 0.35;
/// Part of the box left off at each side, where background shows.
const MARGIN: f32 = 0.1;
/// Pixels looked at along a side of the box that has so many, at least, and fewer than twice as many: enough for a
/// histogram, and the cost does not grow with the person.
const LEAST_STEPS: u32 = 40;
/// Weight of a grey pixel's vote for its hue: so small that any colour outvotes it, yet a grey torso has a flat
/// histogram rather than none.
const GREY_VOTE: f32 = 1e-3;

/// Histograms of hue (votes weighted by how colourful a pixel is) and saturation in the torso's box, each summing to 1;
/// all zero when the torso was not seen. `joints` are in pixels of `frame`.
pub(crate) fn histograms(frame: &Frame, joints: &[[f32; 3]; EVIDENCE_JOINTS]) -> Histograms {
    let (mut hue, mut saturation) = ([0.0; APPEARANCE_BINS], [0.0; APPEARANCE_BINS]);
    let Some([left, top, right, bottom]) = torso_box(frame, joints) else {
        return (hue, saturation);
    };
    let mut pixels = 0.0_f32;
    for row in (top..bottom).step_by(step(bottom - top)) {
        for column in (left..right).step_by(step(right - left)) {
            let i = 3 * (row as usize * frame.width as usize + column as usize);
            let Some(&[r, g, b]) = frame.rgb.get(i..i + 3) else {
                continue;
            };
            let (h, s, chroma) = hue_saturation(r, g, b);
            let bin = |x: f32| ((x * APPEARANCE_BINS as f32) as usize).min(APPEARANCE_BINS - 1);
            saturation[bin(s)] += 1.0;
            hue[bin(h)] += chroma;
            pixels += 1.0;
        }
    }
    if pixels > 0.0 {
        let grey = pixels * GREY_VOTE / APPEARANCE_BINS as f32;
        hue.iter_mut().for_each(|v| *v += grey);
        let votes: f32 = hue.iter().sum();
        hue.iter_mut().for_each(|v| *v /= votes);
        saturation.iter_mut().for_each(|v| *v /= pixels);
    }
    (hue, saturation)
}

/// From one pixel that is looked at to the next, along a side of so many.
fn step(side: u32) -> usize {
    (side / LEAST_STEPS).max(1) as usize
}

/// Pixels [left, top, right, bottom), inside the picture; `None` without a hip, or without shoulder and neck, or when
/// nothing of the box is in the picture.
fn torso_box(frame: &Frame, joints: &[[f32; 3]; EVIDENCE_JOINTS]) -> Option<[u32; 4]> {
    let seen = |j: &&usize| joints[**j][2] > 0.0;
    let upper = || SHOULDERS.iter().chain([&NECK]).filter(seen);
    let lower = || HIPS.iter().filter(seen);
    upper().next()?;
    lower().next()?;
    let span = |axis: usize| {
        let values = upper().chain(lower()).map(|&j| joints[j][axis]);
        values.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| {
            (a.min(v), b.max(v))
        })
    };
    let ((left, right), (top, bottom)) = (span(0), span(1));
    let (width, height) = (right - left, bottom - top);
    let inside = |low: f32, high: f32, least: f32, size: u32| {
        let half = 0.5 * ((high - low) * (1.0 - 2.0 * MARGIN)).max(least);
        let centre = 0.5 * (low + high);
        let clip = |x: f32| x.round().clamp(0.0, size as f32) as u32;
        let (a, b) = (clip(centre - half), clip(centre + half));
        (a < b).then_some((a, b))
    };
    let (left, right) = inside(left, right, LEAST_SIDE * height, frame.width)?;
    let (top, bottom) = inside(top, bottom, LEAST_SIDE * width, frame.height)?;
    Some([left, top, right, bottom])
}

/// Hue and saturation of HSV, 0–1, and chroma (largest minus smallest channel), 0–1.
fn hue_saturation(r: u8, g: u8, b: u8) -> (f32, f32, f32) {
    let [r, g, b] = [r, g, b].map(f32::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let chroma = most - least;
    if chroma == 0.0 {
        return (0.0, 0.0, 0.0);
    }
    let sextant = if most == r {
        ((g - b) / chroma).rem_euclid(6.0)
    } else if most == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    (sextant / 6.0, chroma / most, chroma / 255.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(colour: impl Fn(u32, u32) -> [u8; 3]) -> Frame {
        let (width, height) = (100, 80);
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        Frame {
            width,
            height,
            rgb: pixels.flat_map(|(x, y)| colour(x, y)).collect(),
            ..Default::default()
        }
    }

    fn torso(left: f32, top: f32, right: f32, bottom: f32) -> [[f32; 3]; EVIDENCE_JOINTS] {
        let mut joints = [[0.0; 3]; EVIDENCE_JOINTS];
        joints[2] = [left, top, 0.9];
        joints[5] = [right, top, 0.9];
        joints[8] = [left, bottom, 0.9];
        joints[11] = [right, bottom, 0.9];
        joints
    }

    #[test]
    fn hue_and_saturation_match_known_colours() {
        assert_eq!(hue_saturation(255, 0, 0), (0.0, 1.0, 1.0));
        assert_eq!(hue_saturation(0, 255, 0), (2.0 / 6.0, 1.0, 1.0));
        assert_eq!(hue_saturation(0, 0, 255), (4.0 / 6.0, 1.0, 1.0));
        let (hue, saturation, _) = hue_saturation(200, 100, 150);
        assert!((hue - 5.5 / 6.0).abs() < 1e-6 && (saturation - 0.5).abs() < 1e-6);
        assert_eq!(hue_saturation(7, 7, 7), (0.0, 0.0, 0.0));
    }

    #[test]
    fn no_more_pixels_are_looked_at_of_a_large_torso() {
        for side in 1..4000 {
            let looked_at = (0..side).step_by(step(side)).count();
            assert!(
                (side.min(40) as usize..80).contains(&looked_at),
                "{looked_at} of {side}"
            );
        }
    }

    #[test]
    fn a_blue_shirt_before_a_red_wall_is_blue() {
        let frame = picture(|x, y| {
            if (30..60).contains(&x) && (20..60).contains(&y) {
                [0, 0, 200]
            } else {
                [200, 0, 0]
            }
        });
        let (hue, saturation) = histograms(&frame, &torso(30.0, 20.0, 59.0, 59.0));
        assert!(hue[20] > 0.99, "{hue:?}");
        assert_eq!(saturation[APPEARANCE_BINS - 1], 1.0);
        assert!((hue.iter().sum::<f32>() - 1.0).abs() < 1e-4);
    }

    #[test]
    fn grey_has_a_flat_hue() {
        let frame = picture(|_, _| [90, 90, 90]);
        let (hue, saturation) = histograms(&frame, &torso(30.0, 20.0, 59.0, 59.0));
        let flat = 1.0 / APPEARANCE_BINS as f32;
        assert!(hue.iter().all(|h| (h - flat).abs() < 1e-4), "{hue:?}");
        assert_eq!(saturation[0], 1.0);
    }

    #[test]
    fn a_torso_half_outside_counts_and_one_outside_does_not() {
        let frame = picture(|_, _| [0, 200, 0]);
        let (hue, _) = histograms(&frame, &torso(-20.0, 60.0, 20.0, 120.0));
        assert!(hue[10] > 0.99);
        let (hue, saturation) = histograms(&frame, &torso(200.0, 20.0, 240.0, 60.0));
        assert_eq!((hue, saturation), Default::default());
    }

    #[test]
    fn one_shoulder_and_one_hip_are_enough_and_shoulders_alone_are_not() {
        let frame = picture(|_, _| [0, 200, 0]);
        let mut joints = torso(30.0, 20.0, 59.0, 59.0);
        joints[5] = [0.0; 3];
        joints[11] = [0.0; 3];
        assert!(histograms(&frame, &joints).0[10] > 0.99);
        joints[8] = [0.0; 3];
        assert_eq!(histograms(&frame, &joints), Default::default());
    }

    #[test]
    fn an_empty_picture_has_no_torso() {
        let joints = torso(30.0, 20.0, 59.0, 59.0);
        assert_eq!(histograms(&Frame::default(), &joints), Default::default());
    }
}

//! The network's input against exact arithmetic and against another library.

use edgecap::capture::{Crop, Frame, Letterbox, PADDING, Resizer};
use image::RgbImage;
use image::imageops::{self, FilterType};
use proptest::prelude::*;

/// Smooth waves with some fine detail.
fn picture(width: u32, height: u32) -> Frame {
    let mut rgb = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let (x, y) = (x as f32, y as f32);
            let a = 128.0 + 80.0 * (0.11 * x).sin() + 40.0 * (0.37 * y).cos();
            let b = 128.0 + 100.0 * (0.05 * (x + 2.0 * y)).sin();
            let c = ((x as u32 * 37 + y as u32 * 91) % 256) as f32;
            rgb.extend_from_slice(&[a as u8, b as u8, c as u8]);
        }
    }
    Frame {
        width,
        height,
        rgb,
        ..Frame::default()
    }
}

fn run(frame: &Frame, width: u32, height: u32) -> (Vec<u8>, Letterbox) {
    let mut resizer = Resizer::new(width, height);
    let mut out = vec![0; resizer.output_bytes()];
    let letterbox = resizer.run(frame, &mut out);
    (out, letterbox)
}

/// The same resampling in f64, one output pixel at a time.
fn exact(frame: &Frame, width: u32, height: u32) -> Vec<f64> {
    let (sw, sh) = (f64::from(frame.width), f64::from(frame.height));
    let scale = (f64::from(width) / sw).min(f64::from(height) / sh);
    let axis = |i: u32, target: u32, n: f64| -> Option<Vec<(usize, f64)>> {
        let pad = 0.5 * (f64::from(target) - n * scale);
        let centre = (f64::from(i) + 0.5 - pad) / scale;
        if centre < 0.0 || centre >= n {
            return None;
        }
        if scale > 0.5 {
            let at = (centre - 0.5).clamp(0.0, n - 1.0);
            let next = (at as usize + 1).min(n as usize - 1);
            return Some(vec![(at as usize, 1.0 - at.fract()), (next, at.fract())]);
        }
        let (lo, hi) = (
            (centre - 0.5 / scale).max(0.0),
            (centre + 0.5 / scale).min(n),
        );
        let cover = |j: usize| (hi.min(j as f64 + 1.0) - lo.max(j as f64)).max(0.0) / (hi - lo);
        Some(
            (0..n as usize)
                .map(|j| (j, cover(j)))
                .filter(|t| t.1 > 0.0)
                .collect(),
        )
    };
    let mut out = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let taps = axis(x, width, sw).zip(axis(y, height, sh));
            for c in 0..3 {
                out.push(match &taps {
                    None => f64::from(PADDING),
                    Some((xs, ys)) => ys
                        .iter()
                        .flat_map(|(j, wy)| xs.iter().map(move |(i, wx)| (i, j, wx * wy)))
                        .map(|(i, j, w)| {
                            w * f64::from(frame.rgb[3 * (j * frame.width as usize + i) + c])
                        })
                        .sum(),
                });
            }
        }
    }
    out
}

fn assert_close(out: &[u8], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(out.len(), expected.len());
    let worst = out
        .iter()
        .zip(expected)
        .map(|(a, b)| (f64::from(*a) - b).abs())
        .fold(0.0, f64::max);
    assert!(worst <= tolerance, "{what}: {worst}");
}

#[test]
fn agrees_with_exact_arithmetic() {
    for (sw, sh, dw, dh) in [
        (160, 90, 64, 40), // areas of 2.5 × 2.5, bars above and below
        (64, 48, 64, 40),  // bilinear, bars left and right
        (33, 77, 64, 40),  // high and narrow
        (20, 10, 64, 40),  // larger
        (64, 40, 64, 40),  // unchanged
        (301, 5, 64, 40),  // a stripe
        (1, 1, 64, 40),
        (160, 900, 16, 16),
        (900, 160, 16, 16),
    ] {
        let frame = picture(sw, sh);
        let (out, _) = run(&frame, dw, dh);
        assert_close(
            &out,
            &exact(&frame, dw, dh),
            1.5,
            &format!("{sw}x{sh} to {dw}x{dh}"),
        );
    }
}

#[test]
fn an_unchanged_size_changes_nothing() {
    let frame = picture(64, 40);
    assert_eq!(run(&frame, 64, 40).0, frame.rgb);
}

/// The picture as the other library takes it.
fn library(frame: &Frame) -> RgbImage {
    RgbImage::from_raw(frame.width, frame.height, frame.rgb.clone()).unwrap()
}

fn numbers(picture: &RgbImage) -> Vec<f64> {
    picture.as_raw().iter().map(|v| f64::from(*v)).collect()
}

/// The whole output by another library, for sizes that need no bars.
#[test]
fn agrees_with_the_image_library() {
    // Whole factors: its thumbnails are area averages.
    for factor in [2, 3, 4, 7] {
        let frame = picture(64 * factor, 40 * factor);
        let expected = numbers(&imageops::thumbnail(&library(&frame), 64, 40));
        assert_close(
            &run(&frame, 64, 40).0,
            &expected,
            1.5,
            &format!("area {factor}"),
        );
    }
    // Its triangle filter is bilinear where it enlarges.
    for (sw, sh) in [(32, 20), (48, 30), (40, 25), (56, 35)] {
        let frame = picture(sw, sh);
        let resized = imageops::resize(&library(&frame), 64, 40, FilterType::Triangle);
        assert_close(
            &run(&frame, 64, 40).0,
            &numbers(&resized),
            2.0,
            &format!("bilinear {sw}x{sh}"),
        );
    }
}

#[test]
fn one_resizer_takes_pictures_of_changing_size() {
    let mut resizer = Resizer::new(64, 40);
    let mut out = vec![0; resizer.output_bytes()];
    for (w, h) in [(100, 100), (30, 90), (100, 100), (5, 1)] {
        let frame = picture(w, h);
        let letterbox = resizer.run(&frame, &mut out);
        assert_eq!((out.clone(), letterbox), run(&frame, 64, 40));
    }
}

#[test]
fn a_dot_lands_where_the_letterbox_says() {
    for (w, h) in [(640, 360), (320, 480), (50, 50)] {
        let mut frame = Frame {
            width: w,
            height: h,
            rgb: vec![0; 3 * (w * h) as usize],
            ..Frame::default()
        };
        let (u, v) = (w / 3, 2 * h / 3);
        let size = 6i64;
        for y in -size..=size {
            for x in -size..=size {
                let at = 3 * ((i64::from(v) + y) * i64::from(w) + i64::from(u) + x) as usize;
                frame.rgb[at] = 255;
            }
        }
        let (out, letterbox) = run(&frame, 160, 96);
        let (mut su, mut sv, mut sum) = (0.0, 0.0, 0.0);
        for (k, pixel) in out.chunks_exact(3).enumerate() {
            // The bars are grey, the dot is red.
            let weight = f32::from(pixel[0].saturating_sub(pixel[1]));
            su += weight * (k % 160) as f32;
            sv += weight * (k / 160) as f32;
            sum += weight;
        }
        let [eu, ev] = letterbox.to_input(u as f32, v as f32);
        assert!(
            (su / sum - eu).abs() < 0.1 && (sv / sum - ev).abs() < 0.1,
            "{w}x{h}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_sizes_fit(sw in 1u32..400, sh in 1u32..400, dw in 1u32..80, dh in 1u32..80, level in any::<u8>()) {
        let frame = Frame {
            width: sw,
            height: sh,
            rgb: vec![level; 3 * (sw * sh) as usize],
            ..Frame::default()
        };
        let (out, l) = run(&frame, dw, dh);
        // A flat picture stays flat, to the bit.
        prop_assert!(out.iter().all(|v| *v == level || *v == PADDING));
        prop_assert!(out.contains(&level));
        // Forth and back; corners stay inside.
        let [u, v] = l.to_input(3.0, 4.0);
        let [x, y] = l.to_original(u, v);
        prop_assert!((x - 3.0).abs() < 1e-2 && (y - 4.0).abs() < 1e-2);
        let [left, top] = l.to_input(-0.5, -0.5);
        let [right, bottom] = l.to_input(sw as f32 - 0.5, sh as f32 - 0.5);
        prop_assert!(left > -0.51 && top > -0.51 && right < dw as f32 - 0.49 && bottom < dh as f32 - 0.49);
    }
}

proptest! {
    #[test]
    fn a_crop_is_what_the_whole_has_there(
        (w, h) in (1u32..200, 1u32..200),
        (left, top) in (0usize..64, 0usize..40),
        (right, bottom) in (1usize..=64, 1usize..=40),
    ) {
        let crop = Crop { left, top, width: right.max(left + 1) - left, height: bottom.max(top + 1) - top };
        let frame = picture(w, h);
        let (whole, there) = run(&frame, 64, 40);
        let mut out = vec![1; 3 * crop.area()];
        let here = Resizer::new(64, 40).run_crop(&frame, crop, &mut out);
        let rows = whole.chunks_exact(3 * 64).skip(top).take(crop.height);
        let expected: Vec<u8> = rows.flat_map(|row| &row[3 * left..][..3 * crop.width]).copied().collect();
        prop_assert_eq!(out, expected);
        let [u, v] = there.to_input(3.0, 5.0);
        let [pu, pv] = here.to_input(3.0, 5.0);
        prop_assert!((u - left as f32 - pu).abs() < 1e-3 && (v - top as f32 - pv).abs() < 1e-3);
    }
}

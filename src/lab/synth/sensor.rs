//! Linear light goes in, the picture that a camera would deliver comes out.

use glam::Vec3;

use super::noise::Dice;
use super::scene::Sensor;
use crate::capture::Frame;

/// Exposes, blurs, tints and adds noise. `level`: mean luminance to expose for (kept over a clip, so that the exposure
/// does not flicker); `dice`: noise of this frame.
pub fn develop(
    light: &[Vec3],
    size: (u32, u32),
    sensor: &Sensor,
    level: f32,
    dice: &mut Dice,
) -> Frame {
    let (w, h) = (size.0 as usize, size.1 as usize);
    let gain = sensor.brightness.powf(2.2) / level.max(1e-4);
    let blurred = blur(light, w, h, sensor.blur);
    let mut rgb = Vec::with_capacity(3 * w * h);
    // Noise of neighbouring pixels is alike after demosaicing: half of it is shared along the row.
    let mut last = Vec3::ZERO;
    for (i, c) in blurred.iter().enumerate() {
        let (x, y) = (
            (i % w) as f32 / w as f32 - 0.5,
            (i / w) as f32 / h as f32 - 0.5,
        );
        let fall = 1.0 - sensor.vignette * (x * x + y * y) * 1.6;
        let c = *c * sensor.tint * (gain * fall);
        let grey = c.dot(Vec3::new(0.30, 0.59, 0.11));
        let c = Vec3::splat(grey).lerp(c, sensor.saturation).max(Vec3::ZERO);
        // display curve: gamma with a shoulder
        let curve = |v: f32| {
            let v = v * (1.0 + v / 6.0) / (1.0 + v * 0.75);
            let d = (v * 1.45).powf(1.0 / 2.2);
            ((d - 0.45) * sensor.contrast + 0.45).clamp(0.0, 1.0)
        };
        let fresh = Vec3::new(dice.normal(), dice.normal(), dice.normal());
        let grain = 0.5 * last + 0.8 * fresh + Vec3::splat(0.6 * dice.normal());
        last = fresh;
        for k in 0..3 {
            let v = curve(c[k]);
            let noisy = v + grain[k] * sensor.noise * (0.4 + 0.9 * v.sqrt());
            rgb.push((noisy.clamp(0.0, 1.0) * 255.0).round() as u8);
        }
    }
    Frame {
        width: size.0,
        height: size.1,
        rgb,
        time_ns: 0,
        sequence: 0,
    }
}

/// Mean luminance of linear light.
pub fn mean_level(light: &[Vec3]) -> f32 {
    // Windows and sky must not drive the exposure: compress before averaging.
    let sum: f32 = light
        .iter()
        .map(|c| c.dot(Vec3::new(0.30, 0.59, 0.11)).max(0.0).powf(0.45))
        .sum();
    (sum / light.len().max(1) as f32).powf(1.0 / 0.45)
}

/// Separable Gaussian.
fn blur(light: &[Vec3], w: usize, h: usize, sigma: f32) -> Vec<Vec3> {
    if sigma < 0.2 {
        return light.to_vec();
    }
    let reach = (3.0 * sigma).ceil() as i32;
    let raw: Vec<f32> = (-reach..=reach)
        .map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp())
        .collect();
    let total: f32 = raw.iter().sum();
    let taps: Vec<(i32, f32)> = (-reach..=reach)
        .zip(raw.iter().map(|v| v / total))
        .collect();
    let mut across = Vec::with_capacity(light.len());
    for y in 0..h {
        for x in 0..w as i32 {
            across.push(
                taps.iter()
                    .map(|&(k, v)| light[y * w + (x + k).clamp(0, w as i32 - 1) as usize] * v)
                    .sum::<Vec3>(),
            );
        }
    }
    let mut out = Vec::with_capacity(light.len());
    for y in 0..h as i32 {
        for x in 0..w {
            out.push(
                taps.iter()
                    .map(|&(k, v)| across[(y + k).clamp(0, h as i32 - 1) as usize * w + x] * v)
                    .sum::<Vec3>(),
            );
        }
    }
    out
}

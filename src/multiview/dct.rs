//! Trajectories of few cosines: windows of a sequence go in, the smooth trajectory nearest to it comes out.
//!
//! In every window a joint's path is a sum of the first vectors of the DCT-II, fitted robustly (Geman–McClure by
//! reweighting); windows overlap by half and are blended, so that no seam shows.

use glam::DVec3;

use super::triangulate::robust_weight;

/// Seconds of a window: with its base they say how fast a path may turn.
const WINDOW: f64 = 1.0;
/// Frames of a window at least: at few a second a base that follows every turn would follow every error.
const LEAST: usize = 15;
/// Vectors of a window's base.
const VECTORS: usize = 10;
/// Distance from its trajectory beyond which a joint counts little, metres.
pub const SIGMA: f64 = 0.1;
const REWEIGHTINGS: usize = 4;

/// Frames of a window at `rate` frames a second.
fn window(rate: f64) -> usize {
    ((WINDOW * rate).round() as usize).max(LEAST)
}

/// Where windows begin and how long they are, at `rate` frames a second: half overlapping, the last one ending with the
/// sequence.
pub fn windows(frames: usize, rate: f64) -> Vec<(usize, usize)> {
    let window = window(rate);
    if frames <= window {
        return vec![(0, frames)];
    }
    let mut all: Vec<_> = (0..=frames - window)
        .step_by(window / 2)
        .map(|s| (s, window))
        .collect();
    if all.last().is_some_and(|(s, n)| s + n < frames) {
        all.push((frames - window, window));
    }
    all
}

/// The smooth path near one joint's, of which there are `rate` frames a second.
pub fn smooth(path: &[DVec3], rate: f64) -> Vec<DVec3> {
    let mut sum = vec![DVec3::ZERO; path.len()];
    let mut weights = vec![0.0; path.len()];
    for (start, length) in windows(path.len(), rate) {
        // Shorter sequences have as many vectors for their length.
        let vectors = (VECTORS * length).div_ceil(window(rate));
        let piece = nearest(&path[start..start + length], vectors.clamp(2, VECTORS));
        for (k, point) in piece.into_iter().enumerate() {
            // A window counts most in its middle.
            let weight = (k + 1).min(length - k) as f64;
            sum[start + k] += weight * point;
            weights[start + k] += weight;
        }
    }
    sum.iter().zip(&weights).map(|(s, w)| *s / *w).collect()
}

/// The nearest path of so many cosines.
fn nearest(path: &[DVec3], vectors: usize) -> Vec<DVec3> {
    let n = path.len();
    let vectors = vectors.min(n);
    let base: Vec<Vec<f64>> = (0..n)
        .map(|k| {
            let phase = std::f64::consts::PI * (k as f64 + 0.5) / n as f64;
            (0..vectors).map(|m| (phase * m as f64).cos()).collect()
        })
        .collect();
    let mut weights = vec![1.0; n];
    let mut out = path.to_vec();
    for _ in 0..REWEIGHTINGS {
        let mut a = nalgebra::DMatrix::<f64>::zeros(vectors, vectors);
        let mut b = nalgebra::DMatrix::<f64>::zeros(vectors, 3);
        for ((row, point), w) in base.iter().zip(path).zip(&weights) {
            for i in 0..vectors {
                for j in 0..vectors {
                    a[(i, j)] += w * row[i] * row[j];
                }
                for c in 0..3 {
                    b[(i, c)] += w * row[i] * point[c];
                }
            }
        }
        for i in 0..vectors {
            a[(i, i)] += 1e-6;
        }
        let Some(factor) = a.cholesky() else {
            break;
        };
        let x = factor.solve(&b);
        for ((row, point), (out, w)) in base.iter().zip(path).zip(out.iter_mut().zip(&mut weights))
        {
            *out = DVec3::from_array(std::array::from_fn(|c| {
                row.iter().enumerate().map(|(i, r)| r * x[(i, c)]).sum()
            }));
            *w = robust_weight((*out - *point).length_squared(), SIGMA);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_cover_everything() {
        for (rate, window) in [(30.0, 30), (60.0, 60), (25.0, 25), (5.0, 15)] {
            for frames in [1, 2, 29, 30, 31, 44, 45, 46, 100] {
                let all = windows(frames, rate);
                let mut covered = vec![0; frames];
                for &(start, length) in &all {
                    assert_eq!(length, frames.min(window));
                    covered[start..start + length]
                        .iter_mut()
                        .for_each(|c| *c += 1);
                }
                assert!(
                    covered.iter().all(|c| (1..=3).contains(c)),
                    "{frames} at {rate}: {covered:?}"
                );
            }
        }
    }

    /// How much of a joint's swing, so many times a second, its smooth path keeps, root mean squares over five seconds.
    fn kept(rate: f64, swings: f64) -> f64 {
        let swing = |k: usize| (std::f64::consts::TAU * swings * k as f64 / rate + 0.4).sin();
        let path: Vec<DVec3> = (0..(5.0 * rate) as usize)
            .map(|k| DVec3::new(0.02 * swing(k), 0.9, 3.0))
            .collect();
        let size = |path: &[DVec3]| path.iter().map(|p| p.x * p.x).sum::<f64>();
        (size(&smooth(&path, rate)) / size(&path)).sqrt()
    }

    #[test]
    fn how_fast_a_path_may_turn_goes_by_seconds() {
        for rate in [15.0, 25.0, 30.0, 60.0, 120.0] {
            let [slow, fast] = [2.0, 7.0].map(|swings| kept(rate, swings));
            assert!(slow > 0.95 && fast < 0.25, "{rate}: {slow} {fast}");
        }
        // At few frames a second there are more frames in a window.
        assert!(kept(10.0, 2.0) > 0.95, "{}", kept(10.0, 2.0));
    }

    #[test]
    fn slow_paths_stay_jumps_go() {
        let path: Vec<DVec3> = (0..90)
            .map(|k| {
                let t = f64::from(k) / 30.0;
                DVec3::new((2.0 * t).sin(), 0.3 * t, (3.0 * t).cos() * 0.2)
            })
            .collect();
        let still = smooth(&path, 30.0);
        let worst = still
            .iter()
            .zip(&path)
            .map(|(a, b)| a.distance(*b))
            .fold(0.0, f64::max);
        assert!(worst < 0.02, "{worst}");
        let mut hit = path.clone();
        hit[40].y += 0.8;
        let mended = smooth(&hit, 30.0);
        assert!(
            (mended[40] - path[40]).length() < 0.05,
            "{}",
            mended[40] - path[40]
        );
        assert_eq!(smooth(&path[..1], 30.0).len(), 1);
        assert!((smooth(&path[..2], 30.0)[1] - path[1]).length() < 1e-3);
    }
}

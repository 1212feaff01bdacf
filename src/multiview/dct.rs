//! Trajectories of few cosines: windows of a sequence go in, the smooth trajectory nearest to it comes out.
//!
//! In every window a joint's path is a sum of the first vectors of the DCT-II, fitted robustly (Geman–McClure by
//! reweighting); windows overlap by half and are blended, so that no seam shows.

use glam::DVec3;

use super::triangulate::robust_weight;

/// Frames of a window.
pub const WINDOW: usize = 30;
/// Vectors of a window's base.
pub const VECTORS: usize = 10;
/// Distance from its trajectory beyond which a joint counts little, metres.
pub const SIGMA: f64 = 0.1;
const REWEIGHTINGS: usize = 4;

/// Where windows begin and how long they are: half overlapping, the last one ending with the sequence.
pub fn windows(frames: usize) -> Vec<(usize, usize)> {
    if frames <= WINDOW {
        return vec![(0, frames)];
    }
    let mut all: Vec<_> = (0..=frames - WINDOW)
        .step_by(WINDOW / 2)
        .map(|s| (s, WINDOW))
        .collect();
    if all.last().is_some_and(|(s, n)| s + n < frames) {
        all.push((frames - WINDOW, WINDOW));
    }
    all
}

/// The smooth path near one joint's.
pub fn smooth(path: &[DVec3]) -> Vec<DVec3> {
    let mut sum = vec![DVec3::ZERO; path.len()];
    let mut weights = vec![0.0; path.len()];
    for (start, length) in windows(path.len()) {
        let piece = window(&path[start..start + length]);
        for (k, point) in piece.into_iter().enumerate() {
            // A window counts most in its middle.
            let weight = (k + 1).min(length - k) as f64;
            sum[start + k] += weight * point;
            weights[start + k] += weight;
        }
    }
    sum.iter().zip(&weights).map(|(s, w)| *s / *w).collect()
}

fn window(path: &[DVec3]) -> Vec<DVec3> {
    let n = path.len();
    // Shorter sequences have as many vectors for their length.
    let vectors = (VECTORS * n).div_ceil(WINDOW).clamp(2, VECTORS).min(n);
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
        for frames in [1, 2, 29, 30, 31, 44, 45, 46, 100] {
            let all = windows(frames);
            let mut covered = vec![0; frames];
            for &(start, length) in &all {
                assert_eq!(length, frames.min(WINDOW));
                covered[start..start + length]
                    .iter_mut()
                    .for_each(|c| *c += 1);
            }
            assert!(
                covered.iter().all(|c| (1..=3).contains(c)),
                "{frames}: {covered:?}"
            );
        }
    }

    #[test]
    fn slow_paths_stay_jumps_go() {
        let path: Vec<DVec3> = (0..90)
            .map(|k| {
                let t = f64::from(k) / 30.0;
                DVec3::new((2.0 * t).sin(), 0.3 * t, (3.0 * t).cos() * 0.2)
            })
            .collect();
        let still = smooth(&path);
        let worst = still
            .iter()
            .zip(&path)
            .map(|(a, b)| a.distance(*b))
            .fold(0.0, f64::max);
        assert!(worst < 0.02, "{worst}");
        let mut hit = path.clone();
        hit[40].y += 0.8;
        let mended = smooth(&hit);
        assert!(
            (mended[40] - path[40]).length() < 0.05,
            "{}",
            mended[40] - path[40]
        );
        assert_eq!(smooth(&path[..1]).len(), 1);
        assert!((smooth(&path[..2])[1] - path[1]).length() < 1e-3);
    }
}

//! Points of one plane and of another go in, the projective map between them comes out.

use glam::{DMat3, DVec2};
use nalgebra::{SMatrix, SVector, SymmetricEigen};

/// Of the greatest eigenvalue, what the second least must be.
const LEAST: f64 = 1e-9;

/// The homography that takes first points to second ones, by the normalised direct linear transform (Hartley 1997).
/// `None` for fewer than four, or such as lie on a line.
pub fn homography(pairs: &[(DVec2, DVec2)]) -> Option<DMat3> {
    if pairs.len() < 4 {
        return None;
    }
    let (from, to) = (
        normaliser(pairs.iter().map(|p| p.0))?,
        normaliser(pairs.iter().map(|p| p.1))?,
    );
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (a, b) in pairs {
        let (a, b) = (from * a.extend(1.0), to * b.extend(1.0));
        for (axis, at) in [b.x, b.y].into_iter().enumerate() {
            let row = SVector::<f64, 9>::from_fn(|k, _| match k / 3 {
                g if g == axis => a[k % 3],
                2 => -at * a[k % 3],
                _ => 0.0,
            });
            normal.ger(1.0, &row, &row, 1.0);
        }
    }
    let eigen = SymmetricEigen::try_new(normal, 1e-14, 500)?;
    let mut values: Vec<f64> = eigen.eigenvalues.iter().copied().collect();
    values.sort_by(f64::total_cmp);
    // Points on a line leave more than one map.
    if values[1] < LEAST * values[8] {
        return None;
    }
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let h = DMat3::from_cols_array(&std::array::from_fn(|k| h[3 * (k % 3) + k / 3]));
    let h = to.inverse() * h * from;
    let size = h.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
    (size > 0.0 && size.is_finite()).then(|| h * (1.0 / size))
}

/// Moves points to a mean of 0 and a mean distance from it of 1.
fn normaliser(points: impl Iterator<Item = DVec2> + Clone) -> Option<DMat3> {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<DVec2>() / count;
    let scale = points.map(|p| p.distance(mean)).sum::<f64>() / count;
    (scale > 1e-12)
        .then(|| DMat3::from_scale(DVec2::splat(1.0 / scale)) * DMat3::from_translation(-mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_map_is_found_again() {
        let truth = DMat3::from_cols_array(&[1.1, 0.2, 1e-4, -0.1, 0.9, 2e-4, 300.0, 200.0, 1.0]);
        let grid = (0..20).map(|k| DVec2::new((k % 5) as f64, (k / 5) as f64) * 30.0);
        let pairs: Vec<_> = grid
            .map(|p| {
                let q = truth * p.extend(1.0);
                (p, q.truncate() / q.z)
            })
            .collect();
        let found = homography(&pairs).unwrap();
        for (p, q) in &pairs {
            let h = found * p.extend(1.0);
            assert!((h.truncate() / h.z).distance(*q) < 1e-9);
        }
        let line: Vec<_> = pairs[..5].to_vec();
        assert_eq!(homography(&line), None);
    }
}

//! Several calibrated cameras: pixels of one point go in, the point comes out.

use glam::{DMat3, DVec2, DVec3};

use crate::camera::View;

/// The point seen at these pixels of at least two views: nearest to all rays, then least reprojection error with
/// outliers weighted down beyond `sigma` pixels.
pub fn triangulate(seen: &[(&View, DVec2)], sigma: f64) -> Option<DVec3> {
    if seen.len() < 2 {
        return None;
    }
    let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
    for (view, pixel) in seen {
        let d = view.ray(*pixel);
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        a += across;
        b += across * view.position;
    }
    if a.determinant().abs() < 1e-6 {
        return None;
    }
    let mut point = a.inverse() * b;
    for _ in 0..8 {
        let (mut h, mut g) = (DMat3::ZERO, DVec3::ZERO);
        for (view, pixel) in seen {
            let r = view.project(point)? - *pixel;
            let w = 1.0 / (1.0 + r.length_squared() / (sigma * sigma));
            let step = 1e-4;
            let mut columns = [DVec2::ZERO; 3];
            for (axis, column) in DVec3::AXES.iter().zip(&mut columns) {
                let ahead = view.project(point + *axis * step)?;
                *column = (ahead - *pixel - r) / step;
            }
            let row = |f: fn(DVec2) -> f64| DVec3::from_array(columns.map(f));
            for (along, off) in [(row(|c| c.x), r.x), (row(|c| c.y), r.y)] {
                h += w * DMat3::from_cols(along * along.x, along * along.y, along * along.z);
                g += w * along * off;
            }
        }
        if h.determinant().abs() < 1e-12 {
            return None;
        }
        let step = h.inverse() * g;
        point -= step;
        if step.length() < 1e-7 {
            break;
        }
    }
    point.is_finite().then_some(point)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_of_distorted_views_meet_in_the_point() {
        let views = [0.0, 80.0, 170.0, 260.0].map(View::around);
        for point in [DVec3::ZERO, DVec3::new(0.3, -0.8, 0.2)] {
            let seen: Vec<_> = views
                .iter()
                .map(|v| (v, v.project(point).unwrap()))
                .collect();
            let found = triangulate(&seen, 10.0).unwrap();
            assert!((found - point).length() < 1e-6, "{found}");
            // One view that is 200 px off hardly matters.
            let mut bad = seen.clone();
            bad[1].1.x += 200.0;
            let found = triangulate(&bad, 10.0).unwrap();
            assert!((found - point).length() < 0.02, "{found}");
        }
        assert_eq!(triangulate(&[], 10.0), None);
        assert!(views[0].project(DVec3::new(0.0, 0.0, -9.0)).is_none());
    }
}

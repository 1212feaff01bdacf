//! A calibrated view: points in space to pixels, pixels to rays, rays of several views to a point.

use edgecap_client::message::Intrinsics;
use glam::{DMat3, DVec2, DVec3};

/// Films are coded in squares of as many pixels.
const MACROBLOCK: u32 = 16;

/// A camera in the world, pixels of the original picture, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// What the calibration calls it.
    pub name: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Focal lengths and principal point.
    pub focal: DVec2,
    /// Principal point.
    pub centre: DVec2,
    /// Radial k1, k2 and tangential p1, p2 of Brown's model, as in OpenCV.
    pub distortion: [f64; 4],
    /// World axes to camera axes (x right, y down, z forward).
    pub rotation: DMat3,
    /// Where the camera stands in the world.
    pub position: DVec3,
}

impl View {
    /// The pinhole without distortion.
    pub fn intrinsics(&self) -> Intrinsics {
        Intrinsics {
            fx: self.focal.x as f32,
            fy: self.focal.y as f32,
            cx: self.centre.x as f32,
            cy: self.centre.y as f32,
        }
    }

    /// This camera for pictures of `size` pixels: as it was calibrated, or as films show what was calibrated in whole macroblocks
    /// of 16 pixels, cut at the right and below. `None` for pictures of another camera or scale.
    pub fn for_pictures(&self, size: [u32; 2]) -> Option<Self> {
        let fits = (0..2).all(|k| {
            size[k] == self.size[k] || size[k].next_multiple_of(MACROBLOCK) == self.size[k]
        });
        fits.then(|| Self {
            size,
            ..self.clone()
        })
    }

    /// A world point in camera axes.
    pub fn to_camera(&self, point: DVec3) -> DVec3 {
        self.rotation * (point - self.position)
    }

    /// Pixel of a world point; `None` behind the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let p = self.to_camera(point);
        (p.z > 0.05).then(|| self.distort(p.truncate() / p.z) * self.focal + self.centre)
    }

    fn distort(&self, p: DVec2) -> DVec2 {
        let [k1, k2, p1, p2] = self.distortion;
        let r2 = p.length_squared();
        let xy = p.x * p.y;
        p * (1.0 + r2 * (k1 + r2 * k2))
            + DVec2::new(
                2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x),
                p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * xy,
            )
    }

    /// Direction in the world through a pixel; distortion is undone by fixed-point iteration.
    fn ray(&self, pixel: DVec2) -> DVec3 {
        let seen = (pixel - self.centre) / self.focal;
        let mut p = seen;
        for _ in 0..10 {
            p += seen - self.distort(p);
        }
        (self.rotation.transpose() * p.extend(1.0)).normalize()
    }
}

/// The point seen at these pixels of at least two views: nearest to all rays, then least reprojection error with outliers
/// weighted down beyond `sigma` pixels.
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

    fn around(degrees: f64) -> View {
        // Three metres away, looking at the origin; the world's y points down here.
        let rotation = DMat3::from_rotation_y(degrees.to_radians());
        View {
            name: format!("{degrees}"),
            size: [1080, 1920],
            focal: DVec2::new(1680.0, 1682.0),
            centre: DVec2::new(532.0, 948.0),
            distortion: [-0.046, 0.14, 0.0006, -0.0007],
            rotation,
            position: -3.0 * (rotation.transpose() * DVec3::Z),
        }
    }

    #[test]
    fn rays_of_distorted_views_meet_in_the_point() {
        let views = [0.0, 80.0, 170.0, 260.0].map(around);
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

    #[test]
    fn pictures_may_lack_what_fills_the_last_macroblock() {
        let coded = View {
            size: [1088, 1920],
            ..around(0.0)
        };
        let shown = coded.for_pictures([1080, 1920]).unwrap();
        assert_eq!(shown.size, [1080, 1920]);
        assert_eq!(shown.centre, coded.centre);
        assert_eq!(coded.for_pictures([1088, 1920]), Some(coded.clone()));
        for other in [[1072, 1920], [1088, 1080], [544, 960], [1096, 1920]] {
            assert_eq!(coded.for_pictures(other), None, "{other:?}");
        }
    }
}

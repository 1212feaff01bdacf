//! A calibrated camera in the world: points in space to pixels, pixels to rays.

use edgecap_client::message::Intrinsics;
use glam::{DMat3, DVec2, DVec3};

use super::Brown;

/// Films are coded in squares of as many pixels.
const MACROBLOCK: u32 = 16;
/// Part of width and height by which a principal point may be off the middle of pictures of a size not told.
const NEAR_MIDDLE: f64 = 0.1;
/// A pixel that comes back so near, pixels, when the lens is undone and done again is one that the lens shows.
const SHOWN: f64 = 1.0;
/// Halvings after which a fold is known to a pixel.
const HALVINGS: usize = 12;
/// Pixels: no picture is broader.
const MOST: f64 = 65_536.0;

/// A camera in the world, pixels of the original picture, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// What the calibration calls it.
    pub name: String,
    /// Pixels across and down; 0x0 where the calibration does not say.
    pub size: [u32; 2],
    /// Focal lengths across and down, pixels.
    pub focal: DVec2,
    /// Principal point, pixels.
    pub centre: DVec2,
    /// What the lens does to the pinhole's picture.
    pub distortion: Brown,
    /// World axes to camera axes (x right, y down, z forward).
    pub rotation: DMat3,
    /// Where the camera stands in the world, metres.
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

    /// This camera for pictures of `size` pixels: as it was calibrated, or as films show what was calibrated in whole
    /// macroblocks of 16 pixels, cut at the right and below. Where the calibration does not say for which, the
    /// principal point must be near the pictures' middle. `None` for pictures of another camera or scale.
    pub fn for_pictures(&self, size: [u32; 2]) -> Option<Self> {
        let fits = match self.size {
            [0, 0] => self.off_middle(size.map(f64::from)) < NEAR_MIDDLE,
            own => {
                (0..2).all(|k| size[k] == own[k] || size[k].next_multiple_of(MACROBLOCK) == own[k])
            }
        };
        fits.then(|| Self {
            size,
            ..self.clone()
        })
    }

    /// Pixels across and down; such that the principal point is in the middle, where the calibration does not say.
    pub fn likely_size(&self) -> [u32; 2] {
        match self.size {
            [0, 0] => (2.0 * self.centre + 1.0)
                .to_array()
                .map(|s| s.round().clamp(1.0, MOST) as u32),
            told => told,
        }
    }

    /// Horizontal field of view, degrees.
    pub fn fov_degrees(&self) -> f64 {
        let half = 0.5 * f64::from(self.likely_size()[0]);
        2.0 * (half / self.focal.x.abs()).atan().to_degrees()
    }

    /// How far the principal point is from the middle of pictures of `size`, the larger part of width and height.
    pub fn off_middle(&self, size: [f64; 2]) -> f64 {
        (self.centre / DVec2::from(size) - 0.5).abs().max_element()
    }

    /// This camera for pictures that somebody flipped left to right.
    pub fn mirrored(&self) -> Self {
        let last = f64::from(self.likely_size()[0]) - 1.0;
        Self {
            focal: DVec2::new(-self.focal.x, self.focal.y),
            centre: DVec2::new(last - self.centre.x, self.centre.y),
            ..self.clone()
        }
    }

    /// A world point in camera axes.
    pub fn to_camera(&self, point: DVec3) -> DVec3 {
        self.rotation * (point - self.position)
    }

    /// Pixel of a world point; `None` behind the camera and beyond the lens's fold.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let p = self.to_camera(point);
        let plane = (p.z > 0.05).then(|| p.truncate() / p.z);
        let shown = plane.filter(|p| self.distortion.shows(*p))?;
        Some(self.distortion.distort(shown) * self.focal + self.centre)
    }

    /// A pixel of the distorted picture on the plane z = 1 in camera axes, the lens undone.
    pub fn plane(&self, pixel: DVec2) -> DVec2 {
        self.distortion
            .undistort((pixel - self.centre) / self.focal)
    }

    /// The same; `None` where the lens shows nothing by its coefficients, beyond its fold.
    pub fn shown(&self, pixel: DVec2) -> Option<DVec2> {
        let plane = self.plane(pixel);
        let again = self.distortion.distort(plane) * self.focal + self.centre;
        (again.distance(pixel) <= SHOWN).then_some(plane)
    }

    /// How far from the principal point the lens shows nothing any more by its coefficients, pixels, on the side where
    /// that is nearest; `None` where it shows something in all of the picture.
    pub fn folds_at(&self) -> Option<f64> {
        let last = DVec2::from(self.likely_size().map(f64::from)) - 1.0;
        let border = [
            (0, 0),
            (1, 0),
            (2, 0),
            (0, 1),
            (2, 1),
            (0, 2),
            (1, 2),
            (2, 2),
        ];
        let folds = border.into_iter().filter_map(|(x, y)| {
            let out = last * DVec2::new(x.into(), y.into()) / 2.0 - self.centre;
            let is_shown = |share: f64| self.shown(self.centre + share * out).is_some();
            if is_shown(1.0) {
                return None;
            }
            let (mut inside, mut beyond) = (0.0, 1.0);
            for _ in 0..HALVINGS {
                let middle = (inside + beyond) / 2.0;
                if is_shown(middle) {
                    inside = middle;
                } else {
                    beyond = middle;
                }
            }
            Some(inside * out.length())
        });
        folds.min_by(f64::total_cmp)
    }

    /// Where a pinhole would show what the picture shows at a pixel.
    pub fn by_pinhole(&self, pixel: DVec2) -> DVec2 {
        self.plane(pixel) * self.focal + self.centre
    }

    /// Direction in the world through a pixel of the distorted picture, a unit vector.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        (self.rotation.transpose() * self.plane(pixel).extend(1.0)).normalize()
    }
}

#[cfg(test)]
impl View {
    /// Three metres from the origin, looking at it; the world's y points down.
    pub(crate) fn around(degrees: f64) -> Self {
        let rotation = DMat3::from_rotation_y(degrees.to_radians());
        Self {
            name: format!("{degrees}"),
            size: [1080, 1920],
            focal: DVec2::new(1680.0, 1682.0),
            centre: DVec2::new(532.0, 948.0),
            distortion: Brown {
                radial: [-0.046, 0.14, 0.0],
                tangential: [0.0006, -0.0007],
            },
            rotation,
            position: -3.0 * (rotation.transpose() * DVec3::Z),
        }
    }

    /// A webcam behind a lens that bends by this radial coefficient alone: with -0.3, r·(1 − 0.3·r²) is 0.7027 at most.
    pub(crate) fn barrel(k1: f64) -> Self {
        Self {
            size: [1280, 720],
            focal: DVec2::splat(600.0),
            centre: DVec2::new(639.5, 359.5),
            distortion: Brown {
                radial: [k1, 0.0, 0.0],
                tangential: [0.0; 2],
            },
            ..Self::around(0.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_may_lack_what_fills_the_last_macroblock() {
        let coded = View {
            size: [1088, 1920],
            ..View::around(0.0)
        };
        let shown = coded.for_pictures([1080, 1920]).unwrap();
        assert_eq!(shown.size, [1080, 1920]);
        assert_eq!(shown.centre, coded.centre);
        assert_eq!(coded.for_pictures([1088, 1920]), Some(coded.clone()));
        for other in [[1072, 1920], [1088, 1080], [544, 960], [1096, 1920]] {
            assert_eq!(coded.for_pictures(other), None, "{other:?}");
        }
    }

    #[test]
    fn what_lies_beyond_the_fold_is_outside_of_the_picture() {
        let barrel = View {
            distortion: Brown {
                radial: [-0.3, 0.0, 0.0],
                tangential: [0.0; 2],
            },
            ..View::around(0.0)
        };
        // Three metres ahead, and so many to the right: the lens shows 0.7 focal lengths from the middle at most.
        let beside = |x: f64| barrel.project(DVec3::new(x, 0.0, 0.0));
        assert!(beside(0.9).is_some_and(|p| p.x < 1080.0));
        // By the formula alone the last one is in the picture, 380 pixels to the right of the middle.
        for x in [3.3, 4.0, 5.1] {
            assert_eq!(beside(x), None, "{x} m");
        }
        let flipped = barrel.mirrored();
        assert_eq!(flipped.project(DVec3::new(5.1, 0.0, 0.0)), None);
    }

    #[test]
    fn pixels_beyond_the_fold_are_not_shown() {
        let wide = View::barrel(-0.3);
        let beside = |r: f64| wide.shown(wide.centre + DVec2::new(600.0 * r, 0.0));
        assert!(beside(0.69).is_some_and(|p| (0.9..1.0542).contains(&p.x)));
        assert_eq!([beside(0.71), beside(-0.9)], [None, None]);
        let fold = wide.folds_at().unwrap();
        assert!((fold - 421.6).abs() < 2.0, "{fold}");
        assert_eq!(View::barrel(-0.05).folds_at(), None);
    }

    #[test]
    fn in_flipped_pictures_everything_is_on_the_other_side() {
        let (view, point) = (View::around(20.0), DVec3::new(0.3, -0.2, 0.4));
        let (seen, flipped) = (view.project(point).unwrap(), view.mirrored());
        let there = flipped.project(point).unwrap();
        assert!((there - DVec2::new(1079.0 - seen.x, seen.y)).length() < 1e-9);
        assert!((flipped.ray(there) - view.ray(seen)).length() < 1e-6);
    }

    #[test]
    fn of_a_size_not_told_the_principal_point_is_near_the_middle() {
        let untold = View {
            size: [0; 2],
            ..View::around(0.0)
        };
        for size in [[1080, 1920], [1088, 1920]] {
            assert_eq!(untold.for_pictures(size).unwrap().size, size);
        }
        for other in [[1920, 1080], [540, 960], [2160, 3840]] {
            assert_eq!(untold.for_pictures(other), None, "{other:?}");
        }
        assert_eq!(untold.likely_size(), [1065, 1897]);
    }
}

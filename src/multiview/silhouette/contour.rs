//! A mask goes in, the line where a person ends and nobody begins comes out.

use glam::{DVec2, IVec2, Vec2};

use crate::camera::View;

/// Half the side of the window that tells a line's direction, pixels.
const WINDOW: i32 = 3;
/// Points of a contour at most.
const MOST: usize = 220;
/// The golden section: multiples of it are spread evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// Pixels under which a mask is a speck, and points of a contour under which it tells nothing.
const LEAST: usize = 60;
const LEAST_POINTS: usize = 20;

/// Who every pixel of a picture shows: an identity, or 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Row by row.
    pub owners: Vec<u8>,
    /// The identity of what is neither somebody's nor surely nobody's, where there is one.
    pub unknown: Option<u8>,
}

impl Mask {
    /// Who a pixel shows; `None` outside of the picture.
    pub fn at(&self, p: IVec2) -> Option<u8> {
        let [w, h] = self.size.map(|s| s as i32);
        let inside = p.x >= 0 && p.y >= 0 && p.x < w && p.y < h;
        inside.then(|| self.owners[(p.y * w + p.x) as usize])
    }

    /// Whose most of these pixels are: of more than a third of them, or nobody's.
    pub fn owner(&self, pixels: impl Iterator<Item = DVec2>) -> Option<u8> {
        let mut counts = [0usize; 256];
        let mut all = 0;
        for p in pixels {
            all += 1;
            counts[usize::from(self.at(p.round().as_ivec2()).unwrap_or(0))] += 1;
        }
        let (owner, count) = (1..=255u8)
            .filter(|id| Some(*id) != self.unknown)
            .map(|id| (id, counts[usize::from(id)]))
            .max_by_key(|(_, n)| *n)?;
        (3 * count > all).then_some(owner)
    }
}

impl Mask {
    /// Whether it has more values of people than one, or would have where more of them were to be seen: one that tells
    /// what is unknown gives everybody a value of their own.
    pub fn tells_people_apart(&self) -> bool {
        if self.unknown.is_some() {
            return true;
        }
        let mut people = self
            .owners
            .iter()
            .filter(|o| **o != 0 && Some(**o) != self.unknown);
        let first = people.next();
        people.any(|o| Some(o) != first)
    }
}

/// A point of a contour, on the plane z = 1 of the camera, the lens undone. Those of all frames of a person are held at
/// once: in f32, which knows the plane to a hundredth of a pixel and better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Where it is.
    pub plane: Vec2,
    /// Unit vector to where nobody is.
    pub normal: Vec2,
}

/// The line round a person's mask, as far as nobody else and no edge of the picture is beside it.
#[derive(Debug, Clone, PartialEq)]
pub struct Contour {
    /// Its points, evenly spread.
    pub points: Vec<Point>,
    /// Whether the mask knows of every pixel whose it is.
    pub is_sure: bool,
}

impl Contour {
    /// The contour of `owner`, where the lens shows anything by its coefficients; `None` where little of them is seen.
    pub fn new(mask: &Mask, owner: u8, view: &View) -> Option<Self> {
        let [w, h] = mask.size.map(|s| s as i32);
        let mut line: Vec<(DVec2, DVec2)> = Vec::new();
        let mut area = 0;
        for (k, _) in mask.owners.iter().enumerate().filter(|(_, o)| **o == owner) {
            area += 1;
            let p = IVec2::new(k as i32 % w, k as i32 / w);
            if p.x < WINDOW || p.y < WINDOW || p.x >= w - WINDOW || p.y >= h - WINDOW {
                continue;
            }
            let free = |d: &IVec2| mask.at(p + *d) == Some(0);
            let sides = [IVec2::X, IVec2::NEG_X, IVec2::Y, IVec2::NEG_Y];
            let Some(side) = sides.iter().find(|d| free(d)) else {
                continue;
            };
            if let Some(normal) = outwards(mask, owner, p) {
                line.push((p.as_dvec2() + 0.5 * side.as_dvec2(), normal));
            }
        }
        let step = line.len().div_ceil(MOST).max(1);
        // Rows that have two edges give one side and the other in turn: at even steps one would be left out.
        let spread = |k: usize| (k as f64 * GOLDEN).fract() * step as f64;
        let some = (0..line.len() / step).map(|k| line[k * step + spread(k) as usize]);
        let points = some.filter_map(|(pixel, normal)| {
            let plane = view.shown(pixel)?;
            let normal = (view.shown(pixel + normal)? - plane).try_normalize()?;
            Some(Point {
                plane: plane.as_vec2(),
                normal: normal.as_vec2(),
            })
        });
        let points: Vec<Point> = points.collect();
        (area >= LEAST && points.len() >= LEAST_POINTS).then_some(Self {
            points,
            is_sure: mask.unknown.is_none(),
        })
    }
}

/// Direction from a person to nobody at a pixel of their edge; `None` where others are near.
fn outwards(mask: &Mask, owner: u8, p: IVec2) -> Option<DVec2> {
    let mut sum = DVec2::ZERO;
    for y in -WINDOW..=WINDOW {
        for x in -WINDOW..=WINDOW {
            let d = IVec2::new(x, y);
            match mask.at(p + d)? {
                0 => sum += d.as_dvec2(),
                o if o == owner => sum -= d.as_dvec2(),
                _ => return None,
            }
        }
    }
    sum.try_normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contour_ends_where_the_lens_shows_nothing() {
        let view = View::barrel(-0.3);
        let fold = view.folds_at().unwrap();
        let [w, h] = view.size.map(|s| s as i32);
        let radius = 120.0;
        let contour = |middle: DVec2| {
            let at = |k: i32| DVec2::new((k % w).into(), (k / w).into());
            let owner = |k: i32| u8::from(at(k).distance(middle) < radius);
            let mask = Mask {
                size: view.size,
                owners: (0..w * h).map(owner).collect(),
                unknown: None,
            };
            Contour::new(&mask, 1, &view)
        };
        // Across the fold.
        let middle = view.centre + DVec2::new(fold - 40.0, 0.0);
        let found = contour(middle).unwrap();
        assert!(found.points.len() > 60, "{}", found.points.len());
        let upper = found.points.iter().filter(|p| p.plane.y < 0.0).count();
        let half = found.points.len() / 2;
        assert!(upper.abs_diff(half) < half / 4, "{upper} of {}", 2 * half);
        for point in &found.points {
            let plane = point.plane.as_dvec2();
            let pixel = view.distortion.distort(plane) * view.focal + view.centre;
            let off = pixel.distance(middle) - radius;
            assert!(off.abs() < 2.0, "{pixel}: {off} pixels from the edge");
        }
        // Beyond it.
        let out = DVec2::new(fold + radius + 20.0, 0.0);
        assert_eq!(contour(view.centre + out), None);
    }
}

//! A mask goes in, the line where a person ends and nobody begins comes out.

use glam::{DVec2, IVec2, Vec2};

use crate::camera::View;

/// Half the side of the window that tells a line's direction, pixels.
const WINDOW: i32 = 3;
/// Points of a contour at most.
const MOST: usize = 220;
/// Pixels under which a mask is a speck.
const LEAST: usize = 60;

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
    /// The contour of `owner`; `None` where little of them is seen.
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
        if area < LEAST || line.len() < 20 {
            return None;
        }
        let step = line.len().div_ceil(MOST);
        let points = line.iter().step_by(step).filter_map(|(pixel, normal)| {
            let plane = view.plane(*pixel);
            let normal = (view.plane(*pixel + *normal) - plane).try_normalize()?;
            Some(Point {
                plane: plane.as_vec2(),
                normal: normal.as_vec2(),
            })
        });
        Some(Self {
            points: points.collect(),
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

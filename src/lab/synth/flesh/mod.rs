//! The body as a smooth solid: a build and its clothes go in, a signed distance in the rest pose comes out.

mod arms;
mod hair;
mod head;
mod legs;
mod solid;
mod trunk;

use glam::{Quat, Vec3};

use self::solid::Solid;
use super::outfit::{Matter, Outfit};
use super::shape::{Bone, Shape};

/// A part of the body: a solid, how softly it joins the rest, what it is made of, which bone moves it.
#[derive(Debug, Clone)]
pub struct Part {
    solid: Solid,
    soft: f32,
    /// Substance of its surface.
    pub matter: Matter,
    /// Bone that moves it.
    pub bone: Bone,
    centre: Vec3,
    reach: f32,
}

/// The whole rest-pose solid.
#[derive(Debug, Clone)]
pub struct Flesh {
    /// All parts.
    pub parts: Vec<Part>,
}

impl Part {
    fn new(solid: Solid, soft: f32, matter: Matter, bone: Bone) -> Self {
        let (centre, reach) = solid.bound();
        Self {
            solid,
            soft,
            matter,
            bone,
            centre,
            reach,
        }
    }

    /// Signed distance (approximate for ellipsoids and stacks), negative inside.
    pub fn distance(&self, p: Vec3) -> f32 {
        self.solid.distance(p)
    }

    /// Points all over its surface in the rest pose.
    pub fn points(&self) -> Vec<Vec3> {
        self.solid.points()
    }
}

/// An ellipsoid on the head, in units of stature: centre x, y, z; half axes; angle about x (radians); softness.
type Lump = [f32; 8];

/// A body being put together; lengths in metres.
struct Sculptor<'a> {
    parts: Vec<Part>,
    shape: &'a Shape,
    outfit: &'a Outfit,
    /// Metres per unit of stature.
    u: f32,
    /// Thickness of limbs per unit of stature.
    limb: f32,
    /// Widening of the trunk.
    fat: f32,
}

impl<'a> Sculptor<'a> {
    fn new(shape: &'a Shape, outfit: &'a Outfit) -> Self {
        let u = shape.unit();
        let (bulk, muscle) = (shape.bulk, shape.muscle);
        Self {
            parts: Vec::with_capacity(64),
            shape,
            outfit,
            u,
            limb: (0.97 + 0.10 * muscle + 0.16 * bulk) * u,
            fat: 1.0 + 0.20 * bulk.max(0.0) + 0.10 * bulk.min(0.0),
        }
    }

    /// A place in the rest pose from fractions of the stature.
    fn at(&self, x: f32, y: f32, z: f32) -> Vec3 {
        self.shape.at(x, y, z)
    }

    /// A value between a man's and a woman's.
    fn mix(&self, m: f32, f: f32) -> f32 {
        m + (f - m) * self.shape.feminine
    }

    /// Two ends and their radii; `soft` in units of stature.
    fn cone(
        &mut self,
        [a, b]: [Vec3; 2],
        [ra, rb]: [f32; 2],
        soft: f32,
        matter: Matter,
        bone: Bone,
    ) {
        let solid = Solid::Cone { a, b, ra, rb };
        self.parts
            .push(Part::new(solid, soft * self.u, matter, bone));
    }

    fn egg(
        &mut self,
        centre: Vec3,
        radii: Vec3,
        turn: Quat,
        soft: f32,
        matter: Matter,
        bone: Bone,
    ) {
        let solid = Solid::Egg {
            centre,
            radii,
            turn,
        };
        self.parts
            .push(Part::new(solid, soft * self.u, matter, bone));
    }

    fn stack(&mut self, rows: Vec<[f32; 4]>, soft: f32, matter: Matter, bone: Bone) {
        let solid = Solid::Stack(rows);
        self.parts
            .push(Part::new(solid, soft * self.u, matter, bone));
    }
}

impl Flesh {
    /// Builds the solid of a dressed person.
    pub fn new(shape: &Shape, outfit: &Outfit) -> Self {
        let mut body = Sculptor::new(shape, outfit);
        body.trunk();
        for side in 0..2 {
            body.arm(side);
            body.leg(side);
        }
        body.skirt();
        body.head();
        body.bag();
        Self { parts: body.parts }
    }

    /// Least and greatest corner of a box around the surface, which is softer than its parts and so a little larger.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let start = (Vec3::MAX, Vec3::MIN);
        self.parts.iter().fold(start, |(lo, hi), part| {
            let (least, greatest) = part.solid.extent();
            let margin = Vec3::splat(part.soft);
            (lo.min(least - margin), hi.max(greatest + margin))
        })
    }

    /// Parts that can matter within `radius` of `p`.
    pub fn near(&self, p: Vec3, radius: f32) -> Vec<u16> {
        (0..self.parts.len())
            .filter(|&k| {
                let part = &self.parts[k];
                p.distance(part.centre) - part.reach < radius + part.soft + 0.03
            })
            .map(|k| k as u16)
            .collect()
    }

    /// Signed distance to the union of some parts, which stand on the floor y = 0.
    pub fn distance(&self, p: Vec3, among: &[u16]) -> f32 {
        let mut d = 1.0f32;
        for &k in among {
            let part = &self.parts[k as usize];
            let e = part.distance(p);
            let h = (part.soft - (d - e).abs()).max(0.0) / part.soft.max(1e-6);
            d = d.min(e) - h * h * part.soft * 0.25;
        }
        d.max(-p.y)
    }
}

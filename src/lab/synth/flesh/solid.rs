//! Solids that bodies are put together from, and how far a point is from them.

use glam::{Quat, Vec3};

/// Points of an ellipse of a stack.
const ROUND: usize = 24;

/// One solid.
#[derive(Debug, Clone)]
pub(super) enum Solid {
    /// Two spheres and the cone between them.
    Cone { a: Vec3, b: Vec3, ra: f32, rb: f32 },
    /// Ellipsoid turned by a rotation.
    Egg {
        centre: Vec3,
        radii: Vec3,
        turn: Quat,
    },
    /// Stacked ellipses: height, half width, half depth, centre z; heights rise.
    Stack(Vec<[f32; 4]>),
}

impl Solid {
    /// Centre and radius of a sphere around it.
    pub(super) fn bound(&self) -> (Vec3, f32) {
        match self {
            Solid::Cone { a, b, ra, rb } => ((*a + *b) * 0.5, a.distance(*b) * 0.5 + ra.max(*rb)),
            Solid::Egg { centre, radii, .. } => (*centre, radii.max_element()),
            Solid::Stack(rows) => {
                let (lo, hi) = (rows[0][0], rows[rows.len() - 1][0]);
                let wide = rows
                    .iter()
                    .map(|r| r[1].max(r[2] + r[3].abs()))
                    .fold(0.0, f32::max);
                (Vec3::new(0.0, 0.5 * (lo + hi), 0.0), 0.5 * (hi - lo) + wide)
            }
        }
    }

    /// Least and greatest corner of the box around it.
    pub(super) fn extent(&self) -> (Vec3, Vec3) {
        let least = |axis: Vec3| -self.farthest(-axis);
        let corner = |f: &dyn Fn(Vec3) -> f32| Vec3::new(f(Vec3::X), f(Vec3::Y), f(Vec3::Z));
        (corner(&least), corner(&|axis| self.farthest(axis)))
    }

    /// How far it reaches along a unit vector from the origin.
    pub(super) fn farthest(&self, along: Vec3) -> f32 {
        match self {
            Solid::Cone { a, b, ra, rb } => (a.dot(along) + ra).max(b.dot(along) + rb),
            Solid::Egg {
                centre,
                radii,
                turn,
            } => centre.dot(along) + (*radii * (turn.inverse() * along)).length(),
            Solid::Stack(rows) => {
                let reach = |&[y, w, d, z]: &[f32; 4]| {
                    y * along.y + z * along.z + (w * along.x).hypot(d * along.z)
                };
                rows.iter().map(reach).fold(f32::MIN, f32::max)
            }
        }
    }

    /// Points all over its surface; those of a cone on the spheres at its ends.
    pub(super) fn points(&self) -> Vec<Vec3> {
        match self {
            Solid::Cone { a, b, ra, rb } => directions()
                .flat_map(|d| [*a + d * *ra, *b + d * *rb])
                .collect(),
            Solid::Egg {
                centre,
                radii,
                turn,
            } => directions()
                .map(|d| *centre + *turn * (d * *radii))
                .collect(),
            Solid::Stack(rows) => {
                let row = |&[y, w, d, z]: &[f32; 4]| {
                    (0..ROUND).map(move |k| {
                        let (s, c) = (std::f32::consts::TAU * k as f32 / ROUND as f32).sin_cos();
                        Vec3::new(w * c, y, z + d * s)
                    })
                };
                rows.iter().flat_map(row).collect()
            }
        }
    }

    /// Signed distance (approximate for ellipsoids and stacks), negative inside.
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        match self {
            Solid::Cone { a, b, ra, rb } => {
                let axis = *b - *a;
                let t = ((p - *a).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
                p.distance(*a + axis * t) - (ra + (rb - ra) * t)
            }
            Solid::Egg {
                centre,
                radii,
                turn,
            } => ellipsoid(turn.inverse() * (p - *centre), *radii),
            Solid::Stack(rows) => {
                let (lo, hi) = (rows[0][0], rows[rows.len() - 1][0]);
                let y = p.y.clamp(lo, hi);
                let k = rows.partition_point(|r| r[0] <= y).clamp(1, rows.len() - 1);
                let (a, b) = (rows[k - 1], rows[k]);
                let t = (y - a[0]) / (b[0] - a[0]);
                let t = t * t * (3.0 - 2.0 * t) * 0.5 + t * 0.5;
                let mix = |i: usize| a[i] + (b[i] - a[i]) * t;
                let (w, d, z) = (mix(1), mix(2), mix(3));
                let q = Vec3::new(p.x, 0.0, p.z - z);
                let side = ellipse(q.x, q.z, w, d);
                let over = p.y - y;
                if over == 0.0 {
                    side.max(lo - p.y).max(p.y - hi)
                } else if side > 0.0 {
                    side.hypot(over)
                } else {
                    over.abs().max(side)
                }
            }
        }
    }
}

/// Unit vectors in all directions, 25 degrees apart at most.
fn directions() -> impl Iterator<Item = Vec3> {
    let side = || -2..=2i32;
    let grid = side().flat_map(move |x| side().flat_map(move |y| side().map(move |z| [x, y, z])));
    grid.filter(|v| v.iter().any(|c| c.abs() == 2))
        .map(|v| Vec3::from(v.map(|c| c as f32)).normalize())
}

/// Nothing inside is farther from the surface than the least half axis, which the estimate would have along the others.
fn ellipsoid(p: Vec3, r: Vec3) -> f32 {
    let k0 = (p / r).length();
    let k1 = (p / (r * r)).length();
    let deepest = -r.min_element();
    if k1 < 1e-6 {
        deepest
    } else {
        (k0 * (k0 - 1.0) / k1).max(deepest)
    }
}

/// The same of an ellipse.
fn ellipse(x: f32, z: f32, w: f32, d: f32) -> f32 {
    let k0 = (x / w).hypot(z / d);
    let k1 = (x / (w * w)).hypot(z / (d * d));
    let deepest = -w.min(d);
    if k1 < 1e-6 {
        deepest
    } else {
        (k0 * (k0 - 1.0) / k1).max(deepest)
    }
}

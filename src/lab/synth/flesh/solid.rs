//! Solids that bodies are put together from, and how far a point is from them.

use glam::{Quat, Vec3};

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
                    side
                } else if side > 0.0 {
                    side.hypot(over)
                } else {
                    over.abs().max(side)
                }
            }
        }
    }
}

fn ellipsoid(p: Vec3, r: Vec3) -> f32 {
    let k0 = (p / r).length();
    let k1 = (p / (r * r)).length();
    if k1 < 1e-6 {
        -r.min_element()
    } else {
        k0 * (k0 - 1.0) / k1
    }
}

fn ellipse(x: f32, z: f32, w: f32, d: f32) -> f32 {
    let k0 = (x / w).hypot(z / d);
    let k1 = (x / (w * w)).hypot(z / (d * d));
    if k1 < 1e-6 {
        -w.min(d)
    } else {
        k0 * (k0 - 1.0) / k1
    }
}

//! The forms of things, and where rays meet them.

use glam::{Vec2, Vec3};

use super::Finish;

/// Something solid that is not a person.
#[derive(Debug, Clone, Copy)]
pub struct Thing {
    /// Its form.
    pub form: Form,
    /// Its surface.
    pub finish: Finish,
    /// Casts and occludes; pictures on walls do not need to.
    pub solid: bool,
}

/// Form of a [`Thing`].
#[derive(Debug, Clone, Copy)]
pub enum Form {
    /// Box.
    Block {
        /// Its centre.
        centre: Vec3,
        /// Half sizes.
        half: Vec3,
        /// Angle about y, radians.
        turn: f32,
    },
    /// Upright cylinder.
    Post {
        /// Centre of its lower end.
        foot: Vec3,
        /// Its height.
        height: f32,
        /// Its radius.
        radius: f32,
    },
    /// Ellipsoid with a bumpy look: foliage, balls, cushions.
    Ball {
        /// Its centre.
        centre: Vec3,
        /// Half axes.
        radii: Vec3,
    },
}

impl Thing {
    /// Something solid.
    pub(super) fn new(form: Form, finish: Finish) -> Self {
        Self {
            form,
            finish,
            solid: true,
        }
    }

    /// Something flat on the back wall.
    pub(super) fn on_wall(centre: Vec3, half: Vec3, finish: Finish) -> Self {
        let turn = 0.0;
        Self {
            form: Form::Block { centre, half, turn },
            finish,
            solid: false,
        }
    }
}

impl Form {
    /// Whether a ray passes outside the form's bounding sphere: much cheaper than [`hit`](Self::hit), and true for most
    /// rays.
    pub(super) fn misses(&self, from: Vec3, dir: Vec3) -> bool {
        let (centre, reach2) = match *self {
            Form::Block { centre, half, .. } => (centre, half.length_squared()),
            Form::Post {
                foot,
                height,
                radius,
            } => (
                foot + Vec3::Y * (0.5 * height),
                0.25 * height * height + radius * radius,
            ),
            Form::Ball { centre, radii } => (centre, radii.max_element().powi(2)),
        };
        let to = centre - from;
        let along = to.dot(dir);
        let away = to.length_squared();
        (along < 0.0 && away > reach2) || away - along * along / dir.length_squared() > reach2
    }

    /// Nearest meeting with a ray in `1e-3..limit`, with the normal.
    pub fn hit(&self, from: Vec3, dir: Vec3, limit: f32) -> Option<(f32, Vec3)> {
        match *self {
            Form::Block { centre, half, turn } => {
                let (s, c) = turn.sin_cos();
                let spin = |v: Vec3| Vec3::new(v.x * c - v.z * s, v.y, v.z * c + v.x * s);
                let (o, d) = (spin(from - centre), spin(dir));
                let inv = d.recip();
                let (t0, t1) = ((-half - o) * inv, (half - o) * inv);
                let (lo, hi) = (t0.min(t1), t0.max(t1));
                let (near, far) = (lo.max_element(), hi.min_element());
                if near > far || near < 1e-3 || near >= limit {
                    return None;
                }
                let axis = lo.max_position();
                let mut n = Vec3::ZERO;
                n[axis] = -d[axis].signum();
                Some((near, Vec3::new(n.x * c + n.z * s, n.y, n.z * c - n.x * s)))
            }
            Form::Post {
                foot,
                height,
                radius,
            } => {
                let (ox, oz) = (from.x - foot.x, from.z - foot.z);
                let a = dir.x * dir.x + dir.z * dir.z;
                let b = ox * dir.x + oz * dir.z;
                let c = ox * ox + oz * oz - radius * radius;
                let disc = b * b - a * c;
                let mut best: Option<(f32, Vec3)> = None;
                if disc > 0.0 && a > 1e-9 {
                    let t = (-b - disc.sqrt()) / a;
                    let y = from.y + dir.y * t - foot.y;
                    if t > 1e-3 && t < limit && y > 0.0 && y < height {
                        best = Some((
                            t,
                            Vec3::new((ox + dir.x * t) / radius, 0.0, (oz + dir.z * t) / radius),
                        ));
                    }
                }
                let t = (foot.y + height - from.y) / dir.y;
                if dir.y < 0.0 && t > 1e-3 && t < best.map_or(limit, |b| b.0) {
                    let (x, z) = (ox + dir.x * t, oz + dir.z * t);
                    if x * x + z * z < radius * radius {
                        best = Some((t, Vec3::Y));
                    }
                }
                best
            }
            Form::Ball { centre, radii } => {
                let (o, d) = ((from - centre) / radii, dir / radii);
                let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
                let disc = b * b - a * c;
                if disc <= 0.0 {
                    return None;
                }
                let t = (-b - disc.sqrt()) / a;
                (t > 1e-3 && t < limit).then(|| (t, ((o + d * t) / radii).normalize_or(Vec3::Y)))
            }
        }
    }

    /// Surface coordinates in metres.
    pub(super) fn chart(&self, p: Vec3, n: Vec3) -> Vec2 {
        match *self {
            Form::Block { centre, turn, .. } => {
                let (s, c) = turn.sin_cos();
                let q = p - centre;
                let q = Vec3::new(q.x * c - q.z * s, p.y, q.z * c + q.x * s);
                let m = Vec3::new(n.x * c - n.z * s, n.y, n.z * c + n.x * s).abs();
                if m.y > 0.5 {
                    Vec2::new(q.x, q.z)
                } else if m.x > m.z {
                    Vec2::new(q.z, q.y)
                } else {
                    Vec2::new(q.x, q.y)
                }
            }
            Form::Post { foot, radius, .. } => {
                Vec2::new((p.x - foot.x).atan2(p.z - foot.z) * radius, p.y)
            }
            Form::Ball { centre, .. } => {
                let q = p - centre;
                Vec2::new(q.x + 0.6 * q.z, q.y + 0.3 * q.z)
            }
        }
    }
}

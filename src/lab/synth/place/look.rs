//! A ray goes in, what it sees of a place comes out.

use glam::{Vec2, Vec3};

use super::{Finish, Form, Place};
use crate::lab::synth::noise::{fractal, smoothstep, value};

/// What a ray meets.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// Distance in units of the ray's direction.
    pub t: f32,
    /// Surface normal towards the ray's origin.
    pub normal: Vec3,
    /// Linear colour before light.
    pub albedo: Vec3,
    /// Gives its own light: sky, windows, screens.
    pub glows: bool,
    /// Index of the thing met.
    pub thing: Option<usize>,
}

impl Place {
    /// First thing a ray meets (`solid` things only when `shadow`); always hits something unless `shadow`.
    fn nearest(
        &self,
        from: Vec3,
        dir: Vec3,
        limit: f32,
        shadow: bool,
    ) -> Option<(f32, usize, Vec3)> {
        let mut best: Option<(f32, usize, Vec3)> = None;
        for (k, thing) in self.things.iter().enumerate() {
            if (shadow && !thing.solid) || thing.form.misses(from, dir) {
                continue;
            }
            let far = best.map_or(limit, |b| b.0);
            if let Some((t, n)) = thing.form.hit(from, dir, far) {
                best = Some((t, k, n));
                if shadow {
                    break;
                }
            }
        }
        best
    }

    /// Whether something solid lies towards a light.
    pub fn shaded(&self, from: Vec3, to_light: Vec3) -> bool {
        self.nearest(from, to_light, 40.0, true).is_some()
    }

    /// What a ray sees.
    pub fn look(&self, from: Vec3, dir: Vec3) -> Hit {
        let mut hit = Hit {
            t: f32::MAX,
            normal: Vec3::Y,
            albedo: Vec3::ZERO,
            glows: false,
            thing: None,
        };
        let mut finish: Option<(&Finish, Vec2)> = None;
        let mut plane = |t: f32, n: Vec3, f: &'static dyn Fn(Vec3) -> Vec2, paint| {
            if t > 1e-3 && t < hit.t {
                hit.t = t;
                hit.normal = n;
                finish = Some((paint, f(from + dir * t)));
            }
        };
        if dir.y < 0.0 {
            plane(
                -from.y / dir.y,
                Vec3::Y,
                &|p| Vec2::new(p.x, p.z),
                &self.floor,
            );
        }
        if let Some(room) = &self.room {
            if dir.y > 0.0 {
                plane(
                    (room.height - from.y) / dir.y,
                    Vec3::NEG_Y,
                    &|p| Vec2::new(p.x, p.z),
                    &room.walls[2],
                );
            }
            if dir.z < 0.0 {
                plane(
                    (room.back - from.z) / dir.z,
                    Vec3::Z,
                    &|p| Vec2::new(p.x, p.y),
                    &room.walls[0],
                );
            }
            if let Some(front) = room.front.filter(|_| dir.z > 0.0) {
                plane(
                    (front - from.z) / dir.z,
                    Vec3::NEG_Z,
                    &|p| Vec2::new(p.x, p.y),
                    &room.walls[0],
                );
            }
            if dir.x < 0.0 {
                plane(
                    (room.sides[0] - from.x) / dir.x,
                    Vec3::X,
                    &|p| Vec2::new(p.z, p.y),
                    &room.walls[1],
                );
            }
            if dir.x > 0.0 {
                plane(
                    (room.sides[1] - from.x) / dir.x,
                    Vec3::NEG_X,
                    &|p| Vec2::new(p.z, p.y),
                    &room.walls[1],
                );
            }
        }
        if let Some((t, k, n)) = self.nearest(from, dir, hit.t, false) {
            let thing = &self.things[k];
            let p = from + dir * t;
            hit = Hit {
                t,
                normal: n,
                thing: Some(k),
                ..hit
            };
            finish = Some((&thing.finish, thing.form.chart(p, n)));
        }
        match finish {
            Some((finish, q)) => {
                let grain = if hit.t < 12.0 { self.grain } else { 0.0 };
                (hit.albedo, hit.glows) = finish.at(q, grain);
                let p = from + dir * hit.t;
                if let Some(room) = &self.room
                    && hit.thing.is_none()
                    && hit.normal.y == 0.0
                    && p.y < 0.09
                {
                    hit.albedo = room.skirting * (0.6 + 0.4 * smoothstep(0.0, 0.02, p.y));
                }
                if let Some(k) = hit.thing
                    && let Form::Ball { centre, radii } = self.things[k].form
                {
                    // leaves: bumps that break the outline's shading
                    let q = (p - centre) / radii * 5.0;
                    let seed = self.things[k].finish.seed;
                    let bump = Vec3::new(
                        value(q * 1.7, seed),
                        value(q * 1.7, seed ^ 1),
                        value(q * 1.7, seed ^ 2),
                    );
                    hit.normal =
                        (hit.normal + (bump - Vec3::splat(0.5)) * 1.6).normalize_or(Vec3::Y);
                }
                if self.room.is_none() {
                    // haze
                    let far = 1.0 - (-hit.t / 90.0).exp();
                    hit.albedo = hit.albedo.lerp(self.sky[0] * 0.8, far);
                }
                hit
            }
            None => {
                let d = dir.normalize();
                let up = d.y.max(0.0);
                let mut c = self.sky[0].lerp(self.sky[1], smoothstep(0.0, 0.5, up));
                let q = Vec3::new(d.x / (up + 0.15), d.z / (up + 0.15), 0.3) * 1.3;
                let n = smoothstep(0.45, 0.75, fractal(q, 4, self.seed));
                c = c.lerp(Vec3::splat(0.95), n * self.clouds);
                let azimuth = d.x.atan2(-d.z);
                let ridge = 0.10 * fractal(Vec3::new(azimuth * 4.0, 0.0, 0.0), 4, self.seed ^ 77);
                if d.y < ridge {
                    let tree =
                        fractal(Vec3::new(azimuth * 60.0, d.y * 60.0, 0.0), 3, self.seed ^ 5);
                    c = self.hills * (0.5 + 0.9 * tree);
                }
                Hit {
                    t: 1e4,
                    normal: Vec3::Y,
                    albedo: c,
                    glows: true,
                    thing: None,
                }
            }
        }
    }
}

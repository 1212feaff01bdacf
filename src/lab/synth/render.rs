//! A scene and everyone's stance go in, light comes out: deferred shading of rasterised people over a ray-cast place.

use glam::{Mat3, Vec2, Vec3};

use super::mesh::spot;
use super::noise::{smoothstep, value};
use super::outfit::Matter;
use super::raster::{Buffer, NOBODY, TRIANGLE_BITS};
use super::scene::{Scene, Stance};
pub use super::survey::SUPERSAMPLE;
use super::survey::{Skins, Survey, survey};
use crate::joints::{L_ANKLE, L_FOOT_TIP, PELVIS, R_ANKLE, R_FOOT_TIP};

/// The place as every sample sees it, without people: computed once for a camera that does not move.
#[derive(Debug, Clone)]
pub struct Backdrop {
    pub(super) z: Vec<f32>,
    albedo: Vec<Vec3>,
    normal: Vec<Vec3>,
    /// Share of the key light that furniture lets through; negative: the surface glows by itself.
    key: Vec<f32>,
}

/// One rendered moment, before the sensor.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Linear light of every pixel, row by row.
    pub light: Vec<Vec3>,
    /// Who is where.
    pub survey: Survey,
}

/// Sample position in pixels.
fn pixel_of(sample: usize) -> f32 {
    (sample as f32 + 0.5) / SUPERSAMPLE as f32 - 0.5
}

impl Backdrop {
    /// Looks at the place through every sample of the scene's camera.
    pub fn new(scene: &Scene) -> Self {
        let camera = &scene.camera;
        let (w, h) = (
            camera.width as usize * SUPERSAMPLE,
            camera.height as usize * SUPERSAMPLE,
        );
        let n = w * h;
        let mut out = Self {
            z: Vec::with_capacity(n),
            albedo: Vec::with_capacity(n),
            normal: Vec::with_capacity(n),
            key: Vec::with_capacity(n),
        };
        for y in 0..h {
            for x in 0..w {
                let dir = camera.ray(pixel_of(x), pixel_of(y));
                let hit = scene.place.look(camera.eye, dir);
                let key = if hit.glows {
                    -1.0
                } else {
                    let p = camera.eye + dir * hit.t + hit.normal * 0.01;
                    let lit = hit.normal.dot(scene.light.to_key) > 0.0
                        && !scene.place.shaded(p, scene.light.to_key);
                    f32::from(u8::from(lit))
                };
                out.z.push(hit.t);
                out.albedo.push(hit.albedo);
                out.normal.push(hit.normal);
                out.key.push(key);
            }
        }
        out
    }
}

/// Depth of everyone seen from the key light.
struct ShadowMap {
    axes: Mat3,
    origin: Vec2,
    scale: f32,
    buffer: Buffer,
}

const SHADOW_SIZE: usize = 640;

impl ShadowMap {
    fn new(to_light: Vec3, surfaces: &[(Vec<Vec3>, Vec<Vec3>)], triangles: &[&[[u32; 3]]]) -> Self {
        let side = to_light.any_orthonormal_vector();
        let up = to_light.cross(side);
        // rows: light-space x, y, depth away from the light; the handedness keeps front faces clockwise in the map
        let axes = Mat3::from_cols(side, -up, -to_light).transpose();
        let axes = if axes.determinant() < 0.0 {
            Mat3::from_cols(-side, -up, -to_light).transpose()
        } else {
            axes
        };
        let (mut lo, mut hi) = (Vec2::splat(f32::MAX), Vec2::splat(f32::MIN));
        for (points, _) in surfaces {
            for p in points {
                let q = (axes * *p).truncate();
                lo = lo.min(q);
                hi = hi.max(q);
            }
        }
        let span = (hi - lo).max_element().max(0.5);
        let scale = (SHADOW_SIZE - 4) as f32 / span;
        let mut map = Self {
            axes,
            origin: lo,
            scale,
            buffer: Buffer::new(SHADOW_SIZE, SHADOW_SIZE),
        };
        for (k, (points, _)) in surfaces.iter().enumerate() {
            let seen: Vec<(Vec2, f32)> = points.iter().map(|p| map.place(*p)).collect();
            map.buffer.draw(k as u32, &seen, triangles[k]);
        }
        map
    }

    /// Texel and depth; depth is offset to stay positive.
    fn place(&self, p: Vec3) -> (Vec2, f32) {
        let q = self.axes * p;
        (
            (q.truncate() - self.origin) * self.scale + Vec2::splat(2.0),
            q.z + 100.0,
        )
    }

    /// Share of the key light that reaches a point.
    fn lit(&self, p: Vec3, bias: f32, softness: f32, turn: f32) -> f32 {
        let (at, z) = self.place(p);
        let edge = SHADOW_SIZE as f32 - 1.0;
        let r = (softness * self.scale).max(0.8);
        if at.x < -r || at.y < -r || at.x > edge + r || at.y > edge + r {
            return 1.0;
        }
        // eight taps on a spiral, turned per sample so that bands become noise
        let mut sum = 0.0;
        for k in 0..8 {
            let a = turn * std::f32::consts::TAU + k as f32 * 2.399_963;
            let q = at + Vec2::from_angle(a) * r * ((k as f32 + 0.5) / 8.0).sqrt();
            let (x, y) = (q.x.round(), q.y.round());
            let free = x < 0.0
                || y < 0.0
                || x > edge
                || y > edge
                || self.buffer.z[y as usize * SHADOW_SIZE + x as usize] > z - bias;
            sum += f32::from(u8::from(free));
        }
        sum / 8.0
    }
}

/// Renders one moment.
pub fn render(scene: &Scene, backdrop: &Backdrop, stances: &[Stance]) -> Picture {
    let camera = &scene.camera;
    let (w, h) = (camera.width as usize, camera.height as usize);
    let sw = w * SUPERSAMPLE;
    let (survey, skins) = survey(scene, &backdrop.z, stances);
    let Skins {
        surfaces,
        in_camera: seen,
        triangles,
    } = skins;
    let (samples, posed) = (&survey.samples, &survey.posed);

    let shadows = ShadowMap::new(scene.light.to_key, &surfaces, &triangles);
    let feet: Vec<Vec3> = posed
        .iter()
        .flat_map(|p| [R_ANKLE, L_ANKLE, R_FOOT_TIP, L_FOOT_TIP].map(|j| p.joints[j]))
        .collect();
    let hips: Vec<Vec3> = posed.iter().map(|p| p.joints[PELVIS]).collect();
    let mut light = Vec::with_capacity(w * h);
    let share = 1.0 / (SUPERSAMPLE * SUPERSAMPLE) as f32;
    for y in 0..h {
        for x in 0..w {
            let mut sum = Vec3::ZERO;
            for sy in 0..SUPERSAMPLE {
                for sx in 0..SUPERSAMPLE {
                    let (px, py) = (x * SUPERSAMPLE + sx, y * SUPERSAMPLE + sy);
                    let at = py * sw + px;
                    let ray = camera.ray(pixel_of(px), pixel_of(py));
                    let p = camera.eye + ray * samples.z[at];
                    let turn = super::noise::lattice(px as i32, py as i32, 0, 11);
                    let who = samples.who[at];
                    let c = if who == NOBODY {
                        backdrop_light(scene, backdrop, &shadows, at, p, turn, &feet, &hips)
                    } else {
                        let k = (who >> TRIANGLE_BITS) as usize;
                        let t = triangles[k][(who & ((1 << TRIANGLE_BITS) - 1)) as usize];
                        let d = camera.axes * ray;
                        person_light(
                            scene,
                            stances[k].person,
                            t,
                            &seen[k],
                            &surfaces[k].1,
                            d,
                            p,
                            &shadows,
                            turn,
                            ray,
                        )
                    };
                    // A single glint must not outshine its pixel.
                    sum += c.min(Vec3::splat(2.0));
                }
            }
            light.push(sum * share);
        }
    }
    Picture { light, survey }
}

#[allow(clippy::too_many_arguments)] // one sample's whole context; a struct would only rename it
fn backdrop_light(
    scene: &Scene,
    backdrop: &Backdrop,
    shadows: &ShadowMap,
    at: usize,
    p: Vec3,
    turn: f32,
    feet: &[Vec3],
    hips: &[Vec3],
) -> Vec3 {
    let albedo = backdrop.albedo[at];
    if backdrop.key[at] < 0.0 {
        return albedo;
    }
    let l = &scene.light;
    let n = backdrop.normal[at];
    let up = 0.5 + 0.5 * n.y;
    let mut ambient = l.sky * up + l.ground * (1.0 - up);
    // People darken the floor beneath them.
    let mut open = 1.0;
    if n.y > 0.5 {
        for f in feet {
            let d2 = (p - *f).length_squared();
            if d2 < 0.25 {
                open *= 1.0 - 0.45 * (-d2 / 0.012).exp();
            }
        }
        for f in hips {
            let d2 = (p.x - f.x).powi(2) + (p.z - f.z).powi(2);
            if d2 < 2.0 {
                open *= 1.0 - 0.28 * (-d2 / 0.16).exp();
            }
        }
    }
    if let Some(room) = &scene.place.room {
        // corners of a room
        let near = |d: f32| 1.0 - 0.25 * (-d.abs() / 0.25).exp();
        ambient *= near(p.z - room.back) * near(p.x - room.sides[0]) * near(p.x - room.sides[1]);
        if n.y.abs() < 0.5 {
            ambient *= near(p.y);
        }
    }
    let facing = n.dot(l.to_key).max(0.0);
    let mut c = ambient * open + l.fill * n.dot(l.to_fill).max(0.0) * 0.5;
    if facing > 0.0 && backdrop.key[at] > 0.0 {
        c += l.key * facing * shadows.lit(p, 0.02, l.softness, turn);
    }
    albedo * c
}

#[allow(clippy::too_many_arguments)] // one sample's whole context; a struct would only rename it
fn person_light(
    scene: &Scene,
    person: usize,
    t: [u32; 3],
    seen: &[Vec3],
    normals: &[Vec3],
    d: Vec3,
    p: Vec3,
    shadows: &ShadowMap,
    turn: f32,
    ray: Vec3,
) -> Vec3 {
    let person = &scene.people[person];
    let [a, b, c] = t.map(|i| seen[i as usize]);
    // barycentric coordinates of the sample's ray in the triangle
    let (wa, wb, wc) = (d.dot(b.cross(c)), d.dot(c.cross(a)), d.dot(a.cross(b)));
    let sum = wa + wb + wc;
    let [wa, wb, wc] = if sum.abs() > 1e-12 {
        [wa / sum, wb / sum, wc / sum]
    } else {
        [1.0, 0.0, 0.0]
    };
    let v = t.map(|i| &person.mesh().vertices[i as usize]);
    let first = if wa >= wb && wa >= wc {
        v[0]
    } else if wb >= wc {
        v[1]
    } else {
        v[2]
    };
    let rest = v[0].rest * wa + v[1].rest * wb + v[2].rest * wc;
    let open = v[0].openness * wa + v[1].openness * wb + v[2].openness * wc;
    let mut n =
        (normals[t[0] as usize] * wa + normals[t[1] as usize] * wb + normals[t[2] as usize] * wc)
            .normalize_or(Vec3::Y);
    let s = spot(&person.shape, rest, first.bone);
    let outfit = &person.outfit;
    let matter = outfit.matter(first.matter, &s);
    let albedo = outfit.colour(matter, &s);
    let cloth = match matter {
        Matter::Top => outfit.top.folds,
        Matter::Bottom => outfit.bottom.folds,
        Matter::Hair => 0.8,
        Matter::Bag => 0.5,
        _ => 0.0,
    };
    if cloth > 0.0 {
        let seed = outfit.top.seed;
        let q = Vec3::new(rest.x * 22.0, rest.y * 11.0, rest.z * 22.0);
        let bump = |k: u32| value(q, seed ^ k) - 0.5 + 0.5 * (value(q * 2.7, seed ^ (k + 9)) - 0.5);
        n = (n + Vec3::new(bump(1), 0.6 * bump(2), bump(3)) * (1.1 * cloth)).normalize_or(n);
    }
    let l = &scene.light;
    let up = 0.5 + 0.5 * n.y;
    let open = 0.30 + 0.70 * smoothstep(0.0, 0.95, open);
    let mut light = (l.sky * up + l.ground * (1.0 - up)) * open;
    let wrap = if matter == Matter::Skin { 0.25 } else { 0.1 };
    let facing = ((n.dot(l.to_key) + wrap) / (1.0 + wrap)).max(0.0);
    if facing > 0.0 {
        light += l.key * facing * shadows.lit(p + n * 0.02, 0.03, l.softness * 0.5, turn);
    }
    light += l.fill * n.dot(l.to_fill).max(0.0) * open;
    let mut c = albedo * light;
    if matches!(matter, Matter::Skin | Matter::Hair | Matter::Shoe) {
        let half = (l.to_key - ray.normalize()).normalize_or(Vec3::Y);
        c += l.key * 0.06 * n.dot(half).max(0.0).powi(24);
    }
    c
}

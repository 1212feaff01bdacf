//! A surface's pattern: coordinates go in, a colour comes out.

use glam::{Vec2, Vec3};

use super::{Finish, Paint};
use crate::lab::synth::noise::{fractal, lattice, smoothstep, value};

impl Finish {
    /// Linear colour at surface coordinates in metres; the flag says that it gives its own light.
    pub(super) fn at(&self, q: Vec2, grain: f32) -> (Vec3, bool) {
        let seed = self.seed;
        let p3 = Vec3::new(q.x, q.y, 0.0);
        let stain = 0.90 + 0.2 * fractal(p3 * 1.3, 3, seed);
        let fine = 1.0 + grain * (value(p3 * 90.0, seed) - 0.5);
        let edge = |x: f32, w: f32| {
            let f = x - x.floor();
            smoothstep(0.0, w, f.min(1.0 - f))
        };
        let cell = |x: f32, y: f32, k: i32| lattice(x.floor() as i32, y.floor() as i32, k, seed);
        let colour = match self.paint {
            Paint::Plaster => self.a * stain,
            Paint::Planks(w) => {
                let row = q.y / w;
                let x = q.x / (w * 9.0) + 7.3 * cell(0.0, row, 1);
                let tone = 0.7 + 0.6 * cell(x, row, 2);
                let vein = fractal(
                    Vec3::new(q.x * 3.0, q.y * 60.0, cell(x, row, 3) * 50.0),
                    2,
                    seed,
                );
                let joint = edge(row, 0.04) * edge(x, 0.006);
                self.a.lerp(self.b, 0.55 * vein) * tone * (0.45 + 0.55 * joint)
            }
            Paint::Tiles(w) | Paint::Chequers(w) => {
                let t = q / w;
                let odd = (t.x.floor() as i32 + t.y.floor() as i32) & 1 == 1;
                let joint = edge(t.x, 0.03) * edge(t.y, 0.03);
                let ground = if matches!(self.paint, Paint::Chequers(_)) && odd {
                    self.b
                } else {
                    self.a
                };
                ground * (0.9 + 0.2 * cell(t.x, t.y, 4)) * stain * (0.6 + 0.4 * joint)
            }
            Paint::Bricks(h) => {
                let row = q.y / h;
                let x = q.x / (h * 2.9) + 0.5 * (row.floor().rem_euclid(2.0));
                let joint = edge(row, 0.07) * edge(x, 0.03);
                let brick = self.a * (0.7 + 0.6 * cell(x, row, 5));
                (self.b * 0.5 + Vec3::splat(0.15)).lerp(brick, joint) * stain
            }
            Paint::Rough(s) => {
                let n = fractal(p3 / s, 3, seed);
                let patch = fractal(p3 * 0.7, 3, seed ^ 9);
                self.a
                    .lerp(self.b, smoothstep(0.35, 0.7, 0.6 * n + 0.4 * patch))
                    * (0.65 + 0.7 * n)
            }
            Paint::Bands(w) => {
                self.a
                    .lerp(self.b, smoothstep(0.45, 0.55, (q.x / w).fract().abs()))
                    * stain
            }
            Paint::Blotches(s) => {
                let n = fractal(p3 / s, 4, seed);
                self.a.lerp(self.b, smoothstep(0.42, 0.58, n))
                    * (0.6 + 0.8 * fractal(p3 / s * 3.0, 2, seed ^ 5))
            }
            Paint::Facade(w) => {
                let t = Vec2::new(q.x / w, q.y / (w * 1.25));
                let f = t - t.floor();
                let pane = f.x > 0.25 && f.x < 0.75 && f.y > 0.25 && f.y < 0.8;
                if pane {
                    let lit = cell(t.x, t.y, 6);
                    Vec3::new(0.10, 0.13, 0.17) * (0.4 + 1.8 * lit) * (0.7 + 0.6 * f.y)
                } else {
                    self.a * stain * (0.85 + 0.3 * cell(0.0, t.y, 7))
                }
            }
            Paint::Shelves => {
                let row = q.y / 0.33;
                let f = row - row.floor();
                if f < 0.09 {
                    self.a * 0.8
                } else {
                    let width = 0.03 + 0.03 * cell(0.0, row, 8);
                    let k = q.x / width + 3.0 * cell(0.0, row, 12);
                    let tall = 0.55 + 0.4 * cell(k, row, 9);
                    if f > tall {
                        self.a * 0.12
                    } else {
                        let h = cell(k, row, 10);
                        let g = cell(k, row, 11);
                        Vec3::new(h, (h * 3.7 + g).fract(), g) * 0.5 * (0.5 + 0.5 * edge(k, 0.12))
                    }
                }
            }
            Paint::Collage(s) => {
                let mut c = self.a * stain;
                for (k, scale) in [(20, 1.0), (30, 0.5), (40, 0.27)] {
                    let t = q / (s * scale) + Vec2::splat(0.37 * k as f32);
                    let f = t - t.floor();
                    let r = |n: i32| cell(t.x, t.y, k + n);
                    let lo = Vec2::new(0.4 * r(0), 0.4 * r(1));
                    let hi = Vec2::new(0.6 + 0.4 * r(2), 0.6 + 0.4 * r(3));
                    if r(4) < 0.3 && f.cmpgt(lo).all() && f.cmplt(hi).all() {
                        let tint = Vec3::splat(r(5)).lerp(Vec3::new(r(5), r(6), r(7)), r(8));
                        c = self.b.lerp(tint * tint, 0.7)
                            * (0.5 + fractal(p3 / (0.15 * s), 2, seed ^ 3));
                    }
                }
                c
            }
            Paint::Window => {
                let f = q - q.floor();
                let bar = (f.x - 0.5).abs() < 0.03
                    || (f.y - 0.5).abs() < 0.03
                    || f.min_element() < 0.05
                    || f.max_element() > 0.95;
                if bar {
                    return (self.b, false);
                }
                let n = fractal(Vec3::new(q.x * 3.0, q.y * 3.0, 1.0), 3, seed);
                let tree = smoothstep(0.1, -0.1, f.y - 0.25 - 0.5 * n);
                return (
                    (self.a * 1.3).lerp(Vec3::new(0.10, 0.17, 0.06), tree * 0.8),
                    true,
                );
            }
        };
        (colour * fine, false)
    }
}

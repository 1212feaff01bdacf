//! Where a scene plays: chance goes in, a procedural room or outdoor place comes out, which answers rays.

use glam::{Vec2, Vec3};

use super::noise::{Dice, fractal, lattice, smoothstep, value};
use super::outfit::linear;

/// How a surface is painted; colours are linear RGB.
#[derive(Debug, Clone, Copy)]
pub enum Paint {
    /// One colour with faint stains.
    Plaster,
    /// Boards of this width in metres.
    Planks(f32),
    /// Square tiles of this size with joints.
    Tiles(f32),
    /// Tiles of two colours.
    Chequers(f32),
    /// Bricks of this height.
    Bricks(f32),
    /// Coarse noise of this size: carpet, gravel, lawn, asphalt.
    Rough(f32),
    /// Vertical bands of this width.
    Bands(f32),
    /// Large blotches: murals, foliage.
    Blotches(f32),
    /// Windows of this width in a facade.
    Facade(f32),
    /// Shelves full of books and boxes.
    Shelves,
    /// Random rectangles of many colours: posters, screens, shop fronts.
    Collage(f32),
    /// A bright window with panes.
    Window,
}

/// Paint with its colours.
#[derive(Debug, Clone, Copy)]
pub struct Finish {
    /// The pattern.
    pub paint: Paint,
    /// First colour.
    pub a: Vec3,
    /// Second colour.
    pub b: Vec3,
    /// Seed of its noise.
    pub seed: u32,
}

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

/// A whole place: floor, optional walls, things, sky.
#[derive(Debug, Clone)]
pub struct Place {
    /// The floor y = 0.
    pub floor: Finish,
    /// Indoors: x of the left and right wall, z of the back wall, height of the ceiling.
    pub room: Option<Room>,
    /// Furniture, trees, houses.
    pub things: Vec<Thing>,
    /// Sky colours: horizon, zenith.
    pub sky: [Vec3; 2],
    /// Strength of the finest texture; costs bytes in compressed clips.
    pub grain: f32,
    /// Strength of clouds.
    pub clouds: f32,
    /// Colour of far hills.
    pub hills: Vec3,
    /// Seed of its noise.
    pub seed: u32,
}

/// Walls.
#[derive(Debug, Clone, Copy)]
pub struct Room {
    /// Left and right wall.
    pub sides: [f32; 2],
    /// Back wall.
    pub back: f32,
    /// Ceiling.
    pub height: f32,
    /// Back, side walls, ceiling.
    pub walls: [Finish; 3],
    /// Skirting board colour.
    pub skirting: Vec3,
}

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

fn hue(dice: &mut Dice, saturation: f32, lo: f32, hi: f32) -> Vec3 {
    let (h, s, v) = (
        dice.unit() * 6.0,
        saturation * dice.unit(),
        dice.range(lo, hi),
    );
    let k = |n: f32| {
        let k = (n + h) % 6.0;
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    linear(Vec3::new(k(5.0), k(3.0), k(1.0)))
}

impl Finish {
    fn new(paint: Paint, a: Vec3, b: Vec3, dice: &mut Dice) -> Self {
        Self {
            paint,
            a,
            b,
            seed: dice.bits() as u32,
        }
    }

    fn wood(dice: &mut Dice) -> Self {
        let v = dice.range(0.25, 0.85);
        let a = linear(Vec3::new(
            v,
            v * dice.range(0.66, 0.85),
            v * dice.range(0.4, 0.68),
        ));
        let width = dice.range(0.07, 0.2);
        Self::new(Paint::Planks(width), a, a * dice.range(0.5, 0.85), dice)
    }

    fn wall(dice: &mut Dice) -> Self {
        let a = if dice.chance(0.65) {
            hue(dice, 0.18, 0.55, 0.95)
        } else {
            hue(dice, 0.55, 0.25, 0.85)
        };
        let b = a * dice.range(0.55, 0.95);
        let paint = match dice.below(14) {
            0..=6 => Paint::Plaster,
            7 => Paint::Bands(dice.range(0.08, 0.5)),
            8 | 9 => Paint::Bricks(dice.range(0.07, 0.25)),
            10 => Paint::Tiles(dice.range(0.15, 0.6)),
            11 => Paint::Planks(dice.range(0.1, 0.3)),
            12 => Paint::Collage(dice.range(1.2, 3.0)),
            _ => Paint::Blotches(dice.range(0.3, 1.2)),
        };
        if matches!(paint, Paint::Collage(_) | Paint::Blotches(_)) {
            let b = hue(dice, 0.7, 0.15, 0.9);
            return Self::new(paint, a, b, dice);
        }
        Self::new(paint, a, b, dice)
    }

    fn object(dice: &mut Dice) -> Self {
        if dice.chance(0.4) {
            return Self::wood(dice);
        }
        let a = if dice.chance(0.5) {
            hue(dice, 0.2, 0.08, 0.9)
        } else {
            hue(dice, 0.8, 0.2, 0.8)
        };
        let b = hue(dice, 0.6, 0.1, 0.9);
        let paint = match dice.below(12) {
            0..=5 => Paint::Plaster,
            6 => Paint::Bands(dice.range(0.04, 0.2)),
            7 => Paint::Tiles(dice.range(0.1, 0.4)),
            8 => Paint::Collage(dice.range(0.15, 0.7)),
            9 => Paint::Shelves,
            10 => Paint::Rough(dice.range(0.01, 0.06)),
            _ => Paint::Blotches(dice.range(0.08, 0.4)),
        };
        Self::new(paint, a, b, dice)
    }

    /// Linear colour at surface coordinates in metres; the flag says that it gives its own light.
    fn at(&self, q: Vec2, grain: f32) -> (Vec3, bool) {
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

impl Place {
    /// A random place for people who stand `near` metres in front of a camera at `eye`.
    pub fn random(dice: &mut Dice, eye: Vec3, near: f32) -> Self {
        if dice.chance(0.6) {
            Self::indoors(dice, eye, near)
        } else {
            Self::outdoors(dice, near)
        }
    }

    /// A room with furniture along its walls, the back wall behind `near`.
    pub fn indoors(dice: &mut Dice, eye: Vec3, near: f32) -> Self {
        let back = -near - dice.range(0.8, 5.0);
        let wide = if dice.chance(0.7) { 0.75 * near } else { 0.0 };
        let left = -dice.range(2.0, 6.0).max(wide);
        let right = dice.range(2.0, 6.0).max(wide);
        let height = dice.range(2.4, 4.2).max(eye.y + 0.3);
        let floor = match dice.below(6) {
            0 | 1 => Finish::wood(dice),
            2 => {
                let a = hue(dice, 0.15, 0.4, 0.9);
                let w = dice.range(0.25, 0.8);
                Finish::new(Paint::Tiles(w), a, a * 0.6, dice)
            }
            3 => {
                let (a, b) = (hue(dice, 0.3, 0.1, 0.9), hue(dice, 0.3, 0.1, 0.9));
                let w = dice.range(0.25, 0.6);
                Finish::new(Paint::Chequers(w), a, b, dice)
            }
            4 => {
                let a = hue(dice, 0.6, 0.15, 0.7);
                let s = dice.range(0.01, 0.04);
                Finish::new(Paint::Rough(s), a, a * 0.8, dice)
            }
            _ => {
                let a = hue(dice, 0.1, 0.3, 0.75);
                Finish::new(Paint::Plaster, a, a, dice)
            }
        };
        let wall = Finish::wall(dice);
        let side = if dice.chance(0.6) {
            wall
        } else {
            Finish::wall(dice)
        };
        let ceiling = Finish::new(
            Paint::Plaster,
            Vec3::splat(dice.range(0.5, 0.85)),
            Vec3::ONE,
            dice,
        );
        let mut things = Vec::new();
        let free = |dice: &mut Dice, near_wall: f32| {
            let x = dice.range(left, right);
            Vec3::new(x, 0.0, back + near_wall)
        };
        // windows, pictures and doors on the walls
        for _ in 0..dice.below(5) {
            let w = dice.range(0.25, 1.1);
            let h = dice.range(0.25, 0.9);
            let window = dice.chance(0.35);
            let centre = Vec3::new(dice.range(left, right), dice.range(1.2, 2.0), back + 0.01);
            let finish = if window {
                let a = Vec3::new(0.7, 0.85, 1.0) * dice.range(0.6, 1.2);
                Finish::new(Paint::Window, a, Vec3::splat(dice.range(0.1, 0.8)), dice)
            } else {
                let (a, b) = (hue(dice, 0.7, 0.1, 0.9), hue(dice, 0.7, 0.1, 0.9));
                let s = dice.range(0.2, 0.6);
                let paint = if dice.chance(0.5) {
                    Paint::Collage(s)
                } else {
                    Paint::Blotches(s)
                };
                Finish::new(paint, a, b, dice)
            };
            things.push(Thing {
                form: Form::Block {
                    centre,
                    half: Vec3::new(w, h, 0.02),
                    turn: 0.0,
                },
                finish,
                solid: false,
            });
        }
        if dice.chance(0.4) {
            let finish = Finish::object(dice);
            let x = dice.range(left + 0.5, right - 0.5);
            things.push(Thing {
                form: Form::Block {
                    centre: Vec3::new(x, 1.02, back),
                    half: Vec3::new(0.45, 1.02, 0.04),
                    turn: 0.0,
                },
                finish,
                solid: false,
            });
        }
        // cupboards, shelves, sofas, tables, plants near the walls
        for _ in 0..dice.below(7) {
            let along_side = dice.chance(0.6);
            let deep = dice.range(0.15, 0.45);
            let foot = if along_side {
                let x = if dice.chance(0.5) {
                    left + deep
                } else {
                    right - deep
                };
                Vec3::new(x, 0.0, dice.range(back, -1.8))
            } else {
                free(dice, deep)
            };
            Self::furnish(&mut things, dice, foot);
        }
        Self {
            floor,
            room: Some(Room {
                sides: [left, right],
                back,
                height,
                walls: [wall, side, ceiling],
                skirting: if dice.chance(0.5) {
                    Vec3::splat(0.8)
                } else {
                    Finish::wood(dice).a
                },
            }),
            things,
            sky: [Vec3::ONE; 2],
            grain: 0.12,
            clouds: 0.0,
            hills: Vec3::ONE,
            seed: dice.bits() as u32,
        }
    }

    /// Adds one piece of furniture.
    pub fn furnish(things: &mut Vec<Thing>, dice: &mut Dice, foot: Vec3) {
        let turn = if dice.chance(0.6) {
            0.0
        } else {
            dice.range(-0.6, 0.6)
        };
        let mut block = |offset: Vec3, half: Vec3, finish: Finish| {
            let spun = Vec3::new(
                offset.x * turn.cos() + offset.z * turn.sin(),
                offset.y,
                offset.z * turn.cos() - offset.x * turn.sin(),
            );
            things.push(Thing {
                form: Form::Block {
                    centre: foot + spun,
                    half,
                    turn,
                },
                finish,
                solid: true,
            });
        };
        match dice.below(7) {
            0 | 1 => {
                // cupboard or shelf
                let half = Vec3::new(
                    dice.range(0.25, 0.7),
                    dice.range(0.3, 1.05),
                    dice.range(0.15, 0.32),
                );
                let finish = Finish::object(dice);
                block(Vec3::Y * half.y, half, finish);
            }
            2 | 3 => {
                // table
                let (w, d, h) = (
                    dice.range(0.35, 0.9),
                    dice.range(0.25, 0.45),
                    dice.range(0.42, 0.9),
                );
                let top = Finish::object(dice);
                let leg = Finish::object(dice);
                block(Vec3::Y * h, Vec3::new(w, 0.02, d), top);
                for (sx, sz) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
                    let at = Vec3::new(sx * (w - 0.05), 0.5 * h, sz * (d - 0.05));
                    block(at, Vec3::new(0.025, 0.5 * h, 0.025), leg);
                }
                if dice.chance(0.5) {
                    let finish = Finish::object(dice);
                    let s = dice.range(0.05, 0.16);
                    let x = dice.range(-0.6, 0.6) * w;
                    block(Vec3::new(x, h + s, 0.0), Vec3::new(s, s, 0.6 * s), finish);
                }
            }
            4 => {
                // sofa
                let w = dice.range(0.4, 1.0);
                let f = Finish::object(dice);
                block(Vec3::new(0.0, 0.21, 0.0), Vec3::new(w, 0.21, 0.4), f);
                block(Vec3::new(0.0, 0.42, -0.32), Vec3::new(w, 0.42, 0.1), f);
                block(Vec3::new(-w, 0.3, 0.0), Vec3::new(0.09, 0.3, 0.4), f);
                block(Vec3::new(w, 0.3, 0.0), Vec3::new(0.09, 0.3, 0.4), f);
            }
            5 => {
                // plant
                let finish = Finish::object(dice);
                things.push(Thing {
                    form: Form::Post {
                        foot,
                        height: 0.35,
                        radius: dice.range(0.12, 0.2),
                    },
                    finish,
                    solid: true,
                });
                let h = dice.range(0.6, 1.5);
                let green = linear(Vec3::new(
                    dice.range(0.1, 0.4),
                    dice.range(0.3, 0.6),
                    dice.range(0.05, 0.3),
                ));
                for _ in 0..4 {
                    let c = foot
                        + Vec3::new(
                            dice.range(-0.2, 0.2),
                            h * dice.range(0.5, 1.0),
                            dice.range(-0.2, 0.2),
                        );
                    let r = Vec3::new(
                        dice.range(0.12, 0.3),
                        dice.range(0.15, 0.35),
                        dice.range(0.12, 0.3),
                    );
                    let finish = Finish::new(Paint::Blotches(0.05), green, green * 0.3, dice);
                    things.push(Thing {
                        form: Form::Ball {
                            centre: c,
                            radii: r,
                        },
                        finish,
                        solid: true,
                    });
                }
            }
            _ => {
                // pillar, lamp, bin
                let finish = Finish::object(dice);
                let (height, radius) =
                    dice.pick(&[(2.5, 0.16), (1.6, 0.03), (0.7, 0.2), (1.1, 0.05)]);
                things.push(Thing {
                    form: Form::Post {
                        foot,
                        height,
                        radius,
                    },
                    finish,
                    solid: true,
                });
            }
        }
    }

    /// Open air: ground, sky, trees or houses, mostly behind `near`.
    pub fn outdoors(dice: &mut Dice, near: f32) -> Self {
        let green = |dice: &mut Dice| {
            linear(Vec3::new(
                dice.range(0.15, 0.5),
                dice.range(0.32, 0.6),
                dice.range(0.08, 0.3),
            ))
        };
        let floor = match dice.below(6) {
            0 | 1 => {
                let a = green(dice);
                let s = dice.range(0.02, 0.12);
                Finish::new(Paint::Rough(s), a, a * 0.5, dice)
            }
            2 => {
                let a = Vec3::splat(dice.range(0.05, 0.3));
                Finish::new(Paint::Rough(0.02), a, a * 0.75, dice)
            }
            3 => {
                let a = hue(dice, 0.25, 0.4, 0.8);
                let s = dice.range(0.2, 1.2);
                Finish::new(Paint::Tiles(s), a, a, dice)
            }
            4 => {
                let a = linear(Vec3::new(0.78, 0.7, 0.55)) * dice.range(0.5, 1.1);
                Finish::new(Paint::Rough(0.08), a, a * 0.7, dice)
            }
            _ => {
                let a = hue(dice, 0.7, 0.3, 0.7);
                Finish::new(Paint::Plaster, a, a, dice)
            }
        };
        let mut things = Vec::new();
        let far = near * 1.5 + dice.range(4.0, 25.0);
        if dice.chance(0.5) {
            // a row of houses
            let mut x = -30.0;
            while x < 30.0 {
                let w = dice.range(2.0, 6.0);
                let h = dice.range(2.0, 8.0);
                let a = hue(dice, 0.4, 0.3, 0.85);
                let paint = match dice.below(4) {
                    0 => Paint::Bricks(0.2),
                    1 => Paint::Collage(1.5),
                    _ => Paint::Facade(dice.range(1.0, 2.2)),
                };
                let finish = Finish::new(paint, a, a * 0.6, dice);
                let z = -far - dice.range(0.0, 6.0);
                things.push(Thing {
                    form: Form::Block {
                        centre: Vec3::new(x + w, h, z - 3.0),
                        half: Vec3::new(w, h, 3.0),
                        turn: 0.0,
                    },
                    finish,
                    solid: true,
                });
                x += 2.0 * w + dice.range(-0.5, 3.0);
            }
        }
        for _ in 0..dice.below(9) {
            // trees and bushes
            let z = -near * dice.range(0.8, 1.2) - dice.range(1.0, 18.0);
            let foot = Vec3::new(dice.range(-0.9, 0.9) * z.abs(), 0.0, z);
            let leaf = green(dice);
            if dice.chance(0.7) {
                let h = dice.range(1.5, 3.5);
                let bark = linear(Vec3::new(0.35, 0.27, 0.2)) * dice.range(0.5, 1.4);
                let radius = dice.range(0.06, 0.25);
                let finish = Finish::new(Paint::Rough(0.05), bark, bark * 0.4, dice);
                things.push(Thing {
                    form: Form::Post {
                        foot,
                        height: h + 1.0,
                        radius,
                    },
                    finish,
                    solid: true,
                });
                for _ in 0..6 {
                    let r = dice.range(0.6, 1.6);
                    let c = foot
                        + Vec3::new(
                            dice.range(-1.2, 1.2),
                            h + dice.range(0.3, 2.5),
                            dice.range(-1.0, 1.0),
                        );
                    let finish = Finish::new(Paint::Blotches(0.3), leaf, leaf * 0.15, dice);
                    things.push(Thing {
                        form: Form::Ball {
                            centre: c,
                            radii: Vec3::new(r, 0.8 * r, r),
                        },
                        finish,
                        solid: true,
                    });
                }
            } else {
                for _ in 0..4 {
                    let r = dice.range(0.3, 0.8);
                    let c = foot + Vec3::new(dice.range(-1.0, 1.0), 0.6 * r, dice.range(-0.4, 0.4));
                    let finish = Finish::new(Paint::Blotches(0.12), leaf, leaf * 0.2, dice);
                    things.push(Thing {
                        form: Form::Ball {
                            centre: c,
                            radii: Vec3::splat(r),
                        },
                        finish,
                        solid: true,
                    });
                }
            }
        }
        if dice.chance(0.35) {
            // fence or wall
            let finish = Finish::wall(dice);
            let h = dice.range(0.4, 1.2);
            let z = -near - dice.range(1.5, 8.0);
            things.push(Thing {
                form: Form::Block {
                    centre: Vec3::new(0.0, h, z),
                    half: Vec3::new(20.0, h, 0.1),
                    turn: dice.range(-0.2, 0.2),
                },
                finish,
                solid: true,
            });
        }
        for _ in 0..dice.below(3) {
            let z = -near - dice.range(0.3, 6.0);
            let foot = Vec3::new(dice.range(-0.6, 0.6) * z.abs(), 0.0, z);
            Self::furnish(&mut things, dice, foot);
        }
        let blue = dice.unit();
        let horizon =
            Vec3::new(0.80, 0.85, 0.90).lerp(Vec3::new(0.95, 0.85, 0.75), dice.unit() * 0.4);
        Self {
            floor,
            room: None,
            things,
            sky: [
                horizon,
                Vec3::new(0.55, 0.6, 0.65).lerp(Vec3::new(0.12, 0.28, 0.65), blue),
            ],
            grain: 0.12,
            clouds: dice.unit(),
            hills: green(dice).lerp(Vec3::new(0.4, 0.5, 0.6), dice.range(0.2, 0.8)),
            seed: dice.bits() as u32,
        }
    }

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

impl Form {
    /// Whether a ray passes outside the form's bounding sphere: much cheaper than [`hit`](Self::hit), and true for most rays.
    fn misses(&self, from: Vec3, dir: Vec3) -> bool {
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
    fn chart(&self, p: Vec3, n: Vec3) -> Vec2 {
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

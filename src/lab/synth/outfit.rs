//! What a person wears and how skin and cloth are coloured: chance goes in, garments and a colour at every point of the
//! rest pose come out.

use glam::{Vec2, Vec3};

use super::noise::{Dice, fractal, smoothstep, value};

/// Substance of a surface point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
#[allow(missing_docs)]
pub enum Matter {
    #[default]
    Skin,
    Top,
    Bottom,
    Shoe,
    Hair,
    Hat,
    Bag,
}

/// How a garment is printed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Print {
    /// One colour.
    Plain,
    /// Bands across a direction, this many a metre.
    Stripes(Vec3, f32),
    /// Squares, this many a metre.
    Checks(f32),
    /// Blotches of this size in metres.
    Mottled(f32),
    /// Dots, this many a metre.
    Dots(f32),
    /// A badge on the chest (tops) or a line along the leg (bottoms).
    Badge,
    /// The upper part in the second colour.
    Halves,
}

/// Colours of one garment; all colours are linear RGB, 0–1.
#[derive(Debug, Clone, Copy)]
pub struct Cloth {
    /// Ground colour.
    pub colour: Vec3,
    /// Colour of the print.
    pub second: Vec3,
    /// The print.
    pub print: Print,
    /// Strength of folds, 0–1.
    pub folds: f32,
    /// Seed of its noise.
    pub seed: u32,
}

/// Length of hair and what is over it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Hair {
    Bald,
    Short,
    Full,
    Bob,
    Long,
    Ponytail,
    Bun,
    Afro,
    Cap,
    Beanie,
}

/// Everything a person wears. Lengths along limbs: 0 at the shoulder or hip, 1 at elbow or knee, 2 at wrist or ankle.
#[derive(Debug, Clone)]
pub struct Outfit {
    /// Skin colour.
    pub skin: Vec3,
    /// Hair colour.
    pub hair_colour: Vec3,
    /// Hair style.
    pub hair: Hair,
    /// Beard strength, 0–1.
    pub beard: f32,
    /// Glasses.
    pub glasses: bool,
    /// End of the sleeves; negative: no sleeves.
    pub sleeve: f32,
    /// End of the trousers.
    pub trouser: f32,
    /// Height of the top's hem, fraction of stature.
    pub hem: f32,
    /// Height of the collar, fraction of stature.
    pub collar: f32,
    /// End of a skirt along the leg, if worn.
    pub skirt: Option<f32>,
    /// The top and the bottom (and skirt) are one piece.
    pub one_piece: bool,
    /// Bare upper body.
    pub bare_chest: bool,
    /// An open jacket shows a shirt of this colour in front.
    pub open_front: Option<Vec3>,
    /// Looseness of the top, metres.
    pub top_ease: f32,
    /// Looseness of the bottom, metres.
    pub bottom_ease: f32,
    /// Trousers widen (positive) or narrow downwards.
    pub flare: f32,
    /// Feet: end of socks along the leg (2: none).
    pub sock: f32,
    /// Sock colour.
    pub sock_colour: Vec3,
    /// A rucksack.
    pub bag: bool,
    /// The top.
    pub top: Cloth,
    /// The bottom.
    pub bottom: Cloth,
    /// Shoes.
    pub shoe: Cloth,
    /// Hat or bag.
    pub extra: Cloth,
}

/// Hue, saturation, value to linear RGB.
fn hsv(h: f32, s: f32, v: f32) -> Vec3 {
    let k = |n: f32| {
        let k = (n + h.rem_euclid(1.0) * 6.0) % 6.0;
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    linear(Vec3::new(k(5.0), k(3.0), k(1.0)))
}

/// Display value (gamma 2.2) to linear light.
pub(super) fn linear(c: Vec3) -> Vec3 {
    Vec3::new(c.x.powf(2.2), c.y.powf(2.2), c.z.powf(2.2))
}

impl Cloth {
    /// A random garment: mostly dull, dark or white, saturated colours the exception.
    pub fn random(dice: &mut Dice) -> Self {
        let paint = |dice: &mut Dice| match dice.below(10) {
            0 | 1 => hsv(dice.unit(), dice.range(0.0, 0.3), dice.range(0.06, 0.22)),
            2 | 3 => hsv(dice.unit(), dice.range(0.0, 0.12), dice.range(0.75, 0.97)),
            4..=6 => hsv(dice.unit(), dice.range(0.1, 0.45), dice.range(0.25, 0.8)),
            _ => hsv(dice.unit(), dice.range(0.5, 0.9), dice.range(0.25, 0.75)),
        };
        let colour = paint(dice);
        let second = paint(dice);
        let print = match dice.below(20) {
            0..=9 => Print::Plain,
            10 | 11 => Print::Stripes(Vec3::Y, dice.range(6.0, 26.0)),
            12 => Print::Stripes(Vec3::X, dice.range(8.0, 26.0)),
            13 => Print::Checks(dice.range(5.0, 16.0)),
            14 => Print::Mottled(dice.range(0.02, 0.12)),
            15 => Print::Dots(dice.range(10.0, 24.0)),
            16 => Print::Halves,
            _ => Print::Badge,
        };
        Self {
            colour,
            second,
            print,
            folds: dice.range(0.2, 1.0),
            seed: dice.bits() as u32,
        }
    }

    /// Colour at a rest-pose point.
    fn at(&self, p: Vec3) -> Vec3 {
        let shade = 0.9 + 0.2 * value(p * 60.0, self.seed);
        let on = match self.print {
            Print::Plain => 0.0,
            Print::Stripes(axis, n) => smoothstep(
                -0.25,
                0.25,
                (p.dot(axis) * n * std::f32::consts::TAU).sin() - 0.2,
            ),
            Print::Checks(n) => {
                let band = |x: f32| smoothstep(-0.2, 0.2, (x * n * std::f32::consts::TAU).sin());
                0.5 * (band(p.x + 0.5 * p.z) + band(p.y))
            }
            Print::Mottled(size) => smoothstep(0.45, 0.55, fractal(p / size, 2, self.seed)),
            Print::Dots(n) => {
                let q = Vec2::new(p.x + 0.6 * p.z, p.y) * n;
                let d = (q - q.floor() - Vec2::splat(0.5)).length();
                1.0 - smoothstep(0.18, 0.3, d)
            }
            Print::Badge | Print::Halves => 0.0,
        };
        self.colour.lerp(self.second, on) * shade
    }
}

/// A rest-pose point described for [`Outfit::colour`], all lengths as fractions of stature.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    /// Rest position, metres.
    pub p: Vec3,
    /// Rest position over the proportion unit, heights as in the proportion tables.
    pub table: Vec3,
    /// Along the arm (0 shoulder, 1 elbow, 2 wrist), if the point is on an arm.
    pub arm: Option<f32>,
    /// Along the leg (0 hip, 1 knee, 2 ankle), if the point is on a leg.
    pub leg: Option<f32>,
    /// The point belongs to the head bone.
    pub head: bool,
}

impl Outfit {
    /// Random clothes for a person.
    pub fn random(feminine: f32, dice: &mut Dice) -> Self {
        let tone = dice.unit().powf(1.2);
        let skin = linear(Vec3::new(0.87, 0.69, 0.59).lerp(Vec3::new(0.30, 0.19, 0.13), tone))
            * Vec3::new(1.0, dice.range(0.94, 1.06), dice.range(0.88, 1.08));
        let hair_colour = if dice.chance(0.16) {
            hsv(0.1, 0.06, dice.range(0.45, 0.9))
        } else if tone < 0.45 && dice.chance(0.5) {
            hsv(
                dice.range(0.04, 0.11),
                dice.range(0.4, 0.7),
                dice.range(0.2, 0.75),
            )
        } else {
            hsv(
                dice.range(0.02, 0.1),
                dice.range(0.1, 0.5),
                dice.range(0.05, 0.25),
            )
        };
        let hair = if feminine > 0.5 {
            dice.pick(&[
                Hair::Long,
                Hair::Long,
                Hair::Long,
                Hair::Bob,
                Hair::Bob,
                Hair::Ponytail,
                Hair::Ponytail,
                Hair::Bun,
                Hair::Full,
                Hair::Short,
                Hair::Cap,
                Hair::Afro,
                Hair::Beanie,
            ])
        } else {
            dice.pick(&[
                Hair::Short,
                Hair::Short,
                Hair::Short,
                Hair::Short,
                Hair::Full,
                Hair::Full,
                Hair::Bald,
                Hair::Cap,
                Hair::Beanie,
                Hair::Afro,
                Hair::Bob,
            ])
        };
        let mut top = Cloth::random(dice);
        let mut bottom = Cloth::random(dice);
        if dice.chance(0.35) {
            // jeans
            bottom.colour = hsv(
                dice.range(0.57, 0.64),
                dice.range(0.3, 0.7),
                dice.range(0.15, 0.6),
            );
            bottom.print = Print::Plain;
        } else if dice.chance(0.6) {
            bottom.print = Print::Plain;
        }
        let one_piece = dice.chance(0.12);
        if one_piece {
            bottom = top;
        }
        let bare_chest = feminine < 0.5 && dice.chance(0.06);
        let sport = dice.chance(0.3);
        if sport && dice.chance(0.5) {
            top.print = dice.pick(&[Print::Badge, Print::Halves, Print::Stripes(Vec3::Y, 9.0)]);
        }
        let sleeve = if dice.chance(if feminine > 0.5 { 0.25 } else { 0.1 }) {
            -1.0
        } else if sport || dice.chance(0.45) {
            dice.range(0.4, 0.95)
        } else {
            dice.range(1.5, 2.02)
        };
        let skirt = (feminine > 0.5 && dice.chance(0.3)).then(|| dice.range(0.45, 1.75));
        let trouser = if skirt.is_some() {
            if dice.chance(0.4) { 2.0 } else { 0.2 }
        } else if sport && dice.chance(0.7) {
            dice.range(0.25, 1.0)
        } else if dice.chance(0.15) {
            dice.range(0.5, 1.2)
        } else {
            dice.range(1.75, 2.06)
        };
        let loose = dice.unit() * dice.unit();
        let tucked = dice.chance(0.35) || skirt.is_some();
        Self {
            skin,
            hair_colour,
            hair,
            beard: if feminine < 0.5 && dice.chance(0.35) {
                dice.range(0.3, 0.9)
            } else {
                0.0
            },
            glasses: dice.chance(0.18),
            sleeve,
            trouser,
            hem: if tucked {
                dice.range(0.575, 0.60)
            } else {
                dice.range(0.47, 0.555)
            },
            collar: dice.range(0.815, 0.845),
            skirt,
            one_piece,
            bare_chest,
            open_front: (sleeve > 1.4 && dice.chance(0.3)).then(|| Cloth::random(dice).colour),
            top_ease: 0.004 + 0.024 * dice.unit() * dice.unit(),
            bottom_ease: 0.003 + 0.022 * loose,
            flare: dice.range(-0.2, 0.8) * loose,
            sock: if dice.chance(0.3) {
                dice.range(1.3, 1.9)
            } else {
                2.0
            },
            sock_colour: if dice.chance(0.6) {
                Vec3::splat(0.75)
            } else {
                Cloth::random(dice).colour
            },
            bag: dice.chance(0.08),
            top,
            bottom,
            shoe: {
                let mut c = Cloth::random(dice);
                c.print = Print::Plain;
                if dice.chance(0.5) {
                    c.colour = Vec3::splat(dice.pick(&[0.01, 0.02, 0.05, 0.6, 0.75]));
                }
                c
            },
            extra: Cloth::random(dice),
        }
    }

    /// Substance at a point whose nearest part is made of `nearest`.
    pub fn matter(&self, nearest: Matter, s: &Spot) -> Matter {
        if matches!(nearest, Matter::Hat | Matter::Bag | Matter::Shoe) {
            return nearest;
        }
        let (y, z) = (s.table.y, s.table.z);
        if s.head {
            // The hairline falls from the forehead to the nape.
            let line = match self.hair {
                Hair::Bald => 2.0,
                Hair::Cap | Hair::Beanie => 0.878,
                _ => 0.880,
            };
            let uneven =
                0.010 * (value(Vec3::new(s.table.x * 90.0, z * 60.0, 0.0), self.top.seed) - 0.5);
            let temple = 0.007 * (s.table.x.abs() / 0.04) * smoothstep(0.0, 0.04, z);
            let front = y > line + 0.84 * (z + 0.045) + temple + uneven;
            return if nearest == Matter::Hair && (front || z < 0.0)
                || (front && self.hair != Hair::Bald)
            {
                Matter::Hair
            } else {
                Matter::Skin
            };
        }
        if nearest == Matter::Hair {
            return Matter::Hair;
        }
        let wave = 0.003 * (s.p.x * 40.0 + s.p.z * 31.0).sin();
        if let Some(a) = s.arm {
            let covered = if self.sleeve < 0.0 {
                a < -0.12
            } else {
                a < self.sleeve + 4.0 * wave
            };
            return if covered && !self.bare_chest {
                Matter::Top
            } else {
                Matter::Skin
            };
        }
        if nearest == Matter::Bottom && self.skirt.is_some() {
            return Matter::Bottom;
        }
        if let Some(l) = s.leg
            && y < self.hem + wave
        {
            return if l < self.trouser + 4.0 * wave || y > 0.49 {
                Matter::Bottom
            } else {
                Matter::Skin
            };
        }
        // A collar that is lower in front.
        let collar = self.collar
            - 0.018 * smoothstep(0.0, 0.05, z) * (1.0 - (s.table.x / 0.05).powi(2)).max(0.0);
        if y < self.hem + wave {
            Matter::Bottom
        } else if y < collar && !self.bare_chest {
            Matter::Top
        } else {
            Matter::Skin
        }
    }

    /// Linear colour at a point of the given substance.
    pub fn colour(&self, matter: Matter, s: &Spot) -> Vec3 {
        let t = s.table;
        match matter {
            Matter::Skin => self.flesh(s),
            Matter::Hair => {
                let strand = value(Vec3::new(t.x * 420.0, t.y * 60.0, t.z * 420.0), 7);
                self.hair_colour * (0.45 + 1.1 * strand)
            }
            Matter::Hat | Matter::Bag => self.extra.at(s.p),
            Matter::Shoe => {
                let sole = t.y < 0.008;
                if sole {
                    self.shoe.second * 0.8
                } else {
                    self.shoe.at(s.p)
                }
            }
            Matter::Top => {
                if let Some(inner) = self.open_front
                    && s.arm.is_none()
                    && t.z > 0.02
                    && t.x.abs() < 0.022 + 0.03 * smoothstep(0.72, 0.82, t.y)
                {
                    return inner;
                }
                let c = self.top.at(s.p);
                match self.top.print {
                    Print::Badge
                        if s.arm.is_none()
                            && t.z > 0.0
                            && (t.y - 0.735).abs() < 0.035
                            && (t.x - 0.004).abs() < 0.048 =>
                    {
                        let letters =
                            value(Vec3::new(t.x * 160.0, t.y * 110.0, 0.0), self.top.seed);
                        c.lerp(self.top.second, smoothstep(0.42, 0.5, letters))
                    }
                    Print::Halves if s.arm.is_some() || t.y > 0.72 => self.top.second,
                    // buttons and seams would be below a pixel
                    _ => c,
                }
            }
            Matter::Bottom => {
                let c = self.bottom.at(s.p);
                if self.bottom.print == Print::Badge && t.x.abs() > 0.1 && t.z.abs() < 0.012 {
                    return self.bottom.second;
                }
                let belt =
                    (t.y - self.hem.max(0.575)).abs() < 0.007 && self.hem > 0.57 && !self.one_piece;
                if belt { c * 0.35 } else { c }
            }
        }
    }

    fn flesh(&self, s: &Spot) -> Vec3 {
        let t = s.table;
        let mut c = self.skin * (0.94 + 0.12 * value(s.p * 35.0, 3));
        if let Some(l) = s.leg
            && l > self.sock
        {
            return self.sock_colour;
        }
        if !s.head {
            return c;
        }
        if t.z < 0.03 {
            return c;
        }
        let x = t.x.abs();
        let ellipse = |cx: f32, cy: f32, rx: f32, ry: f32| {
            ((x - cx) / rx).powi(2) + ((t.y - cy) / ry).powi(2)
        };
        let paint = |c: &mut Vec3, d: f32, with: Vec3, strength: f32| {
            *c = c.lerp(with, strength * (1.0 - smoothstep(0.6, 1.3, d)));
        };
        // eye sockets lie in shade, then white, iris, brow, mouth, cheeks
        let shade = c * 0.62;
        paint(&mut c, ellipse(0.0175, 0.9345, 0.013, 0.0085), shade, 0.8);
        paint(
            &mut c,
            ellipse(0.0175, 0.9335, 0.0085, 0.0036),
            Vec3::splat(0.55),
            0.8,
        );
        paint(
            &mut c,
            ellipse(0.0175, 0.9335, 0.0042, 0.0042),
            Vec3::new(0.02, 0.015, 0.012),
            1.0,
        );
        paint(
            &mut c,
            ellipse(0.0185, 0.9455, 0.0125, 0.0032),
            self.hair_colour * 0.6,
            0.85,
        );
        let cheek = c * Vec3::new(1.08, 0.86, 0.84);
        paint(&mut c, ellipse(0.024, 0.912, 0.012, 0.011), cheek, 0.6);
        let lips = c * Vec3::new(0.82, 0.42, 0.42);
        paint(&mut c, ellipse(0.0, 0.8935, 0.0145, 0.0042), lips, 0.95);
        let nostril = c * 0.45;
        paint(
            &mut c,
            ellipse(0.0055, 0.9065, 0.0035, 0.0024),
            nostril,
            0.9,
        );
        if self.beard > 0.0 {
            let lower = 1.0 - smoothstep(0.897, 0.908, t.y - 0.35 * (x - 0.015).max(0.0));
            let mouth = smoothstep(0.8, 1.6, ellipse(0.0, 0.8935, 0.014, 0.005));
            c = c.lerp(self.hair_colour * 0.7, self.beard * lower * mouth);
        }
        if self.glasses {
            let rim = (ellipse(0.0175, 0.933, 0.0145, 0.011) - 1.0).abs();
            let bridge = x < 0.004 && (t.y - 0.936).abs() < 0.002;
            if rim < 0.28 || bridge {
                c = Vec3::splat(0.015);
            }
        }
        c
    }
}

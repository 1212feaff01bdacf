//! The open air: ground, sky, trees, houses.

use glam::Vec3;

use super::finish::hue;
use super::{Finish, Form, Paint, Place, Thing};
use crate::lab::synth::noise::Dice;
use crate::lab::synth::outfit::linear;

impl Place {
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
                things.push(Thing::new(
                    Form::Block {
                        centre: Vec3::new(x + w, h, z - 3.0),
                        half: Vec3::new(w, h, 3.0),
                        turn: 0.0,
                    },
                    finish,
                ));
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
                things.push(Thing::new(
                    Form::Post {
                        foot,
                        height: h + 1.0,
                        radius,
                    },
                    finish,
                ));
                for _ in 0..6 {
                    let r = dice.range(0.6, 1.6);
                    let c = foot
                        + Vec3::new(
                            dice.range(-1.2, 1.2),
                            h + dice.range(0.3, 2.5),
                            dice.range(-1.0, 1.0),
                        );
                    let finish = Finish::new(Paint::Blotches(0.3), leaf, leaf * 0.15, dice);
                    things.push(Thing::new(
                        Form::Ball {
                            centre: c,
                            radii: Vec3::new(r, 0.8 * r, r),
                        },
                        finish,
                    ));
                }
            } else {
                for _ in 0..4 {
                    let r = dice.range(0.3, 0.8);
                    let c = foot + Vec3::new(dice.range(-1.0, 1.0), 0.6 * r, dice.range(-0.4, 0.4));
                    let finish = Finish::new(Paint::Blotches(0.12), leaf, leaf * 0.2, dice);
                    things.push(Thing::new(
                        Form::Ball {
                            centre: c,
                            radii: Vec3::splat(r),
                        },
                        finish,
                    ));
                }
            }
        }
        if dice.chance(0.35) {
            // fence or wall
            let finish = Finish::wall(dice);
            let h = dice.range(0.4, 1.2);
            let z = -near - dice.range(1.5, 8.0);
            things.push(Thing::new(
                Form::Block {
                    centre: Vec3::new(0.0, h, z),
                    half: Vec3::new(20.0, h, 0.1),
                    turn: dice.range(-0.2, 0.2),
                },
                finish,
            ));
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
}

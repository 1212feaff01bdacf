//! Furniture, plants and posts.

use glam::Vec3;

use super::{Finish, Form, Paint, Place, Thing};
use crate::lab::synth::noise::Dice;
use crate::lab::synth::outfit::linear;

impl Place {
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
            things.push(Thing::new(
                Form::Block {
                    centre: foot + spun,
                    half,
                    turn,
                },
                finish,
            ));
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
                things.push(Thing::new(
                    Form::Post {
                        foot,
                        height: 0.35,
                        radius: dice.range(0.12, 0.2),
                    },
                    finish,
                ));
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
                    things.push(Thing::new(
                        Form::Ball {
                            centre: c,
                            radii: r,
                        },
                        finish,
                    ));
                }
            }
            _ => {
                // pillar, lamp, bin
                let finish = Finish::object(dice);
                let (height, radius) =
                    dice.pick(&[(2.5, 0.16), (1.6, 0.03), (0.7, 0.2), (1.1, 0.05)]);
                things.push(Thing::new(
                    Form::Post {
                        foot,
                        height,
                        radius,
                    },
                    finish,
                ));
            }
        }
    }
}

//! Rooms.

use glam::Vec3;

use super::finish::hue;
use super::{Finish, Paint, Place, Room, Thing};
use crate::lab::synth::noise::Dice;

impl Place {
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
            things.push(Thing::on_wall(centre, Vec3::new(w, h, 0.02), finish));
        }
        if dice.chance(0.4) {
            let finish = Finish::object(dice);
            let x = dice.range(left + 0.5, right - 0.5);
            things.push(Thing::on_wall(
                Vec3::new(x, 1.02, back),
                Vec3::new(0.45, 1.02, 0.04),
                finish,
            ));
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
                front: None,
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
}

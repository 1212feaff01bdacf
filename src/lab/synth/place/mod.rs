//! Where a scene plays: chance goes in, a procedural room or outdoor place comes out, which answers rays.

mod finish;
mod form;
mod furniture;
mod indoors;
mod look;
mod outdoors;
mod paint;

use glam::Vec3;

pub use self::finish::{Finish, Paint};
pub use self::form::{Form, Thing};
pub use self::look::Hit;
use super::noise::Dice;

/// A whole place: floor, optional walls, things, sky.
#[derive(Debug, Clone)]
pub struct Place {
    /// The floor y = 0.
    pub floor: Finish,
    /// Indoors: x of the left and right wall, z of the back wall and perhaps the front, height of the ceiling.
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
    /// Front wall, where cameras look that way.
    pub front: Option<f32>,
    /// Ceiling.
    pub height: f32,
    /// Back, side walls, ceiling.
    pub walls: [Finish; 3],
    /// Skirting board colour.
    pub skirting: Vec3,
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
}

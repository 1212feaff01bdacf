//! A posed body goes in, how low its skin reaches comes out, without the skin being made.

use glam::Vec3;

use super::flesh::Flesh;
use super::outfit::Outfit;
use super::pose::Posed;
use super::shape::{BONES, Shape};
use super::weights::{is_trunk, of_trunk};

/// Height of the lowest point of a dressed body above the floor, metres, within about a centimetre of its skin's.
pub fn lowest(shape: &Shape, outfit: &Outfit, posed: &Posed) -> f32 {
    // Heights alone: a row of each bone's rotation, and what is added.
    let rows: [(Vec3, f32); BONES] = std::array::from_fn(|b| {
        let row = posed.turn[b].inverse() * Vec3::Y;
        (row, posed.at[b].y - row.dot(shape.pivot(b)))
    });
    let moved = |b: usize, p: Vec3| rows[b].0.dot(p) + rows[b].1;
    let mut lowest = f32::MAX;
    for part in Flesh::new(shape, outfit).parts {
        for p in part.points() {
            // Soles are flat: nothing of the skin is below the floor that the rest pose stands on.
            let p = p.max(Vec3::new(f32::MIN, 0.0, f32::MIN));
            let height = if is_trunk(part.bone) {
                let weights = of_trunk(shape, p, part.matter);
                weights.map(|(b, w)| w * moved(b.into(), p)).iter().sum()
            } else {
                moved(part.bone as usize, p)
            };
            lowest = lowest.min(height);
        }
    }
    lowest
}

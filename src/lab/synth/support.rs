//! What people of stills sit and stand on: somebody posed goes in, the block under them comes out.

use glam::{Quat, Vec3};

use super::place::Form;
use super::pose::Posed;
use super::shape::Shape;
use crate::joints::{ANKLES, FOOT_TIPS, KNEES, PELVIS};

/// How far a seat lies below the pelvis, in units of the proportion tables.
const SEAT_BELOW: f32 = 0.08;
/// How far a seat stays behind knees and ankles, which have flesh around them, in the same units.
const CLEAR_OF_LEGS: f32 = 0.05;
/// Half the depth of a seat that legs leave room for, metres.
const SEAT_HALF: f32 = 0.19;
/// How far a step reaches beyond the joints that it carries, metres.
const BEYOND_FEET: f32 = 0.12;
/// Joints nearer to a step than this are carried by it, metres.
const CARRIED: f32 = 0.35;

/// A stool, box or bench on the floor under somebody who sits at `at` and looks along `heading` degrees; `half` its
/// width in metres. It ends behind the shins.
pub fn seat(shape: &Shape, posed: &Posed, at: Vec3, heading: f32, half: f32) -> Form {
    let u = shape.unit();
    let facing = Quat::from_rotation_y(heading.to_radians());
    let ahead = |j: usize| (facing.inverse() * (posed.joints[j] - at)).z;
    let legs = [KNEES, ANKLES].into_iter().flatten().map(ahead);
    let front = legs.fold(f32::MAX, f32::min) - CLEAR_OF_LEGS * u;
    let front = front.clamp(0.0, SEAT_HALF);
    let top = posed.joints[PELVIS].y - SEAT_BELOW * u;
    let middle = facing * (Vec3::Z * (0.5 * (front - SEAT_HALF)));
    Form::Block {
        centre: Vec3::new(at.x, 0.5 * top, at.z) + middle,
        half: Vec3::new(half, 0.5 * top, 0.5 * (front + SEAT_HALF)),
        turn: heading.to_radians(),
    }
}

/// A block on the floor under somebody who stands, sits or lies `at.y` metres above it, as large as what it carries.
pub fn step(posed: &Posed, at: Vec3, heading: f32) -> Form {
    let facing = Quat::from_rotation_y(heading.to_radians());
    let (mut lo, mut hi) = (Vec3::ZERO, Vec3::ZERO);
    let feet = [ANKLES, FOOT_TIPS].into_iter().flatten();
    let near = (0..posed.joints.len()).filter(|&j| posed.joints[j].y < at.y + CARRIED);
    for j in feet.chain(near) {
        let p = facing.inverse() * (posed.joints[j] - at);
        (lo, hi) = (lo.min(p), hi.max(p));
    }
    let middle = 0.5 * (lo + hi);
    let half = 0.5 * (hi - lo) + Vec3::splat(BEYOND_FEET);
    let centre = at + facing * Vec3::new(middle.x, 0.0, middle.z);
    Form::Block {
        centre: Vec3::new(centre.x, 0.5 * at.y, centre.z),
        half: Vec3::new(half.x, 0.5 * at.y, half.z),
        turn: heading.to_radians(),
    }
}

//! Walking and running: speed and phase go in, a pose comes out.

use super::pose::{Arm, Leg, Pose};
use super::shape::Shape;

/// A bump of height 1 at `at` on the circle 0..1.
fn bump(phase: f32, at: f32, width: f32) -> f32 {
    let d = (phase - at + 0.5).rem_euclid(1.0) - 0.5;
    (-(d / width).powi(2)).exp()
}

/// Place of a foot in front of the hip over a stride, −1..1: carried back evenly while it stands on the floor (a foot
/// that stands must not slide), swung forwards in the rest of the time, corners rounded.
fn travel(phase: f32) -> f32 {
    let sharp = |p: f32| {
        let p = p.rem_euclid(1.0);
        if p < STANCE {
            1.0 - 2.0 * p / STANCE
        } else {
            -(std::f32::consts::PI * (p - STANCE) / (1.0 - STANCE)).cos()
        }
    };
    (-3..=3)
        .map(|k| sharp(phase + 0.015 * k as f32))
        .sum::<f32>()
        / 7.0
}

/// Share of the stride in which a foot moves back evenly.
const STANCE: f32 = 0.56;

/// Length of a full stride (two steps), metres, at a speed in m/s.
pub fn stride_length(shape: &Shape, speed: f32) -> f32 {
    0.80 * shape.stature * (speed.abs() / 1.35).powf(0.55).clamp(0.25, 2.2)
}

/// Pose at a phase of the stride, 0..1; at 0 the right heel strikes. `speed` in m/s; above 2 the person runs.
pub fn stride(shape: &Shape, speed: f32, phase: f32) -> Pose {
    let tau = std::f32::consts::TAU;
    let run = ((speed - 1.8) / 0.8).clamp(0.0, 1.0);
    // Half of the way that the hip makes over a standing foot.
    let reach = 0.5 * STANCE * stride_length(shape, speed.min(2.6));
    let leg = 0.50 * shape.stature;
    let swing = (reach / leg).clamp(0.0, 0.8).asin().to_degrees();
    let effort = (swing / 26.0).clamp(0.15, 1.6);
    let mut pose = Pose::default();
    for side in 0..2 {
        let p = (phase + 0.5 * side as f32).rem_euclid(1.0);
        let yields = 13.0 * effort.min(1.0) * bump(p, 0.13, 0.09);
        // The thigh rises by half of what the knee yields, so that the ankle stays where it stands.
        let flex = 2.0 + 0.5 * yields + swing * (travel(p) + run * 0.25 * bump(p, 0.85, 0.12));
        let knee = 4.0
            + effort.min(1.0) * (56.0 + 30.0 * run) * bump(p, 0.72, 0.125)
            + yields
            + run * 16.0;
        // pitch of the foot against the floor, toes up positive
        let foot = effort.min(1.0)
            * (17.0 * bump(p, 0.99, 0.06)
                - 48.0 * bump(p, 0.63, 0.085)
                - 14.0 * bump(p, 0.76, 0.08));
        let lean = 3.0 + 8.0 * run;
        pose.legs[side] = Leg {
            flex: flex + lean * 0.5,
            abduct: 1.5,
            rotate: 7.0,
            knee,
            ankle: foot - (flex + lean * 0.5 - knee - lean),
        };
        let arm = -(tau * (p - 0.97)).cos();
        pose.arms[side] = Arm {
            flex: 4.0 + arm * 20.0 * effort.min(1.2) * (1.0 + 0.5 * run),
            abduct: 7.0 + 5.0 * run,
            twist: 5.0 + 15.0 * run,
            elbow: 16.0 + 12.0 * arm.max(0.0) * effort + 68.0 * run,
        };
        pose.lean[0] = lean;
    }
    let turn = (tau * (phase - 0.97)).cos();
    pose.lean[1] = -2.0 * (tau * (phase - 0.2)).sin() * effort.min(1.0);
    pose.lean[2] = 5.0 * turn * effort.min(1.2);
    pose.spine = [2.0, -pose.lean[1], -9.0 * turn * effort.min(1.2)];
    pose.neck = [-2.0 - 4.0 * run, 4.0 * turn * effort.min(1.0)];
    pose.hop = run * 0.05 * (0.5 - 0.5 * (2.0 * tau * (phase - 0.05)).cos());
    pose
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::lab::synth::noise::Dice;
    use crate::lab::synth::pose::Posed;

    #[test]
    fn standing_feet_hardly_slide() {
        let shape = Shape::new(1.75, 0.3, 0.0, 0.0, &mut Dice::new(3, 3));
        for speed in [0.8, 1.2, 1.5] {
            let stride_seconds = stride_length(&shape, speed) / speed;
            let ankle = |p: f32| {
                let at = Vec3::Z * (speed * p * stride_seconds);
                Posed::new(&shape, &stride(&shape, speed, p), at, 0.0).joints[10]
            };
            let (mut sum, mut n) = (0.0, 0.0);
            for k in 0..20 {
                let p = 0.10 + 0.30 * k as f32 / 20.0;
                let v = (ankle(p + 0.01) - ankle(p)) / (0.01 * stride_seconds);
                sum += v.x.hypot(v.z);
                n += 1.0;
            }
            let slide = sum / n;
            assert!(
                slide < 0.25 * speed,
                "at {speed} m/s the standing foot slides at {slide} m/s"
            );
        }
    }
}

//! Things people do on the spot: an act and the seconds since it began go in, a pose comes out.

use super::noise::value;
use super::pose::{Arm, Leg, Pose};
use glam::Vec3;

/// Something a person does while standing, walking or sitting.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(missing_docs)] // the names say it; the side is 0 right, 1 left
pub enum Act {
    Wave(usize),
    RaiseBoth,
    ReachUp(usize),
    ReachForward(usize),
    Point(usize),
    HandsOnHips,
    CrossArms,
    Telephone(usize),
    Squat,
    Bow,
    JumpingJack,
    Stretch,
    Clap,
    Drink(usize),
    LookAround,
    /// On a seat this high (pelvis, metres).
    Sit(f32),
}

/// Slow random drift about 0, −1..1, different per person and channel.
fn drift(t: f32, person: u32, channel: u32) -> f32 {
    2.0 * value(Vec3::new(t * 0.55, channel as f32 * 7.7, 0.5), person) - 1.0
}

/// Standing at ease: weight shifts, breath, small movements of head and arms.
pub fn idle(t: f32, person: u32) -> Pose {
    let d = |c| drift(t, person, c);
    let shift = d(0);
    let breath = (t * 1.6).sin();
    let mut pose = Pose {
        lean: [0.5, 2.5 * shift, 3.0 * d(1)],
        spine: [3.0 + 1.5 * d(2) + 0.6 * breath, -3.0 * shift, 5.0 * d(3)],
        neck: [5.0 + 8.0 * d(4), 26.0 * d(5)],
        ..Pose::default()
    };
    for side in 0..2 {
        let c = 10 + 10 * side as u32;
        pose.arms[side] = Arm::new(
            3.0 + 6.0 * d(c),
            8.0 + 2.0 * d(c + 1),
            8.0 * d(c + 2),
            15.0 + 8.0 * d(c + 3),
        );
        let bend = 6.0 + 5.0 * d(c + 4) * if side == 0 { shift } else { -shift };
        pose.legs[side] = Leg {
            flex: 0.5 * bend,
            abduct: 4.0,
            rotate: 9.0,
            knee: bend,
            ankle: 0.5 * bend,
        };
    }
    pose
}

/// Pose of an act `t` seconds after its start, laid over the pose that the body would have without it.
pub fn act(act: Act, base: &Pose, t: f32) -> Pose {
    let mut p = *base;
    let swing = |rate: f32| (t * rate * std::f32::consts::TAU).sin();
    match act {
        Act::Wave(s) => {
            p.arms[s] = Arm::new(12.0, 82.0, -82.0, 95.0 + 24.0 * swing(1.5));
            p.spine[1] += if s == 0 { -2.0 } else { 2.0 };
        }
        Act::RaiseBoth => {
            let a = Arm::new(10.0 + 6.0 * swing(0.5), 158.0 + 6.0 * swing(0.6), 0.0, 18.0);
            p.arms = [a; 2];
            p.neck[0] -= 8.0;
        }
        Act::ReachUp(s) => {
            p.arms[s] = Arm::new(158.0 + 8.0 * swing(0.4), 12.0, 0.0, 12.0);
            p.spine[1] += if s == 0 { 8.0 } else { -8.0 };
            p.neck[0] -= 18.0;
        }
        Act::ReachForward(s) => {
            p.arms[s] = Arm::new(78.0 + 8.0 * swing(0.5), 6.0, 0.0, 12.0 + 10.0 * swing(0.7));
            p.spine[0] += 10.0;
            p.spine[2] += if s == 0 { 14.0 } else { -14.0 };
        }
        Act::Point(s) => {
            p.arms[s] = Arm::new(30.0, 80.0, 0.0, 6.0);
            p.neck[1] = if s == 0 { -35.0 } else { 35.0 };
        }
        Act::HandsOnHips => p.arms = [Arm::new(-24.0, 40.0, 62.0, 92.0); 2],
        Act::CrossArms => {
            p.arms = [
                Arm::new(38.0, 14.0, 62.0, 102.0),
                Arm::new(48.0, 14.0, 58.0, 98.0),
            ];
        }
        Act::Telephone(s) => {
            p.arms[s] = Arm::new(48.0, 30.0, 6.0, 142.0);
            p.neck[0] += 6.0;
        }
        Act::Squat => {
            let d = 42.0 - 42.0 * (t * 0.45 * std::f32::consts::TAU).cos();
            p.lean[0] = 0.28 * d;
            p.spine[0] = 4.0 + 0.12 * d;
            p.legs = [Leg {
                flex: d,
                abduct: 12.0,
                rotate: 18.0,
                knee: 1.22 * d,
                ankle: 0.22 * d - 0.28 * d + 0.28 * d,
            }; 2];
            let lift = d.min(75.0);
            p.arms = [Arm::new(lift, 10.0, 10.0, 12.0); 2];
        }
        Act::Bow => {
            let d = 30.0 - 30.0 * (t * 0.4 * std::f32::consts::TAU).cos();
            p.lean[0] = 0.6 * d;
            p.spine[0] = 4.0 + 0.5 * d;
            for l in &mut p.legs {
                *l = Leg {
                    flex: 0.65 * d,
                    abduct: 5.0,
                    rotate: 8.0,
                    knee: 5.0 + 0.1 * d,
                    ankle: 5.0,
                };
            }
            p.arms = [Arm::new(1.0 * d, 6.0, 10.0, 10.0); 2];
        }
        Act::JumpingJack => {
            let k = 0.5 - 0.5 * (t * 1.1 * std::f32::consts::TAU).cos();
            p.arms = [Arm::new(5.0, 12.0 + 140.0 * k, 0.0, 15.0); 2];
            p.legs = [Leg {
                flex: 4.0,
                abduct: 3.0 + 22.0 * k,
                rotate: 8.0,
                knee: 8.0,
                ankle: 3.0,
            }; 2];
            p.hop = 0.07 * (t * 2.2 * std::f32::consts::TAU - 0.6).sin().max(0.0);
        }
        Act::Stretch => {
            let side = swing(0.25);
            p.spine[1] = 26.0 * side;
            p.lean[1] = 6.0 * side;
            p.arms = [
                Arm::new(8.0, 150.0 - 40.0 * (-side).max(0.0), 0.0, 20.0),
                Arm::new(8.0, 150.0 - 40.0 * side.max(0.0), 0.0, 20.0),
            ];
        }
        Act::Clap => {
            let k = swing(1.8);
            p.arms = [Arm::new(48.0, 6.0 + 8.0 * k, 38.0 - 9.0 * k, 72.0); 2];
        }
        Act::Drink(s) => {
            p.arms[s] = Arm::new(58.0, 24.0, 42.0, 118.0 + 8.0 * swing(0.3));
            p.neck[0] -= 8.0;
        }
        Act::LookAround => {
            p.neck = [2.0 + 8.0 * swing(0.23), 55.0 * swing(0.19)];
            p.spine[2] = 14.0 * swing(0.19);
        }
        Act::Sit(height) => {
            p.seat = height;
            p.lean = [-4.0, 0.0, 0.0];
            p.spine[0] = 12.0;
            p.legs = [Leg {
                flex: 84.0,
                abduct: 7.0,
                rotate: 6.0,
                knee: 82.0,
                ankle: 0.0,
            }; 2];
            p.arms = [
                Arm::new(30.0, 8.0, 12.0, 48.0),
                Arm::new(34.0, 8.0, 14.0, 52.0),
            ];
        }
    }
    p
}

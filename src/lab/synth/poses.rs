//! Random stances for stills: everyday gestures, sport, poses drawn from the skeleton's limits, and the floor.

use glam::Vec3;

use super::gait;
use super::noise::Dice;
use super::pose::{Arm, Leg, Pose, Posed};
use super::shape::Shape;
use crate::joints::{
    HEAD, HEAD_TOP, L_ANKLE, L_ELBOW, L_HAND, L_HIP, L_KNEE, L_WRIST, NECK, PELVIS, R_ANKLE,
    R_ELBOW, R_HAND, R_HIP, R_KNEE, R_WRIST,
};

const HANG: Arm = Arm::new(2.0, 7.0, 0.0, 12.0);

/// Arm gestures of the right arm, mirrored for the left.
pub fn gesture(dice: &mut Dice) -> Arm {
    let mut j = |v: f32, d: f32| v + d * dice.normal();
    let (a, b, c, e) = (j(0.0, 9.0), j(0.0, 8.0), j(0.0, 12.0), j(0.0, 12.0));
    let base = match dice.below(15) {
        0..=2 => Arm::new(4.0, 9.0, 0.0, 15.0),
        3 => Arm::new(20.0, 12.0, 35.0, 85.0), // forearm across the belly
        4 => Arm::new(-22.0, 38.0, 62.0, 95.0), // hand on the hip
        5 => Arm::new(80.0, 10.0, 0.0, 20.0),  // pointing forwards
        6 => Arm::new(5.0, 85.0, 0.0, 15.0),   // out to the side
        7 => Arm::new(0.0, 160.0, 0.0, 20.0),  // up
        8 => Arm::new(20.0, 70.0, -80.0, 100.0), // greeting
        9 => Arm::new(45.0, 18.0, 30.0, 140.0), // telephone, hand at the face
        10 => Arm::new(45.0, 8.0, 15.0, 75.0), // carrying, reading
        11 => Arm::new(150.0, 20.0, 0.0, 25.0), // reaching up
        12 => Arm::new(60.0, 25.0, 70.0, 100.0), // arms crossed
        13 => Arm::new(-40.0, 12.0, 0.0, 30.0), // swinging back
        _ => Arm::new(95.0, 60.0, 60.0, 120.0), // hands behind the head
    };
    Arm::new(
        base.flex + a,
        base.abduct + b,
        base.twist + c,
        base.elbow + e,
    )
}

fn legs(dice: &mut Dice, pose: &mut Pose) {
    let spread = dice.range(1.0, 14.0);
    let level = |l: &mut Leg| l.ankle = (l.knee - l.flex).clamp(-45.0, 20.0);
    match dice.below(16) {
        0..=4 => {
            // standing, weight on one leg
            let bend = dice.range(0.0, 25.0) * f32::from(u8::from(dice.chance(0.5)));
            let side = dice.below(2);
            pose.legs = [Leg::new(0.0, spread * 0.5, 3.0, 0.0); 2];
            pose.legs[side].knee = bend;
            pose.legs[side].flex = bend * 0.6;
        }
        5 => {
            // wide stance
            let w = dice.range(14.0, 34.0);
            pose.legs = [Leg::new(5.0, w, dice.range(2.0, 30.0), 0.0); 2];
        }
        6 | 7 => {
            // squat
            let d = dice.range(25.0, 110.0);
            pose.legs = [Leg::new(d, spread * 1.4, d * 1.15, 0.0); 2];
            pose.lean[0] = d * 0.25;
            pose.spine[0] += d * 0.15;
        }
        8 => {
            // lunge
            let d = dice.range(25.0, 75.0);
            let side = dice.below(2);
            pose.legs[side] = Leg::new(d, 4.0, d, 0.0);
            pose.legs[1 - side] = Leg::new(-d * 0.4, 4.0, d * 0.5, -30.0);
            pose.lean[0] = dice.range(0.0, 25.0);
        }
        9 => {
            // kick
            let side = dice.below(2);
            pose.legs[side] = Leg::new(
                dice.range(20.0, 100.0),
                spread,
                dice.range(0.0, 80.0),
                -20.0,
            );
            pose.legs[1 - side] = Leg::new(2.0, 4.0, 8.0, 0.0);
            pose.lean[0] = -dice.range(0.0, 15.0);
            return;
        }
        10 | 11 => {
            // sitting on an unseen or seen seat
            let d = dice.range(75.0, 100.0);
            pose.seat = dice.range(0.47, 0.62);
            pose.legs = [
                Leg::new(d, spread, dice.range(70.0, 100.0), 0.0),
                Leg::new(d - 4.0, spread, dice.range(70.0, 105.0), 0.0),
            ];
            pose.spine[0] += dice.range(-5.0, 30.0);
        }
        12 => {
            // jump
            pose.hop = dice.range(0.05, 0.5);
            let d = dice.range(0.0, 70.0);
            pose.legs = [
                Leg::new(d, spread * 1.5, d * 1.3, -30.0),
                Leg::new(d * 0.6, spread * 1.5, d, -30.0),
            ];
            return;
        }
        13 => {
            // bending down
            let d = dice.range(25.0, 80.0);
            pose.lean[0] = d;
            pose.spine[0] += 20.0;
            pose.legs = [Leg::new(d, spread, dice.range(2.0, 35.0), 0.0); 2];
            for l in &mut pose.legs {
                l.flex += l.knee * 0.5;
                l.ankle = (l.knee + d - l.flex).clamp(-45.0, 20.0);
            }
            return;
        }
        14 => {
            // kneeling
            let side = dice.below(2);
            pose.legs[side] = Leg::new(90.0, 8.0, 90.0, 0.0);
            pose.legs[1 - side] =
                Leg::new(dice.range(-5.0, 15.0), 5.0, dice.range(85.0, 110.0), -40.0);
            return;
        }
        _ => {
            // anything the joints allow
            let same = dice.chance(0.4);
            for k in 0..2 {
                pose.legs[k] = Leg {
                    flex: dice.range(-20.0, 110.0),
                    abduct: dice.range(-8.0, 40.0),
                    rotate: dice.range(-20.0, 40.0),
                    knee: dice.range(0.0, 135.0),
                    ankle: dice.range(-40.0, 18.0),
                };
            }
            if same {
                pose.legs[1] = pose.legs[0];
            }
            pose.lean = [dice.range(-25.0, 45.0), dice.range(-25.0, 25.0), 0.0];
            return;
        }
    }
    for l in &mut pose.legs {
        level(l);
        l.rotate = 10.0;
    }
}

/// Whether arms pass through the trunk, the head or the thighs.
fn collides(shape: &Shape, pose: &Pose) -> bool {
    let b = Posed::new(shape, pose, Vec3::ZERO, 0.0);
    let u = shape.unit();
    let capsule = |p: Vec3, a: Vec3, c: Vec3, r: f32| {
        let t = ((p - a).dot(c - a) / (c - a).length_squared()).clamp(0.0, 1.0);
        p.distance(a + (c - a) * t) < r
    };
    let j = &b.joints;
    for (elbow, wrist, hand) in [(R_ELBOW, R_WRIST, R_HAND), (L_ELBOW, L_WRIST, L_HAND)] {
        for p in [
            j[elbow].lerp(j[wrist], 0.4),
            j[elbow].lerp(j[wrist], 0.75),
            j[wrist],
            j[hand],
        ] {
            if capsule(p, j[PELVIS], j[NECK] - Vec3::Y * 0.02, 0.098 * u)
                || capsule(p, j[HEAD], j[HEAD_TOP], 0.07 * u)
                || capsule(p, j[R_HIP], j[R_KNEE], 0.06 * u)
                || capsule(p, j[L_HIP], j[L_KNEE], 0.06 * u)
            {
                return true;
            }
        }
    }
    let side = (j[R_WRIST] - j[L_WRIST]).length() < 0.05 * u;
    side || (j[R_KNEE] - j[L_KNEE]).length() < 0.05 * u
        || (j[R_ANKLE] - j[L_ANKLE]).length() < 0.06 * u
}

/// A random pose of somebody with this build.
pub fn random(shape: &Shape, dice: &mut Dice) -> Pose {
    untangled(shape, || attempt(shape, dice))
}

/// A random pose of somebody with this build who lies or sits on the floor.
pub fn on_the_floor(shape: &Shape, dice: &mut Dice) -> Pose {
    untangled(shape, || {
        if dice.chance(0.7) {
            lying(dice)
        } else {
            sitting_on_the_floor(dice)
        }
    })
}

/// The first of a dozen poses in which nothing passes through anything, or the last of them.
fn untangled(shape: &Shape, mut draw: impl FnMut() -> Pose) -> Pose {
    let mut last = Pose::default();
    for _ in 0..12 {
        last = draw();
        if !collides(shape, &last) {
            break;
        }
    }
    last
}

/// On the back, on the belly or on a side; the head to the left or the right of the heading.
fn lying(dice: &mut Dice) -> Pose {
    let mut pose = Pose::default();
    // `lean[1]` lays the body down sideways, then `lean[0]` rolls it about its long axis: -90 looks up.
    let (up, down) = (-90.0, 90.0);
    let roll = match dice.below(10) {
        0..=4 => up,
        5..=7 => down,
        _ => dice.pick(&[0.0, 180.0]),
    };
    pose.lean = [
        roll + 12.0 * dice.normal(),
        dice.sign() * (90.0 + 4.0 * dice.normal()),
        0.0,
    ];
    pose.spine = [
        5.0 * dice.normal(),
        6.0 * dice.normal(),
        10.0 * dice.normal(),
    ];
    // Whoever lies on the belly has the face to a side and off the floor.
    pose.neck = if roll == down {
        [dice.range(-25.0, -5.0), dice.range(-60.0, 60.0)]
    } else {
        [dice.range(-8.0, 25.0), dice.range(-35.0, 35.0)]
    };
    let stretched = Leg::new(
        dice.range(-3.0, 6.0),
        dice.range(2.0, 18.0),
        dice.range(0.0, 12.0),
        -25.0,
    );
    pose.legs = [stretched; 2];
    if roll == up {
        let bent = Leg::new(
            dice.range(35.0, 65.0),
            dice.range(2.0, 15.0),
            dice.range(70.0, 120.0),
            0.0,
        );
        match dice.below(6) {
            0 => pose.legs = [bent; 2],
            1 => pose.legs[dice.below(2)] = bent,
            2 => {
                pose.legs = [Leg::new(dice.range(40.0, 100.0), 5.0, dice.range(0.0, 90.0), 0.0); 2];
            }
            _ => {}
        }
    } else if roll == down {
        if dice.chance(0.3) {
            pose.legs[dice.below(2)].knee = dice.range(20.0, 95.0);
        }
    } else {
        for leg in &mut pose.legs {
            *leg = Leg::new(dice.range(10.0, 90.0), 3.0, dice.range(10.0, 110.0), -10.0);
        }
    }
    let arm = |dice: &mut Dice| match dice.below(6) {
        0 | 1 => Arm::new(
            dice.range(-5.0, 10.0),
            dice.range(8.0, 35.0),
            0.0,
            dice.range(5.0, 30.0),
        ),
        2 => Arm::new(5.0, dice.range(60.0, 120.0), -40.0, dice.range(10.0, 100.0)),
        3 => Arm::new(
            dice.range(150.0, 175.0),
            dice.range(5.0, 25.0),
            0.0,
            dice.range(0.0, 40.0),
        ),
        4 => Arm::new(95.0, 60.0, 60.0, 120.0), // under or behind the head
        _ => gesture(dice),
    };
    pose.arms = [arm(dice), arm(dice)];
    pose
}

/// With stretched, bent or crossed legs, upright or leaning back on the hands.
fn sitting_on_the_floor(dice: &mut Dice) -> Pose {
    let mut pose = Pose {
        spine: [
            dice.range(0.0, 35.0),
            5.0 * dice.normal(),
            9.0 * dice.normal(),
        ],
        neck: [dice.range(-15.0, 25.0), 25.0 * dice.normal()],
        arms: [gesture(dice), gesture(dice)],
        ..Pose::default()
    };
    let spread = dice.range(2.0, 25.0);
    let stretched = Leg::new(88.0, spread, dice.range(0.0, 15.0), -10.0);
    let bent = Leg::new(
        dice.range(100.0, 120.0),
        spread * 0.6,
        dice.range(70.0, 135.0),
        0.0,
    );
    pose.legs = match dice.below(4) {
        0 => [stretched; 2],
        1 => [bent; 2],
        2 => {
            let mut crossed = Leg::new(100.0, 40.0, dice.range(115.0, 140.0), -20.0);
            crossed.rotate = 45.0;
            [crossed; 2]
        }
        _ if dice.chance(0.5) => [stretched, bent],
        _ => [bent, stretched],
    };
    if dice.chance(0.45) {
        // leaning back on the hands or, farther down, on the elbows; a leg may be in the air
        let back = dice.range(10.0, 60.0);
        pose.lean[0] = -back;
        let prop = if back < 35.0 {
            Arm::new(-dice.range(25.0, 50.0), 12.0, 0.0, dice.range(0.0, 15.0))
        } else {
            Arm::new(-dice.range(10.0, 40.0), 12.0, 0.0, dice.range(70.0, 100.0))
        };
        pose.arms = [prop; 2];
        for leg in &mut pose.legs {
            leg.flex -= back;
        }
        if dice.chance(0.4) {
            pose.legs[dice.below(2)].flex += dice.range(20.0, 60.0);
        }
    }
    pose
}

fn attempt(shape: &Shape, dice: &mut Dice) -> Pose {
    let mut pose = Pose::default();
    let (n0, n1, n2) = (dice.normal(), dice.normal(), dice.normal());
    pose.spine = [4.0 + 7.0 * n0, 5.0 * n1, 9.0 * n2];
    pose.neck = [4.0 + 12.0 * dice.normal(), 25.0 * dice.normal()];
    if dice.chance(0.28) {
        // walking or running, caught in mid-step
        let run = dice.chance(0.3);
        let speed = if run {
            dice.range(2.2, 4.5)
        } else {
            dice.range(0.5, 1.8)
        };
        let mut walk = gait::stride(shape, speed, dice.unit());
        walk.neck = pose.neck;
        walk.spine[1] += pose.spine[1] * 0.5;
        if dice.chance(0.3) {
            walk.arms[dice.below(2)] = gesture(dice);
        }
        return walk;
    }
    legs(dice, &mut pose);
    let alike = dice.chance(0.3);
    let right = if dice.chance(0.12) {
        any_arm(dice)
    } else {
        gesture(dice)
    };
    let left = if alike {
        right
    } else if dice.chance(0.12) {
        any_arm(dice)
    } else {
        gesture(dice)
    };
    pose.arms = [right, left];
    if dice.chance(0.2) {
        pose.arms[dice.below(2)] = HANG;
    }
    if dice.chance(0.06) {
        // lying, falling, handstands: rare
        pose.lean[0] += dice.range(-100.0, 100.0);
        pose.lean[1] += dice.range(-50.0, 50.0);
        pose.seat = 0.0;
    }
    pose
}

fn any_arm(dice: &mut Dice) -> Arm {
    Arm::new(
        dice.range(-45.0, 165.0),
        dice.range(-10.0, 120.0),
        dice.range(-70.0, 80.0),
        dice.range(0.0, 140.0),
    )
}

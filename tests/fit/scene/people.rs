//! People who walk, wave, squat, turn, leave and return: their pose is a function of time.

use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;

use edgecap::body::skeleton::{BoneLengths, Pose, Posed, Skeleton};
use edgecap::joints::{
    ANKLES, BODY_JOINTS, ELBOWS, FOOT_TIPS, HANDS, HEAD, HEAD_TOP, PELVIS, SHOULDERS, WRISTS,
};
use edgecap::message::APPEARANCE_BINS;
use glam::{DQuat, DVec2, DVec3};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use super::{Angles, CAMERA_HEIGHT, angle, gauss, random_lengths};

/// A straight walk on the floor: from … to (x, z) in metres, start and end in seconds.
#[derive(Debug, Clone, Copy)]
pub struct Leg {
    pub start: f64,
    pub end: f64,
    pub from: DVec2,
    pub to: DVec2,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    Stand,
    Wave,
    Squat,
    Reach,
    JumpingJack,
    TurnRound,
}

pub struct Person {
    pub height: f64,
    pub lengths: BoneLengths,
    pub legs: Vec<Leg>,
    pub activity: Activity,
    /// Direction faced when standing, 0 towards the camera.
    pub facing: f64,
    pub clothes: [[f64; APPEARANCE_BINS]; 2],
    /// Seconds between which a counter hides everything below the hips and the network invents legs near them.
    pub counter: Option<Counter>,
    offset: f64,
}

/// Invented legs.
#[derive(Debug, Clone, Copy)]
pub struct Counter {
    pub from: f64,
    pub to: f64,
    /// Length of the invented legs in the picture, as a share of the true.
    pub legs2d: f64,
    /// The same of Stage II's.
    pub legs3d: f64,
}

struct Names {
    spine: [usize; 3],
    neck: [usize; 2],
    /// Right, left: flexion, abduction, rotation, elbow.
    arms: [[usize; 4]; 2],
    /// Right, left: flexion, abduction, rotation, knee, ankle.
    legs: [[usize; 5]; 2],
}

fn names() -> &'static Names {
    static NAMES: OnceLock<Names> = OnceLock::new();
    NAMES.get_or_init(|| Names {
        spine: [
            angle("spine_flexion"),
            angle("spine_lateral"),
            angle("spine_twist"),
        ],
        neck: [angle("neck_flexion"), angle("neck_yaw")],
        arms: ["r", "l"].map(|s| {
            [
                "shoulder_flexion",
                "shoulder_abduction",
                "shoulder_rotation",
                "elbow_flexion",
            ]
            .map(|n| angle(&format!("{s}_{n}")))
        }),
        legs: ["r", "l"].map(|s| {
            [
                "hip_flexion",
                "hip_abduction",
                "hip_rotation",
                "knee_flexion",
                "ankle_flexion",
            ]
            .map(|n| angle(&format!("{s}_{n}")))
        }),
    })
}

impl Person {
    /// Somebody with random height, proportions and clothes.
    pub fn new(seed: u64, legs: Vec<Leg>, activity: Activity) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed.wrapping_mul(7919) + 17);
        let mut clothes = [[0.0; APPEARANCE_BINS]; 2];
        for (kind, bins) in clothes.iter_mut().enumerate() {
            // Golden-ratio steps keep clothes of successive seeds apart; a second, weaker colour.
            let centre = (seed as f64 * 0.618 + kind as f64 * 0.31).fract() * 30.0;
            let second = rng.random_range(0.0..30.0);
            for (b, bin) in bins.iter_mut().enumerate() {
                let peak = |c: f64, width: f64| {
                    let d = (b as f64 + 0.5 - c).abs();
                    let d = if kind == 0 { d.min(30.0 - d) } else { d };
                    (-0.5 * (d / width).powi(2)).exp() / width
                };
                *bin = peak(centre, 1.3) + 0.3 * peak(second, 1.5);
            }
            let sum: f64 = bins.iter().sum();
            bins.iter_mut().for_each(|b| *b /= sum);
        }
        Self {
            height: 1.70 + 0.08 * gauss(&mut rng).clamp(-1.5, 1.5),
            lengths: random_lengths(&mut rng),
            legs,
            activity,
            facing: rng.random_range(-0.6..0.6),
            clothes,
            counter: None,
            offset: rng.random_range(0.0..10.0),
        }
    }

    pub fn behind(mut self, counter: Counter) -> Self {
        self.counter = Some(counter);
        self
    }

    /// The counter, while the person is behind it.
    pub fn counter_at(&self, t: f64) -> Option<Counter> {
        self.counter.filter(|c| t >= c.from && t < c.to)
    }

    pub fn of_height(mut self, height: f64) -> Self {
        self.height = height;
        self
    }

    /// Pose (canonical stature, position in metres) and joints in camera space, metres.
    pub fn at(&self, t: f64) -> (Pose, [DVec3; BODY_JOINTS]) {
        let s = Skeleton::builtin();
        let (place, travelled) = self.place(t);
        // Headings and speeds change at once from leg to leg; people take a second to turn. Triangular window.
        const SAMPLES: i32 = 30;
        let (mut heading, mut effort, mut weight) = (0.0, 0.0, 0.0);
        let mut last: Option<f64> = None;
        for i in -SAMPLES..=SAMPLES {
            let w = f64::from(SAMPLES + 1 - i.abs());
            let (direction, speed) = self.direction(t + 0.6 / f64::from(SAMPLES) * f64::from(i));
            let mut towards = direction.x.atan2(direction.y);
            if let Some(last) = last {
                towards += TAU * ((last - towards) / TAU).round();
            }
            last = Some(towards);
            heading += w * towards;
            effort += w * speed;
            weight += w;
        }
        let (heading, effort): (f64, f64) = (heading / weight, effort / weight);
        let mut angles = [0.0; edgecap::body::skeleton::ANGLES];
        let walking = (effort / 1.2).clamp(0.0, 1.2);
        self.stand(t, 1.0 - walking.min(1.0), &mut angles);
        gait(travelled / 1.35 * TAU, walking, &mut angles);
        for (k, a) in angles.iter_mut().enumerate() {
            let [low, high] = s.angles()[k].limits;
            *a = a.clamp(low, high);
        }
        // Facing the camera is a half turn about x; headings turn about the vertical.
        let rotation = DQuat::from_rotation_y(heading) * DQuat::from_rotation_x(PI);
        let mut pose = Pose {
            position: DVec3::ZERO,
            rotation,
            angles,
        };
        let scale = self.height / 1.70;
        let lengths = self.lengths.map(|l| l * scale);
        let mut posed = Posed::default();
        s.pose(&pose, &lengths, &mut posed);
        // On the floor with the lowest point of the feet.
        let sole = ANKLES
            .map(|j| posed.joints[j].y + 0.085 * scale)
            .into_iter()
            .chain(FOOT_TIPS.map(|j| posed.joints[j].y + 0.02 * scale))
            .fold(f64::NEG_INFINITY, f64::max);
        let shift = DVec3::new(place.x, CAMERA_HEIGHT - sole, place.y);
        pose.position = shift;
        let mut joints = posed.joints.map(|p| p + shift);
        // Shrugging shoulders and a tilting head: outside the fitted model.
        let shrug = 0.02 * scale * (0.7 * t + self.offset).sin();
        for j in [SHOULDERS, ELBOWS, WRISTS, HANDS].into_iter().flatten() {
            joints[j].y -= shrug;
        }
        let tilt = 0.02 * scale * (0.9 * t + 2.0 * self.offset).sin();
        let side = posed.frames[PELVIS] * DVec3::X;
        joints[HEAD_TOP] += side * tilt;
        joints[HEAD] += side * (0.4 * tilt);
        (pose, joints)
    }

    /// Place on the floor (x, z) and metres walked so far.
    fn place(&self, t: f64) -> (DVec2, f64) {
        let mut walked = 0.0;
        let mut place = self.legs.first().map_or(DVec2::new(0.0, 4.0), |l| l.from);
        for leg in &self.legs {
            if t < leg.start {
                break;
            }
            let share = ((t - leg.start) / (leg.end - leg.start)).clamp(0.0, 1.0);
            // Constant speed with soft starts and stops.
            let soft = share * share * (3.0 - 2.0 * share);
            let share = 0.5 * share + 0.5 * soft;
            place = leg.from.lerp(leg.to, share);
            walked += leg.from.distance(leg.to) * share;
        }
        (place, walked)
    }

    /// Direction (sin, cos of the heading; 0 towards the camera) and speed.
    fn direction(&self, t: f64) -> (DVec2, f64) {
        for leg in &self.legs {
            if t >= leg.start && t <= leg.end {
                let d = leg.to - leg.from;
                let speed = d.length() / (leg.end - leg.start);
                if d.length() > 1e-6 {
                    // Towards +x is the person's left when facing the camera: heading −90°.
                    return (DVec2::new(-d.x, -d.y).normalize(), speed);
                }
            }
        }
        let mut facing = self.facing;
        if self.activity == Activity::TurnRound {
            facing += 0.5 * (t + self.offset);
        }
        (DVec2::new(facing.sin(), facing.cos()), 0.0)
    }

    fn stand(&self, t: f64, share: f64, a: &mut Angles) {
        let n = names();
        let time = t + self.offset;
        let wave = |hz: f64| (TAU * hz * time).sin();
        let up = |hz: f64| 0.5 - 0.5 * (TAU * hz * time).cos();
        let mut add = |k: usize, v: f64| a[k] += share * v;
        for (side, arm) in n.arms.iter().enumerate() {
            add(arm[1], 0.15);
            add(arm[3], 0.25 + 0.05 * wave(0.2));
            add(n.legs[side][1], 0.08);
        }
        add(n.spine[1], 0.05 * wave(0.13));
        add(n.neck[1], 0.3 * wave(0.17));
        add(n.neck[0], 0.1 * wave(0.11));
        match self.activity {
            Activity::Stand | Activity::TurnRound => {}
            Activity::Wave => {
                add(n.arms[0][1], 1.4);
                add(n.arms[0][0], 0.3);
                add(n.arms[0][3], 1.0 + 0.5 * wave(1.2));
                add(n.arms[0][2], 0.6 * wave(1.2));
            }
            Activity::Squat => {
                let d = up(0.35);
                for leg in n.legs {
                    add(leg[0], 1.5 * d);
                    add(leg[3], 1.9 * d);
                    add(leg[4], -0.3 * d);
                }
                for arm in n.arms {
                    add(arm[0], 1.4 * d);
                }
                add(n.spine[0], 0.4 * d);
            }
            Activity::Reach => {
                for (i, arm) in n.arms.iter().enumerate() {
                    let r = up(0.25 + 0.1 * i as f64);
                    add(arm[0], 1.9 * r);
                    add(arm[3], 1.0 - 0.8 * r);
                    add(arm[1], 0.5 * r);
                }
                add(n.spine[2], 0.4 * wave(0.2));
            }
            Activity::JumpingJack => {
                let d = up(0.6);
                for arm in n.arms {
                    add(arm[1], 2.4 * d);
                }
                for leg in n.legs {
                    add(leg[1], 0.35 * d);
                }
            }
        }
    }
}

fn gait(phase: f64, amount: f64, a: &mut Angles) {
    let n = names();
    let share = amount.min(1.0);
    for side in 0..2 {
        let p = phase + PI * side as f64;
        let leg = n.legs[side];
        a[leg[0]] += amount * (0.42 * p.sin() + 0.1);
        a[leg[3]] += amount * (0.12 + 0.85 * p.cos().max(0.0).powi(2));
        a[leg[4]] += amount * 0.15 * (p + 1.0).sin();
        let arm = n.arms[side];
        a[arm[0]] -= amount * 0.38 * p.sin();
        a[arm[1]] += share * 0.12;
        a[arm[3]] += share * (0.35 - 0.2 * p.sin());
    }
    a[n.spine[2]] += amount * 0.1 * phase.sin();
    a[n.spine[0]] += share * 0.05;
}

/// A walk from place to place at about `speed`, starting at `start`.
pub fn walk(start: f64, speed: f64, places: &[(f64, f64)]) -> Vec<Leg> {
    let mut t = start;
    places
        .windows(2)
        .map(|w| {
            let (from, to) = (DVec2::from(w[0]), DVec2::from(w[1]));
            let leg = Leg {
                start: t,
                end: t + (from.distance(to) / speed).max(0.5),
                from,
                to,
            };
            t = leg.end;
            leg
        })
        .collect()
}

/// Everyday movement without crossings: five people, no exits.
pub fn everyday() -> Vec<Person> {
    let still = |x, z| walk(0.0, 1.0, &[(x, z), (x, z)]);
    vec![
        Person::new(
            1,
            walk(
                0.0,
                1.1,
                &[
                    (-1.2, 3.6),
                    (-2.2, 4.8),
                    (-1.0, 5.6),
                    (-1.2, 3.6),
                    (-2.4, 5.0),
                    (-0.9, 4.2),
                ],
            ),
            Activity::Stand,
        ),
        Person::new(2, still(0.1, 3.2), Activity::Wave),
        Person::new(3, still(1.2, 3.8), Activity::Squat),
        Person::new(4, still(2.4, 4.6), Activity::Reach),
        Person::new(5, still(0.8, 6.5), Activity::TurnRound),
    ]
}

/// Two couples who walk through each other's way, at slightly and at clearly different depths.
pub fn crossing() -> Vec<Person> {
    let shuttle = |start: f64, speed: f64, a: (f64, f64), b: (f64, f64)| {
        let mut places = Vec::new();
        for _ in 0..6 {
            // Half a second to turn round.
            places.extend([a, (a.0, a.1 + 0.01), b, (b.0, b.1 + 0.01)]);
        }
        walk(start, speed, &places)
    };
    vec![
        Person::new(
            11,
            shuttle(0.5, 1.2, (-1.8, 3.6), (1.8, 3.6)),
            Activity::Stand,
        ),
        Person::new(
            12,
            shuttle(0.5, 1.2, (1.8, 4.3), (-1.8, 4.3)),
            Activity::Stand,
        ),
        Person::new(
            13,
            shuttle(1.5, 0.9, (-2.2, 5.4), (2.2, 5.4)),
            Activity::Stand,
        ),
        Person::new(
            14,
            shuttle(2.0, 1.3, (2.4, 6.2), (-2.4, 6.2)),
            Activity::Stand,
        ),
    ]
}

/// Six people who wander, meet, leave the picture and come back within a minute.
pub fn wanderers(seconds: f64, seed: u64) -> Vec<Person> {
    let mut rng = SmallRng::seed_from_u64(seed);
    let activities = [
        Activity::Stand,
        Activity::Wave,
        Activity::Reach,
        Activity::Squat,
        Activity::TurnRound,
        Activity::Stand,
    ];
    (0..6)
        .map(|i| {
            let lane = 3.2 + 0.7 * i as f64;
            let mut legs = Vec::new();
            let mut here = DVec2::new(rng.random_range(-0.4..0.4) * lane, lane);
            let mut t = rng.random_range(0.0..4.0);
            let mut outside = false;
            while t < seconds {
                let leaves = !outside && rng.random_bool(0.15);
                let z = lane + rng.random_range(-0.25..0.25);
                let to = if leaves {
                    DVec2::new(
                        (0.7 * z + 1.0) * if rng.random_bool(0.5) { 1.0 } else { -1.0 },
                        z,
                    )
                } else {
                    DVec2::new(rng.random_range(-0.5..0.5) * z, z)
                };
                let speed = rng.random_range(0.8..1.4);
                let time = (here.distance(to) / speed).max(0.3);
                legs.push(Leg {
                    start: t,
                    end: t + time,
                    from: here,
                    to,
                });
                here = to;
                outside = leaves;
                let pause = if leaves {
                    rng.random_range(3.0..40.0)
                } else {
                    rng.random_range(0.5..6.0)
                };
                t += time + pause;
            }
            Person::new(seed * 100 + i, legs, activities[i as usize])
        })
        .collect()
}

/// Ten people in view.
pub fn ten() -> Vec<Person> {
    let activities = [
        Activity::Wave,
        Activity::Squat,
        Activity::Reach,
        Activity::JumpingJack,
        Activity::Stand,
    ];
    (0..10u64)
        .map(|i| {
            let z = 4.0 + 1.5 * (i / 5) as f64;
            // The back row looks through the gaps of the front row.
            let x = ((i % 5) as f64 - 2.25 + 0.5 * (i / 5) as f64) * 0.26 * z;
            let legs = walk(0.0, 1.0, &[(x, z), (x + 0.3, z + 0.3), (x, z)]);
            Person::new(40 + i, legs, activities[i as usize % 5])
        })
        .collect()
}

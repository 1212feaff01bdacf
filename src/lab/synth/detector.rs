//! What is true about a view goes in, what a network would tell of it comes out: noise that stays and noise that goes,
//! the bias of every joint, joints and people missed, outliers, sides exchanged. No pictures.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};

use super::noise::Dice;
use super::truth::{SELF_OCCLUDED, TruthFrame, TruthPerson, VISIBLE};
use crate::joints::{
    BODY_JOINTS, CANONICAL_STATURE, EVIDENCE_JOINTS, MIRROR, MIRROR_BODY, NECK, PELVIS, R_ANKLE,
    R_ELBOW, R_FOOT_TIP, R_HAND, R_HIP, R_KNEE, R_SHOULDER, R_WRIST,
};
use crate::message::{FLAG_FILE_TIME, Intrinsics, MAX_PEOPLE, Observation, ObservationFrame};

/// Fewest joints by which somebody is found.
const LEAST_JOINTS: usize = 4;
/// Right joints of arms and legs: evidence, then body joints as well.
pub const ARMS: [&[usize]; 2] = [
    &[R_SHOULDER, R_ELBOW, R_WRIST],
    &[R_SHOULDER, R_ELBOW, R_WRIST, R_HAND],
];
/// Legs likewise.
pub const LEGS: [&[usize]; 2] = [
    &[R_HIP, R_KNEE, R_ANKLE],
    &[R_HIP, R_KNEE, R_ANKLE, R_FOOT_TIP],
];

/// What a detector gets wrong. Lengths are metres at the person's distance and canonical stature, rates probabilities a
/// frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flaws {
    /// Where evidence joints are told to be against where they are: to the person's left, up, forward.
    pub bias: [[f32; 3]; EVIDENCE_JOINTS],
    /// Standard deviation an axis of the error in the picture that stays, of that which is new in every frame, and the
    /// time constant of what stays, seconds.
    pub plane: [f32; 3],
    /// The same for root-relative joints in space.
    pub space: [f32; 3],
    /// A joint is missed.
    pub lost: f32,
    /// A joint is 0.3 to 0.8 m off.
    pub outlier: f32,
    /// A person is missed.
    pub miss: f32,
    /// Share of frames in which arms or legs have the names of the other side, each.
    pub exchanged: f32,
    /// How long that lasts in the mean, seconds.
    pub exchanged_time: f32,
}

impl Flaws {
    /// Of the network that comes along, in the mean of three clips of synthetic people (512×320, 15 and 30 frames a
    /// second, `examples/observation_noise`). On films of real people it is worse: 2 to 4 % of the stature where four
    /// views meet.
    pub const MEASURED: Self = Self {
        bias: [
            [-0.002, 0.007, -0.007],
            [0.001, 0.001, 0.000],
            [-0.002, 0.000, 0.002],
            [0.003, -0.010, -0.008],
            [-0.001, -0.001, 0.012],
            [0.004, -0.003, -0.003],
            [0.003, -0.002, 0.002],
            [0.001, -0.002, -0.003],
            [0.003, -0.005, 0.000],
            [0.003, -0.008, -0.001],
            [0.001, -0.010, 0.001],
            [-0.001, -0.005, -0.003],
            [-0.002, -0.003, 0.003],
            [-0.004, -0.003, -0.001],
        ],
        plane: [0.0173, 0.0141, 0.61],
        space: [0.0518, 0.0320, 1.02],
        lost: 0.0048,
        outlier: 0.0092,
        miss: 0.0048,
        exchanged: 0.0053,
        exchanged_time: 0.06,
    };
    /// None.
    pub const NONE: Self = Self {
        bias: [[0.0; 3]; EVIDENCE_JOINTS],
        plane: [0.0, 0.0, 1.0],
        space: [0.0, 0.0, 1.0],
        lost: 0.0,
        outlier: 0.0,
        miss: 0.0,
        exchanged: 0.0,
        exchanged_time: 0.1,
    };
}

/// A detector with a memory, for the frames of one view in their order.
#[derive(Debug)]
pub struct Detector {
    flaws: Flaws,
    fps: f32,
    dice: Dice,
    people: BTreeMap<u32, State>,
}

/// What stays from frame to frame.
#[derive(Debug, Clone)]
struct State {
    plane: [Vec2; EVIDENCE_JOINTS],
    space: [Vec3; BODY_JOINTS],
    /// Arms, legs.
    exchanged: [bool; 2],
}

impl Detector {
    /// A detector of a view with `fps` frames a second. Views need seeds of their own.
    pub fn new(flaws: Flaws, fps: f32, seed: u64) -> Self {
        Self {
            flaws,
            fps,
            dice: Dice::new(seed, 77),
            people: BTreeMap::new(),
        }
    }

    /// What it tells of the next frame of a film, a picture of `size` pixels; how many there are is not known. Joints
    /// that others or things hide are not seen.
    pub fn observe(&mut self, truth: &TruthFrame, size: [u32; 2]) -> ObservationFrame {
        let c = &truth.camera;
        let lens = Intrinsics {
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
        };
        let mut frame = ObservationFrame {
            sequence: truth.frame,
            capture_ns: truth.time_ns,
            width: size[0],
            height: size[1],
            intrinsics: lens,
            flags: FLAG_FILE_TIME,
            ..ObservationFrame::default()
        };
        let mut seen: Vec<Observation> = truth
            .people
            .iter()
            .filter_map(|person| self.person(person, [lens.fx, lens.fy]))
            .collect();
        // In no order.
        if seen.len() > 1 {
            let by = self.dice.below(seen.len());
            seen.rotate_left(by);
        }
        seen.truncate(MAX_PEOPLE);
        frame.count = seen.len() as u32;
        frame.people[..seen.len()].copy_from_slice(&seen);
        frame
    }

    fn person(&mut self, person: &TruthPerson, focal: [f32; 2]) -> Option<Observation> {
        let flaws = self.flaws;
        self.remember(person.id);
        let missed = self.dice.chance(flaws.miss);
        let dice = &mut self.dice;
        let state = &self.people[&person.id];
        let grown = person.stature / CANONICAL_STATURE;
        let body = axes(&person.joints3d);
        let mut seen = Observation {
            score: 0.98,
            ..Observation::default()
        };
        for (j, out) in seen.joints2d.iter_mut().enumerate() {
            let white = flaws.plane[1] * Vec2::new(dice.normal(), dice.normal());
            let sure = dice.range(0.5, 0.95);
            let (outlier, lost) = (dice.chance(flaws.outlier), dice.chance(flaws.lost));
            let (angle, far) = (dice.range(0.0, std::f32::consts::TAU), dice.range(0.3, 0.8));
            let visible = matches!(person.visibility[j], VISIBLE | SELF_OCCLUDED);
            if !visible || (j != NECK && lost) {
                continue;
            }
            let told = body.map_or(Vec3::ZERO, |axes| axes * Vec3::from(flaws.bias[j]));
            let mut error = state.plane[j] + white + told.truncate();
            if j != NECK && outlier {
                error = Vec2::from_angle(angle) * far;
            }
            let depth = person.joints3d[j][2].max(0.1);
            let pixels = error * grown / depth * Vec2::from(focal);
            let at = Vec2::from(person.joints2d[j]) + pixels;
            *out = [at.x, at.y, sure];
        }
        let root = Vec3::from(person.joints3d[PELVIS]);
        for (j, out) in seen.joints3d.iter_mut().enumerate() {
            let white = flaws.space[1] * Vec3::new(dice.normal(), dice.normal(), dice.normal());
            let error = if j == PELVIS {
                Vec3::ZERO
            } else {
                state.space[j] + white
            };
            *out = ((Vec3::from(person.joints3d[j]) - root) / grown + error).to_array();
        }
        for (limb, exchanged) in [ARMS, LEGS].into_iter().zip(state.exchanged) {
            if exchanged {
                exchange(&mut seen, limb);
            }
        }
        let joints = seen.joints2d.iter().filter(|j| j[2] > 0.0).count();
        (!missed && joints >= LEAST_JOINTS).then_some(seen)
    }

    /// Moves on what stays of the errors about a person.
    fn remember(&mut self, id: u32) {
        let (flaws, fps, dice) = (self.flaws, self.fps, &mut self.dice);
        let plane = |dice: &mut Dice| flaws.plane[0] * Vec2::new(dice.normal(), dice.normal());
        let space = |dice: &mut Dice| {
            flaws.space[0] * Vec3::new(dice.normal(), dice.normal(), dice.normal())
        };
        let memory = |time: f32| {
            let keep = (-1.0 / (fps * time)).exp();
            (keep, (1.0 - keep * keep).sqrt())
        };
        let known = self.people.contains_key(&id);
        let state = self.people.entry(id).or_insert_with(|| State {
            plane: std::array::from_fn(|_| plane(dice)),
            space: std::array::from_fn(|_| space(dice)),
            exchanged: [false; 2],
        });
        if known {
            let (keep, fresh) = memory(flaws.plane[2]);
            for s in &mut state.plane {
                *s = *s * keep + plane(dice) * fresh;
            }
            let (keep, fresh) = memory(flaws.space[2]);
            for s in &mut state.space {
                *s = *s * keep + space(dice) * fresh;
            }
        }
        let end = (1.0 / (fps * flaws.exchanged_time)).min(1.0);
        let begin = (end * flaws.exchanged / (1.0 - flaws.exchanged).max(0.01)).min(1.0);
        for exchanged in &mut state.exchanged {
            *exchanged = if *exchanged {
                !dice.chance(end)
            } else {
                dice.chance(begin)
            };
        }
    }
}

/// Gives arms or legs the names of the other side, in the picture and in space.
pub fn exchange(seen: &mut Observation, [evidence, body]: [&[usize]; 2]) {
    for &right in evidence {
        seen.joints2d.swap(right, MIRROR[right]);
    }
    for &right in body {
        seen.joints3d.swap(right, MIRROR_BODY[right]);
    }
}

/// A person's left, up and forward as columns, from joints in any right-handed axes; `None` where hips and trunk are in
/// line.
pub fn axes(joints: &[[f32; 3]; BODY_JOINTS]) -> Option<glam::Mat3> {
    let at = |j: usize| Vec3::from(joints[j]);
    let up = (at(NECK) - at(PELVIS)).try_normalize()?;
    let left = at(11) - at(8) + 0.5 * (at(5) - at(2));
    let left = (left - up * left.dot(up)).try_normalize()?;
    Some(glam::Mat3::from_cols(left, up, left.cross(up)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::synth::studio::Studio;

    fn flaws() -> Flaws {
        let mut flaws = Flaws {
            plane: [0.02, 0.02, 0.5],
            outlier: 0.02,
            lost: 0.03,
            miss: 0.01,
            exchanged: 0.05,
            exchanged_time: 0.2,
            ..Flaws::NONE
        };
        flaws.bias[8] = [0.0, 0.05, 0.0];
        flaws
    }

    #[test]
    fn without_flaws_the_truth_is_told() {
        let studio = Studio::new(3, (512, 320), 1, 2, 4, 10.0);
        let mut detector = Detector::new(Flaws::NONE, 10.0, 1);
        for k in 0..4 {
            let truth = studio.outline(0, k);
            let seen = detector.observe(&truth, [512, 320]);
            assert_eq!(seen.count as usize, truth.people.len());
            for person in &truth.people {
                let same = seen.people().iter().any(|o| {
                    (0..EVIDENCE_JOINTS).all(|j| {
                        o.joints2d[j][2] == 0.0 || o.joints2d[j][..2] == person.joints2d[j]
                    })
                });
                assert!(same, "person {} of frame {k}", person.id);
            }
        }
    }

    #[test]
    fn sides_are_told_apart_and_the_seed_decides() {
        let studio = Studio::new(4, (512, 320), 1, 1, 40, 20.0);
        let run = |seed| {
            let mut detector = Detector::new(flaws(), 20.0, seed);
            (0..40)
                .map(|k| detector.observe(&studio.outline(0, k), [512, 320]).people)
                .collect::<Vec<_>>()
        };
        assert!(run(1) == run(1) && run(1) != run(2));
        let joints = studio.outline(0, 0).people[0].joints3d;
        let axes = axes(&joints).unwrap();
        // In camera axes y points down.
        assert!(axes.y_axis.y < -0.8 && (axes.determinant() - 1.0).abs() < 1e-4);
        let left = Vec3::from(joints[5]) - Vec3::from(joints[2]);
        assert!(axes.x_axis.dot(left) > 0.2);
    }
}

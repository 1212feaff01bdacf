//! Moving skeletons with exact truth and observations as a weak Stage I and II would deliver them. No pictures.
//!
//! The truth moves by the same 29 angles as the fitted skeleton, but every person has proportions of their own,
//! shoulders that shrug and a head that tilts, which the fitted skeleton cannot do.
#![allow(dead_code, reason = "tests and bench use different parts")]
#![allow(
    clippy::needless_range_loop,
    reason = "a joint's index runs over several arrays at once"
)]

use edgecap::body::skeleton::{ANGLES, BoneLengths, Pose, Posed, Skeleton};
use edgecap::joints::{
    ANKLES, BODY_JOINTS, ELBOWS, EVIDENCE_JOINTS, FOOT_TIPS, HANDS, HEAD, HEAD_TOP, HIPS, KNEES,
    L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, MIRRORED, NECK, PELVIS, R_ANKLE, R_ELBOW,
    R_FOOT_TIP, R_HIP, R_KNEE, R_SHOULDER, R_WRIST, SHOULDERS, SPINE, WRISTS,
};
use edgecap::message::{APPEARANCE_BINS, Intrinsics, Observation, ObservationFrame};
use glam::{DQuat, DVec2, DVec3};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

pub mod measure;
pub mod people;
pub mod ring;

/// Height of the camera above the floor, metres; it looks horizontally.
pub const CAMERA_HEIGHT: f64 = 1.4;
pub const WIDTH: u32 = 1280;
pub const HEIGHT: u32 = 720;

/// How bad observations are. Lengths in metres at the person's distance and canonical stature.
#[derive(Debug, Clone, Copy)]
pub struct Noise {
    /// Slow and white part of the 2D error per axis.
    pub slow2d: f64,
    pub white2d: f64,
    /// Time constant of the slow part, seconds.
    pub time2d: f64,
    /// Slow and white part of the 3D error per axis, and the slow part's time constant.
    pub slow3d: f64,
    pub white3d: f64,
    pub time3d: f64,
    /// How many times worse 3D is where the joint is not seen.
    pub hidden3d: f64,
    /// Probability per frame that a person is missed, and that a burst of 3–8 such frames begins.
    pub miss: f64,
    pub burst: f64,
    /// Probability per frame and joint of a joint missing, and of a joint far off.
    pub lost: f64,
    pub outlier: f64,
    /// Probability per frame that a limb starts being hidden, for half a second to two.
    pub hidden: f64,
    /// Probability per frame that left and right of arms or legs are exchanged.
    pub swap: f64,
    /// Probability per frame of a person who is not there.
    pub phantom: f64,
}

impl Noise {
    /// 2D: 3 % of the stature; 3D: 55 mm mean error.
    pub const REAL: Self = Self {
        slow2d: 0.041,
        white2d: 0.031,
        time2d: 0.4,
        slow3d: 0.030,
        white3d: 0.015,
        time3d: 0.4,
        hidden3d: 2.0,
        miss: 0.05,
        burst: 0.003,
        lost: 0.03,
        outlier: 0.02,
        hidden: 0.004,
        swap: 0.02,
        phantom: 0.05,
    };
    /// Measured with `examples/observation_noise` on the fifth model, int8: 300 frames of `edgecap synth --clip
    /// --people 4 --seed 11 --fps 30` at 512×320, 709 of 725 appearances found; 0.01 people a frame who are not there.
    pub const MEASURED: Self = Self {
        slow2d: 0.0246,
        white2d: 0.0203,
        time2d: 1.13,
        slow3d: 0.0749,
        white3d: 0.0363,
        time3d: 0.85,
        hidden3d: 2.19,
        miss: 0.0041,
        burst: 0.0041,
        lost: 0.0068,
        outlier: 0.0212,
        hidden: 0.0,
        swap: 0.0337,
        phantom: 0.0133,
    };
    pub const NONE: Self = Self {
        slow2d: 0.0,
        white2d: 0.0,
        time2d: 0.4,
        slow3d: 0.0,
        white3d: 0.0,
        time3d: 0.4,
        hidden3d: 1.0,
        miss: 0.0,
        burst: 0.0,
        lost: 0.0,
        outlier: 0.0,
        hidden: 0.0,
        swap: 0.0,
        phantom: 0.0,
    };
}

/// Truth of one person in one frame, camera space, metres.
#[derive(Debug, Clone)]
pub struct Truth {
    pub person: usize,
    pub joints: [DVec3; BODY_JOINTS],
    pub pose: Pose,
    pub height: f64,
    /// Evidence joints that a perfect detector would see.
    pub visible: [bool; EVIDENCE_JOINTS],
    /// What hides the legs, if anything does.
    pub counter: Option<people::Counter>,
    /// Whether a perfect detector would see the person.
    pub detectable: bool,
    /// Which observation is this person's, if any.
    pub observation: Option<usize>,
}

pub struct Scene {
    pub people: Vec<people::Person>,
    pub camera: Intrinsics,
    pub noise: Noise,
    pub fps: f64,
    rng: SmallRng,
    states: Vec<NoiseState>,
    frame: u64,
}

#[derive(Clone)]
struct NoiseState {
    slow2d: [DVec2; EVIDENCE_JOINTS],
    slow3d: [DVec3; BODY_JOINTS],
    missing: u32,
    hidden: Option<(usize, f64)>,
}

/// Knees and ankles.
const LEGS: [usize; 4] = [R_KNEE, R_ANKLE, L_KNEE, L_ANKLE];
const LIMBS: [&[usize]; 6] = [
    &[R_ELBOW, R_WRIST],
    &[L_ELBOW, L_WRIST],
    &[R_KNEE, R_ANKLE],
    &[L_KNEE, L_ANKLE],
    &[R_WRIST],
    &[L_WRIST],
];

impl Scene {
    pub fn new(people: Vec<people::Person>, noise: Noise, fps: f64, seed: u64) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed);
        let states = people
            .iter()
            .map(|_| NoiseState {
                slow2d: std::array::from_fn(|_| gauss2(&mut rng) * noise.slow2d),
                slow3d: std::array::from_fn(|_| gauss3(&mut rng) * noise.slow3d),
                missing: 0,
                hidden: None,
            })
            .collect();
        Self {
            people,
            camera: Intrinsics::from_horizontal_fov(WIDTH, HEIGHT, 70.0),
            noise,
            fps,
            rng,
            states,
            frame: 0,
        }
    }

    pub fn time(&self, frame: u64) -> f64 {
        frame as f64 / self.fps
    }

    /// The next frame and its truth.
    pub fn next(&mut self) -> (ObservationFrame, Vec<Truth>) {
        let t = self.time(self.frame);
        let mut truths = self.truths(t);
        let mut frame = ObservationFrame {
            sequence: self.frame,
            capture_ns: 1_000_000_000 + (t * 1e9).round() as u64,
            width: WIDTH,
            height: HEIGHT,
            intrinsics: self.camera,
            ..ObservationFrame::default()
        };
        let mut seen: Vec<(Observation, Option<usize>)> = Vec::new();
        for i in 0..truths.len() {
            if let Some(observation) = self.observe(&truths, i) {
                seen.push((observation, Some(i)));
            }
        }
        if self.rng.random_bool(self.noise.phantom) {
            seen.push((self.phantom(), None));
        }
        seen.sort_by(|a, b| b.0.score.total_cmp(&a.0.score));
        for (slot, (observation, owner)) in seen.iter().enumerate() {
            frame.people[slot] = *observation;
            if let Some(i) = owner {
                truths[*i].observation = Some(slot);
            }
        }
        frame.count = seen.len() as u32;
        self.frame += 1;
        (frame, truths)
    }

    /// Everyone at a time, without noise.
    pub fn truths(&self, t: f64) -> Vec<Truth> {
        let mut truths: Vec<Truth> = (0..self.people.len())
            .map(|person| {
                let (pose, joints) = self.people[person].at(t);
                Truth {
                    person,
                    joints,
                    pose,
                    height: self.people[person].height,
                    counter: self.people[person].counter_at(t),
                    visible: [false; EVIDENCE_JOINTS],
                    detectable: false,
                    observation: None,
                }
            })
            .collect();
        for i in 0..truths.len() {
            for j in 0..EVIDENCE_JOINTS {
                truths[i].visible[j] = self.sees(&truths, i, j);
            }
            let n = truths[i].visible.iter().filter(|v| **v).count();
            truths[i].detectable = truths[i].visible[1] && n >= 4;
        }
        truths
    }

    /// In the picture and with nobody's trunk in front.
    fn sees(&self, truths: &[Truth], person: usize, joint: usize) -> bool {
        let p = truths[person].joints[joint];
        if p.z < 0.3 || (LEGS.contains(&joint) && truths[person].counter.is_some()) {
            return false;
        }
        let [u, v] = self.camera.project(p.as_vec3().to_array());
        if u < 0.0 || v < 0.0 || u >= WIDTH as f32 || v >= HEIGHT as f32 {
            return false;
        }
        !truths.iter().enumerate().any(|(i, other)| {
            if i == person {
                return false;
            }
            let (neck, pelvis) = (other.joints[NECK], other.joints[PELVIS]);
            let depth = pelvis.z;
            if depth < 0.3 || depth > p.z - 0.25 {
                return false;
            }
            // A cylinder from the head to the knees, at the other's depth.
            let q = p * (depth / p.z);
            let width = 0.2 * other.height / 1.7;
            let top = neck.y - 0.25;
            let bottom = pelvis.y + 0.55;
            (q.x - 0.5 * (neck.x + pelvis.x)).abs() < width && q.y > top && q.y < bottom
        })
    }

    fn observe(&mut self, truths: &[Truth], i: usize) -> Option<Observation> {
        let truth = &truths[i];
        let noise = self.noise;
        let rng = &mut self.rng;
        let state = &mut self.states[i];
        let memory = |time: f64| {
            let keep = (-1.0 / (self.fps * time)).exp();
            (keep, (1.0 - keep * keep).sqrt())
        };
        let (keep, fresh) = memory(noise.time2d);
        for s in &mut state.slow2d {
            *s = *s * keep + gauss2(rng) * noise.slow2d * fresh;
        }
        let (keep, fresh) = memory(noise.time3d);
        for s in &mut state.slow3d {
            *s = *s * keep + gauss3(rng) * noise.slow3d * fresh;
        }
        if let Some((_, left)) = &mut state.hidden {
            *left -= 1.0 / self.fps;
            if *left < 0.0 {
                state.hidden = None;
            }
        } else if rng.random_bool(noise.hidden) {
            state.hidden = Some((rng.random_range(0..LIMBS.len()), rng.random_range(0.5..2.0)));
        }
        if state.missing > 0 {
            state.missing -= 1;
            return None;
        }
        if rng.random_bool(noise.burst) {
            state.missing = rng.random_range(3..9);
            return None;
        }
        if !truth.detectable || rng.random_bool(noise.miss) {
            return None;
        }
        let scale = truth.height / 1.70;
        let depth = truth.joints[PELVIS].z;
        let mut seen = Observation::default();
        let hidden: &[usize] = state.hidden.map_or(&[], |(limb, _)| LIMBS[limb]);
        for j in 0..EVIDENCE_JOINTS {
            let invented = truth.counter.filter(|_| LEGS.contains(&j));
            let visible = truth.visible[j] || invented.is_some();
            if !visible || hidden.contains(&j) || (j != NECK && rng.random_bool(noise.lost)) {
                continue;
            }
            let at = invented.map_or(truth.joints[j], |c| shortened(&truth.joints, j, c.legs2d));
            let [u, v] = self.camera.project(at.as_vec3().to_array());
            let mut error = state.slow2d[j] + gauss2(rng) * noise.white2d;
            if j != NECK && rng.random_bool(noise.outlier) {
                let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
                error = DVec2::from_angle(angle) * rng.random_range(0.3..0.8);
            }
            let pixels = error * scale / depth * f64::from(self.camera.fx);
            seen.joints2d[j] = [
                u + pixels.x as f32,
                v + pixels.y as f32,
                rng.random_range(0.4..0.95),
            ];
        }
        for j in 0..BODY_JOINTS {
            let below = LEGS.contains(&SEEN_THROUGH[j]);
            let invented = truth.counter.filter(|_| below);
            let worse = match SEEN_THROUGH[j] {
                _ if invented.is_some() => noise.hidden3d,
                k if seen.joints2d[k][2] > 0.0 => 1.0,
                _ => noise.hidden3d,
            };
            let error = (state.slow3d[j] + gauss3(rng) * noise.white3d) * worse;
            let error = if j == PELVIS { DVec3::ZERO } else { error };
            let at = invented.map_or(truth.joints[j], |c| shortened(&truth.joints, j, c.legs3d));
            let p = (at - truth.joints[PELVIS]) / scale + error;
            seen.joints3d[j] = p.as_vec3().to_array();
        }
        if rng.random_bool(noise.swap) {
            let arms = rng.random_bool(0.5);
            let (pairs, tips) = if arms {
                ([SHOULDERS, ELBOWS, WRISTS], HANDS)
            } else {
                ([HIPS, KNEES, ANKLES], FOOT_TIPS)
            };
            for [a, b] in pairs {
                seen.joints2d.swap(a, b);
            }
            if rng.random_bool(0.5) {
                for [a, b] in pairs.into_iter().chain([tips]) {
                    seen.joints3d.swap(a, b);
                }
            }
        }
        let n = seen.joints2d.iter().filter(|j| j[2] > 0.0).count();
        if n < 4 {
            return None;
        }
        // Probabilities that somebody is there lie in the uppermost tenth, those of ghosts below.
        seen.score = 0.9 + 0.1 * seen.joints2d.iter().map(|j| j[2]).sum::<f32>() / n as f32;
        self.dress(truths, i, &mut seen);
        Some(seen)
    }

    /// Torso histograms: the person's clothes, noise, and a share of whoever stands close in the picture.
    fn dress(&mut self, truths: &[Truth], i: usize, seen: &mut Observation) {
        if [R_SHOULDER, L_SHOULDER, R_HIP, L_HIP]
            .iter()
            .filter(|&&j| seen.joints2d[j][2] > 0.0)
            .count()
            < 3
        {
            return;
        }
        let centre = |t: &Truth| t.joints[SPINE].truncate() / t.joints[SPINE].z;
        let near = truths.iter().enumerate().find(|(k, t)| {
            *k != i
                && t.joints[SPINE].z > 0.3
                && (centre(t) - centre(&truths[i])).length() * truths[i].joints[SPINE].z < 0.35
        });
        let rng = &mut self.rng;
        for (out, pick) in [(&mut seen.hue, 0), (&mut seen.saturation, 1)] {
            let mut sum = 0.0;
            for b in 0..APPEARANCE_BINS {
                let own = self.people[i].clothes[pick][b];
                let other = near.map_or(own, |(k, _)| self.people[k].clothes[pick][b]);
                let clean = 0.75 * own + 0.25 * other + 0.004;
                out[b] = (clean * (0.35 * gauss(rng)).exp()) as f32;
                sum += out[b];
            }
            out.iter_mut().for_each(|v| *v /= sum);
        }
    }

    /// Somebody who is not there: a plausible pose in a random place.
    fn phantom(&mut self) -> Observation {
        let s = Skeleton::builtin();
        let rng = &mut self.rng;
        let depth = rng.random_range(2.0..7.0);
        let mut pose = Pose::facing_camera(depth);
        pose.position.x = rng.random_range(-0.6..0.6) * depth;
        pose.position.y = rng.random_range(0.0..0.8);
        pose.rotation = DQuat::from_rotation_y(rng.random_range(-3.0..3.0)) * pose.rotation;
        for (k, angle) in pose.angles.iter_mut().enumerate() {
            let [low, high] = s.angles()[k].limits;
            *angle = low + (high - low) * rng.random_range(0.2..0.8);
        }
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let mut seen = Observation {
            score: rng.random_range(0.7..0.94),
            ..Observation::default()
        };
        for j in 0..EVIDENCE_JOINTS {
            if rng.random_bool(0.8) {
                let [u, v] = self.camera.project(posed.joints[j].as_vec3().to_array());
                seen.joints2d[j] = [u, v, rng.random_range(0.2..0.6)];
            }
        }
        for j in 0..BODY_JOINTS {
            seen.joints3d[j] = (posed.joints[j] - pose.position).as_vec3().to_array();
        }
        seen.hue = [1.0 / 30.0; APPEARANCE_BINS];
        seen.saturation = [1.0 / 30.0; APPEARANCE_BINS];
        seen
    }
}

const SEEN_THROUGH: [usize; BODY_JOINTS] = [
    HEAD_TOP, NECK, R_SHOULDER, R_ELBOW, R_WRIST, L_SHOULDER, L_ELBOW, L_WRIST, R_HIP, R_KNEE,
    R_ANKLE, L_HIP, L_KNEE, L_ANKLE, R_HIP, NECK, HEAD_TOP, R_WRIST, L_WRIST, R_ANKLE, L_ANKLE,
];

/// A joint of a leg that is `share` as long as it should be.
fn shortened(joints: &[DVec3; BODY_JOINTS], joint: usize, share: f64) -> DVec3 {
    let hip = if [R_KNEE, R_ANKLE, R_FOOT_TIP].contains(&joint) {
        R_HIP
    } else {
        L_HIP
    };
    joints[hip].lerp(joints[joint], share)
}

/// Standard normal number.
pub fn gauss(rng: &mut SmallRng) -> f64 {
    let u: f64 = 1.0 - rng.random::<f64>();
    let v: f64 = rng.random();
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

fn gauss2(rng: &mut SmallRng) -> DVec2 {
    DVec2::new(gauss(rng), gauss(rng))
}

fn gauss3(rng: &mut SmallRng) -> DVec3 {
    DVec3::new(gauss(rng), gauss(rng), gauss(rng))
}

/// Proportions of a random person of canonical stature.
pub fn random_lengths(rng: &mut SmallRng) -> BoneLengths {
    let s = Skeleton::builtin();
    let mut lengths = *s.lengths();
    for [r, l] in MIRRORED {
        let factor = (0.05 * gauss(rng).clamp(-2.0, 2.0)).exp();
        lengths[r] *= factor;
        lengths[l] *= factor;
    }
    for j in [HEAD_TOP, NECK, SPINE, HEAD] {
        lengths[j] *= (0.05 * gauss(rng).clamp(-2.0, 2.0)).exp();
    }
    let scale = 1.70 / s.stature(&lengths);
    lengths.map(|l| l * scale)
}

pub fn angle(name: &str) -> usize {
    Skeleton::builtin()
        .angles()
        .iter()
        .position(|a| a.name == name)
        .unwrap_or_else(|| panic!("no angle {name}"))
}

pub type Angles = [f64; ANGLES];

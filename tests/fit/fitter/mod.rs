//! Stage III against exact truth: what a fitter makes of the observations of one camera.

mod accuracy;
mod damage;
mod identities;
mod lean;
mod looks;
mod memory;
mod movement;
mod prediction;
mod times;

use edgecap::body::skeleton::{BoneLengths, Pose, Posed, Skeleton};
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::PELVIS;
use edgecap::message::{APPEARANCE_BINS, BodyFrame, Intrinsics, Observation, ObservationFrame};
use glam::DVec2;

use crate::scene::measure::Report;
use crate::scene::people::{Activity, Leg, Person};
use crate::scene::{HEIGHT, Noise, Scene, WIDTH};

const FPS: f64 = 30.0;

fn check_everywhere(report: &Report) {
    assert!(report.finite, "a number was not finite");
    assert!(
        report.beyond <= 5.0,
        "an angle exceeded its limit by {}°",
        report.beyond
    );
    assert!(
        report.mpjpe3() <= report.mpjpe2(),
        "Stage III is worse than Stage II"
    );
}

/// Somebody who stands at (x, z).
fn standing(seed: u64, x: f64, z: f64) -> Person {
    let here = DVec2::new(x, z);
    let leg = Leg {
        start: 0.0,
        end: 1.0,
        from: here,
        to: here,
    };
    Person::new(seed, vec![leg], Activity::Stand)
}

/// Clothes of one hue, or of none, and one saturation, each the number of a bin.
fn dress(seen: &mut Observation, hue: Option<usize>, saturation: usize) {
    seen.hue = [1.0 / APPEARANCE_BINS as f32; APPEARANCE_BINS];
    if let Some(hue) = hue {
        seen.hue = [0.0; APPEARANCE_BINS];
        seen.hue[hue] = 1.0;
    }
    seen.saturation = [0.0; APPEARANCE_BINS];
    seen.saturation[saturation] = 1.0;
}

/// People who stand still before a fitter, of whom each frame shows some.
struct Stage {
    scene: Scene,
    fitter: Fitter,
    /// Nanoseconds without frames so far.
    paused: u64,
}

impl Stage {
    fn new(cast: Vec<Person>) -> Self {
        Self::at(FPS, cast)
    }

    /// At so many frames a second.
    fn at(fps: f64, cast: Vec<Person>) -> Self {
        Self {
            scene: Scene::new(cast, Noise::NONE, fps, 1),
            fitter: Fitter::new(FitConfig::default()).unwrap(),
            paused: 0,
        }
    }

    /// A frame of those whom `shows`, which may change what is seen of them. Who everybody is published as.
    fn frame(&mut self, shows: impl Fn(usize, &mut Observation) -> bool) -> Vec<Option<u32>> {
        let (mut frame, truths) = self.scene.next();
        let mut people = Vec::new();
        for (k, truth) in truths.iter().enumerate() {
            let mut seen = frame.people[truth.observation.expect("in view")];
            if shows(k, &mut seen) {
                people.push(seen);
            }
        }
        frame.count = people.len() as u32;
        frame.people[..people.len()].copy_from_slice(&people);
        frame.capture_ns += self.paused;
        let mut out = BodyFrame::default();
        self.fitter.update(&frame, &mut out);
        let id = |x: f64| {
            let mut bodies = out.bodies().iter();
            let here = bodies.find(|b| (f64::from(b.position[0]) - x).abs() < 0.4);
            here.map(|b| b.id)
        };
        truths.iter().map(|t| id(t.joints[PELVIS].x)).collect()
    }
}

/// Somebody of canonical stature who faces the camera at (x, z), metres, and of whom everything is seen but looks, at
/// so many seconds.
fn facing(seconds: f64, x: f64, z: f64) -> ObservationFrame {
    let mut pose = Pose::facing_camera(z);
    pose.position.x = x;
    posing(seconds, &pose, Skeleton::builtin().lengths())
}

/// Somebody of canonical stature with such bones in such a pose, of whom everything is seen but looks, at so many
/// seconds.
fn posing(seconds: f64, pose: &Pose, lengths: &BoneLengths) -> ObservationFrame {
    let camera = Intrinsics::from_horizontal_fov(WIDTH, HEIGHT, 70.0);
    let mut posed = Posed::default();
    Skeleton::builtin().pose(pose, lengths, &mut posed);
    let mut seen = Observation {
        score: 0.99,
        ..Observation::default()
    };
    for (out, joint) in seen.joints2d.iter_mut().zip(posed.joints) {
        let [u, v] = camera.project(joint.as_vec3().to_array());
        *out = [u, v, 0.95];
    }
    for (out, joint) in seen.joints3d.iter_mut().zip(posed.joints) {
        *out = (joint - posed.joints[PELVIS]).as_vec3().to_array();
    }
    let mut frame = ObservationFrame {
        capture_ns: (seconds * 1e9).round() as u64,
        width: WIDTH,
        height: HEIGHT,
        intrinsics: camera,
        count: 1,
        ..ObservationFrame::default()
    };
    frame.people[0] = seen;
    frame
}

/// Takes looks away.
fn undress(seen: &mut Observation) {
    seen.hue = [0.0; APPEARANCE_BINS];
    seen.saturation = [0.0; APPEARANCE_BINS];
}

//! Bodies of the fitted model itself, who walk about and wave before a ring of cameras.

use glam::{DMat3, DQuat, DVec2, DVec3, Vec2};

use super::{Cast, Trial};
use crate::body::BodyModel;
use crate::body::mesh::{MeshBody, MeshPose, PosedTree, Skin};
use crate::camera::{Brown, View};
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use crate::lab::synth::detector::{Detector, Flaws};
use crate::lab::synth::noise::Dice;
use crate::lab::synth::raster::{Buffer, NOBODY};
use crate::lab::synth::truth::{ABSENT, TruthCamera, TruthFrame, TruthPerson, VISIBLE};
use crate::message::Observation;
use crate::multiview::{Mask, PosePrior, body_joints, evidence_joints, stature};

/// Frames a second.
pub const RATE: f64 = 30.0;
/// Bias of a steady detector's joints, metres an axis.
const BIAS: f32 = 0.012;

/// One body over time.
#[derive(Debug, Clone)]
pub struct Walker {
    /// Shape coefficients.
    pub betas: Vec<f64>,
    /// Pose by frame; the world's y points up.
    pub poses: Vec<MeshPose>,
    /// Evidence joints by frame, world.
    pub joints: Vec<[DVec3; EVIDENCE_JOINTS]>,
    body_joints: Vec<[DVec3; BODY_JOINTS]>,
    stature: f64,
}

impl Walker {
    /// Somebody who walks about `place`.
    pub fn new(frames: usize, seed: u64, place: DVec3) -> Self {
        let body = MeshBody::shipped();
        let mut dice = Dice::new(seed, 100);
        let betas: Vec<f64> = (0..10).map(|_| 0.9 * f64::from(dice.normal())).collect();
        let (shape, poses) = (body.person(&betas), motion(frames, seed, place));
        let mut posed = PosedTree::default();
        let (joints, body_joints) = poses
            .iter()
            .map(|pose| {
                body.kinematics(pose, &shape, &mut posed);
                (evidence_joints(&posed), body_joints(&posed))
            })
            .unzip();
        Self {
            stature: stature(body, &betas),
            betas,
            poses,
            joints,
            body_joints,
        }
    }

    /// What a view shows of them: 1 where they are.
    pub fn mask(&self, frame: usize, view: &View) -> Mask {
        let body = MeshBody::shipped();
        let person = body.person(&self.betas);
        let (mut posed, mut vertices) = (PosedTree::default(), Vec::new());
        body.kinematics(&self.poses[frame], &person, &mut posed);
        Skin::new(body, &person).pose(body, &self.poses[frame], &posed, &mut vertices);
        let placed: Vec<(Vec2, f32)> = vertices
            .iter()
            .map(|v| {
                let point = v.as_dvec3();
                let pixel = view.project(point).unwrap_or(DVec2::NAN).as_vec2();
                (pixel, view.to_camera(point).z as f32)
            })
            .collect();
        let [width, height] = view.size.map(|s| s as usize);
        let mut buffer = Buffer::new(width, height);
        buffer.draw(0, &placed, body.faces());
        Mask {
            size: view.size,
            owners: buffer.who.iter().map(|w| u8::from(*w != NOBODY)).collect(),
            unknown: None,
        }
    }

    fn truth(&self, id: u32, frame: usize, view: &View) -> TruthPerson {
        let joints = &self.body_joints[frame];
        let pixels = joints.map(|p| view.project(p).unwrap_or(DVec2::NAN).as_vec2());
        let [width, height] = view.size.map(|s| s as f32);
        let inside = |p: Vec2| p.x >= 0.0 && p.y >= 0.0 && p.x < width && p.y < height;
        TruthPerson {
            id,
            stature: self.stature as f32,
            joints3d: joints.map(|p| view.to_camera(p).as_vec3().to_array()),
            joints2d: pixels.map(|p| p.to_array()),
            visibility: pixels.map(|p| if inside(p) { VISIBLE } else { ABSENT }),
            bounds: None,
            pixels: 0.0,
        }
    }
}

/// Cameras round the origin, at most six, 4.2 m away and 1.6 m high; the world's y points up.
pub fn ring(count: usize) -> Vec<View> {
    [0.0, 120.0, 240.0, 60.0, 300.0, 180.0f64][..count]
        .iter()
        .map(|degrees| {
            let a = degrees.to_radians();
            let position = DVec3::new(4.2 * a.sin(), 1.6, 4.2 * a.cos());
            let z = (DVec3::new(0.0, 1.0, 0.0) - position).normalize();
            let x = z.cross(DVec3::Y).normalize();
            View {
                name: format!("{degrees}"),
                size: [1080, 1080],
                focal: DVec2::splat(1150.0),
                centre: DVec2::splat(540.0),
                distortion: Brown {
                    radial: [-0.05, 0.02, 0.0],
                    tangential: [0.0005, -0.0003],
                },
                rotation: DMat3::from_cols(x, z.cross(x), z).transpose(),
                position,
            }
        })
        .collect()
}

/// Somebody who walks about a place, waves and turns.
fn motion(frames: usize, seed: u64, place: DVec3) -> Vec<MeshPose> {
    let mut dice = Dice::new(seed, 101);
    let speed = f64::from(dice.range(0.7, 1.3));
    let heading = f64::from(dice.range(0.0, 6.0));
    let mean = PosePrior::shipped().mean();
    (0..frames)
        .map(|k| {
            let t = k as f64 / RATE * speed;
            let step = (4.0 * t).sin();
            let mut rotations = mean;
            let mut bend = |joint: usize, x: f64, z: f64| {
                rotations[joint] =
                    DQuat::from_rotation_z(z) * DQuat::from_rotation_x(x) * rotations[joint];
            };
            bend(1, -0.1 - 0.35 * step, 0.0);
            bend(2, -0.1 + 0.35 * step, 0.0);
            bend(4, 0.25 + 0.25 * (4.0 * t + 1.2).sin(), 0.0);
            bend(5, 0.25 - 0.25 * (4.0 * t + 1.2).sin(), 0.0);
            bend(16, 0.0, 0.25 * (2.2 * t).sin());
            bend(17, 0.0, 0.3 * (1.7 * t).cos());
            bend(3, 0.05 * step, 0.08 * (1.3 * t).sin());
            rotations[0] = DQuat::from_rotation_y(heading + 0.8 * (0.6 * t).sin());
            MeshPose {
                pelvis: place
                    + DVec3::new(
                        0.4 * (0.9 * t).sin(),
                        0.92 + 0.02 * (8.0 * t).cos(),
                        0.3 * (0.7 * t).cos(),
                    ),
                rotations,
            }
        })
        .collect()
}

/// A detector whose errors are new in every frame: 18 mm an axis (5 pixels at 4.2 m), a bias of 12 mm an axis, 3 %
/// outliers and 5 % of joints not seen. Nothing is exchanged.
pub fn steady(seed: u64) -> Flaws {
    let mut dice = Dice::new(seed, 102);
    let mut flaws = Flaws {
        plane: [0.0, 0.018, 1.0],
        space: [0.03, 0.015, 0.4],
        outlier: 0.03,
        lost: 0.05,
        ..Flaws::NONE
    };
    for bias in &mut flaws.bias[2..] {
        *bias = std::array::from_fn(|_| BIAS * dice.normal());
    }
    flaws
}

/// What cameras see of everybody: by frame, by view, in no order.
pub fn observe(
    views: &[View],
    walkers: &[Walker],
    flaws: Flaws,
    seed: u64,
) -> Vec<Vec<Vec<Observation>>> {
    let mut detectors: Vec<Detector> = (0..views.len() as u64)
        .map(|v| Detector::new(flaws, RATE as f32, seed.wrapping_mul(64) + v))
        .collect();
    let frames = walkers.iter().map(|w| w.poses.len()).min().unwrap_or(0);
    (0..frames)
        .map(|k| {
            let each = views.iter().zip(&mut detectors);
            each.map(|(view, detector)| {
                let people = walkers.iter().zip(1..);
                let lens = view.intrinsics();
                let truth = TruthFrame {
                    frame: k as u64,
                    time_ns: (1e9 * k as f64 / RATE).round() as u64,
                    file: None,
                    camera: TruthCamera {
                        fx: lens.fx,
                        fy: lens.fy,
                        cx: lens.cx,
                        cy: lens.cy,
                        floor: [0.0; 4],
                    },
                    people: people.map(|(w, id)| w.truth(id, k, view)).collect(),
                };
                detector.observe(&truth, view.size).people().to_vec()
            })
            .collect()
        })
        .collect()
}

/// One walker before so many cameras.
pub fn own(seed: u64, views: usize, frames: usize, flaws: Flaws) -> Trial {
    let (views, walker) = (ring(views), Walker::new(frames, seed, DVec3::ZERO));
    let seen = observe(&views, std::slice::from_ref(&walker), flaws, seed);
    Trial {
        views,
        seen,
        joints: walker.joints.clone(),
        stature: walker.stature,
        betas: Some(walker.betas.clone()),
        rate: RATE,
        cast: Cast::Walker(Box::new(walker)),
    }
}

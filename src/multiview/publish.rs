//! Fitted bodies as the messages that every reader of bodies knows, in the calibration's world axes.
//!
//! Joints are the mesh body's; angles and bone rotations are those of the 29-degree skeleton laid into them.

use glam::DVec3;

use super::fit::PersonFit;
use super::points;
use crate::body::BodyModel;
use crate::body::mesh::MeshBody;
use crate::body::skeleton::{BoneLengths, Pose, Posed, Skeleton, bone_rotations, rotation_vector};
use crate::fit::SEEN_THROUGH;
use crate::joints::{BODY_JOINTS, PARENTS, PELVIS};
use crate::message::{Body, BodyState, JointState};
use crate::solve::{Effort, LeastSquares, NormalEquations, Solver};

/// How sure a joint is that two views saw, one, or none.
const SURE: [f32; 3] = [0.95, 0.8, 0.5];

struct Laid<'a> {
    skeleton: &'a Skeleton,
    lengths: &'a BoneLengths,
    targets: &'a [DVec3; BODY_JOINTS],
}

impl LeastSquares for Laid<'_> {
    type State = (Pose, Posed);

    fn envelope(&self) -> &[usize] {
        self.skeleton.elimination().envelope()
    }

    fn cost(&self, (_, posed): &(Pose, Posed)) -> f64 {
        posed
            .joints
            .iter()
            .zip(self.targets)
            .map(|(p, t)| p.distance_squared(*t))
            .sum()
    }

    fn linearise(&self, (_, posed): &(Pose, Posed), out: &mut NormalEquations) {
        let rows = self.skeleton.elimination().rows();
        let mut columns: Vec<(usize, DVec3)> = Vec::new();
        for (j, target) in self.targets.iter().enumerate() {
            let off = posed.joints[j] - *target;
            columns.clear();
            self.skeleton
                .jacobian(posed, j, |d, c| columns.push((rows[d], c)));
            for &(a, ca) in &columns {
                out.pull(a, ca.dot(off));
                for &(b, cb) in &columns {
                    if b <= a {
                        out.add(a, b, ca.dot(cb));
                    }
                }
            }
        }
    }

    fn step(&self, from: &(Pose, Posed), descent: &[f64], to: &mut (Pose, Posed)) {
        let rows = self.skeleton.elimination().rows();
        to.0 = from.0.moved(&std::array::from_fn(|d| -descent[rows[d]]));
        self.skeleton.clamp(&mut to.0.angles);
        self.skeleton.pose(&to.0, self.lengths, &mut to.1);
    }
}

/// One message body a frame of a person, with the frame's number. `stature` in metres, `rate` in frames a second.
pub fn bodies(body: &MeshBody, person: &PersonFit, stature: f64, rate: f64) -> Vec<(usize, Body)> {
    let skeleton = Skeleton::builtin();
    let Some(first) = person.frames.first() else {
        return Vec::new();
    };
    let joints: Vec<[DVec3; BODY_JOINTS]> = person
        .frames
        .iter()
        .map(|f| points::all(body, &f.body.posed))
        .collect();
    let lengths = bone_lengths(&joints);
    let mut state = (Pose::facing_camera(0.0), Posed::default());
    state.0.position = joints[0][PELVIS];
    // The mesh body at rest looks along z with y up, as the skeleton does.
    state.0.rotation = first.body.pose.rotations[0];
    let (mut solver, mut spare) = (Solver::default(), state);
    let mut out = Vec::with_capacity(joints.len());
    for (k, (f, targets)) in person.frames.iter().zip(&joints).enumerate() {
        let problem = Laid {
            skeleton,
            lengths: &lengths,
            targets,
        };
        state.0.position = targets[PELVIS];
        skeleton.pose(&state.0, &lengths, &mut state.1);
        let iterations = if k == 0 { 60 } else { 12 };
        solver.solve(
            &problem,
            Effort {
                iterations,
                tolerance: 1e-6,
            },
            &mut state,
            &mut spare,
        );
        let seen = SEEN_THROUGH.map(|j| {
            let sights = f.moment.sights.iter().flatten();
            sights.filter(|s| s.rays[j].is_some()).count()
        });
        let is_seen = seen.iter().any(|s| *s > 0);
        let confidence = std::array::from_fn(|j| SURE[2 - seen[j].min(2)]);
        let turn = rotation_vector(state.0.rotation);
        let near = [k.saturating_sub(1), (k + 1).min(joints.len() - 1)];
        let span =
            (person.frames[near[1]].frame - person.frames[near[0]].frame).max(1) as f64 / rate;
        let velocity = (joints[near[1]][PELVIS] - joints[near[0]][PELVIS]) / span;
        let message = Body {
            id: person.id,
            state: match is_seen {
                true => BodyState::TRACKED,
                false => BodyState::PREDICTED,
            },
            position: targets[PELVIS].as_vec3().to_array(),
            orientation: state.0.rotation.normalize().as_quat().to_array(),
            velocity: velocity.as_vec3().to_array(),
            angles: std::array::from_fn(|d| match d {
                0..3 => targets[PELVIS][d] as f32,
                3..6 => turn[d - 3] as f32,
                _ => state.0.angles[d - 6] as f32,
            }),
            joints3d: targets.map(|p| p.as_vec3().to_array()),
            score: confidence.iter().sum::<f32>() / BODY_JOINTS as f32,
            confidence,
            height: stature as f32,
            bone_lengths: std::array::from_fn(
                |j| if j == PELVIS { 0.0 } else { lengths[j] as f32 },
            ),
            bone_rotations: bone_rotations(&state.1).map(|q| q.as_quat().to_array()),
            joint_states: std::array::from_fn(|j| match seen[j] {
                0 if is_seen => JointState::OCCLUDED,
                0 => JointState::PREDICTED,
                _ => JointState::OBSERVED,
            }),
            ..Body::default()
        };
        out.push((f.frame, message));
    }
    out
}

/// Mean distances between joints: the body's, apart from what a spine and shoulders bend.
fn bone_lengths(joints: &[[DVec3; BODY_JOINTS]]) -> BoneLengths {
    std::array::from_fn(|j| {
        let each = joints.iter().map(|p| p[j].distance(p[PARENTS[j]]));
        each.sum::<f64>() / joints.len() as f64
    })
}

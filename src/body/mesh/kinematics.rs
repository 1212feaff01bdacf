//! Where a posed body's joints are, and how they move with its pose and shape.

use glam::{DMat3, DQuat, DVec3};

use super::{JOINTS, MeshBody, PARENTS, REPORTED, first_turn};
use crate::body::model::{BodyModel, Elimination};

/// The joint that carries each of edgecap's joints along: a head top moves with the head, a hand with the wrist's
/// joint.
pub(super) const CARRIERS: [usize; REPORTED] = [
    15, 12, 17, 19, 21, 16, 18, 20, 2, 5, 8, 1, 4, 7, 0, 6, 15, 23, 22, 11, 10,
];

/// A pose: where the pelvis is, metres, and how every joint is turned against its parent; the root's rotation takes the
/// body's axes (x to its left, y up, z forward) to those it is wanted in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshPose {
    /// Place of the pelvis' joint.
    pub pelvis: DVec3,
    /// Rotations, the root's first.
    pub rotations: [DQuat; JOINTS],
}

/// What stays a person's own: shape coefficients, and where they put the joints at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    betas: Vec<f64>,
    joints: [DVec3; JOINTS],
    /// Edgecap's joints against their carriers.
    reported: [DVec3; REPORTED],
}

impl Person {
    /// Shape coefficients, in standard deviations.
    pub fn betas(&self) -> &[f64] {
        &self.betas
    }

    /// Joints at rest, metres.
    pub fn joints(&self) -> &[DVec3; JOINTS] {
        &self.joints
    }
}

/// A posed tree: global rotations and places of the joints.
#[derive(Debug, Clone, PartialEq)]
pub struct PosedTree {
    pub(super) turn: [DMat3; JOINTS],
    pub(super) place: [DVec3; JOINTS],
    reported: [DVec3; REPORTED],
}

impl Default for PosedTree {
    fn default() -> Self {
        Self {
            turn: [DMat3::IDENTITY; JOINTS],
            place: [DVec3::ZERO; JOINTS],
            reported: [DVec3::ZERO; REPORTED],
        }
    }
}

impl PosedTree {
    /// Places of the tree's joints, metres.
    pub fn joints(&self) -> &[DVec3; JOINTS] {
        &self.place
    }

    /// Global rotations: from the body's axes at rest.
    pub fn rotations(&self) -> &[DMat3; JOINTS] {
        &self.turn
    }

    /// Edgecap's joints, in the order of the messages.
    pub fn reported(&self) -> &[DVec3; REPORTED] {
        &self.reported
    }
}

/// Degrees of freedom that move a joint, in rising order: the pelvis' place and the rotations above it.
pub(super) fn moved_by(joint: usize) -> Vec<usize> {
    let mut above: Vec<usize> =
        std::iter::successors(Some(PARENTS[joint]), |&a| (a != 0).then(|| PARENTS[a]))
            .filter(|&a| a != joint)
            .collect();
    above.sort_unstable();
    let turns = above
        .iter()
        .flat_map(|&a| (0..3).map(move |k| first_turn(a) + k));
    (0..3).chain(turns).collect()
}

impl MeshBody {
    /// The person of these shape coefficients; those not given are 0.
    ///
    /// # Panics
    /// When there are more coefficients than [`MeshBody::components`].
    pub fn person(&self, betas: &[f64]) -> Person {
        assert!(
            betas.len() <= self.components(),
            "expected at most {} shape coefficients, found {}",
            self.components(),
            betas.len()
        );
        let mut joints = self.joints.map(DVec3::from);
        for (beta, moves) in betas.iter().zip(&self.joint_components) {
            for (joint, step) in joints.iter_mut().zip(moves) {
                *joint += *beta * DVec3::from(*step);
            }
        }
        let own = &self.reported;
        let mut reported = own.rest.map(DVec3::from);
        for (beta, moves) in betas.iter().zip(&own.components) {
            for (joint, step) in reported.iter_mut().zip(moves) {
                *joint += *beta * DVec3::from(*step);
            }
        }
        for (joint, &carrier) in reported.iter_mut().zip(&own.carrier) {
            *joint -= joints[carrier];
        }
        Person {
            betas: betas.to_vec(),
            joints,
            reported,
        }
    }

    /// How a joint of a posed tree moves with a shape coefficient, metres a standard deviation, the pelvis held.
    pub fn joint_by_shape(&self, posed: &PosedTree, joint: usize, component: usize) -> DVec3 {
        let step = |j: usize| DVec3::from(self.joint_components[component][j]);
        let mut sum = DVec3::ZERO;
        let mut at = joint;
        while at != 0 {
            let parent = PARENTS[at];
            sum += posed.turn[parent] * (step(at) - step(parent));
            at = parent;
        }
        sum
    }

    /// The same of one of edgecap's joints.
    pub fn reported_by_shape(&self, posed: &PosedTree, joint: usize, component: usize) -> DVec3 {
        let own = &self.reported;
        let carrier = own.carrier[joint];
        let against = DVec3::from(own.components[component][joint])
            - DVec3::from(self.joint_components[component][carrier]);
        self.joint_by_shape(posed, carrier, component) + posed.turn[carrier] * against
    }

    /// Calls `column` with every degree of freedom that moves one of edgecap's joints, in rising order, and its
    /// derivative.
    pub fn reported_jacobian(
        &self,
        posed: &PosedTree,
        joint: usize,
        mut column: impl FnMut(usize, DVec3),
    ) {
        let carrier = self.reported.carrier[joint];
        derivatives(posed, carrier, posed.reported[joint], true, &mut column);
    }
}

/// Derivatives of a point that moves with `joint`; with its own rotation, too, where `own`.
fn derivatives(
    posed: &PosedTree,
    joint: usize,
    point: DVec3,
    own: bool,
    column: &mut impl FnMut(usize, DVec3),
) {
    for (k, axis) in DVec3::AXES.into_iter().enumerate() {
        column(k, axis);
    }
    let mut chain = [0; JOINTS];
    let mut length = 0;
    let mut at = joint;
    let mut counts = own;
    loop {
        if counts {
            chain[length] = at;
            length += 1;
        }
        if at == 0 {
            break;
        }
        at = PARENTS[at];
        counts = true;
    }
    // Parents come before children in the tree's order, so the chain read backwards rises.
    for &a in chain[..length].iter().rev() {
        let frame = if a == 0 {
            DMat3::IDENTITY
        } else {
            posed.turn[PARENTS[a]]
        };
        let arm = point - posed.place[a];
        for k in 0..3 {
            column(first_turn(a) + k, frame.col(k).cross(arm));
        }
    }
}

/// A step turns a joint about the axes of its parent, the root about those of the world.
impl BodyModel for MeshBody {
    type Pose = MeshPose;
    type Shape = Person;
    type Posed = PosedTree;

    /// In camera axes: y down, the face towards the camera.
    fn rest_pose(&self) -> MeshPose {
        let mut rotations = [DQuat::IDENTITY; JOINTS];
        rotations[0] = DQuat::from_rotation_x(std::f64::consts::PI);
        MeshPose {
            pelvis: DVec3::ZERO,
            rotations,
        }
    }

    fn moved(&self, pose: &MeshPose, step: &[f64]) -> MeshPose {
        let mut moved = *pose;
        moved.pelvis += DVec3::from_slice(step);
        for (rotation, by) in moved.rotations.iter_mut().zip(step[3..].chunks_exact(3)) {
            *rotation = (DQuat::from_scaled_axis(DVec3::from_slice(by)) * *rotation).normalize();
        }
        moved
    }

    fn kinematics(&self, pose: &MeshPose, person: &Person, out: &mut PosedTree) {
        out.turn[0] = DMat3::from_quat(pose.rotations[0]);
        out.place[0] = pose.pelvis;
        for (joint, &parent) in PARENTS.iter().enumerate().skip(1) {
            out.turn[joint] = out.turn[parent] * DMat3::from_quat(pose.rotations[joint]);
            out.place[joint] = out.place[parent]
                + out.turn[parent] * (person.joints[joint] - person.joints[parent]);
        }
        for (k, &carrier) in self.reported.carrier.iter().enumerate() {
            out.reported[k] = out.place[carrier] + out.turn[carrier] * person.reported[k];
        }
    }

    fn jacobian(&self, posed: &PosedTree, joint: usize, mut column: impl FnMut(usize, DVec3)) {
        derivatives(posed, joint, posed.place[joint], false, &mut column);
    }

    fn elimination(&self) -> &Elimination {
        &self.elimination
    }
}

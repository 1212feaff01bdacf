//! The mesh body: a shape and a pose of SMPL's tree go in, joints and a skinned mesh come out.
//!
//! Loper et al., SMPL: A Skinned Multi-Person Linear Model (SIGGRAPH Asia 2015). Files of that format are read by
//! [`MeshBody::read`]; [`MeshBody::shipped`] is this project's own (`models/body`). Metres; a body at rest has x to its
//! left, y up, z forward.

mod error;
mod kinematics;
mod read;
mod skin;
mod surface;

use std::sync::OnceLock;

pub use error::MeshError;
pub use kinematics::{MeshPose, Person, PosedTree};
pub use skin::Skin;
pub use surface::Surface;

use super::model::Elimination;

/// Joints of the tree.
pub const JOINTS: usize = 24;
/// Degrees of freedom of a pose: the pelvis' place and a rotation of every joint.
pub const FREEDOM: usize = 3 + 3 * JOINTS;
/// First of the three degrees of freedom that turn a joint of the tree, a number an axis of its parent's, of the
/// world's for the root.
pub const fn first_turn(joint: usize) -> usize {
    3 + 3 * joint
}
/// Joints of edgecap's own that a body may know a regressor of.
pub const REPORTED: usize = crate::joints::BODY_JOINTS;
/// The joint that every joint hangs on; the root's is itself.
pub const PARENTS: [usize; JOINTS] = [
    0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21,
];
/// SMPL's names of the joints.
pub const NAMES: [&str; JOINTS] = [
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
];
/// Values a vertex in `posedirs` has for a pose: nine of every rotation but the root's.
const CORRECTIVES: usize = 9 * (JOINTS - 1);

static SHIPPED: &[u8] = include_bytes!("../../../models/body/body.npz");

/// A body model: what a shape and a pose make of a mesh.
#[derive(Debug, Clone)]
pub struct MeshBody {
    template: Vec<[f32; 3]>,
    /// Component after component, a displacement of every vertex.
    components: Vec<Vec<[f32; 3]>>,
    /// `CORRECTIVES` × vertices, or empty.
    correctives: Vec<Vec<[f32; 3]>>,
    faces: Vec<[u32; 3]>,
    weights: skin::Weights,
    /// Where the joints of the mean body are, and how every component moves them.
    joints: [[f64; 3]; JOINTS],
    joint_components: Vec<[[f64; 3]; JOINTS]>,
    reported: Reported,
    elimination: Elimination,
}

/// Where edgecap's joints are on the body at rest, and which joint carries each.
#[derive(Debug, Clone)]
struct Reported {
    carrier: [usize; REPORTED],
    rest: [[f64; 3]; REPORTED],
    components: Vec<[[f64; 3]; REPORTED]>,
}

impl MeshBody {
    /// The body that comes with the program, CC0.
    ///
    /// # Panics
    /// If the embedded file is damaged, which the tests rule out.
    pub fn shipped() -> &'static Self {
        static BODY: OnceLock<MeshBody> = OnceLock::new();
        BODY.get_or_init(|| {
            Self::read(std::io::Cursor::new(SHIPPED)).expect("the embedded body model is intact")
        })
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.template.len()
    }

    /// Number of shape components.
    pub fn components(&self) -> usize {
        self.components.len()
    }

    /// Triangles, three vertices each, counter-clockwise seen from outside.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// Which joints move a vertex, and how much: 1 in all.
    pub fn influences(&self, vertex: usize) -> &[(u8, f32)] {
        self.weights.of(vertex)
    }
}

#[cfg(test)]
mod tests;

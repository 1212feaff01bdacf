//! A body while it is fitted: pose, shape, and where they put the joints.

use crate::body::BodyModel;
use crate::body::mesh::{MeshBody, MeshPose, Person, PosedTree};

/// A body that is being fitted.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// The pose.
    pub pose: MeshPose,
    /// The person.
    pub person: Person,
    /// Where that puts the joints.
    pub posed: PosedTree,
}

impl Fitted {
    /// A body of this pose and shape.
    pub fn new(body: &MeshBody, pose: MeshPose, betas: &[f64]) -> Self {
        let person = body.person(betas);
        let mut posed = PosedTree::default();
        body.kinematics(&pose, &person, &mut posed);
        Self {
            pose,
            person,
            posed,
        }
    }
}

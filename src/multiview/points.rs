//! The joints of a mesh body that views can see.

use glam::DVec3;

use crate::body::mesh::{MeshBody, PosedTree};
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};

/// The evidence joints.
pub fn evidence(posed: &PosedTree) -> [DVec3; EVIDENCE_JOINTS] {
    std::array::from_fn(|j| posed.reported()[j])
}

/// All of edgecap's joints.
pub fn all(posed: &PosedTree) -> [DVec3; BODY_JOINTS] {
    *posed.reported()
}

/// Calls `column` with every parameter that moves a joint and its derivative: those of the pose, then the first
/// `shapes` shape coefficients, numbered from `first_shape`.
pub fn jacobian(
    body: &MeshBody,
    posed: &PosedTree,
    j: usize,
    (first_shape, shapes): (usize, usize),
    mut column: impl FnMut(usize, DVec3),
) {
    body.reported_jacobian(posed, j, &mut column);
    for c in 0..shapes {
        column(first_shape + c, body.reported_by_shape(posed, j, c));
    }
}

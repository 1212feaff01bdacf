//! The joints of a mesh body that views can see: its own where it knows them, the tree's nearest where it does not.

use glam::DVec3;

use crate::body::BodyModel;
use crate::body::mesh::{MeshBody, PosedTree};
use crate::joints::{BODY_JOINTS, EVIDENCE_JOINTS};

/// For edgecap's joints the joints of SMPL's tree at the same place; none for the head's top, hands' and feet's tips
/// apart.
const TREE: [Option<usize>; BODY_JOINTS] = [
    None,
    Some(12),
    Some(17),
    Some(19),
    Some(21),
    Some(16),
    Some(18),
    Some(20),
    Some(2),
    Some(5),
    Some(8),
    Some(1),
    Some(4),
    Some(7),
    Some(0),
    Some(6),
    Some(15),
    Some(23),
    Some(22),
    Some(11),
    Some(10),
];

/// Where joint `j` of edgecap's is; `None` where the body has none.
pub fn point(body: &MeshBody, posed: &PosedTree, j: usize) -> Option<DVec3> {
    if body.reports() {
        return Some(posed.reported()[j]);
    }
    TREE[j].map(|t| posed.joints()[t])
}

/// The evidence joints; the head's top above the head's joint where the body has none.
pub fn evidence(body: &MeshBody, posed: &PosedTree) -> [DVec3; EVIDENCE_JOINTS] {
    std::array::from_fn(|j| point(body, posed, j).unwrap_or_else(|| head_top(posed)))
}

/// All of edgecap's joints, likewise.
pub fn all(body: &MeshBody, posed: &PosedTree) -> [DVec3; BODY_JOINTS] {
    std::array::from_fn(|j| point(body, posed, j).unwrap_or_else(|| head_top(posed)))
}

/// A head's length above its joint, for bodies that do not say.
fn head_top(posed: &PosedTree) -> DVec3 {
    posed.joints()[15] + posed.rotations()[15] * DVec3::new(0.0, 0.2, 0.0)
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
    if body.reports() {
        body.reported_jacobian(posed, j, &mut column);
    } else if let Some(t) = TREE[j] {
        body.jacobian(posed, t, &mut column);
    } else {
        return;
    }
    for c in 0..shapes {
        let moves = match TREE[j] {
            Some(t) if !body.reports() => body.joint_by_shape(posed, t, c),
            _ => body.reported_by_shape(posed, j, c),
        };
        column(first_shape + c, moves);
    }
}

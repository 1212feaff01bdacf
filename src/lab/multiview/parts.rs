//! Frames of a fitted person and the true one of the same model go in, how far vertices of posed meshes are apart comes
//! out, by part of the body.

use glam::Vec3;

use super::own::Walker;
use crate::body::BodyModel;
use crate::body::mesh::{JOINTS, MeshBody, MeshPose, Person, PosedTree, Skin};
use crate::multiview::PersonFrame;

/// Parts of a body; the neck is the head's.
pub const PARTS: [&str; 8] = [
    "head",
    "trunk",
    "upper arms",
    "forearms",
    "hands",
    "thighs",
    "shanks",
    "feet",
];
/// The part that each joint moves.
const OF_JOINT: [usize; JOINTS] = [
    1, 5, 5, 1, 6, 6, 1, 7, 7, 1, 7, 7, 0, 1, 1, 0, 2, 2, 3, 3, 4, 4, 4, 4,
];

/// Mean distance of the posed meshes' vertices in the world by part, metres. A vertex is of the part whose joint moves
/// it most.
pub fn apart(frames: &[PersonFrame], truth: &Walker) -> [f64; PARTS.len()] {
    let body = MeshBody::shipped();
    let strongest = |v: usize| {
        let most = body.influences(v).iter().max_by(|a, b| a.1.total_cmp(&b.1));
        OF_JOINT[usize::from(most.map_or(0, |(joint, _)| *joint))]
    };
    let part: Vec<usize> = (0..body.vertices()).map(strongest).collect();
    let (mut sums, mut counts) = ([0.0; PARTS.len()], [0.0_f64; PARTS.len()]);
    let own = body.person(&truth.betas);
    let mut own_skin = Skin::new(body, &own);
    for f in frames {
        let mut skin = Skin::new(body, &f.body.person);
        let found = posed(&mut skin, &f.body.person, &f.body.pose);
        let real = posed(&mut own_skin, &own, &truth.poses[f.frame]);
        for ((a, b), part) in found.iter().zip(&real).zip(&part) {
            sums[*part] += f64::from(a.distance(*b));
            counts[*part] += 1.0;
        }
    }
    std::array::from_fn(|k| sums[k] / counts[k].max(1.0))
}

fn posed(skin: &mut Skin, person: &Person, pose: &MeshPose) -> Vec<Vec3> {
    let body = MeshBody::shipped();
    let (mut tree, mut vertices) = (PosedTree::default(), Vec::new());
    body.kinematics(pose, person, &mut tree);
    skin.pose(body, pose, &tree, &mut vertices);
    vertices
}

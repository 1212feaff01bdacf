//! A person of `synth` without clothes and hair: a shape of the mesh body goes in, how far the two surfaces are apart
//! comes out, the person's limbs turned as those of the body at rest.

use glam::{DQuat, Quat, Vec3};

use super::shell::{Shell, apart};
use crate::body::BodyModel;
use crate::body::mesh::{JOINTS, MeshBody, MeshPose, PosedTree, Skin};
use crate::joints::{
    BODY_JOINTS, L_ANKLE, L_ELBOW, L_FOOT_TIP, L_HAND, L_KNEE, L_WRIST, R_ANKLE, R_ELBOW,
    R_FOOT_TIP, R_HAND, R_KNEE, R_WRIST,
};
use crate::lab::synth::outfit::{Hair, Outfit};
use crate::lab::synth::pose::Posed;
use crate::lab::synth::scene::Person;
use crate::lab::synth::shape::{BONE_PARENT, BONE_PIVOT, BONES, JOINT_BONE};
use crate::multiview::body_joints;

/// Size of the skin's cells, metres.
const SKIN: f32 = 0.0125;
/// Bones of arms, hands, legs and feet, and the joint that each points to. Trunk and head stand alike in both.
const LIMBS: [(usize, usize); 12] = [
    (4, R_ELBOW),
    (5, R_WRIST),
    (6, R_HAND),
    (8, L_ELBOW),
    (9, L_WRIST),
    (10, L_HAND),
    (11, R_KNEE),
    (12, R_ANKLE),
    (13, R_FOOT_TIP),
    (14, L_KNEE),
    (15, L_ANKLE),
    (16, L_FOOT_TIP),
];

/// A person without clothes and hair, shoes apart.
#[derive(Debug, Clone)]
pub struct Bare(Person);

impl Bare {
    /// The same person undressed.
    pub fn new(person: &Person) -> Self {
        let outfit = Outfit {
            hair: Hair::Bald,
            bare_chest: true,
            trouser: 0.0,
            skirt: None,
            top_ease: 0.0,
            bottom_ease: 0.0,
            bag: false,
            ..person.outfit.clone()
        };
        Self(Person::new(person.id, person.shape.clone(), outfit, SKIN))
    }

    /// Mean distance of the vertices of the mesh body at rest from this person's skin, and of the skin's vertices from
    /// the body, metres.
    pub fn apart(&self, betas: &[f64]) -> [f64; 2] {
        let body = MeshBody::shipped();
        let person = body.person(betas);
        let at_rest = MeshPose {
            pelvis: person.joints()[0],
            rotations: [DQuat::IDENTITY; JOINTS],
        };
        let mut posed = PosedTree::default();
        body.kinematics(&at_rest, &person, &mut posed);
        let joints = body_joints(&posed).map(|j| j.as_vec3());
        let rest = Skin::new(body, &person).rest().collect();
        let rest = Shell::new(rest, body.faces().to_vec());
        apart(&rest, &self.skin(&joints))
    }

    /// The skin with limbs that point as between these joints, near them, metres.
    fn skin(&self, joints: &[Vec3; BODY_JOINTS]) -> Shell {
        let (shape, mesh) = (&self.0.shape, self.0.mesh());
        let mut turn = [Quat::IDENTITY; BONES];
        for (bone, end) in LIMBS {
            let start = BONE_PIVOT[bone];
            let along = |all: &[Vec3; BODY_JOINTS]| (all[end] - all[start]).normalize();
            turn[bone] = Quat::from_rotation_arc(along(&shape.joints), along(joints));
        }
        let mut at = [shape.pivot(0); BONES];
        for b in 1..BONES {
            let p = BONE_PARENT[b];
            at[b] = at[p] + turn[p] * (shape.pivot(b) - shape.pivot(p));
        }
        let own: [Vec3; BODY_JOINTS] = std::array::from_fn(|j| {
            let b = JOINT_BONE[j];
            at[b] + turn[b] * (shape.joints[j] - shape.pivot(b))
        });
        let off = joints.iter().sum::<Vec3>() - own.iter().sum::<Vec3>();
        let off = off / BODY_JOINTS as f32;
        let posed = Posed {
            turn,
            at: at.map(|p| p + off),
            joints: own.map(|p| p + off),
        };
        Shell::new(mesh.pose(&posed, &self.0.pivots).0, mesh.triangles.clone())
    }
}

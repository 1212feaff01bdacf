//! A person's build: chance goes in, rest joints and bone pivots of one person come out.
//!
//! Body space: x to the person's left, y up, z to the front, metres; the rest pose stands on y = 0 with straight legs
//! and arms 45° away from the body.

use glam::Vec3;

use super::noise::Dice;
use crate::joints::{
    BODY_JOINTS, HEAD_TOP, L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, NECK, PELVIS,
    R_ANKLE, R_ELBOW, R_HIP, R_KNEE, R_SHOULDER, R_WRIST, SPINE,
};

/// Bones that move rigidly; values index every per-bone array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // the names say it: R and L are the person's own right and left
pub enum Bone {
    Pelvis,
    Chest,
    Head,
    RClavicle,
    RUpperArm,
    RForearm,
    RHand,
    LClavicle,
    LUpperArm,
    LForearm,
    LHand,
    RThigh,
    RShin,
    RFoot,
    LThigh,
    LShin,
    LFoot,
}

/// Number of [`Bone`]s.
pub const BONES: usize = 17;

/// Parent of every bone (parents come first); the pelvis is its own.
pub const BONE_PARENT: [usize; BONES] = [0, 0, 1, 1, 3, 4, 5, 1, 7, 8, 9, 0, 11, 12, 0, 14, 15];
/// Body joint about which a bone turns.
pub const BONE_PIVOT: [usize; BONES] = [
    PELVIS, SPINE, NECK, NECK, R_SHOULDER, R_ELBOW, R_WRIST, NECK, L_SHOULDER, L_ELBOW, L_WRIST,
    R_HIP, R_KNEE, R_ANKLE, L_HIP, L_KNEE, L_ANKLE,
];
/// Bone that carries each body joint.
pub const JOINT_BONE: [usize; BODY_JOINTS] = [
    2, 1, 3, 4, 5, 7, 8, 9, 0, 11, 12, 0, 14, 15, 0, 0, 2, 6, 10, 13, 16,
];
/// Angle of the rest pose's arms from hanging, radians.
pub const REST_ARM: f32 = std::f32::consts::FRAC_PI_4;

/// Build of one person.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Crown to floor, metres, without hair.
    pub stature: f32,
    /// 0 masculine to 1 feminine proportions.
    pub feminine: f32,
    /// −1 thin to 1 heavy.
    pub bulk: f32,
    /// −1 slack to 1 muscular.
    pub muscle: f32,
    /// Rest position of the body joints.
    pub joints: [Vec3; BODY_JOINTS],
}

impl Shape {
    /// A random adult or youth, 1.45–2.0 m.
    pub fn random(dice: &mut Dice) -> Self {
        let feminine = if dice.chance(0.5) {
            dice.range(0.75, 1.0)
        } else {
            dice.range(0.0, 0.25)
        };
        let stature = (1.76 - 0.12 * feminine + 0.075 * dice.normal()).clamp(1.45, 2.0);
        let bulk = (0.42 * dice.normal()).clamp(-0.9, 1.0);
        let muscle = (0.5 * dice.normal() - 0.3 * feminine).clamp(-1.0, 1.0);
        Self::new(stature, feminine, bulk, muscle, dice)
    }

    /// A person with the given build and small random proportions.
    pub fn new(stature: f32, feminine: f32, bulk: f32, muscle: f32, dice: &mut Dice) -> Self {
        let leg = 1.0 + 0.022 * dice.normal().clamp(-2.0, 2.0);
        let arm = 1.0 + 0.03 * dice.normal().clamp(-2.0, 2.0);
        let shoulder = (0.109 - 0.010 * feminine + 0.004 * muscle)
            * (1.0 + 0.04 * dice.normal().clamp(-2.0, 2.0));
        let hip = 0.060 + 0.004 * feminine;
        let hip_y = 0.518 * leg;
        let pelvis_y = hip_y + 0.006;
        let trunk = 0.845 - 0.524;
        let neck_y = 0.845 + 0.4 * (pelvis_y - 0.524);
        let up = |f: f32| pelvis_y + (neck_y - pelvis_y) * f;
        let down = Vec3::new(REST_ARM.sin(), -REST_ARM.cos(), 0.0);
        let mirror = |p: Vec3| Vec3::new(-p.x, p.y, p.z);
        let l_sho = Vec3::new(shoulder, up((0.789 - 0.524) / trunk), -0.002);
        let l_elb = l_sho + down * 0.160 * arm;
        let l_wri = l_elb + down * 0.142 * arm;
        let l_hand = l_wri + down * 0.058 * arm;
        let l_hip = Vec3::new(hip, hip_y, 0.0);
        let l_kne = Vec3::new(hip + 0.006, 0.2865 * leg, 0.006);
        let l_ank = Vec3::new(hip + 0.008, 0.039, -0.008);
        let l_toe = Vec3::new(hip + 0.016, 0.010, 0.100);
        let top = neck_y + 0.149;
        let joints = [
            Vec3::new(0.0, top, 0.016),
            Vec3::new(0.0, neck_y, 0.0),
            mirror(l_sho),
            mirror(l_elb),
            mirror(l_wri),
            l_sho,
            l_elb,
            l_wri,
            mirror(l_hip),
            mirror(l_kne),
            mirror(l_ank),
            l_hip,
            l_kne,
            l_ank,
            Vec3::new(0.0, pelvis_y, 0.0),
            Vec3::new(0.0, up((0.656 - 0.524) / trunk), -0.008),
            Vec3::new(0.0, neck_y + 0.0595, 0.018),
            mirror(l_hand),
            l_hand,
            mirror(l_toe),
            l_toe,
        ];
        // Proportions above are fractions of an average stature: bring the crown to the wanted one.
        let scale = stature / (top + 0.006);
        Self {
            stature,
            feminine,
            bulk,
            muscle,
            joints: joints.map(|p| p * scale),
        }
    }

    /// Position about which a bone turns, rest pose.
    pub fn pivot(&self, bone: usize) -> Vec3 {
        self.joints[BONE_PIVOT[bone]]
    }

    /// Rest position of a point of the proportion tables (fractions of an average stature): heights move with the
    /// joints between which they lie.
    pub fn at(&self, x: f32, y: f32, z: f32) -> Vec3 {
        let s = self.unit();
        let (hip, neck) = (self.joints[L_HIP].y / s, self.joints[NECK].y / s);
        let y = if y < 0.518 {
            y * hip / 0.518
        } else if y < 0.845 {
            hip + (y - 0.518) * (neck - hip) / (0.845 - 0.518)
        } else {
            neck + y - 0.845
        };
        Vec3::new(x, y, z) * s
    }

    /// Metres per unit of the proportion tables.
    pub fn unit(&self) -> f32 {
        (self.joints[HEAD_TOP].y - self.joints[NECK].y) / 0.149
    }
}

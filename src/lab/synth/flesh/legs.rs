//! Legs with trousers and shoes.

use glam::Vec3;

use super::Sculptor;
use crate::joints::{ANKLES, FOOT_TIPS, HIPS, KNEES};
use crate::lab::synth::outfit::Matter;
use crate::lab::synth::shape::Bone;

impl Sculptor<'_> {
    /// The right (0) or left (1) leg.
    pub(super) fn leg(&mut self, side: usize) {
        let (u, limb, outfit) = (self.u, self.limb, self.outfit);
        let s = if side == 0 { -1.0 } else { 1.0 };
        let j = &self.shape.joints;
        let [hip, kne, ank] = [HIPS, KNEES, ANKLES].map(|pair| j[pair[side]]);
        let toe = j[FOOT_TIPS[side]];
        let [thigh_bone, shin, foot] = if side == 0 {
            [Bone::RThigh, Bone::RShin, Bone::RFoot]
        } else {
            [Bone::LThigh, Bone::LShin, Bone::LFoot]
        };
        let leg_fem = 1.0 + 0.05 * self.shape.feminine;
        let (rt, rm, rk, rc, ra) = (
            0.0500 * limb * leg_fem,
            0.0440 * limb * leg_fem,
            0.0300 * limb,
            0.0325 * limb,
            0.0205 * (0.5 * limb + 0.5 * u),
        );
        let groin = hip + Vec3::new(s * 0.004, -0.022, -0.004) * u;
        let thigh = hip.lerp(kne, 0.42);
        let calf = kne.lerp(ank, 0.28) + Vec3::new(0.0, 0.0, -0.010) * u;
        self.cone([groin, thigh], [rt, rm], 0.012, Matter::Skin, thigh_bone);
        self.cone([thigh, kne], [rm, rk], 0.012, Matter::Skin, thigh_bone);
        self.cone([kne, calf], [rk * 0.98, rc], 0.015, Matter::Skin, shin);
        self.cone([calf, ank], [rc, ra], 0.015, Matter::Skin, shin);
        let e = outfit.bottom_ease;
        let upper = outfit.trouser.min(1.0);
        let radius = |t: f32, bare: f32| bare + e * (0.6 + 0.6 * t) + 0.016 * outfit.flare * t;
        if upper > 0.05 {
            let r_top = rt + 0.5 * e;
            if upper < 0.42 {
                self.cone(
                    [groin, hip.lerp(kne, upper)],
                    [r_top, radius(0.3, rm)],
                    0.01,
                    Matter::Bottom,
                    thigh_bone,
                );
            } else {
                self.cone(
                    [groin, thigh],
                    [r_top, radius(0.42, rm)],
                    0.01,
                    Matter::Bottom,
                    thigh_bone,
                );
                let t = (upper - 0.42) / 0.58;
                self.cone(
                    [thigh, hip.lerp(kne, upper)],
                    [radius(0.42, rm), radius(upper, rm + (rk - rm) * t)],
                    0.01,
                    Matter::Bottom,
                    thigh_bone,
                );
            }
        }
        if outfit.trouser > 1.0 {
            let lower = (outfit.trouser - 1.0).min(0.97);
            let end = kne.lerp(ank, lower);
            let mid = kne.lerp(ank, 0.28 * lower.min(1.0));
            self.cone(
                [kne, mid],
                [radius(1.0, rk), radius(1.2, rc)],
                0.01,
                Matter::Bottom,
                shin,
            );
            self.cone(
                [mid, end],
                [
                    radius(1.2, rc),
                    radius(1.0 + lower, rc + (ra - rc) * 0.8 * lower),
                ],
                0.01,
                Matter::Bottom,
                shin,
            );
        }
        // shoe: heel, ball, toes, flat below
        let heel = Vec3::new(ank.x, 0.019 * u, ank.z - 0.020 * u);
        let tip = Vec3::new(toe.x, 0.0135 * u, toe.z + 0.006 * u);
        let ball = Vec3::new(ank.x + s * 0.006 * u, 0.016 * u, ank.z + 0.068 * u);
        self.cone(
            [ank, heel],
            [ra * 1.1, 0.0215 * u],
            0.012,
            Matter::Shoe,
            foot,
        );
        self.cone(
            [heel, ball],
            [0.0215 * u, 0.0235 * u],
            0.012,
            Matter::Shoe,
            foot,
        );
        self.cone(
            [ank + Vec3::new(0.0, -0.004, 0.012) * u, ball],
            [0.020 * u, 0.0205 * u],
            0.012,
            Matter::Shoe,
            foot,
        );
        self.cone(
            [ball, tip],
            [0.0235 * u, 0.0165 * u],
            0.012,
            Matter::Shoe,
            foot,
        );
    }
}

//! Arms with sleeves and hands.

use glam::{Quat, Vec3};

use super::Sculptor;
use crate::joints::{ELBOWS, HANDS, SHOULDERS, WRISTS};
use crate::lab::synth::outfit::Matter;
use crate::lab::synth::shape::{Bone, REST_ARM};

impl Sculptor<'_> {
    /// The right (0) or left (1) arm.
    pub(super) fn arm(&mut self, side: usize) {
        let (u, limb, outfit) = (self.u, self.limb, self.outfit);
        let s = if side == 0 { -1.0 } else { 1.0 };
        let j = &self.shape.joints;
        let [sho, elb, wri] = [SHOULDERS, ELBOWS, WRISTS].map(|pair| j[pair[side]]);
        let hand = j[HANDS[side]];
        let [clavicle, upper_arm, forearm, palm] = if side == 0 {
            [
                Bone::RClavicle,
                Bone::RUpperArm,
                Bone::RForearm,
                Bone::RHand,
            ]
        } else {
            [
                Bone::LClavicle,
                Bone::LUpperArm,
                Bone::LForearm,
                Bone::LHand,
            ]
        };
        let arm_fem = 1.0 - 0.12 * self.shape.feminine;
        let (rs, rb, re, rf, rw) = (
            0.0315 * limb * arm_fem,
            0.0285 * limb * arm_fem,
            0.0225 * limb * arm_fem,
            0.0240 * limb * arm_fem,
            0.0148 * (0.6 * limb + 0.4 * u) * arm_fem,
        );
        let mid = sho.lerp(elb, 0.45);
        let fore = elb.lerp(wri, 0.25);
        self.cone(
            [sho + (elb - sho) * 0.04, mid],
            [rs * 0.95, rb],
            0.015,
            Matter::Skin,
            upper_arm,
        );
        self.cone([mid, elb], [rb, re], 0.015, Matter::Skin, upper_arm);
        self.cone([elb, fore], [re * 0.98, rf], 0.015, Matter::Skin, forearm);
        self.cone([fore, wri], [rf, rw], 0.012, Matter::Skin, forearm);
        // deltoid
        self.cone(
            [
                sho + Vec3::new(-s * 0.020 * u, 0.004 * u, 0.0),
                sho + Vec3::new(s * 0.004 * u, 0.0, 0.0),
            ],
            [0.027 * limb * arm_fem, 0.0295 * limb * arm_fem],
            0.02,
            Matter::Skin,
            clavicle,
        );
        if outfit.sleeve >= 0.0 && !outfit.bare_chest {
            let e = outfit.top_ease * 0.8 + 0.002;
            let upper = outfit.sleeve.min(1.0);
            let end = sho.lerp(elb, upper);
            let r_end = rs + (re - rs) * upper + e * (1.0 + 0.4 * (1.0 - upper));
            self.cone(
                [sho + (elb - sho) * 0.06, end],
                [rs * 0.97 + 0.8 * e, r_end],
                0.012,
                Matter::Top,
                upper_arm,
            );
            self.cone(
                [sho + Vec3::new(-s * 0.022 * u, 0.004 * u, 0.0), sho],
                [0.026 * limb * arm_fem + e, 0.028 * limb * arm_fem + e],
                0.015,
                Matter::Top,
                clavicle,
            );
            if outfit.sleeve > 1.0 {
                let lower = (outfit.sleeve - 1.0).min(1.0);
                self.cone(
                    [elb, elb.lerp(wri, lower)],
                    [re + e, rf + (rw * 1.1 - rf) * lower + e],
                    0.012,
                    Matter::Top,
                    forearm,
                );
            }
        }
        // hand: palm, fingers, thumb; the palm faces the thigh, the thumb points forwards
        let along = (hand - wri).normalize();
        let turn = Quat::from_rotation_z(s * REST_ARM);
        self.egg(
            wri + along * 0.034 * u + Vec3::Z * 0.001 * u,
            Vec3::new(0.0105, 0.036, 0.0225) * u,
            turn,
            0.010,
            Matter::Skin,
            palm,
        );
        let inward = turn * Vec3::new(-s, 0.0, 0.0);
        for (z, length) in [
            (-0.014, 0.034),
            (-0.005, 0.041),
            (0.005, 0.043),
            (0.0145, 0.038),
        ] {
            let a = wri + along * 0.054 * u + Vec3::Z * z * u;
            let b = a + (along * length * 0.92 + inward * length * 0.38) * u;
            self.cone([a, b], [0.0062 * u, 0.0052 * u], 0.006, Matter::Skin, palm);
        }
        let a = wri + along * 0.016 * u + Vec3::Z * 0.014 * u;
        self.cone(
            [
                a,
                a + (along * 0.030 + Vec3::Z * 0.018 + inward * 0.010) * u,
            ],
            [0.0085 * u, 0.0058 * u],
            0.008,
            Matter::Skin,
            palm,
        );
    }
}

//! In: directions of a limb's two bones in space. Out: the joint angles that produce them, in closed form. It starts
//! new people and rescues limbs that are stuck in a wrong pose.

use glam::{DQuat, DVec3};

use super::{ANGLES, Skeleton};
use crate::joints::{
    BODY_JOINTS, L_ANKLE, L_ELBOW, L_KNEE, L_WRIST, PARENTS, R_ANKLE, R_ELBOW, R_KNEE, R_WRIST,
};

/// An arm or a leg: a ball joint (three angles: about x, about z, about the bone) and a hinge about x.
#[derive(Debug, Clone, Copy)]
pub struct Limb {
    /// Joint in which the upper bone ends: elbow or knee.
    pub middle: usize,
    /// Joint in which the lower bone ends: wrist or ankle.
    pub end: usize,
}

/// Arms and legs.
pub const LIMBS: [Limb; 4] = [
    Limb {
        middle: R_ELBOW,
        end: R_WRIST,
    },
    Limb {
        middle: L_ELBOW,
        end: L_WRIST,
    },
    Limb {
        middle: R_KNEE,
        end: R_ANKLE,
    },
    Limb {
        middle: L_KNEE,
        end: L_ANKLE,
    },
];

impl Limb {
    /// Indices of the four angles: three of the ball joint, then the hinge.
    pub fn angles(&self, skeleton: &Skeleton) -> [usize; 4] {
        let first = skeleton.own_angles(self.middle).0;
        let hinge = skeleton.own_angles(self.end).0;
        [first, first + 1, first + 2, hinge]
    }

    /// The two sets of angles that point the bones along `upper` and `lower` (camera axes, any length), given the
    /// rotation of the trunk at the ball joint. `current` supplies the rotation of a limb stretched so far that it
    /// shows none.
    pub fn solve(
        &self,
        skeleton: &Skeleton,
        trunk: DQuat,
        upper: DVec3,
        lower: DVec3,
        current: &[f64; ANGLES],
    ) -> Option<[[f64; 4]; 2]> {
        let [k0, k1, k2, hinge] = self.angles(skeleton);
        let sign = |k: usize, axis: DVec3| skeleton.angles()[k].axis.dot(axis).signum();
        let (sf, sa, sr, sh) = (
            sign(k0, DVec3::X),
            sign(k1, DVec3::Z),
            sign(k2, DVec3::Y),
            sign(hinge, DVec3::X),
        );
        let inverse = trunk.conjugate();
        let u = (inverse * upper).try_normalize()?;
        let w = (inverse * lower).try_normalize()?;
        // Rest direction −y under Rx(f)·Rz(a): (sin a, −cos a cos f, −cos a sin f).
        let a = u.x.clamp(-1.0, 1.0).asin();
        let f = (-u.z).atan2(-u.y);
        use std::f64::consts::PI;
        // Where the limb is stretched the second branch turns it by half a turn to keep what it carries.
        let branches = [(f, a, 0.0), (f + PI, PI - a, PI)];
        Some(branches.map(|(f, a, turn)| {
            let ball = DQuat::from_rotation_x(f) * DQuat::from_rotation_z(a);
            let v = ball.conjugate() * w;
            // Ry(r)·Rx(h)·(−y) = (−sin h sin r, −cos h, −sin h cos r), with h = sh·bend.
            let bend = (-v.y).clamp(-1.0, 1.0).acos();
            let rotation = if bend.sin() < 0.17 {
                sr * current[k2] + turn
            } else {
                (-sh * v.x).atan2(-sh * v.z)
            };
            [
                wrap(sf * f, k0, skeleton),
                wrap(sa * a, k1, skeleton),
                wrap(sr * rotation, k2, skeleton),
                bend,
            ]
        }))
    }

    /// The upper and the lower bone of this limb as observed, from joints relative to the pelvis.
    pub fn bones(&self, points: &[DVec3; BODY_JOINTS]) -> (DVec3, DVec3) {
        let start = PARENTS[self.middle];
        (
            points[self.middle] - points[start],
            points[self.end] - points[self.middle],
        )
    }
}

/// The representative of an angle nearest to the middle of its limits.
fn wrap(angle: f64, k: usize, skeleton: &Skeleton) -> f64 {
    let [low, high] = skeleton.angles()[k].limits;
    let middle = 0.5 * (low + high);
    angle - std::f64::consts::TAU * ((angle - middle) / std::f64::consts::TAU).round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Pose, Posed};

    #[test]
    fn one_branch_returns_the_angles() {
        let s = Skeleton::builtin();
        for n in 0..50 {
            let mut pose = Pose::facing_camera(3.0);
            pose.rotation = DQuat::from_scaled_axis(DVec3::new(0.3, 0.1 * n as f64, -0.2));
            for (k, angle) in pose.angles.iter_mut().enumerate() {
                let [low, high] = s.angles()[k].limits;
                *angle = low + (high - low) * ((n * 29 + k * 13) % 37 + 1) as f64 / 40.0;
            }
            let mut posed = Posed::default();
            s.pose(&pose, s.lengths(), &mut posed);
            for limb in LIMBS {
                let (upper, lower) = limb.bones(&posed.joints);
                let trunk = posed.frames[PARENTS[limb.middle]];
                let found = limb.solve(s, trunk, upper, lower, &pose.angles).unwrap();
                // Both branches place the bones.
                for angles in found {
                    let mut again = pose;
                    for (k, a) in limb.angles(s).into_iter().zip(angles) {
                        again.angles[k] = a;
                    }
                    let mut reposed = Posed::default();
                    s.pose(&again, s.lengths(), &mut reposed);
                    let error = (reposed.joints[limb.end] - posed.joints[limb.end]).length();
                    assert!(error < 1e-6, "{limb:?} {error}");
                }
                let wanted = limb.angles(s).map(|k| pose.angles[k]);
                let near = |a: &[f64; 4]| {
                    a.iter().zip(wanted).all(|(a, b)| {
                        let d = (a - b).rem_euclid(std::f64::consts::TAU);
                        d.min(std::f64::consts::TAU - d) < 1e-6
                    })
                };
                assert!(found.iter().any(near), "{found:?} {wanted:?}");
            }
        }
    }
}

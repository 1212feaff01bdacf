//! Joint angles go in, bone rotations and joint positions come out.

use glam::{Quat, Vec3};

use super::shape::{BONE_PARENT, BONE_PIVOT, BONES, JOINT_BONE, REST_ARM, Shape};
use crate::joints::{BODY_JOINTS, L_FOOT_TIP, PELVIS, R_FOOT_TIP};

/// Angles of one arm, degrees; all 0: hanging, palm to the thigh.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Arm {
    /// Raised forwards.
    pub flex: f32,
    /// Raised sideways, before `flex` turns it forwards.
    pub abduct: f32,
    /// Turned inwards about the upper arm.
    pub twist: f32,
    /// Elbow bend.
    pub elbow: f32,
}

/// Angles of one leg, degrees; all 0: straight down.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Leg {
    /// Raised forwards.
    pub flex: f32,
    /// Raised sideways.
    pub abduct: f32,
    /// Turned outwards.
    pub rotate: f32,
    /// Knee bend.
    pub knee: f32,
    /// Toes pulled up.
    pub ankle: f32,
}

/// A pose: everything but place and heading. Degrees.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pose {
    /// Trunk forwards, to the left, turned to the left at the pelvis.
    pub lean: [f32; 3],
    /// Spine: forwards, to the left, turned to the left.
    pub spine: [f32; 3],
    /// Neck: forwards, turned to the left.
    pub neck: [f32; 2],
    /// Right, left.
    pub arms: [Arm; 2],
    /// Right, left.
    pub legs: [Leg; 2],
    /// How far feet, or what else is lowest, are off the floor, metres.
    pub hop: f32,
    /// Seat: pelvis height above the floor in metres when positive; otherwise the feet stand on the floor.
    pub seat: f32,
}

/// A body in the world.
#[derive(Debug, Clone)]
pub struct Posed {
    /// World rotation of every bone against the rest pose.
    pub turn: [Quat; BONES],
    /// World position of every bone's pivot.
    pub at: [Vec3; BONES],
    /// World position of every body joint.
    pub joints: [Vec3; BODY_JOINTS],
}

/// Limits of the skeleton, degrees, as in `models/skeleton.toml`.
fn within(p: &Pose) -> Pose {
    let mut q = *p;
    q.spine = [
        p.spine[0].clamp(-30.0, 60.0),
        p.spine[1].clamp(-35.0, 35.0),
        p.spine[2].clamp(-45.0, 45.0),
    ];
    q.neck = [p.neck[0].clamp(-50.0, 60.0), p.neck[1].clamp(-70.0, 70.0)];
    for a in &mut q.arms {
        a.flex = a.flex.clamp(-60.0, 180.0);
        a.abduct = a.abduct.clamp(-30.0, 180.0);
        a.twist = a.twist.clamp(-90.0, 90.0);
        a.elbow = a.elbow.clamp(0.0, 150.0);
    }
    for l in &mut q.legs {
        l.flex = l.flex.clamp(-20.0, 120.0);
        l.abduct = l.abduct.clamp(-30.0, 45.0);
        l.rotate = l.rotate.clamp(-45.0, 45.0);
        l.knee = l.knee.clamp(0.0, 150.0);
        l.ankle = l.ankle.clamp(-50.0, 20.0);
    }
    q
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

impl Pose {
    /// Between two poses.
    pub fn blend(&self, to: &Pose, t: f32) -> Pose {
        let three = |a: [f32; 3], b: [f32; 3]| std::array::from_fn(|k| lerp(a[k], b[k], t));
        Pose {
            lean: three(self.lean, to.lean),
            spine: three(self.spine, to.spine),
            neck: std::array::from_fn(|k| lerp(self.neck[k], to.neck[k], t)),
            arms: std::array::from_fn(|k| self.arms[k].blend(&to.arms[k], t)),
            legs: std::array::from_fn(|k| self.legs[k].blend(&to.legs[k], t)),
            hop: lerp(self.hop, to.hop, t),
            seat: lerp(self.seat, to.seat, t),
        }
    }

    /// Left and right exchanged.
    pub fn mirrored(&self) -> Pose {
        let flip = |a: [f32; 3]| [a[0], -a[1], -a[2]];
        Pose {
            lean: flip(self.lean),
            spine: flip(self.spine),
            neck: [self.neck[0], -self.neck[1]],
            arms: [self.arms[1], self.arms[0]],
            legs: [self.legs[1], self.legs[0]],
            ..*self
        }
    }
}

impl Arm {
    /// From flexion, abduction, twist, elbow.
    pub const fn new(flex: f32, abduct: f32, twist: f32, elbow: f32) -> Self {
        Self {
            flex,
            abduct,
            twist,
            elbow,
        }
    }

    /// Between two arms.
    pub fn blend(&self, to: &Arm, t: f32) -> Arm {
        Arm {
            flex: lerp(self.flex, to.flex, t),
            abduct: lerp(self.abduct, to.abduct, t),
            twist: lerp(self.twist, to.twist, t),
            elbow: lerp(self.elbow, to.elbow, t),
        }
    }
}

impl Leg {
    /// From flexion, abduction, knee, ankle.
    pub const fn new(flex: f32, abduct: f32, knee: f32, ankle: f32) -> Self {
        Self {
            flex,
            abduct,
            rotate: 0.0,
            knee,
            ankle,
        }
    }

    /// Between two legs.
    pub fn blend(&self, to: &Leg, t: f32) -> Leg {
        Leg {
            flex: lerp(self.flex, to.flex, t),
            abduct: lerp(self.abduct, to.abduct, t),
            rotate: lerp(self.rotate, to.rotate, t),
            knee: lerp(self.knee, to.knee, t),
            ankle: lerp(self.ankle, to.ankle, t),
        }
    }
}

impl Posed {
    /// Forward kinematics. `heading`: degrees about y, 0 faces +z; `place`: where the pelvis stands on the floor.
    pub fn new(shape: &Shape, pose: &Pose, place: Vec3, heading: f32) -> Self {
        let pose = within(pose);
        let rad = f32::to_radians;
        let about = |p: Vec3, d: f32| Quat::from_axis_angle(p, rad(d));
        let mut local = [Quat::IDENTITY; BONES];
        local[0] = about(Vec3::Y, heading + pose.lean[2])
            * about(Vec3::X, pose.lean[0])
            * about(Vec3::Z, -pose.lean[1]);
        local[1] = about(Vec3::Y, pose.spine[2])
            * about(Vec3::X, pose.spine[0])
            * about(Vec3::Z, -pose.spine[1]);
        local[2] = about(Vec3::Y, pose.neck[1]) * about(Vec3::X, pose.neck[0]);
        for (side, s) in [(0, -1.0f32), (1, 1.0)] {
            let (a, l) = (pose.arms[side], pose.legs[side]);
            let (arm, leg) = (3 + 4 * side, 11 + 3 * side);
            let upper = about(Vec3::X, -a.flex) * about(Vec3::Z, s * a.abduct);
            // Raised arms take the shoulder girdle with them.
            let up = (1.0 - (upper * Vec3::NEG_Y).dot(Vec3::NEG_Y)) * 0.5;
            local[arm] = about(Vec3::Z, s * 22.0 * up * up);
            let hang = Quat::from_rotation_z(-s * REST_ARM);
            local[arm + 1] = local[arm].inverse() * upper * about(Vec3::Y, -s * a.twist) * hang;
            local[arm + 2] = hang.inverse() * about(Vec3::X, -a.elbow) * hang;
            local[leg] = about(Vec3::X, -l.flex)
                * about(Vec3::Z, s * l.abduct)
                * about(Vec3::Y, s * l.rotate);
            local[leg + 1] = about(Vec3::X, l.knee);
            local[leg + 2] = about(Vec3::X, -l.ankle);
        }
        let mut turn = [Quat::IDENTITY; BONES];
        let mut at = [Vec3::ZERO; BONES];
        turn[0] = local[0];
        for b in 1..BONES {
            let p = BONE_PARENT[b];
            turn[b] = (turn[p] * local[b]).normalize();
            at[b] = at[p] + turn[p] * (shape.pivot(b) - shape.pivot(p));
        }
        let sole = [13usize, 16].iter().flat_map(|&b| {
            let ankle = shape.pivot(b);
            let toe = shape.joints[if b == 13 { R_FOOT_TIP } else { L_FOOT_TIP }];
            let u = shape.unit();
            [
                Vec3::new(ankle.x, 0.0, ankle.z - 0.030 * u),
                Vec3::new(toe.x, 0.0, toe.z - 0.02 * u),
                Vec3::new(ankle.x, 0.0, ankle.z + 0.060 * u),
                Vec3::new(toe.x, 0.004 * u, toe.z + 0.018 * u),
            ]
            .map(|p| (at[b] + turn[b] * (p - ankle)).y)
        });
        // Kneeling and crawling put other joints on the floor.
        let others = [
            (9usize, 0.055),
            (12, 0.055),
            (3, 0.05),
            (6, 0.05),
            (17, 0.02),
            (18, 0.02),
            (14, 0.09),
            (16, 0.10),
        ]
        .iter()
        .map(|&(j, r)| {
            let b = JOINT_BONE[j];
            (at[b] + turn[b] * (shape.joints[j] - shape.pivot(b))).y - r
        })
        .collect::<Vec<_>>();
        let lowest = sole.chain(others).fold(f32::MAX, f32::min);
        let stand = -lowest;
        let height = if pose.seat > 0.0 {
            let rise = (pose.seat / 0.2).min(1.0);
            lerp(stand, pose.seat.max(stand), rise)
        } else {
            stand
        };
        let shift = Vec3::new(place.x, height + pose.hop + place.y, place.z);
        for p in &mut at {
            *p += shift;
        }
        let joints = std::array::from_fn(|j| {
            let b = JOINT_BONE[j];
            at[b] + turn[b] * (shape.joints[j] - shape.pivot(b))
        });
        debug_assert_eq!(BONE_PIVOT[0], PELVIS);
        Self { turn, at, joints }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::synth::noise::Dice;

    fn standing(pose: Pose, heading: f32) -> Posed {
        let shape = Shape::new(1.75, 0.0, 0.0, 0.0, &mut Dice::new(1, 1));
        Posed::new(&shape, &pose, Vec3::ZERO, heading)
    }

    #[test]
    fn a_person_at_rest_stands_on_the_floor() {
        let b = standing(Pose::default(), 0.0);
        assert!(
            (b.joints[0].y - 1.75).abs() < 0.02,
            "crown at {}",
            b.joints[0].y
        );
        for side in [2, 5] {
            assert!(
                b.joints[side].y > b.joints[side + 1].y
                    && b.joints[side + 1].y > b.joints[side + 2].y
            );
        }
        assert!(b.joints[10].y > 0.03 && b.joints[10].y < 0.12);
        // x points to the person's left, z to the front
        assert!(b.joints[5].x > 0.1 && b.joints[2].x < -0.1 && b.joints[19].z > b.joints[10].z);
    }

    #[test]
    fn angles_move_limbs_the_right_way() {
        let mut pose = Pose::default();
        pose.arms[1] = Arm::new(90.0, 0.0, 0.0, 0.0);
        pose.arms[0] = Arm::new(0.0, 90.0, 0.0, 0.0);
        pose.legs[0] = Leg::new(90.0, 0.0, 90.0, 0.0);
        let b = standing(pose, 0.0);
        assert!(
            b.joints[7].z > b.joints[5].z + 0.4,
            "the left arm points forwards"
        );
        assert!(
            b.joints[4].x < b.joints[2].x - 0.4,
            "the right arm points to the right"
        );
        assert!(
            b.joints[9].z > b.joints[8].z + 0.3,
            "the right knee is in front"
        );
        assert!(
            b.joints[10].y < b.joints[9].y - 0.3,
            "the right shin hangs down"
        );
        let elbow = standing(
            Pose {
                arms: [Arm::new(0.0, 0.0, 0.0, 90.0); 2],
                ..Pose::default()
            },
            0.0,
        );
        assert!(
            elbow.joints[4].z > elbow.joints[3].z + 0.2,
            "elbows bend forwards"
        );
        let left = standing(Pose::default(), 90.0);
        assert!(
            left.joints[19].x > left.joints[10].x + 0.05,
            "a heading of 90 degrees faces +x"
        );
    }

    #[test]
    fn limits_hold() {
        let far = standing(
            Pose {
                legs: [Leg::new(0.0, 0.0, 400.0, 0.0); 2],
                ..Pose::default()
            },
            0.0,
        );
        let most = standing(
            Pose {
                legs: [Leg::new(0.0, 0.0, 150.0, 0.0); 2],
                ..Pose::default()
            },
            0.0,
        );
        assert!(far.joints[10].distance(most.joints[10]) < 1e-4);
    }
}

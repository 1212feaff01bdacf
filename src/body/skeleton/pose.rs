//! The parameters of the 29-DoF skeleton, steps between them, and what forward kinematics makes of them.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use super::{ANGLES, Dof};
use crate::joints::{BODY_JOINTS, DOF};

/// The parameters of a fitted person: 3 + 3 + 23 degrees of freedom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Pelvis in camera space, metres.
    pub position: DVec3,
    /// Rotation of the pelvis from rest axes to camera axes.
    pub rotation: DQuat,
    /// Joint angles in the order of `models/skeleton.toml`, radians.
    pub angles: [f64; ANGLES],
}

impl Pose {
    /// Rest pose, upright and facing the camera, `depth` metres away.
    pub fn facing_camera(depth: f64) -> Self {
        Self {
            position: DVec3::new(0.0, 0.0, depth),
            rotation: DQuat::from_rotation_x(std::f64::consts::PI),
            angles: [0.0; ANGLES],
        }
    }

    /// This pose moved by a step, whose numbers are those of [`Dof`].
    pub fn moved(&self, step: &[f64; DOF]) -> Self {
        let mut angles = self.angles;
        for (angle, d) in angles.iter_mut().zip(&step[Dof::ANGLES]) {
            *angle += d;
        }
        Self {
            position: self.position + DVec3::from_slice(&step[Dof::POSITION]),
            rotation: (DQuat::from_scaled_axis(DVec3::from_slice(&step[Dof::ROTATION]))
                * self.rotation)
                .normalize(),
            angles,
        }
    }

    /// The step that leads from `from` to this pose; the inverse of [`moved`](Self::moved).
    pub fn step_from(&self, from: &Pose) -> [f64; DOF] {
        let mut step = [0.0; DOF];
        (self.position - from.position).write_to_slice(&mut step[Dof::POSITION]);
        rotation_vector(self.rotation * from.rotation.conjugate())
            .write_to_slice(&mut step[Dof::ROTATION]);
        for (d, (to, from)) in step[Dof::ANGLES]
            .iter_mut()
            .zip(self.angles.iter().zip(&from.angles))
        {
            *d = to - from;
        }
        step
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.position.is_finite()
            && self.rotation.is_finite()
            && self.angles.iter().all(|a| a.is_finite())
    }
}

/// The shortest rotation vector of a unit quaternion.
pub fn rotation_vector(q: DQuat) -> DVec3 {
    let q = if q.w < 0.0 { -q } else { q };
    let v = DVec3::new(q.x, q.y, q.z);
    let s = v.length();
    if s < 1e-9 {
        return v * 2.0;
    }
    v * (2.0 * s.atan2(q.w) / s)
}

/// Of the rotation vectors of a unit quaternion, which are a whole turn apart, the one nearer to `last`. Whoever stands
/// before a level camera is turned by half a turn, where the shortest vector changes its sign at every sway.
pub fn rotation_vector_near(q: DQuat, last: DVec3) -> DVec3 {
    let short = rotation_vector(q);
    let Some(axis) = short.try_normalize() else {
        return short;
    };
    let long = short - TAU * axis;
    match long.distance_squared(last) < short.distance_squared(last) {
        true => long,
        false => short,
    }
}

/// A skeleton in a pose: what forward kinematics yields.
#[derive(Debug, Clone, Copy)]
pub struct Posed {
    /// Joints in camera space, metres.
    pub joints: [DVec3; BODY_JOINTS],
    /// Rotation of the bone that ends in each joint, rest axes to camera axes; of the pelvis for joint 14.
    pub frames: [DQuat; BODY_JOINTS],
    /// Axis of every joint angle, camera axes.
    pub axes: [DVec3; ANGLES],
    /// Point about which every joint angle turns.
    pub origins: [DVec3; ANGLES],
    /// How every joint angle moves the point about which it turns, metres per radian, camera axes: those of a raised
    /// arm lift the shoulder.
    pub carried: [DVec3; ANGLES],
}

impl Posed {
    /// The derivative by joint angle `k` of a point `at` beyond it (camera axes), metres per radian.
    pub fn derivative(&self, k: usize, at: DVec3) -> DVec3 {
        self.axes[k].cross(at - self.origins[k]) + self.carried[k]
    }
}

impl Default for Posed {
    fn default() -> Self {
        Self {
            joints: [DVec3::ZERO; BODY_JOINTS],
            frames: [DQuat::IDENTITY; BODY_JOINTS],
            axes: [DVec3::ZERO; ANGLES],
            origins: [DVec3::ZERO; ANGLES],
            carried: [DVec3::ZERO; ANGLES],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_turns_before_a_camera_has_rotation_vectors_without_a_leap() {
        // Twice about themselves, before cameras that look up, ahead and down.
        for tilt in [-0.3, 0.0, 0.3] {
            let mut last = DVec3::ZERO;
            for step in 0..800 {
                let yaw = DQuat::from_rotation_y(2.0 * TAU * f64::from(step) / 800.0);
                let q = DQuat::from_rotation_x(tilt) * Pose::facing_camera(3.0).rotation * yaw;
                let next = rotation_vector_near(q, last);
                let same = DQuat::from_scaled_axis(next).dot(q).abs();
                assert!(same > 1.0 - 1e-9, "{next} is not {q}");
                let leap = next.distance(last);
                assert!(step == 0 || leap < 0.1, "{leap} at {step}, tilt {tilt}");
                last = next;
            }
        }
    }
}

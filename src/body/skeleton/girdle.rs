//! In: the angles of an arm. Out: where the shoulder girdle holds it, and how that changes with them. It needs no
//! degree of freedom of its own: a raised arm takes its shoulder along (scapulohumeral rhythm).

use glam::{DQuat, DVec3};

use super::ANGLES;

/// How an arm lifts the bone at whose end it starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Girdle {
    /// About which that bone turns, at its start; rest axes.
    pub axis: DVec3,
    /// By how much an arm stretched sideways lifts it, radians.
    pub reach: f64,
    /// Flexion and abduction of the arm. The product of their cosines is that of the angle between the upper arm and
    /// where it hangs.
    pub angles: [usize; 2],
}

impl Girdle {
    /// How far the bone is turned, radians: by `reach` × (1 − `hanging`), the cosine of the angle between the upper arm
    /// and where it hangs.
    pub fn turned(&self, hanging: f64) -> f64 {
        self.reach * (1.0 - hanging)
    }

    /// The `bone` (metres, camera axes; `frame` has its rotation) turned as the arm's `angles` tell, and in `carried`
    /// by how much each of these moves its end, metres per radian.
    pub fn lift(
        &self,
        frame: DQuat,
        bone: DVec3,
        angles: &[f64; ANGLES],
        carried: &mut [DVec3; ANGLES],
    ) -> DVec3 {
        let [(sin_a, cos_a), (sin_b, cos_b)] = self.angles.map(|k| angles[k].sin_cos());
        let axis = frame * self.axis;
        let bone = DQuat::from_axis_angle(axis, self.turned(cos_a * cos_b)) * bone;
        let moved = axis.cross(bone) * self.reach;
        carried[self.angles[0]] = moved * (sin_a * cos_b);
        carried[self.angles[1]] = moved * (cos_a * sin_b);
        bone
    }
}

#[cfg(test)]
mod tests {
    use crate::body::skeleton::{Pose, Posed, Skeleton};
    use crate::joints::{NECK, SHOULDERS};

    /// How high the shoulders are above the neck, metres: right, left.
    fn shoulders(arm: &str, degrees: f64) -> [f64; 2] {
        let s = Skeleton::builtin();
        let mut pose = Pose::facing_camera(3.0);
        let k = s.angles().iter().position(|a| a.name == arm).unwrap();
        pose.angles[k] = degrees.to_radians();
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        // Camera axes: y down.
        SHOULDERS.map(|j| posed.joints[NECK].y - posed.joints[j].y)
    }

    #[test]
    fn a_raised_arm_lifts_its_own_shoulder_only() {
        let [right, left] = shoulders("r_shoulder_abduction", 0.0);
        assert!((right - left).abs() < 1e-12 && right < -0.08);
        for (side, name) in ["r", "l"].into_iter().enumerate() {
            for motion in ["flexion", "abduction"] {
                let arm = format!("{side}_shoulder_{motion}", side = name);
                let level = shoulders(&arm, 90.0);
                let overhead = shoulders(&arm, 170.0);
                assert!(level[side] > right + 0.018, "{arm}: {level:?}");
                assert!(overhead[side] > level[side] + 0.018, "{arm}: {overhead:?}");
                assert!((overhead[1 - side] - right).abs() < 1e-12, "{arm}");
            }
        }
    }

    #[test]
    fn an_arm_that_turns_about_itself_lifts_nothing() {
        assert_eq!(
            shoulders("l_shoulder_rotation", 60.0),
            shoulders("l_shoulder_rotation", 0.0)
        );
    }
}

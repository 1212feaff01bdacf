//! In: one person of an [`ObservationFrame`](crate::message::ObservationFrame). Out: the same, checked for numbers that
//! make no sense, on the plane z = 1, with the place in space that makes 2D and 3D agree.

mod exchange;
mod one_euro;
mod root;
mod trust;

pub use exchange::SwapMemory;
pub use one_euro::OneEuro;
pub use root::{disagreement, place};
pub use trust::Trust;

use glam::{DQuat, DVec2, DVec3};

use crate::body::skeleton::Posed;
use crate::camera::translation::DEPTHS;
use crate::joints::{
    BODY_JOINTS, EVIDENCE_JOINTS, HIPS, L_KNEE, MIRROR_BODY, NECK, PELVIS, R_KNEE, SHOULDERS,
};
use crate::message::{Intrinsics, Observation};

/// Farthest a joint can be from the pelvis, metres at canonical stature.
const REACH: f64 = 1.6;
/// Hips and shoulders, right and left.
const TRUNK: [[usize; 2]; 2] = [HIPS, SHOULDERS];
/// Cosine of the turn, 120°, from which somebody shows the other side.
const TURNED: f64 = -0.5;

/// What was seen of one person in one frame.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// Evidence joints on the plane z = 1.
    pub plane: [DVec2; EVIDENCE_JOINTS],
    /// Their confidence, 0–1; 0: not seen.
    pub confidence: [f64; EVIDENCE_JOINTS],
    /// Body joints relative to the pelvis, camera axes, metres at canonical stature.
    pub points3d: [DVec3; BODY_JOINTS],
    /// Whether `points3d` describes a person.
    pub known3d: bool,
    /// Which of `points3d` tell something: not those of limbs whose sides are exchanged in space or in the picture
    /// alone.
    pub tells3d: [bool; BODY_JOINTS],
    /// Pelvis in camera space at canonical stature, from both; `None` where they do not determine it.
    pub root: Option<DVec3>,
    /// Detection score, 0–1.
    pub score: f64,
}

impl Evidence {
    /// Checks and converts an observation. `None` if nothing of it can be used.
    pub fn new(seen: &Observation, camera: &Intrinsics, min_confidence: f64) -> Option<Self> {
        let mut evidence = Self {
            plane: [DVec2::ZERO; EVIDENCE_JOINTS],
            confidence: [0.0; EVIDENCE_JOINTS],
            points3d: [DVec3::ZERO; BODY_JOINTS],
            known3d: true,
            tells3d: [true; BODY_JOINTS],
            root: None,
            score: if seen.score.is_finite() {
                f64::from(seen.score.clamp(0.0, 1.0))
            } else {
                0.0
            },
        };
        for (j, &[u, v, c]) in seen.joints2d.iter().enumerate() {
            let p = DVec2::new(
                (u - camera.cx) as f64 / camera.fx as f64,
                (v - camera.cy) as f64 / camera.fy as f64,
            );
            let c = c as f64;
            // Farther out than 84° from the axis there is no picture.
            if c >= min_confidence && c > 0.0 && c.is_finite() && p.is_finite() && p.length() < 10.0
            {
                evidence.plane[j] = p;
                evidence.confidence[j] = c.min(1.0);
            }
        }
        let pelvis = DVec3::from(seen.joints3d[PELVIS].map(f64::from));
        for (j, point) in evidence.points3d.iter_mut().enumerate() {
            *point = DVec3::from(seen.joints3d[j].map(f64::from)) - pelvis;
            evidence.known3d &= point.is_finite() && point.length() < REACH;
        }
        if evidence.known3d {
            let p = &evidence.points3d;
            let spread = p[NECK]
                .length()
                .max(p[R_KNEE].length())
                .max(p[L_KNEE].length());
            evidence.known3d = spread > 0.1;
        }
        if !evidence.known3d {
            evidence.points3d = [DVec3::ZERO; BODY_JOINTS];
        }
        if evidence.joints_seen() == 0 {
            return None;
        }
        evidence.root = place(&evidence, None);
        Some(evidence)
    }

    /// Turns the joints in space about the pelvis, and finds the place anew.
    pub fn turn(&mut self, rotation: DQuat) {
        if self.known3d {
            for point in &mut self.points3d {
                *point = rotation * *point;
            }
            self.root = place(self, None);
        }
    }

    /// Number of joints seen.
    pub fn joints_seen(&self) -> usize {
        self.confidence.iter().filter(|&&c| c > 0.0).count()
    }

    /// Mean distance to a posed skeleton in the picture, metres at its distance, each joint's at most `cap`; `None`
    /// where too few joints are seen. Left and right may be exchanged as a whole: Stage I confuses them, and somebody
    /// who turns round is still the same person.
    pub fn distance2d(&self, posed: &Posed, cap: f64) -> Option<f64> {
        let depth = posed.joints[PELVIS].z.max(DEPTHS[0]);
        let (mut sum, mut exchanged, mut weight) = (0.0, 0.0, 0.0);
        for j in 0..EVIDENCE_JOINTS {
            let c = self.confidence[j];
            let (p, q) = (posed.joints[j], posed.joints[MIRROR_BODY[j]]);
            if c > 0.0 && p.z > 0.1 && q.z > 0.1 {
                let far =
                    |p: DVec3| ((p.truncate() / p.z - self.plane[j]).length() * depth).min(cap);
                sum += c * far(p);
                exchanged += c * far(q);
                weight += c;
            }
        }
        (weight > 0.0).then(|| sum.min(exchanged) / weight)
    }

    /// Mean distance to a posed skeleton relative to the pelvis, metres at canonical stature, each joint's at most
    /// `cap`; left and right may be exchanged as a whole.
    pub fn distance3d(&self, posed: &Posed, cap: f64) -> Option<f64> {
        self.known3d.then(|| {
            let root = posed.joints[PELVIS];
            let far = |k: usize, j: usize| {
                (posed.joints[k] - root - self.points3d[j])
                    .length()
                    .min(cap)
            };
            let sum: f64 = (0..BODY_JOINTS).map(|j| far(j, j)).sum();
            let exchanged: f64 = (0..BODY_JOINTS).map(|j| far(MIRROR_BODY[j], j)).sum();
            sum.min(exchanged) / BODY_JOINTS as f64
        })
    }

    /// Whether hips and shoulders in 3D both point the other way than those of a posed skeleton.
    pub fn is_turned_from(&self, posed: &Posed) -> bool {
        TRUNK.iter().all(|&[r, l]| {
            let seen = (self.points3d[l] - self.points3d[r]).normalize_or_zero();
            let expected = (posed.joints[l] - posed.joints[r]).normalize_or_zero();
            seen.dot(expected) < TURNED
        })
    }

    /// Box round the joints seen: least and greatest corner on the plane z = 1.
    pub fn bounds(&self) -> (DVec2, DVec2) {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for j in (0..EVIDENCE_JOINTS).filter(|&j| self.confidence[j] > 0.0) {
            low = low.min(self.plane[j]);
            high = high.max(self.plane[j]);
        }
        (low, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::skeleton::{Pose, Skeleton};
    use crate::joints::{L_ELBOW, L_SHOULDER, L_WRIST, R_ANKLE, R_ELBOW, R_WRIST};

    fn exact(position: DVec3) -> (Observation, Intrinsics, Posed) {
        let camera = Intrinsics::from_horizontal_fov(1280, 720, 70.0);
        let s = Skeleton::builtin();
        let mut pose = Pose::facing_camera(3.0);
        pose.position = position;
        let mut posed = Posed::default();
        s.pose(&pose, s.lengths(), &mut posed);
        let mut seen = Observation {
            score: 0.9,
            ..Observation::default()
        };
        for j in 0..EVIDENCE_JOINTS {
            let [u, v] = camera.project(posed.joints[j].as_vec3().to_array());
            seen.joints2d[j] = [u, v, 0.8];
        }
        for j in 0..BODY_JOINTS {
            seen.joints3d[j] = (posed.joints[j] - position).as_vec3().to_array();
        }
        (seen, camera, posed)
    }

    #[test]
    fn the_root_is_where_2d_and_3d_agree() {
        for position in [DVec3::new(0.0, 0.0, 3.0), DVec3::new(-2.0, 0.5, 6.0)] {
            let (mut seen, camera, posed) = exact(position);
            let evidence = Evidence::new(&seen, &camera, 0.05).unwrap();
            assert!((evidence.root.unwrap() - position).length() < 1e-3);
            assert!(evidence.distance2d(&posed, 1.0).unwrap() < 1e-4);
            // One joint far off hardly matters.
            seen.joints2d[R_ANKLE][0] += 300.0;
            let evidence = Evidence::new(&seen, &camera, 0.05).unwrap();
            let error = (evidence.root.unwrap() - position).length();
            assert!(error < 0.12 * position.z, "{error}");
        }
    }

    #[test]
    fn nonsense_is_left_out() {
        let (good, camera, _) = exact(DVec3::new(0.0, 0.0, 3.0));
        let mut seen = good;
        seen.joints2d[R_ELBOW] = [f32::NAN, 0.0, 1.0];
        seen.joints2d[R_WRIST] = [f32::INFINITY, 0.0, 1.0];
        seen.joints2d[L_ELBOW][2] = f32::NAN;
        seen.joints2d[L_WRIST][2] = 0.01;
        let evidence = Evidence::new(&seen, &camera, 0.05).unwrap();
        assert_eq!(evidence.joints_seen(), 10);
        let mut seen = good;
        seen.joints3d[L_SHOULDER] = [f32::NAN; 3];
        assert!(!Evidence::new(&seen, &camera, 0.05).unwrap().known3d);
        let mut seen = good;
        seen.joints3d = [[0.0; 3]; BODY_JOINTS];
        assert!(!Evidence::new(&seen, &camera, 0.05).unwrap().known3d);
        assert!(Evidence::new(&Observation::default(), &camera, 0.05).is_none());
        assert!(Evidence::new(&good, &Intrinsics::default(), 0.05).is_none());
    }
}

//! What one view saw of one person, as rays in the world.

use glam::{DVec2, DVec3, Vec3};

use crate::camera::View;
use crate::camera::translation::least_squares;
use crate::joints::{
    EVIDENCE_JOINTS, MIRROR, R_ANKLE, R_ELBOW, R_HIP, R_KNEE, R_SHOULDER, R_WRIST,
};
use crate::message::Observation;

/// Confidence under which a joint is not seen.
const LEAST_CONFIDENCE: f32 = 0.1;
/// Expected error of a joint in a view, metres at the person: 5 pixels of a person 690 pixels high.
const NOISE: f64 = 0.0123;
/// Weight of a squared metre.
pub const DATA: f64 = 1.0 / (NOISE * NOISE);
/// Shared joints under which two detections cannot be compared.
pub const LEAST_SHARED: usize = 5;

/// One joint in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it was seen, pixels of the picture as it is.
    pub pixel: DVec2,
    /// On the plane z = 1 in camera axes, the lens undone.
    pub plane: DVec2,
    /// Direction in the world.
    pub direction: DVec3,
    /// Confidence, 0–1.
    pub confidence: f64,
}

/// One person in one view.
#[derive(Debug, Clone, PartialEq)]
pub struct Sight {
    /// The evidence joints; none where they were not seen.
    pub rays: [Option<Ray>; EVIDENCE_JOINTS],
    /// Where the view alone has the joints, relative to the pelvis in camera axes, metres, as large as somebody of
    /// canonical stature; none where nobody has lifted them. Not exchanged with the sides of joints.
    pub lifted: Option<[DVec3; EVIDENCE_JOINTS]>,
    /// Which pairs of joints have other sides than the detector said, a bit a pair.
    pub(super) swapped: u8,
}

/// The right one of every pair that has a bit.
const PAIRS: [usize; 6] = [R_SHOULDER, R_ELBOW, R_WRIST, R_HIP, R_KNEE, R_ANKLE];

/// Limbs whose sides a detector exchanges: pairs of evidence joints, the right one first.
pub const LIMB_PAIRS: [&[usize]; 4] = [
    &[R_SHOULDER, R_ELBOW, R_WRIST],
    &[R_HIP, R_KNEE, R_ANKLE],
    &[R_ELBOW, R_WRIST],
    &[R_KNEE, R_ANKLE],
];

impl Sight {
    /// An observation in `view`; joints beyond the fold of its lens are not seen.
    pub fn new(view: &View, seen: &Observation) -> Self {
        let ray = |[u, v, confidence]: [f32; 3]| {
            let is_seen = confidence >= LEAST_CONFIDENCE;
            if !is_seen {
                return None;
            }
            let pixel = DVec2::new(u.into(), v.into());
            // Where the lens shows nothing, no direction is the joint's.
            let plane = view.shown(pixel)?;
            Some(Ray {
                pixel,
                plane,
                direction: (view.rotation.transpose() * plane.extend(1.0)).normalize(),
                confidence: confidence.into(),
            })
        };
        let rays = seen.joints2d.map(ray);
        let lifted = std::array::from_fn(|j| Vec3::from_array(seen.joints3d[j]).as_dvec3());
        let known =
            lifted.iter().all(|p| p.is_finite()) && lifted.iter().any(|p| *p != DVec3::ZERO);
        Self {
            lifted: known.then_some(lifted),
            rays: rays.map(|r| r.filter(|r| r.plane.is_finite() && r.direction.is_finite())),
            swapped: 0,
        }
    }

    /// How far away somebody of canonical stature would be whom the view saw so, metres in camera axes; `None` where
    /// nobody has lifted them, or it cannot be told: by joints that would be behind the camera neither.
    pub fn depth(&self) -> Option<f64> {
        let lifted = self.lifted?;
        let plane = self.rays.map(|r| r.map_or(DVec2::ZERO, |r| r.plane));
        let weights = self.rays.map(|r| r.map_or(0.0, |r| r.confidence));
        let pelvis = least_squares(&plane, &lifted, &weights)?;
        let each = self
            .rays
            .iter()
            .zip(&lifted)
            .filter(|(ray, _)| ray.is_some());
        let (sum, count) = each.fold((0.0, 0), |(s, n), (_, p)| (s + p.z, n + 1));
        let depth = (count > 0).then(|| pelvis.z + sum / f64::from(count));
        depth.filter(|depth| *depth > 0.0)
    }

    /// The same with all sides exchanged.
    pub fn mirrored(&self) -> Self {
        self.exchanged(LIMB_PAIRS[0]).exchanged(LIMB_PAIRS[1])
    }

    /// The same with the sides of some joints exchanged; `right` names the right ones.
    pub fn exchanged(&self, right: &[usize]) -> Self {
        let mut other = self.clone();
        for &j in right {
            other.rays.swap(j, MIRROR[j]);
            let bit = PAIRS.iter().position(|r| *r == j.min(MIRROR[j]));
            other.swapped ^= bit.map_or(0, |b| 1 << b);
        }
        other
    }

    /// Exchanges sides so that these pairs have others than the detector said.
    pub(super) fn swap_as(&mut self, pairs: u8) {
        for (bit, &j) in PAIRS.iter().enumerate() {
            if (self.swapped ^ pairs) >> bit & 1 == 1 {
                self.rays.swap(j, MIRROR[j]);
            }
        }
        self.swapped = pairs;
    }
}

/// Joints of one person in one picture, where seen: on a plane of any unit.
pub type Plane = [Option<DVec2>; EVIDENCE_JOINTS];

/// The joints with arms and legs on the other side where that is nearer to what was before: so much nearer, as a share
/// of how far they are as they are named.
pub fn like(before: &Plane, now: &Plane, share: f64) -> Plane {
    let mut told = *now;
    for right in &LIMB_PAIRS[..2] {
        let pairs = || right.iter().flat_map(|&j| [j, MIRROR[j]]);
        let off = |other: bool| -> f64 {
            let each = pairs().filter_map(|j| {
                let k = if other { MIRROR[j] } else { j };
                Some(before[j]?.distance(now[k]?))
            });
            let (sum, count) = each.fold((0.0, 0), |(s, n), d| (s + d, n + 1));
            if count > 0 {
                sum / count as f64
            } else {
                f64::INFINITY
            }
        };
        if off(true) < share * off(false) {
            for &j in *right {
                told.swap(j, MIRROR[j]);
            }
        }
    }
    told
}

/// Distance of a point from a ray, metres, the point's depth along it being positive.
pub fn distance(origin: DVec3, direction: DVec3, point: DVec3) -> f64 {
    let to = point - origin;
    let along = to.dot(direction);
    if along <= 0.0 {
        to.length()
    } else {
        (to - along * direction).length()
    }
}

/// Shortest distance between two rays, metres; behind either camera as far as the cameras are apart.
pub fn between(a: DVec3, da: DVec3, b: DVec3, db: DVec3) -> f64 {
    let (w, c) = (b - a, da.dot(db));
    let scale = 1.0 - c * c;
    if scale < 1e-9 {
        return (w - w.dot(da) * da).length();
    }
    let s = (w.dot(da) - c * w.dot(db)) / scale;
    let t = (c * w.dot(da) - w.dot(db)) / scale;
    if s <= 0.0 || t <= 0.0 {
        return w.length();
    }
    (a + s * da - b - t * db).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Brown;

    #[test]
    fn a_joint_where_the_lens_shows_nothing_has_no_ray() {
        // r·(1 − 0.3·r²) is 0.7027 at most.
        let view = View {
            distortion: Brown {
                radial: [-0.3, 0.0, 0.0],
                tangential: [0.0; 2],
            },
            ..View::around(0.0)
        };
        let mut seen = Observation::default();
        for (j, r) in [0.2, 0.69, 0.71, 0.9].into_iter().enumerate() {
            let [u, v] = (view.centre + DVec2::Y * r * view.focal.y)
                .as_vec2()
                .to_array();
            seen.joints2d[j] = [u, v, 0.9];
        }
        let rays = Sight::new(&view, &seen).rays;
        let has_ray: [bool; 4] = std::array::from_fn(|j| rays[j].is_some());
        assert_eq!(has_ray, [true, true, false, false]);
    }

    #[test]
    fn joints_that_would_be_behind_the_camera_tell_no_distance() {
        let view = View::around(0.0);
        // Somebody 3 m away whose lifted joints are `share` of what they are across, and so far before the pelvis.
        let depth = |share: f64, ahead: f64| {
            let mut seen = Observation::default();
            for j in 0..EVIDENCE_JOINTS {
                let [x, y] = [0.1 * (j % 3) as f64 - 0.1, 0.1 * j as f64 - 0.7];
                let pixel = view.project(DVec3::new(x, y, 0.0)).expect("in front");
                seen.joints2d[j] = [pixel.x as f32, pixel.y as f32, 0.9];
                let lifted = DVec3::new(share * x, share * y, -ahead);
                seen.joints3d[j] = lifted.as_vec3().to_array();
            }
            Sight::new(&view, &seen).depth()
        };
        let usual = depth(1.0, 0.0).expect("before the camera");
        assert!((usual - 3.0).abs() < 0.01, "{usual}");
        // Upside down the root is 2 m before the camera, the joints 3 m behind it.
        assert_eq!(depth(-1.0, 5.0), None);
    }
}

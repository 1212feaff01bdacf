//! In: a person's seen joints in the picture and Stage II's whole body. Out: where the picture has the joints that were
//! not seen.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS};
use edgecap_client::message::Intrinsics;
use glam::{DVec2, DVec3};

use crate::camera::translation::least_squares;

/// Fewest seen joints that place the body.
const MIN_JOINTS: usize = 4;
/// Nearest that a joint may come to the camera, metres at canonical stature: nearer ones are projected nowhere.
const NEAREST: f64 = 0.1;

/// Puts every evidence joint of confidence 0 where the body (`joints3d`: relative to the pelvis, camera axes, metres)
/// has it, once it stands where it explains the seen ones best. Confidence stays 0. Joints are in pixels of the picture
/// that `camera` describes. Where too little is seen, or a joint is behind the camera, 0, 0 stays.
pub(crate) fn fill(
    joints2d: &mut [[f32; 3]; EVIDENCE_JOINTS],
    joints3d: &[[f32; 3]; BODY_JOINTS],
    camera: &Intrinsics,
) {
    let seen = joints2d.iter().filter(|j| j[2] > 0.0).count();
    if !(MIN_JOINTS..EVIDENCE_JOINTS).contains(&seen) {
        return;
    }
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::from);
    let plane =
        joints2d.map(|[u, v, _]| DVec2::new((f64::from(u) - cx) / fx, (f64::from(v) - cy) / fy));
    let points: [DVec3; EVIDENCE_JOINTS] =
        std::array::from_fn(|j| DVec3::from(joints3d[j].map(f64::from)));
    let weights = joints2d.map(|j| f64::from(j[2]));
    let Some(root) = least_squares(&plane, &points, &weights) else {
        return;
    };
    for (joint, point) in joints2d.iter_mut().zip(points) {
        let at = root + point;
        if joint[2] == 0.0 && at.z > NEAREST {
            *joint = [at.x / at.z * fx + cx, at.y / at.z * fy + cy, 0.0].map(|v| v as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Intrinsics {
        Intrinsics {
            fx: 600.0,
            fy: 620.0,
            cx: 320.0,
            cy: 230.0,
        }
    }

    /// A body at `root` whose joints do not lie in a plane, and its picture.
    fn scene(root: [f32; 3]) -> ([[f32; 3]; BODY_JOINTS], [[f32; 3]; EVIDENCE_JOINTS]) {
        let body: [[f32; 3]; BODY_JOINTS] = std::array::from_fn(|j| {
            let t = j as f32;
            [0.4 * (1.7 * t).sin(), 0.09 * t - 0.6, 0.3 * (2.3 * t).cos()]
        });
        let c = camera();
        let picture = std::array::from_fn(|j| {
            let [x, y, z] = std::array::from_fn(|a| body[j][a] + root[a]);
            [x / z * c.fx + c.cx, y / z * c.fy + c.cy, 0.5]
        });
        (body, picture)
    }

    #[test]
    fn what_was_not_seen_lands_where_it_is() {
        let (body, picture) = scene([0.5, -0.2, 3.1]);
        let mut joints = picture;
        for j in [0, 4, 9, 10] {
            joints[j] = [0.0; 3];
        }
        fill(&mut joints, &body, &camera());
        for (j, (joint, truth)) in joints.iter().zip(picture).enumerate() {
            let off = (joint[0] - truth[0]).hypot(joint[1] - truth[1]);
            assert!(off < 0.01, "joint {j}: {joint:?}, expected {truth:?}");
            let confidence = if [0, 4, 9, 10].contains(&j) { 0.0 } else { 0.5 };
            assert_eq!(joint[2], confidence);
        }
    }

    #[test]
    fn seen_joints_stay_as_they_are() {
        let (body, mut joints) = scene([0.0, 0.0, 4.0]);
        joints[3] = [12.0, 34.0, 0.9];
        joints[7] = [0.0; 3];
        let before = joints;
        fill(&mut joints, &body, &camera());
        for j in (0..EVIDENCE_JOINTS).filter(|j| *j != 7) {
            assert_eq!(joints[j], before[j]);
        }
        assert_ne!(joints[7], [0.0; 3]);
    }

    #[test]
    fn too_little_places_nothing() {
        let (body, picture) = scene([0.0, 0.0, 4.0]);
        let mut few = [[0.0; 3]; EVIDENCE_JOINTS];
        few[..3].copy_from_slice(&picture[..3]);
        let mut together = picture.map(|_| [300.0, 200.0, 0.5]);
        together[2] = [0.0; 3];
        for mut joints in [few, together] {
            let before = joints;
            fill(&mut joints, &body, &camera());
            assert_eq!(joints, before);
        }
    }

    #[test]
    fn nothing_is_projected_from_behind_the_camera() {
        let (mut body, mut joints) = scene([0.0, 0.0, 1.0]);
        body[5] = [0.1, 0.0, -1.5];
        joints[5] = [0.0; 3];
        joints[6] = [0.0; 3];
        fill(&mut joints, &body, &camera());
        assert_eq!(joints[5], [0.0; 3]);
        assert_ne!(joints[6], [0.0; 3]);
    }
}

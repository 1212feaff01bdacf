//! People who all seem to lean, before a camera that looks down on a known floor.

use edgecap::body::skeleton::{Pose, Skeleton};
use edgecap::fit::{FitConfig, Fitter, GroundConfig};
use edgecap::joints::{NECK, PELVIS};
use edgecap::message::BodyFrame;
use glam::{DQuat, DVec3};

use super::{FPS, posing};

/// How far the trunk of somebody upright leans from `up` after four seconds, degrees, who is seen leaning away from the
/// camera by `lean` degrees; the floor is told or not.
fn leans(up: DVec3, lean: f64, is_told: bool) -> f64 {
    let skeleton = Skeleton::builtin();
    let mut pose = Pose::facing_camera(4.0);
    pose.rotation = DQuat::from_rotation_arc(DVec3::NEG_Y, up) * pose.rotation;
    let config = FitConfig {
        ground: is_told.then(|| GroundConfig {
            normal: up.to_array(),
            offset: 2.5,
        }),
        ..FitConfig::default()
    };
    let mut fitter = Fitter::new(config).unwrap();
    let mut out = BodyFrame::default();
    let seems = DQuat::from_rotation_x(-lean.to_radians());
    for f in 0..(4.0 * FPS) as u32 {
        let mut frame = posing(1.0 + f64::from(f) / FPS, &pose, skeleton.lengths());
        for point in &mut frame.people[0].joints3d {
            *point = (seems * DVec3::from(point.map(f64::from)))
                .as_vec3()
                .to_array();
        }
        fitter.update(&frame, &mut out);
    }
    let joint = |j: usize| DVec3::from(out.bodies()[0].joints3d[j].map(f64::from));
    (joint(NECK) - joint(PELVIS)).angle_between(up).to_degrees()
}

#[test]
fn a_known_floor_tells_what_is_upright() {
    for (pitch, lean) in [(30.0f64, 12.0), (45.0, 14.0), (20.0, -10.0)] {
        let up = DQuat::from_rotation_x(-pitch.to_radians()) * DVec3::NEG_Y;
        let [without, with] = [false, true].map(|is_told| leans(up, lean, is_told));
        assert!(
            without > 5.0 && with < 0.6 * without,
            "{lean}° at {pitch}°: {without:.1}° without a floor, {with:.1}° with"
        );
    }
}

//! Joints that Stage II lifted by another lens than a view's go in, in the view's own camera axes they come out.

use glam::DVec3;

use crate::camera::{View, anchor, turn_to_ray};
use crate::message::{Intrinsics, Observation};

/// Turns everybody's `joints3d` from camera axes by the pinhole `lens` to those by the view's lens; a calibration has
/// the ray of the same pixel elsewhere. Whoever is nowhere in the picture, or only where the view's lens shows nothing,
/// stays as they are.
pub fn to_view(view: &View, lens: &Intrinsics, people: &mut [Observation]) {
    for seen in people {
        // Where the lens shows nothing a joint has no ray.
        let Some(pixel) = anchor(seen, |pixel| view.shown(pixel).is_some()) else {
            continue;
        };
        let told = DVec3::from(lens.ray(pixel.x as f32, pixel.y as f32).map(f64::from));
        turn_to_ray(seen, told, view.plane(pixel).extend(1.0));
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat, DVec2};

    use super::*;
    use crate::camera::Brown;
    use crate::joints::{BODY_JOINTS, NECK};

    /// A webcam of 90 degrees with a lens that distorts.
    fn wide() -> View {
        View {
            name: "wide".into(),
            size: [1280, 720],
            focal: DVec2::splat(640.0),
            centre: DVec2::new(639.5, 359.5),
            distortion: Brown {
                radial: [-0.1, 0.02, 0.0],
                tangential: [0.0; 2],
            },
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        }
    }

    /// What Stage II says of somebody whose neck, or whose joints in the mean, are at a pixel with this ray.
    fn lifted(pixel: DVec2, ray: DVec3, by_neck: bool) -> Observation {
        let mut seen = Observation::default();
        let turn = DQuat::from_rotation_arc(DVec3::Z, ray.normalize());
        for (j, point) in seen.joints3d.iter_mut().enumerate() {
            let t = j as f64;
            let aligned = DVec3::new(0.3 * t.sin(), 0.5 * (0.7 * t).cos(), 0.2 * (1.3 * t).sin());
            *point = (turn * aligned).as_vec3().to_array();
        }
        let offs: &[(usize, f32)] = if by_neck {
            &[(NECK, 0.0), (8, 80.0)]
        } else {
            &[(8, 30.0), (11, -30.0)]
        };
        for (j, off) in offs {
            seen.joints2d[*j] = [pixel.x as f32, pixel.y as f32 + off, 0.8];
        }
        seen
    }

    #[test]
    fn poses_are_turned_by_the_calibrated_lens() {
        let view = wide();
        let usual = Intrinsics::from_horizontal_fov(1280, 720, 60.0);
        for (by_neck, pixel) in [
            (true, DVec2::new(1180.0, 200.0)),
            (false, DVec2::new(90.0, 500.0)),
        ] {
            let told = DVec3::from(usual.ray(pixel.x as f32, pixel.y as f32).map(f64::from));
            let mut people = [lifted(pixel, told, by_neck)];
            let truth = lifted(pixel, view.plane(pixel).extend(1.0), by_neck);
            let apart = |seen: &Observation| {
                let each = (0..BODY_JOINTS).map(|j| {
                    DVec3::from(seen.joints3d[j].map(f64::from))
                        .distance(DVec3::from(truth.joints3d[j].map(f64::from)))
                });
                each.fold(0.0, f64::max)
            };
            assert!(apart(&people[0]) > 0.1, "the lenses differ");
            to_view(&view, &usual, &mut people);
            assert!(apart(&people[0]) < 1e-5, "{}", apart(&people[0]));
        }
    }

    #[test]
    fn a_neck_where_the_lens_shows_nothing_turns_nobody() {
        // r·(1 − 0.3·r²) is 0.7027 at most.
        let view = View {
            distortion: Brown {
                radial: [-0.3, 0.0, 0.0],
                tangential: [0.0; 2],
            },
            ..wide()
        };
        let usual = Intrinsics::from_horizontal_fov(1280, 720, 60.0);
        let pixel = view.centre + DVec2::new(0.5, 0.1) * view.focal;
        let mut without = [lifted(pixel, DVec3::Z, false)];
        let mut with = without;
        let beyond = (view.centre + DVec2::new(0.95, 0.0) * view.focal).as_vec2();
        with[0].joints2d[NECK] = [beyond.x, beyond.y, 0.9];
        to_view(&view, &usual, &mut without);
        to_view(&view, &usual, &mut with);
        assert_eq!(with[0].joints3d, without[0].joints3d);
        // Of whom it shows nothing at all it knows no ray.
        let mut nowhere = [lifted(pixel, DVec3::Z, false)];
        for joint in &mut nowhere[0].joints2d {
            *joint = with[0].joints2d[NECK];
        }
        let before = nowhere[0];
        to_view(&view, &usual, &mut nowhere);
        assert_eq!(nowhere[0].joints3d, before.joints3d);
    }

    #[test]
    fn who_is_nowhere_in_the_picture_stays() {
        let mut people = [lifted(DVec2::ZERO, DVec3::X + DVec3::Z, true)];
        people[0].joints2d = Default::default();
        let before = people[0];
        to_view(&wide(), &Intrinsics::default(), &mut people);
        assert_eq!(people[0].joints3d, before.joints3d);
    }
}

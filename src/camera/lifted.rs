//! The axes of lifted joints. Stage II speaks in axes along the ray through a person's neck; whoever publishes its
//! joints turns them to camera axes by the lens that is known there, often that of a usual webcam. Another lens has the
//! ray of the same pixel elsewhere.

use glam::{DQuat, DVec2, DVec3};

use crate::joints::NECK;
use crate::message::{Intrinsics, Observation};

/// The pixel by whose ray Stage II's axes are turned: the neck's, or the mean of the joints that were seen. Joints that
/// are not `shown` do not count.
pub fn anchor(seen: &Observation, shown: impl Fn(DVec2) -> bool) -> Option<DVec2> {
    let at = |[u, v, confidence]: [f32; 3]| {
        let pixel = DVec2::new(u.into(), v.into());
        (confidence > 0.0 && shown(pixel)).then_some(pixel)
    };
    at(seen.joints2d[NECK]).or_else(|| {
        let known: Vec<DVec2> = seen.joints2d.into_iter().filter_map(at).collect();
        (!known.is_empty()).then(|| known.iter().sum::<DVec2>() / known.len() as f64)
    })
}

/// Turns `joints3d`, which lie in camera axes if `told` is the ray of the [`anchor`], to those in which it is `own`.
/// Rays that are no directions change nothing.
pub fn turn_to_ray(seen: &mut Observation, told: DVec3, own: DVec3) {
    let (Some(told), Some(own)) = (told.try_normalize(), own.try_normalize()) else {
        return;
    };
    let [back, forth] = [told, own].map(|ray| DQuat::from_rotation_arc(DVec3::Z, ray));
    let turn = forth * back.inverse();
    for point in &mut seen.joints3d {
        *point = (turn * DVec3::from(point.map(f64::from)))
            .as_vec3()
            .to_array();
    }
}

/// Turns everybody's `joints3d` from camera axes by the pinhole `told` to those by the pinhole `own`.
pub fn to_lens(told: &Intrinsics, own: &Intrinsics, people: &mut [Observation]) {
    for seen in people {
        if let Some(pixel) = anchor(seen, DVec2::is_finite) {
            let [told, own] = [told, own]
                .map(|lens| DVec3::from(lens.ray(pixel.x as f32, pixel.y as f32).map(f64::from)));
            turn_to_ray(seen, told, own);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Somebody whose neck is at a pixel, lifted by a lens: Stage II's axes lie along the neck's ray.
    fn lifted(pixel: [f32; 2], lens: &Intrinsics) -> Observation {
        let mut seen = Observation::default();
        seen.joints2d[NECK] = [pixel[0], pixel[1], 0.9];
        let ray = DVec3::from(lens.ray(pixel[0], pixel[1]).map(f64::from));
        let turn = DQuat::from_rotation_arc(DVec3::Z, ray);
        for (j, point) in seen.joints3d.iter_mut().enumerate() {
            let t = j as f64;
            let aligned = DVec3::new(0.3 * t.sin(), 0.5 * (0.7 * t).cos(), 0.2 * (1.3 * t).sin());
            *point = (turn * aligned).as_vec3().to_array();
        }
        seen
    }

    #[test]
    fn poses_lifted_by_a_usual_lens_are_turned_to_the_true_one() {
        let [usual, wide] = [60.0, 90.0].map(|fov| Intrinsics::from_horizontal_fov(1280, 720, fov));
        let (pixel, truth) = ([1150.0, 200.0], lifted([1150.0, 200.0], &wide));
        let mut people = [lifted(pixel, &usual)];
        let apart = |seen: &Observation| {
            let pairs = seen.joints3d.iter().zip(&truth.joints3d);
            pairs.fold(0.0, |most: f64, (a, b)| {
                most.max(DVec3::from(a.map(f64::from)).distance(DVec3::from(b.map(f64::from))))
            })
        };
        assert!(apart(&people[0]) > 0.05, "the lenses differ");
        to_lens(&usual, &wide, &mut people);
        assert!(apart(&people[0]) < 1e-5);
        let before = people[0];
        to_lens(&wide, &wide, &mut people);
        assert!(apart(&people[0]) < 1e-5 && before.joints2d == people[0].joints2d);
        let mut unseen = [Observation::default()];
        to_lens(&usual, &wide, &mut unseen);
        assert_eq!(
            unseen[0],
            Observation::default(),
            "whoever is nowhere has no ray"
        );
    }
}

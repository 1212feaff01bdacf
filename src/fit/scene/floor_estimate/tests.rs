use glam::DQuat;

use super::*;

/// Camera 2.2 m up, pitched 20° down.
fn truth() -> FloorPlane {
    FloorPlane {
        normal: DQuat::from_rotation_x(-20f64.to_radians()) * DVec3::NEG_Y,
        offset: 2.2,
    }
}

/// An ankle of somebody `share` times as tall as assumed who stands at (x, z) of the true floor, a little off.
fn ankle(share: f64, x: f64, z: f64, off: f64) -> DVec3 {
    ankle_on(truth(), share, x, z, off)
}

fn ankle_on(floor: FloorPlane, share: f64, x: f64, z: f64, off: f64) -> DVec3 {
    let FloorPlane { normal: n, offset } = floor;
    let y = -(n.x * x + n.z * z + offset) / n.y;
    DVec3::new(x, y + off, z) / share - DVec3::new(0.0, ANKLE_HEIGHT, 0.0)
}

/// The floor after people, each by identity and share, walked about for `looks` looks.
fn walked(people: &[(u32, f64)], looks: u32) -> FloorEstimate {
    let mut estimate = FloorEstimate::default();
    for i in 0..looks {
        for &(id, share) in people {
            let k = i + 17 * id;
            let off = 0.05 * (f64::from(k * 37 % 11) / 5.0 - 1.0);
            // One in 25 steps on a stage.
            let wild = if i % 25 == 24 { -1.0 } else { 0.0 };
            let (x, z) = (f64::from(k % 7) - 3.0, 3.0 + 0.5 * f64::from(k % 9));
            estimate.add(id, ankle(share, x, z, off + wild));
        }
        estimate.update();
    }
    estimate
}

#[test]
fn feet_tell_a_tilted_floor() {
    for people in [&[(1, 1.0)][..], &[(1, 1.0), (2, 0.7), (3, 1.05)]] {
        let estimate = walked(people, 300);
        let floor = estimate.floor().unwrap();
        assert!(floor.ground.normal.dot(truth().normal) > 0.999, "{floor:?}");
        assert!(
            (floor.ground.offset - truth().offset).abs() < 0.1,
            "{floor:?}"
        );
    }
}

#[test]
fn the_foot_that_stands_tells_the_floor_below_a_steep_camera() {
    for pitch in [20f64, 45.0] {
        let (sin, cos) = pitch.to_radians().sin_cos();
        let truth = FloorPlane {
            normal: DVec3::new(0.0, -cos, -sin),
            offset: 3.0,
        };
        // Of an ankle (x, z) beyond the point below the camera and above the sole's height on the floor, metres.
        let along = DVec3::new(0.0, -sin, cos);
        let ankle = |x: f64, z: f64, above: f64| {
            let height = above + ANKLE_HEIGHT - truth.offset;
            DVec3::X * x + along * z + truth.normal * height
        };
        let mut estimate = FloorEstimate::default();
        for i in 0..1000u32 {
            // Round a circle; one foot stands, the other one swings past it.
            let (turn, swing) = (0.23 * f64::from(i), (0.377 * f64::from(i)).fract());
            let side = if i % 2 == 0 { 0.1 } else { -0.1 };
            let ahead = -0.6 * (std::f64::consts::PI * swing).cos();
            let above = 0.12 * (std::f64::consts::PI * swing).sin();
            let at = |beside: f64, ahead: f64, above: f64| {
                let out = 1.2 + beside;
                let x = out * turn.cos() - ahead * turn.sin();
                let z = out * turn.sin() + ahead * turn.cos();
                ankle(x, truth.offset * cos / sin + z, above)
            };
            let feet = [at(side, 0.0, 0.0), at(-side, ahead, above)];
            let lower = lower(feet.into_iter(), estimate.down()).unwrap();
            estimate.add(1, lower);
            estimate.update();
        }
        let ground = estimate.floor().expect("a floor").ground;
        let tilt = ground.normal.angle_between(truth.normal).to_degrees();
        let height = (ground.offset - truth.offset).abs();
        assert!(
            tilt < 0.25 && height < 0.05,
            "{pitch}°: {tilt}°, {height} m"
        );
    }
}

#[test]
fn errors_along_the_view_do_not_make_the_floor_more_level() {
    let mut estimate = FloorEstimate::default();
    for i in 0..3000u32 {
        for id in 1..=3u32 {
            // Here and there, and taken for nearer or farther than they are, by 3 %.
            let k = i + 17 * id;
            let random = f64::from(k.wrapping_mul(2_654_435_761) >> 16) / 65536.0 - 0.5;
            let (x, z) = (f64::from(k % 7) - 3.0, 4.0 + 0.1 * f64::from(k % 9));
            let foot = ankle(1.0, x, z, 0.0) + ANKLE_HEIGHT * DVec3::Y;
            let ankle = foot * (1.0 + 0.104 * random) - ANKLE_HEIGHT * DVec3::Y;
            estimate.add(id, ankle);
        }
        estimate.update();
    }
    let ground = estimate.floor().expect("a floor").ground;
    let pitch = |normal: DVec3| (-normal.z).asin().to_degrees();
    let (found, is) = (pitch(ground.normal), pitch(truth().normal));
    assert!((found - is).abs() < 1.0, "{found}°, {is}° in truth");
}

#[test]
fn a_child_in_front_of_an_adult_does_not_tilt_the_floor() {
    for (near, far) in [(0.7, 1.0), (1.0, 0.7), (1.05, 0.95)] {
        let mut estimate = FloorEstimate::default();
        for i in 0..600u32 {
            let along = 0.25 * f64::from(i % 7);
            let across = f64::from(i % 5) - 2.0;
            estimate.add(1, ankle(near, across, 3.0 + along, 0.0));
            estimate.add(2, ankle(far, -across, 4.0 + along, 0.0));
            estimate.update();
        }
        let (tilt, height) = off(&estimate);
        assert!(
            tilt < 1.5 && height < 0.25,
            "{near} before {far}: {tilt}°, {height} m"
        );
    }
}

#[test]
fn a_camera_that_was_tilted_finds_its_new_floor_and_none_that_is_far_steeper() {
    for degrees in [-8.0f64, 8.0] {
        let mut estimate = walked(&[(1, 1.0), (2, 1.05)], 300);
        let tilted = FloorPlane {
            normal: DQuat::from_rotation_x(-degrees.to_radians()) * truth().normal,
            offset: truth().offset,
        };
        let mut steepest = 0.0f64;
        for i in 0..3000u32 {
            let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
            estimate.add(1 + i % 2, ankle_on(tilted, 1.0, x, z, 0.0));
            estimate.update();
            if let Some(floor) = estimate.floor() {
                steepest = steepest.max((-floor.ground.normal.z).asin().to_degrees());
            }
        }
        let ground = estimate.floor().expect("a floor").ground;
        let tilt = ground.normal.angle_between(tilted.normal).to_degrees();
        assert!(
            tilt < 1.0 && steepest < 20.0 + degrees.max(0.0) + 6.0,
            "{degrees}°: {tilt}° off, {steepest}° at most"
        );
    }
}

#[test]
fn one_spot_is_no_floor() {
    let mut estimate = FloorEstimate::default();
    for _ in 0..500 {
        estimate.add(1, DVec3::new(0.0, 1.4, 4.0));
    }
    estimate.update();
    assert!(estimate.floor().is_none());
}

/// How far, degrees and metres, the floor is off.
fn off(estimate: &FloorEstimate) -> (f64, f64) {
    let ground = estimate.floor().expect("a floor").ground;
    let tilt = ground.normal.angle_between(truth().normal).to_degrees();
    (tilt, (ground.offset - truth().offset).abs())
}

#[test]
fn whoever_rests_their_feet_in_one_place_for_long_does_not_tilt_the_floor() {
    // Taken for the floor, beyond what it bears, and on the floor with an error that lasts.
    for (above, nearer) in [(0.3, 1.0), (0.6, 1.0), (0.9, 1.0), (0.0, 0.95)] {
        let mut estimate = walked(&[(1, 1.0)], 2000);
        let rest = |x, z| nearer * ankle(1.0, x, z, -above);
        let places = [rest(-0.9, 4.6), rest(-0.5, 4.7)];
        for _ in 0..4000 {
            for place in places {
                estimate.add(1, place);
            }
            estimate.update();
            let (tilt, height) = off(&estimate);
            assert!(
                tilt < 1.0 && height < 0.1,
                "{above} m: {tilt}°, {height} m off"
            );
        }
        for i in 0..300u32 {
            let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
            estimate.add(1, ankle(1.0, x, z, 0.0));
            estimate.update();
            let (tilt, height) = off(&estimate);
            assert!(
                tilt < 1.0 && height < 0.1,
                "{above} m: {tilt}°, {height} m off"
            );
        }
    }
}

#[test]
fn a_floor_that_is_lost_leaves_no_feet_to_the_next() {
    let mut estimate = walked(&[(1, 1.0)], 50);
    // The camera now looks straight ahead at half the height.
    let moved = FloorPlane {
        normal: DVec3::NEG_Y,
        offset: 0.9,
    };
    let mut lost = None;
    for i in 0..1000u32 {
        let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
        estimate.add(1, ankle_on(moved, 1.0, x, z, 0.0));
        if estimate.standers.is_empty() {
            lost = lost.or(Some(i));
        }
        estimate.update();
    }
    assert!(lost.is_some_and(|i| i < 300), "{lost:?}");
    let ground = estimate.floor().unwrap().ground;
    assert!(ground.normal.dot(moved.normal) > 0.9999, "{ground:?}");
}

#[test]
fn statures_beside_each_other() {
    for people in [
        &[(1, 1.0), (2, 0.7)][..],
        &[(1, 0.93), (2, 1.07)],
        &[(1, 1.06), (2, 1.0), (3, 0.94), (4, 0.65), (5, 0.8)],
    ] {
        let estimate = walked(people, 200);
        let floor = estimate.floor().unwrap();
        for &(id, share) in people {
            let found = floor.stature(id).unwrap();
            assert!((found / share - 1.0).abs() < 0.05, "{share}: {found}");
        }
    }
}

#[test]
fn whoever_stands_alone_is_as_tall_as_assumed() {
    let floor = walked(&[(1, 0.8)], 200);
    assert_eq!(floor.floor().unwrap().stature(1), None);
}

#[test]
fn nobody_is_a_giant() {
    // Feet on a stage, 60 cm up.
    let floor = walked(&[(1, 1.0), (2, 1.03), (3, 1.4)], 200);
    let floor = floor.floor().unwrap();
    assert!((floor.stature(3).unwrap() - 1.0).abs() < 0.05, "{floor:?}");
    assert!((floor.stature(1).unwrap() - 1.0).abs() < 0.05, "{floor:?}");
}

#[test]
fn a_camera_that_was_moved_finds_its_new_floor() {
    let mut estimate = walked(&[(1, 1.0), (2, 1.05)], 1000);
    let moved = FloorPlane {
        normal: DVec3::NEG_Y,
        offset: 0.9,
    };
    for i in 0..3000u32 {
        let (x, z) = (f64::from(i % 7) - 3.0, 3.0 + 0.5 * f64::from(i % 9));
        estimate.add(1 + i % 2, ankle_on(moved, 1.0, x, z, 0.0));
        estimate.update();
    }
    let floor = estimate.floor().unwrap();
    assert!(floor.ground.normal.dot(moved.normal) > 0.999, "{floor:?}");
    assert!((floor.ground.offset - 0.9).abs() < 0.1, "{floor:?}");
}

#[test]
fn memory_is_bounded_and_fades() {
    let mut estimate = walked(&[(1, 1.0), (2, 0.8)], 200);
    assert!(estimate.floor().unwrap().stature(2).is_some());
    for id in 3..3000 {
        estimate.add(id, ankle(1.0, 0.1, 3.0 + 0.001 * f64::from(id), 0.0));
    }
    estimate.update();
    assert!(estimate.standers.len() <= PEOPLE);
    assert_eq!(estimate.floor().and_then(|f| f.stature(2)), None);
    let mut estimate = walked(&[(1, 1.0), (2, 0.8)], 200);
    for i in 0..20_000 {
        estimate.add(1, ankle(1.0, 0.1, 3.0 + f64::from(i % 5), 0.0));
    }
    estimate.update();
    assert!(estimate.count() < MEMORY + 2.0);
    assert_eq!(estimate.floor().and_then(|f| f.stature(2)), None);
}

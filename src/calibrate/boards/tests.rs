//! Corners of boards whose cameras are known, without pictures.

use glam::{DMat3, DQuat, DVec2, DVec3};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use super::*;
use crate::camera::Brown;

const SQUARE: f64 = 0.03;

fn view(name: &str, position: DVec3, target: DVec3) -> View {
    let z = (target - position).normalize();
    let x = z.cross(DVec3::Z).normalize();
    View {
        name: name.into(),
        size: [1280, 960],
        focal: DVec2::new(1000.0, 1004.0),
        centre: DVec2::new(630.0, 470.0),
        distortion: Brown {
            radial: [-0.2, 0.1, 0.0],
            tangential: [0.001, -0.0005],
        },
        rotation: DMat3::from_cols(x, z.cross(x), z).transpose(),
        position,
    }
}

fn room() -> Vec<View> {
    let target = DVec3::new(0.1, 0.1, 0.2);
    vec![
        view("south", DVec3::new(0.0, -1.0, 0.9), target),
        view("east", DVec3::new(0.8, -0.7, 1.1), target),
        view("west", DVec3::new(-0.8, -0.6, 0.8), target),
    ]
}

/// Boards whose front is seen from the south, the first on the floor; `tilt` is how much they lean, a share.
fn boards(count: usize, tilt: f64) -> Vec<Placement> {
    let flat = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let facing = room()[0].rotation.transpose();
    let one = |k: usize| {
        if k == 0 {
            return Placement {
                rotation: flat,
                position: DVec3::ZERO,
            };
        }
        let lean = [
            [0.5, 0.2],
            [-0.4, 0.4],
            [0.1, -0.6],
            [-0.5, -0.2],
            [0.3, 0.5],
        ][k % 5];
        let turn = DQuat::from_rotation_x(tilt * lean[0])
            * DQuat::from_rotation_y(tilt * lean[1])
            * DQuat::from_rotation_z(0.4 * k as f64);
        let rotation = facing * DMat3::from_quat(turn);
        let far = 0.08 * (k % 4) as f64;
        let to = DVec3::new(0.1 * (k % 3) as f64, 0.1, 0.1 + far);
        Placement {
            rotation,
            position: to - rotation * DVec3::new(4.0, 2.5, 0.0) * SQUARE,
        }
    };
    (0..count).map(one).collect()
}

/// What `camera` sees of a 9x6 board, off by `noise` pixels.
fn shots(camera: &View, boards: &[Placement], noise: f64, random: &mut SmallRng) -> Shots {
    let mut shot = |(moment, board): (usize, &Placement)| {
        let corner = |k: usize| {
            let place = DVec2::new((k % 9) as f64, (k / 9) as f64);
            let off = DVec2::from_array(std::array::from_fn(|_| {
                random.random_range(-1.7..1.7) * noise
            }));
            let pixel = camera.project(board.point(place * SQUARE)).unwrap() + off;
            Corner { place, pixel }
        };
        Shot {
            moment,
            corners: (0..54).map(corner).collect(),
        }
    };
    Shots {
        name: camera.name.clone(),
        size: camera.size,
        lens: None,
        pictures: boards.len(),
        shots: boards.iter().enumerate().map(&mut shot).collect(),
    }
}

fn seen(boards: &[Placement], noise: f64) -> (Vec<Shots>, Vec<String>) {
    let mut random = SmallRng::seed_from_u64(3);
    let all = room();
    let each = all.iter().map(|v| shots(v, boards, noise, &mut random));
    (
        each.collect(),
        (0..boards.len()).map(|k| k.to_string()).collect(),
    )
}

fn refused(cameras: &[Shots], moments: &[String]) -> BoardError {
    calibrate_by_board(cameras, moments, SQUARE, Some(0)).unwrap_err()
}

#[test]
fn exact_corners_give_lenses_and_places() {
    let (cameras, moments) = seen(&boards(12, 1.0), 0.0);
    let rig = calibrate_by_board(&cameras, &moments, SQUARE, Some(0)).unwrap();
    for ((found, truth), quality) in rig.views.iter().zip(room()).zip(&rig.quality) {
        let turned = found.rotation * truth.rotation.transpose() - DMat3::IDENTITY;
        let turned = turned
            .to_cols_array()
            .iter()
            .fold(0.0, |m: f64, v| m.max(v.abs()));
        assert!(turned < 1e-5, "{}: turned by {turned}", found.name);
        assert!(
            found.position.distance(truth.position) < 1e-4,
            "{}",
            found.position
        );
        assert!(found.focal.distance(truth.focal) < 0.05, "{}", found.focal);
        assert!(
            found.centre.distance(truth.centre) < 0.05,
            "{}",
            found.centre
        );
        assert!(quality.held_out_rms_px.unwrap() < 0.01, "{quality:?}");
        // Of moments 1 to 11 two are kept apart.
        assert_eq!((quality.used, quality.aside.len()), (10, 0));
    }
}

#[test]
fn a_picture_of_another_board_is_put_aside() {
    let (mut cameras, moments) = seen(&boards(12, 1.0), 0.1);
    for corner in &mut cameras[1].shots[3].corners {
        corner.place.x = 8.0 - corner.place.x;
    }
    // Seen from behind by nobody: the same corners, the board moved between two pictures.
    let moved = cameras[2].shots[7].corners.clone();
    for (corner, other) in cameras[2].shots[2].corners.iter_mut().zip(moved) {
        corner.pixel = other.pixel;
    }
    let rig = calibrate_by_board(&cameras, &moments, SQUARE, Some(0)).unwrap();
    let aside = |c: usize| rig.quality[c].aside.iter().map(|a| a.0).collect::<Vec<_>>();
    assert_eq!([aside(0), aside(1), aside(2)], [vec![], vec![3], vec![2]]);
    // Both fit a place of the board by their own camera, and none of those by the others.
    for c in [1, 2] {
        let off = rig.quality[c].aside[0].1.unwrap();
        assert!(off > 1.0, "{off} px");
    }
    for (found, truth) in rig.views.iter().zip(room()) {
        let off = found.position.distance(truth.position);
        assert!(off < 0.005, "{}: {off} m", found.name);
    }
}

/// One camera takes the picture that tells the floor after the board was moved there.
#[test]
fn a_floor_that_cameras_contradict_is_said_or_outvoted() {
    let all = boards(12, 1.0);
    let (cameras, moments) = seen(&all, 0.1);
    let mut moved = all[0];
    moved.position += DVec3::new(0.05, 0.03, 0.0);
    let mut random = SmallRng::seed_from_u64(4);
    let late = shots(&room()[1], &[moved], 0.1, &mut random)
        .shots
        .remove(0);
    let with_late = |of: &[usize]| -> Vec<Shots> {
        let mut some: Vec<Shots> = of.iter().map(|c| cameras[*c].clone()).collect();
        some[1].shots[0] = late.clone();
        some
    };
    let error = refused(&with_late(&[0, 1]), &moments);
    let BoardError::Floor { off, .. } = &error else {
        panic!("{error}");
    };
    assert_eq!(off.len(), 2);
    let said = error.to_string();
    for word in ["picture 0", "south", "east", "px"] {
        assert!(said.contains(word), "{said}");
    }
    // Of three, two tell.
    let three = with_late(&[0, 1, 2]);
    let rig = calibrate_by_board(&three, &moments, SQUARE, Some(0)).unwrap();
    let aside = |c: usize| rig.quality[c].aside.iter().map(|a| a.0).collect::<Vec<_>>();
    assert_eq!([aside(0), aside(1), aside(2)], [vec![], vec![0], vec![]]);
    for (found, truth) in rig.views.iter().zip(room()) {
        let off = found.position.distance(truth.position);
        assert!(off < 0.005, "{}: {off} m", found.name);
    }
}

/// As of a zoom lens that was calibrated at another zoom.
#[test]
fn a_lens_that_was_given_is_doubted() {
    let (mut cameras, moments) = seen(&boards(12, 1.0), 0.1);
    cameras.truncate(2);
    for (camera, truth) in cameras.iter_mut().zip(room()) {
        camera.lens = Some(truth);
    }
    for wrong in [0, 1] {
        let mut given = cameras.clone();
        if let Some(lens) = &mut given[wrong].lens {
            lens.focal *= 0.4;
        }
        let said = refused(&given, &moments).to_string();
        assert!(said.contains("given by --lens"), "{said}");
    }
    // By its own pictures alone such a lens may do.
    for wrong in [0, 1] {
        let mut given = cameras.clone();
        if let Some(lens) = &mut given[wrong].lens {
            lens.focal *= 0.55;
        }
        let error = refused(&given, &moments);
        let BoardError::Apart { camera, .. } = &error else {
            panic!("{error}");
        };
        assert_eq!(*camera, given[wrong].name);
        let said = error.to_string();
        assert!(said.contains("given by --lens"), "{said}");
    }
}

#[test]
fn pictures_put_aside_do_not_tell_how_far_boards_reach() {
    let (cameras, _) = seen(&boards(12, 1.0), 0.1);
    let mut camera = cameras[1].clone();
    let before = reach(&camera, |_| true);
    for corner in &mut camera.shots[3].corners {
        corner.pixel = DVec2::ZERO;
    }
    assert!(reach(&camera, |_| true) > 0.99);
    assert!(reach(&camera, |s| s.moment != 3) <= before);
}

#[test]
fn a_lens_that_is_known_stays_and_needs_one_picture() {
    let (mut cameras, moments) = seen(&boards(1, 1.0), 0.05);
    for (camera, truth) in cameras.iter_mut().zip(room()) {
        camera.lens = Some(truth);
    }
    let rig = calibrate_by_board(&cameras, &moments, SQUARE, Some(0)).unwrap();
    for (found, truth) in rig.views.iter().zip(room()) {
        assert_eq!(found.focal, truth.focal);
        let off = found.position.distance(truth.position);
        assert!(off < 0.01, "{}: {off} m", found.name);
    }
}

#[test]
fn without_a_floor_the_first_common_board_is_the_world() {
    let (cameras, moments) = seen(&boards(8, 1.0), 0.0);
    let rig = calibrate_by_board(&cameras, &moments, SQUARE, None).unwrap();
    // The first one lies on the floor here, too.
    let off = rig.views[0].position.distance(room()[0].position);
    assert!(off < 1e-3, "{off}");
}

#[test]
fn what_boards_do_not_tell_is_said() {
    let (few, moments) = seen(&boards(4, 1.0), 0.1);
    assert!(matches!(
        refused(&few, &moments),
        BoardError::Few {
            found: 4,
            of: 4,
            ..
        }
    ));

    // Of a part of a board one row may be in view; the lens is known, by which one picture would be enough.
    let (mut row, moments) = seen(&boards(1, 1.0), 0.0);
    row[0].lens = Some(room()[0].clone());
    row[0].shots[0].corners.retain(|c| c.place.y == 0.0);
    let name = row[0].name.clone();
    assert_eq!(refused(&row, &moments), BoardError::Line(name));

    // All of them square to the first camera, the one on the floor left out.
    let (mut square, moments) = seen(&boards(12, 0.0), 0.1);
    square.truncate(1);
    square[0].shots.remove(0);
    let error = calibrate_by_board(&square, &moments, SQUARE, None).unwrap_err();
    assert!(matches!(error, BoardError::Square { .. }), "{error}");
    assert!(
        error.to_string().contains("too square to the camera"),
        "{error}"
    );

    let (mut wide, moments) = seen(&boards(12, 1.0), 0.1);
    for shot in &mut wide[0].shots {
        for corner in &mut shot.corners {
            corner.pixel = fisheye(shot.moment, corner.place);
        }
    }
    let error = refused(&wide, &moments);
    assert!(matches!(error, BoardError::Lens { .. }), "{error}");

    let (together, mut moments) = seen(&boards(6, 1.0), 0.1);
    moments.extend((6..12).map(|k| k.to_string()));
    for camera in 0..3 {
        let mut alone = together.clone();
        for shot in &mut alone[camera].shots {
            shot.moment += 6;
        }
        let name = alone[camera].name.clone();
        assert_eq!(refused(&alone, &moments), BoardError::NotLinked(name));
    }

    // Moments of one camera are one late.
    let (mut late, moments) = seen(&boards(12, 1.0), 0.1);
    let of_one = &mut late[1].shots;
    let pixels: Vec<Vec<DVec2>> = of_one
        .iter()
        .map(|s| s.corners.iter().map(|c| c.pixel).collect())
        .collect();
    for (k, shot) in of_one.iter_mut().enumerate() {
        for (corner, pixel) in shot.corners.iter_mut().zip(&pixels[(k + 1) % 12]) {
            corner.pixel = *pixel;
        }
    }
    let error = refused(&late, &moments);
    let said = error.to_string();
    let BoardError::Apart { limit, .. } = error else {
        panic!("{error}");
    };
    assert!(limit <= allowed(&late[0]), "{limit}");
    assert!(!said.contains("--lens"), "{said}");

    let (mut unseen, moments) = seen(&boards(12, 1.0), 0.1);
    for camera in &mut unseen {
        camera.shots.remove(0);
    }
    assert_eq!(refused(&unseen, &moments), BoardError::NoFloor("0".into()));
}

/// Of a board on a stand, which is taken for the floor: seen by the first camera alone, straight or turned by `turn`
/// radians away from the third one.
fn on_stand(turn: f64) -> Result<Rig, BoardError> {
    let (_, moments) = seen(&boards(12, 1.0), 0.1);
    let mut stand = boards(12, 1.0);
    let facing = room()[0].rotation.transpose();
    let rotation = facing * DMat3::from_rotation_y(-turn);
    let middle = room()[0].position + facing * DVec3::new(0.0, 0.0, 0.28);
    stand[0] = Placement {
        rotation,
        position: middle - rotation * DVec3::new(4.0, 2.5, 0.0) * SQUARE,
    };
    let mut random = SmallRng::seed_from_u64(3);
    let mut cameras = vec![shots(&room()[0], &stand, 0.1, &mut random)];
    for view in &room()[1..] {
        let mut others = shots(view, &stand[1..], 0.1, &mut random);
        others.shots.iter_mut().for_each(|s| s.moment += 1);
        cameras.push(others);
    }
    calibrate_by_board(&cameras, &moments, SQUARE, Some(0))
}

/// As one that stands on the floor does where the board lay a little tilted.
#[test]
fn a_camera_may_come_out_a_little_below_the_board_s_plane() {
    let rig = on_stand(0.0).unwrap();
    let low = rig.views[2].position.z;
    assert!((-0.1..0.0).contains(&low), "{low}");
    let error = on_stand(0.3).unwrap_err();
    let BoardError::UnderFloor { camera, metres, .. } = &error else {
        panic!("{error}");
    };
    assert_eq!(camera, "west");
    assert!((0.25..0.35).contains(metres), "{metres}");
}

/// Where a fisheye lens shows a board close to it: as far from the centre as the angle is large.
fn fisheye(moment: usize, place: DVec2) -> DVec2 {
    let [x, y] = [moment % 3, moment / 3 % 3].map(|k| 0.25 * (k as f64 - 1.0));
    let turn = DMat3::from_rotation_x(-0.6 * y) * DMat3::from_rotation_y(0.6 * x);
    let at =
        turn * ((place - DVec2::new(4.0, 2.5)) * SQUARE).extend(0.0) + DVec3::new(x, 0.6 * y, 0.15);
    let angle = at.truncate().length().atan2(at.z);
    DVec2::new(630.0, 470.0) + at.truncate().normalize_or_zero() * angle * 400.0
}

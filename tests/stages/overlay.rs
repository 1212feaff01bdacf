//! Skeletons over pictures.

use edgecap::capture::{Frame, PhotoDecoder};
use edgecap::joints::{BODY_JOINTS, PARENTS};
use edgecap::message::{Body, BodyState, JointState, Observation};
use edgecap::overlay::{colour_of, draw, write_png};
use proptest::prelude::*;

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;

fn blank() -> Frame {
    Frame {
        width: WIDTH,
        height: HEIGHT,
        rgb: vec![100; (3 * WIDTH * HEIGHT) as usize],
        ..Frame::default()
    }
}

fn pixel(frame: &Frame, u: f32, v: f32) -> [u8; 3] {
    let at = 3 * (v as usize * frame.width as usize + u as usize);
    frame.rgb[at..at + 3].try_into().unwrap()
}

fn is_near(a: [u8; 3], b: [u8; 3]) -> bool {
    let differences = a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(b)));
    differences.sum::<u32>() < 120
}

/// A standing person, joints far enough apart not to cover each other.
fn body(id: u32) -> Body {
    let places: [[f32; 2]; BODY_JOINTS] = [
        [160., 40.],
        [160., 80.],
        [130., 85.],
        [110., 115.],
        [95., 145.],
        [190., 85.],
        [210., 115.],
        [225., 145.],
        [145., 150.],
        [140., 185.],
        [138., 215.],
        [175., 150.],
        [180., 185.],
        [182., 215.],
        [160., 145.],
        [160., 112.],
        [160., 60.],
        [85., 160.],
        [235., 160.],
        [125., 228.],
        [195., 228.],
    ];
    let mut body = Body {
        id,
        score: 0.75,
        state: BodyState::TRACKED,
        joints2d: places,
        ..Body::default()
    };
    body.joints3d.iter_mut().for_each(|j| j[2] = 3.0);
    body.joint_states[..BODY_JOINTS].fill(JointState::OBSERVED);
    body
}

#[test]
fn bones_and_joints_have_the_identitys_colour() {
    for id in [1, 2, 9] {
        let mut frame = blank();
        let body = body(id);
        draw(&mut frame, &[body]);
        for (j, parent) in PARENTS.iter().enumerate() {
            let (a, b) = (body.joints2d[j], body.joints2d[*parent]);
            assert_eq!(pixel(&frame, a[0], a[1]), colour_of(id), "joint {j}");
            if (a[0] - b[0]).hypot(a[1] - b[1]) > 20.0 {
                let middle = pixel(&frame, (a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0);
                assert!(is_near(middle, colour_of(id)), "bone {j}: {middle:?}");
            }
        }
        assert_eq!(
            pixel(&frame, 20.0, 200.0),
            [100; 3],
            "far away nothing changes"
        );
    }
    assert_eq!(colour_of(1), colour_of(8));
    assert_ne!(colour_of(1), colour_of(2));
}

#[test]
fn occluded_joints_are_hollow() {
    let mut body = body(1);
    body.joint_states[17] = JointState::OCCLUDED;
    (body.joints3d[18][2], body.joints2d[18]) = (-1.0, [0.0; 2]);
    let mut frame = blank();
    draw(&mut frame, &[body]);
    assert_eq!(pixel(&frame, 85.0, 160.0), [100; 3], "the middle is open");
    let ring = (0..6).any(|d| is_near(pixel(&frame, 85.0 - d as f32, 160.0), colour_of(1)));
    assert!(ring);
    assert_eq!(
        pixel(&frame, 235.0, 160.0),
        [100; 3],
        "behind the camera there is no joint"
    );
    assert_eq!(pixel(&frame, 0.0, 0.0), [100; 3]);
}

/// With a calibration joints are in its axes: what they say of z is no depth.
#[test]
fn joints_in_the_axes_of_a_room_are_drawn_where_they_are_seen() {
    let mut body = body(1);
    let mut usual = blank();
    draw(&mut usual, &[body]);
    body.joints3d.iter_mut().for_each(|j| j[2] = -1.0);
    let mut frame = blank();
    draw(&mut frame, &[body]);
    assert_eq!(frame, usual);
}

#[test]
fn observations_show_what_was_seen() {
    let mut person = Observation {
        score: 0.5,
        ..Observation::default()
    };
    person.joints2d[1] = [100.0, 100.0, 0.9];
    person.joints2d[2] = [60.0, 120.0, 0.8];
    let mut frame = blank();
    draw(&mut frame, &[person]);
    assert_eq!(pixel(&frame, 100.0, 100.0), colour_of(0));
    assert_eq!(pixel(&frame, 60.0, 120.0), colour_of(0));
    assert_eq!(
        pixel(&frame, 0.0, 0.0),
        [100; 3],
        "unseen joints at (0, 0) are not drawn"
    );
    let mut empty = blank();
    draw(&mut empty, &[Observation::default()]);
    draw::<Body>(&mut empty, &[]);
    assert_eq!(empty, blank());
}

#[test]
fn labels_differ_by_identity() {
    let pictures: Vec<Frame> = [1, 8, 15]
        .map(|id| {
            let mut frame = blank();
            draw(&mut frame, &[body(id)]);
            frame
        })
        .into();
    // Same colour, other number.
    assert_ne!(pictures[0], pictures[1]);
    assert_ne!(pictures[1], pictures[2]);
}

#[test]
fn written_pictures_are_whole_or_absent() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame.png");
    let mut frame = blank();
    draw(&mut frame, &[body(3)]);
    write_png(&frame, &path).unwrap();
    let mut back = Frame::default();
    PhotoDecoder::default()
        .decode(&std::fs::read(&path).unwrap(), &mut back)
        .unwrap();
    assert_eq!(back, frame);
    write_png(&blank(), &path).unwrap();
    let names: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(names, ["frame.png"], "nothing else is left");

    let error = write_png(&frame, &path.join("inside.png")).unwrap_err();
    assert_eq!(error.exit_code(), 73);
    assert!(error.to_string().contains("frame.png/inside.png"));
    std::fs::create_dir(folder.path().join("taken")).unwrap();
    assert!(write_png(&frame, &folder.path().join("taken")).is_err());
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        2,
        "nothing half-written"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_numbers_can_be_drawn(
        values in prop::collection::vec(any::<f32>(), 2 * BODY_JOINTS),
        (w, h) in (1u32..40, 1u32..40),
        id in any::<u32>(),
        score in any::<f32>(),
    ) {
        let mut body = Body { id, score, ..body(1) };
        for (joint, v) in body.joints2d.iter_mut().zip(values.chunks(2)) {
            *joint = [v[0], v[1]];
        }
        let mut frame = Frame { width: w, height: h, rgb: vec![0; (3 * w * h) as usize], ..Frame::default() };
        draw(&mut frame, &[body]);
    }
}

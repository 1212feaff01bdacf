//! What a program in C may do wrong, and what it is told.

use std::ffi::{CStr, CString};
use std::ptr::{null, null_mut};

use edgecap_c::*;
use edgecap_client::Publisher;
use edgecap_client::message::{Body, BodyFrame, World, WorldState};

fn error() -> String {
    // SAFETY: a string with an end, valid until this thread's next call.
    unsafe { CStr::from_ptr(edgecap_error()) }
        .to_str()
        .unwrap()
        .to_owned()
}

fn open(camera: &str) -> *mut edgecap_bodies {
    let camera = CString::new(camera).unwrap();
    // SAFETY: a string with an end.
    unsafe { edgecap_bodies_open(camera.as_ptr()) }
}

#[test]
fn names_that_cannot_be_are_refused() {
    // SAFETY: null is allowed.
    assert!(unsafe { edgecap_bodies_open(null()) }.is_null());
    assert!(error().contains("expected a camera's name, found NULL"));
    assert!(open("no/such").is_null());
    assert!(error().contains("'no/such'"), "{}", error());
    // SAFETY: a string with an end.
    assert!(unsafe { edgecap_bodies_open(c"\xff".as_ptr()) }.is_null());
    assert!(error().contains("no UTF-8"), "{}", error());
}

#[test]
fn null_is_told() {
    let mut frame = null();
    // SAFETY: null is allowed everywhere here.
    unsafe {
        assert_eq!(edgecap_bodies_next(null_mut(), 0, &raw mut frame), -1);
        assert!(error().starts_with("edgecap_bodies_next: expected a reader, found NULL"));
        assert_eq!(edgecap_bodies_publishers(null_mut()), -1);
        assert_eq!(edgecap_bodies_close(null_mut()), 0);
        assert_eq!(error(), "");
        assert_eq!(edgecap_in_world(null(), null(), null_mut()), -1);
        assert!(error().contains("found NULL"));
    }
    assert!(edgecap_joint_name(21).is_null() && edgecap_bone_name(16).is_null());
    assert!(edgecap_health_state_name(6).is_null() && edgecap_health_pace_name(3).is_null());
    assert!(edgecap_coco_name(17).is_null() && edgecap_kinect_name(32).is_null());
    assert_eq!((edgecap_coco_joint(17), edgecap_kinect_joint(32)), (-1, -1));
}

#[test]
fn a_reader_stays_in_its_thread() {
    let camera = format!("test-c-thread-{}", std::process::id());
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let reader = open(&camera);
    assert!(!reader.is_null(), "{}", error());
    let elsewhere = reader as usize;
    std::thread::spawn(move || {
        let (reader, mut frame) = (elsewhere as *mut edgecap_bodies, null());
        // SAFETY: open, and its own thread waits.
        unsafe {
            assert_eq!(edgecap_bodies_newest(reader, 0, &raw mut frame), -1);
            assert!(error().contains("thread that opened it"), "{}", error());
            assert_eq!(edgecap_bodies_close(reader), -1);
            assert!(error().contains("thread that opened it"), "{}", error());
        }
    })
    .join()
    .unwrap();
    let mut frame = null();
    let mut message = BodyFrame::default();
    for sequence in 0..5 {
        message.sequence = sequence;
        publisher.publish(&message).unwrap();
    }
    // SAFETY: open, in its own thread; frames are looked at before the next call.
    unsafe {
        assert_eq!(edgecap_bodies_next(reader, 0, null_mut()), -1);
        assert!(error().contains("a place for the frame"), "{}", error());
        assert_eq!(edgecap_bodies_publishers(reader), 1);
        assert_eq!(edgecap_bodies_next(reader, 0, &raw mut frame), 1);
        assert_eq!((*frame).sequence, 0);
        assert_eq!(edgecap_bodies_newest(reader, 0, &raw mut frame), 1);
        assert_eq!((*frame).sequence, 4);
        assert_eq!(edgecap_bodies_next(reader, 0, &raw mut frame), 0);
        assert_eq!(error(), "");
        drop(publisher);
        assert_eq!(edgecap_bodies_publishers(reader), 0);
        assert_eq!(edgecap_bodies_close(reader), 0);
    }
}

#[test]
fn bodies_are_taken_to_the_floor() {
    let mut frame = BodyFrame::default();
    let body = Body {
        position: [0.5, 1.0, 4.0],
        ..Body::default()
    };
    let mut there = edgecap_world_body {
        position: [9.0; 3],
        orientation: [9.0; 4],
        velocity: [9.0; 3],
        joints3d: [[9.0; 3]; 21],
    };
    // SAFETY: all three are ours.
    unsafe {
        assert_eq!(
            edgecap_in_world(&raw const frame, &raw const body, &raw mut there),
            0
        );
        assert_eq!(there.position, [9.0; 3]);
        frame.world = World {
            rotation: [1.0, 0.0, 0.0, 0.0],
            translation: [0.0, 2.0, 0.0],
            state: WorldState::GIVEN,
        };
        assert_eq!(
            edgecap_in_world(&raw const frame, &raw const body, &raw mut there),
            1
        );
    }
    assert_eq!(there.position, frame.in_world(&body).unwrap().position);
    assert_eq!(there.position, [0.5, 1.0, -4.0]);
}

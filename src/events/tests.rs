//! What is told of somebody who is not looked at all the time.

use super::*;
use crate::joints::{BODY_JOINTS, JOINT_NAMES, PELVIS};
use crate::message::{Body, BodyFrame, BodyState, Event, EventKind, JointState, World, WorldState};

const FPS: f64 = 10.0;

fn standing() -> Body {
    Body {
        id: 1,
        state: BodyState::TRACKED,
        confidence: [0.9; BODY_JOINTS],
        joint_states: [JointState::OBSERVED; BODY_JOINTS],
        ..Body::default()
    }
}

/// The right wrist above the head; seen, or not.
fn hand(is_seen: bool) -> Body {
    let mut body = standing();
    for (j, name) in JOINT_NAMES.iter().enumerate() {
        if *name == "r_wrist" {
            body.joints3d[j] = [0.0, -1.0, 0.0];
        }
        if name.ends_with("_wrist") && !(is_seen && name.starts_with('r')) {
            body.joint_states[j] = JointState::OCCLUDED;
        }
    }
    body
}

fn frame(time: f64, body: Option<Body>) -> BodyFrame {
    let mut frame = BodyFrame {
        pose_ns: (time * 1e9).round() as u64,
        count: u32::from(body.is_some()),
        ..BodyFrame::default()
    };
    frame.bodies[0] = body.unwrap_or_default();
    frame
}

fn look(detector: &mut Detector, frames: impl IntoIterator<Item = BodyFrame>) -> Vec<Event> {
    let frames = frames.into_iter();
    frames.flat_map(|frame| detector.look(&frame)).collect()
}

fn kinds(events: &[Event]) -> Vec<EventKind> {
    events.iter().map(|e| e.kind).collect()
}

/// Frames from one time to another, seconds.
fn film(from: f64, to: f64, body: Option<Body>) -> impl Iterator<Item = BodyFrame> {
    let numbers = (from * FPS).round() as u32..(to * FPS).round() as u32;
    numbers.map(move |k| frame(f64::from(k) / FPS, body))
}

#[test]
fn while_a_camera_was_away_nobody_was_there() {
    let mut detector = Detector::new(EventConfig::default());
    let there = Some(standing());
    let before = film(0.0, 10.0, there).chain(film(610.0, 620.0, None));
    let told = look(&mut detector, before.chain(film(620.0, 622.0, there)));
    let seconds = |kind: EventKind| {
        let event = told.iter().find(|e| e.kind == kind);
        event.map(|e| e.seconds).unwrap()
    };
    assert!((seconds(EventKind::LEFT) - 9.9).abs() < 0.01, "{told:?}");
    let away = seconds(EventKind::CAME_BACK);
    assert!((away - 610.1).abs() < 0.01, "{told:?}");
}

#[test]
fn who_was_there_when_it_closed_has_left_when_it_opens() {
    let mut detector = Detector::new(EventConfig::default());
    let night = film(0.0, 10.0, Some(standing())).chain(film(40_000.0, 40_010.0, None));
    let told = look(&mut detector, night);
    let left: Vec<_> = told.iter().filter(|e| e.kind == EventKind::LEFT).collect();
    assert!(
        matches!(left[..], [e] if (e.seconds - 9.9).abs() < 0.01),
        "{told:?}"
    );
    assert_eq!(detector.present(), 0);
}

#[test]
fn where_a_film_begins_anew_everybody_leaves_first() {
    let mut detector = Detector::new(EventConfig::default());
    let pass = || film(0.0, 10.0, Some(standing()));
    let told = look(&mut detector, pass().chain(pass()).chain(pass()));
    let count = |kind| told.iter().filter(|e| e.kind == kind).count();
    assert_eq!((count(EventKind::ENTERED), count(EventKind::LEFT)), (3, 2));
    let left = told.iter().find(|e| e.kind == EventKind::LEFT).unwrap();
    assert!(
        (left.seconds - 9.9).abs() < 0.1 && left.person > 0,
        "{left:?}"
    );
    let nobody = |e: &&Event| e.kind == EventKind::MAIN_PERSON && e.person == 0;
    assert_eq!(told.iter().filter(nobody).count(), 2);
}

/// Somebody comes, has left after two seconds, and somebody else comes.
fn expect_another_after_two_seconds(told: &[Event]) {
    let come = [EventKind::ENTERED, EventKind::MAIN_PERSON];
    let gone = [EventKind::LEFT, EventKind::MAIN_PERSON];
    assert_eq!(kinds(told), [come, gone, come].concat());
    assert!((told[2].seconds - 1.9).abs() < 0.01, "{told:?}");
}

/// The record of a camera whose processes were started again: numbers and ids begin anew, the clock goes on.
#[test]
fn where_numbers_go_back_an_id_is_another_person_s() {
    let mut detector = Detector::new(EventConfig::default());
    let run = |from| {
        let frames = film(from, from + 2.0, Some(standing()));
        (0..)
            .zip(frames)
            .map(|(sequence, frame)| BodyFrame { sequence, ..frame })
    };
    let told = look(&mut detector, run(0.0).chain(run(12.0)));
    expect_another_after_two_seconds(&told);
}

#[test]
fn where_it_is_said_ids_begin_anew_whatever_the_number_and_the_time() {
    let mut detector = Detector::new(EventConfig::default());
    detector.begin_anew();
    let there = Some(standing());
    let mut told = look(&mut detector, film(0.0, 2.0, there));
    detector.begin_anew();
    told.extend(look(&mut detector, film(2.0, 4.0, there)));
    expect_another_after_two_seconds(&told);
}

#[test]
fn times_that_go_back_by_more_than_half_a_second_are_another_recording_s() {
    for (back, wanted) in [(0.4, 0), (0.7, 1), (1.2, 1)] {
        let mut detector = Detector::new(EventConfig::default());
        let there = Some(standing());
        let told = look(
            &mut detector,
            film(0.0, 3.0, there).chain([frame(2.9 - back, there)]),
        );
        let left = told.iter().filter(|e| e.kind == EventKind::LEFT).count();
        assert_eq!(left, wanted, "{back} s back: {told:?}");
    }
}

#[test]
fn the_main_person_is_nearest_to_what_the_settings_say() {
    // Two metres to the right of the camera, and three in front of it.
    let mut frame = frame(0.0, Some(standing()));
    frame.count = 2;
    frame.bodies[1] = Body {
        id: 2,
        ..standing()
    };
    frame.bodies[0].joints3d[PELVIS] = [0.0, 0.0, 3.0];
    frame.bodies[1].joints3d[PELVIS] = [2.0, 0.0, 4.0];
    // Half a turn about x: z of the floor goes towards the viewer.
    frame.world = World {
        rotation: [1.0, 0.0, 0.0, 0.0],
        translation: [0.0, 1.5, 0.0],
        state: WorldState::GIVEN,
    };
    for (main_near, main) in [(None, 1), (Some([2.2, -3.5]), 2), (Some([0.0, 0.0]), 1)] {
        let mut detector = Detector::new(EventConfig {
            main_near,
            ..EventConfig::default()
        });
        for k in 0..10 {
            frame.pose_ns = k * 100_000_000;
            detector.look(&frame);
        }
        assert_eq!(detector.main_person(), Some(main), "{main_near:?}");
    }
}

/// People by id and distance, metres, before a camera at a time, seconds.
fn people(time: f64, away: &[(u32, f64)]) -> BodyFrame {
    let mut frame = frame(time, None);
    frame.count = away.len() as u32;
    for (body, (id, z)) in frame.bodies.iter_mut().zip(away) {
        *body = Body {
            id: *id,
            ..standing()
        };
        body.joints3d[PELVIS] = [0.0, 0.0, *z as f32];
    }
    frame
}

/// Who is told to be the main person, and in which frame, in a film of three seconds.
fn main_people(scene: impl Fn(u32) -> Vec<(u32, f64)>) -> Vec<(u32, u32)> {
    let mut detector = Detector::new(EventConfig::default());
    let told = (0..30).flat_map(|k| {
        let events = detector.look(&people(f64::from(k) / FPS, &scene(k)));
        let main = events
            .into_iter()
            .filter(|e| e.kind == EventKind::MAIN_PERSON);
        main.map(|e| (k, e.person)).collect::<Vec<_>>()
    });
    told.collect()
}

#[test]
fn of_two_who_stand_side_by_side_one_is_the_main_person() {
    // By turns each of them is nearer by five centimetres.
    let waver = |k: u32| 0.05 * f64::from(k % 2);
    let pair = |k: u32, a: u32, b: u32| vec![(a, 2.0 + waver(k)), (b, 2.0 + waver(k + 1))];
    let told = main_people(|k| pair(k, 1, 2));
    assert!(matches!(told[..], [(6..8, 1 | 2)]), "{told:?}");
    // They come to somebody who stands farther away.
    let join = |k: u32| match k {
        0..10 => vec![(1, 4.0)],
        _ => [vec![(1, 4.0)], pair(k, 2, 3)].concat(),
    };
    let told = main_people(join);
    assert!(matches!(told[..], [(6..8, 1), (16..18, 2 | 3)]), "{told:?}");
}

#[test]
fn whoever_is_nearer_by_far_must_be_so_for_as_long_as_anybody() {
    let passes = |k: u32| match k {
        0..10 => vec![(1, 4.0), (2, 5.0), (3, 5.0)],
        10..12 => vec![(1, 4.0), (2, 3.0), (3, 5.0)],
        _ => vec![(1, 4.0), (2, 3.0), (3, 2.0)],
    };
    let told = main_people(passes);
    assert!(matches!(told[..], [(6..8, 1), (15..17, 3)]), "{told:?}");
    // Nor is anybody who is hardly nearer than the main person.
    let near = |k: u32| vec![(1, 4.0), (2, if k < 10 { 5.0 } else { 3.5 })];
    let told = main_people(near);
    assert!(matches!(told[..], [(6..8, 1)]), "{told:?}");
}

#[test]
fn whoever_is_missed_in_single_frames_enters() {
    let missed = Body {
        state: BodyState::PREDICTED,
        ..standing()
    };
    let enters = |bodies: &dyn Fn(u32) -> Option<Body>| {
        let mut detector = Detector::new(EventConfig::default());
        let film = (0..30).map(|k| frame(f64::from(k) / FPS, bodies(k)));
        kinds(&look(&mut detector, film)).contains(&EventKind::ENTERED)
    };
    let every_third = |k: u32, other| match k % 3 {
        2 => other,
        _ => Some(standing()),
    };
    assert!(enters(&|k| every_third(k, Some(missed))), "still expected");
    assert!(!enters(&|k| every_third(k, None)), "not even expected");
    // Expected for longer than somebody must be seen, between two looks.
    let seldom = |k: u32| {
        Some(if k.is_multiple_of(10) {
            standing()
        } else {
            missed
        })
    };
    assert!(!enters(&seldom), "two looks far apart");
}

#[test]
fn two_frames_far_apart_raise_no_hand() {
    for is_silent in [false, true] {
        let mut detector = Detector::new(EventConfig::default());
        look(&mut detector, film(0.0, 2.0, Some(hand(false))));
        let mut told = look(&mut detector, [frame(2.0, Some(hand(true)))]);
        if !is_silent {
            told.extend(look(&mut detector, film(2.1, 32.0, Some(hand(false)))));
        }
        told.extend(look(&mut detector, [frame(32.0, Some(hand(true)))]));
        assert_eq!(kinds(&told), [], "silent: {is_silent}");
        // Of a hand that stays up it counts from when it was seen again.
        let held = look(&mut detector, film(32.1, 33.0, Some(hand(true))));
        assert_eq!(kinds(&held), [EventKind::HAND_RAISED]);
    }
}

/// The same before a camera that knows its floor.
fn on_floor(frame: BodyFrame) -> BodyFrame {
    BodyFrame {
        world: World {
            rotation: [1.0, 0.0, 0.0, 0.0],
            translation: [0.0, 1.0, 0.0],
            state: WorldState::GIVEN,
        },
        ..frame
    }
}

fn joint(name: &str) -> usize {
    JOINT_NAMES.iter().position(|n| *n == name).unwrap()
}

/// Whether somebody raises a hand, and whether they wave, at whom this is changed.
fn gestures(change: impl Fn(&mut Body)) -> [bool; 2] {
    let mut detector = Detector::new(EventConfig::default());
    let numbers = 0..30;
    let frames = numbers.map(|k| {
        // Above the head it swings beside the elbow.
        let mut body = hand(true);
        body.joints3d[joint("r_wrist")] = [0.2 * (k % 2) as f32, -0.5, 0.0];
        body.joints3d[joint("l_shoulder")] = [0.4, 0.0, 0.0];
        change(&mut body);
        frame(f64::from(k) / FPS, Some(body))
    });
    let told = kinds(&look(&mut detector, frames));
    [EventKind::HAND_RAISED, EventKind::WAVED].map(|kind| told.contains(&kind))
}

#[test]
fn a_gesture_is_read_from_joints_that_are_seen() {
    assert_eq!(gestures(|_| {}), [true, true]);
    for (name, wanted) in [
        ("r_wrist", [false, false]),
        ("head_top", [false, true]),
        ("r_shoulder", [true, false]),
        ("l_shoulder", [true, false]),
        ("r_elbow", [true, false]),
        // Nothing is measured from it.
        ("l_elbow", [true, true]),
    ] {
        let j = joint(name);
        let hidden = gestures(|body| body.joint_states[j] = JointState::OCCLUDED);
        let unsure = gestures(|body| body.confidence[j] = 0.4);
        assert_eq!([hidden, unsure], [wanted; 2], "{name}");
    }
}

#[test]
fn two_frames_far_apart_are_nobody_s_arrival() {
    let mut detector = Detector::new(EventConfig::default());
    let there = Some(standing());
    let told = look(&mut detector, [frame(0.0, there), frame(30.0, there)]);
    assert_eq!(kinds(&told), []);
    let stays = look(&mut detector, film(30.1, 30.6, there));
    assert!(kinds(&stays).contains(&EventKind::ENTERED), "{stays:?}");
}

#[test]
fn two_frames_far_apart_that_know_a_floor_enter_no_zone() {
    let zone = Zone {
        name: "here".into(),
        corners: vec![[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]],
        dwell: None,
    };
    let mut detector = Detector::new(EventConfig {
        zone: vec![zone],
        ..EventConfig::default()
    });
    let on_floor = |time: f64| on_floor(frame(time, Some(standing())));
    look(&mut detector, film(0.0, 2.0, Some(standing())));
    let mut told = look(&mut detector, [on_floor(2.0)]);
    told.extend(look(&mut detector, film(2.1, 32.0, Some(standing()))));
    told.extend(look(&mut detector, [on_floor(32.0)]));
    assert_eq!(kinds(&told), []);
    let stays = look(
        &mut detector,
        (1..6).map(|k| on_floor(32.0 + f64::from(k) / FPS)),
    );
    assert_eq!(kinds(&stays), [EventKind::ZONE_ENTERED]);
}

/// The camera is away for ten minutes, and who was there still is.
#[test]
fn time_in_which_nobody_looked_is_no_stay() {
    let zone = Zone {
        name: "here".into(),
        corners: vec![[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]],
        dwell: Some(5.0),
    };
    let mut detector = Detector::new(EventConfig {
        zone: vec![zone],
        ..EventConfig::default()
    });
    let there = Some(standing());
    // Out of sight for a moment when the camera is back.
    let back = film(602.0, 602.2, None).chain(film(602.2, 610.0, there));
    let frames = film(0.0, 2.0, there)
        .chain(back)
        .chain(film(610.0, 612.0, None));
    let told = frames.map(on_floor).flat_map(|frame| {
        let time = frame.pose_ns as f64 * 1e-9;
        let events = detector.look(&frame);
        events.into_iter().map(move |event| (time, event))
    });
    let told: Vec<(f64, Event)> = told.collect();
    let of = |kind: EventKind| {
        let mut of_kind = told.iter().filter(|(_, e)| e.kind == kind);
        let (found, more) = (of_kind.next(), of_kind.next());
        assert!(more.is_none(), "{told:?}");
        found.unwrap_or_else(|| panic!("{kind:?} in {told:?}"))
    };
    let (when, dwelt) = of(EventKind::DWELT);
    // In the zone from 0.3 s on; 600.1 s are none of the stay.
    assert!((when - 605.4).abs() < 0.15, "{told:?}");
    assert!((dwelt.seconds - 5.0).abs() < 0.15, "{told:?}");
    for (kind, seconds) in [(EventKind::ZONE_LEFT, 9.5), (EventKind::LEFT, 9.8)] {
        assert!((of(kind).1.seconds - seconds).abs() < 0.15, "{told:?}");
    }
}

#[test]
fn of_a_slow_camera_everything_is_told() {
    // A picture, and bodies that go on for 0.1 s and are held then, as `fit --rate` has them.
    let picture = |k: u32, body, ahead: &[f64]| {
        let messages = ahead.iter().map(|ahead| BodyFrame {
            sequence: k.into(),
            ..frame(10.0 * f64::from(k) + ahead, body)
        });
        messages.collect::<Vec<_>>()
    };
    let alone: &[f64] = &[0.0];
    for ahead in [alone, &[0.0, 0.05, 0.1, 0.1, 0.1]] {
        let slow =
            |frames: std::ops::Range<u32>, body| frames.flat_map(move |k| picture(k, body, ahead));
        let mut detector = Detector::new(EventConfig::default());
        let frames = slow(0..4, None).chain(slow(4..10, Some(hand(true))));
        let told = look(&mut detector, frames.chain(slow(10..14, None)));
        assert_eq!(
            kinds(&told),
            [
                EventKind::ENTERED,
                EventKind::HAND_RAISED,
                EventKind::MAIN_PERSON,
                EventKind::LEFT,
                EventKind::MAIN_PERSON
            ],
            "{ahead:?}"
        );
    }
}

//! Stage III against exact truth: identities, errors, jitter, limits, times that misbehave, numbers that make no sense.

use std::collections::BTreeMap;

use crate::scene::measure::{Report, is_finite, line, run};
use crate::scene::people::{self, Activity, Leg, Person};
use crate::scene::{HEIGHT, Noise, Scene, WIDTH};
use edgecap::body::skeleton::{Pose, Posed, Skeleton, rotation_vector};
use edgecap::fit::config::GroundConfig;
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS, NECK, PELVIS};
use edgecap::message::{
    APPEARANCE_BINS, BodyFrame, BodyState, FLAG_END_OF_STREAM, Intrinsics, JointState, Observation,
    ObservationFrame,
};
use glam::{DQuat, DVec2, DVec3, Vec3};
use proptest::prelude::*;

const FPS: f64 = 30.0;

fn check_everywhere(report: &Report) {
    assert!(report.finite, "a number was not finite");
    assert!(
        report.beyond <= 5.0,
        "an angle exceeded its limit by {}°",
        report.beyond
    );
    assert!(
        report.mpjpe3() <= report.mpjpe2(),
        "Stage III is worse than Stage II"
    );
}

#[test]
fn everyday_movement_is_steadier_and_nearer_than_stage_two() {
    let mut scene = Scene::new(people::everyday(), Noise::REAL, FPS, 5);
    let r = run(&mut scene, FitConfig::default(), 300, 30, true);
    println!("{}", line("everyday", &r));
    check_everywhere(&r);
    assert_eq!((r.switches, r.ids, r.false_bodies), (0, 5, 0));
    assert!(r.idf1 > 0.98);
    assert!(r.jitter3.get() < r.jitter2.get() / 5.0);
    assert!(Report::lag_frames(&r.lag3) - Report::lag_frames(&r.lag2) <= 1.0);
    assert!(r.depth_known.get() < 0.05);
    assert!(r.sliding3.get() < 0.35 * r.sliding2.get());
    assert!(r.mpjpe3() < 0.75 * r.mpjpe2());
}

#[test]
fn people_who_cross_keep_their_identities() {
    for seed in [5, 8] {
        let mut scene = Scene::new(people::crossing(), Noise::REAL, FPS, seed);
        let r = run(&mut scene, FitConfig::default(), 450, 30, false);
        println!("{}", line("crossing", &r));
        check_everywhere(&r);
        assert_eq!((r.switches, r.ids), (0, 4), "seed {seed}");
        assert!(r.idf1 >= 0.95);
    }
}

#[test]
fn people_who_leave_come_back_as_themselves() {
    let mut scene = Scene::new(people::wanderers(60.0, 2), Noise::REAL, FPS, 2);
    let r = run(&mut scene, FitConfig::default(), 1500, 30, false);
    println!("{}", line("wanderers", &r));
    check_everywhere(&r);
    assert!(r.idf1 >= 0.95, "IDF1 {}", r.idf1);
}

#[test]
#[ignore = "long: half an hour of six people"]
fn long_half_hour_of_six_people() {
    for seed in 1..=12 {
        let mut scene = Scene::new(people::wanderers(300.0, seed), Noise::REAL, FPS, seed);
        let r = run(&mut scene, FitConfig::default(), 9000, 30, false);
        println!("{}", line(&format!("wanderers {seed}"), &r));
        check_everywhere(&r);
        assert!(r.idf1 >= 0.95, "IDF1 {}", r.idf1);
    }
}

#[test]
#[ignore = "long: ten scenes"]
fn long_crossings() {
    let mut switches = Vec::new();
    for seed in 1..=10 {
        let mut scene = Scene::new(people::crossing(), Noise::REAL, FPS, seed);
        let r = run(&mut scene, FitConfig::default(), 900, 30, false);
        println!("{}", line(&format!("crossing {seed}"), &r));
        check_everywhere(&r);
        switches.push(r.switches);
    }
    assert_eq!(switches, [0; 10]);
}

#[test]
fn angles_and_bone_lengths_give_the_joints() {
    let skeleton = Skeleton::builtin();
    let mut scene = Scene::new(people::everyday(), Noise::REAL, FPS, 4);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut bodies = 0;
    for n in 0..90 {
        let (frame, _) = scene.next();
        fitter.update(&frame, &mut out);
        if n % 3 == 2 {
            fitter.predict(frame.capture_ns + 20_000_000, &mut out);
        }
        for body in out.bodies() {
            bodies += 1;
            let number = |k: usize| f64::from(body.angles[k]);
            let pose = Pose {
                position: DVec3::from_array([0, 1, 2].map(number)),
                rotation: DQuat::from_scaled_axis(DVec3::from_array([3, 4, 5].map(number))),
                angles: std::array::from_fn(|k| number(6 + k)),
            };
            let mut posed = Posed::default();
            skeleton.pose(&pose, &body.bone_lengths.map(f64::from), &mut posed);
            for (j, p) in posed.joints.iter().enumerate() {
                let off = (p.as_vec3() - Vec3::from_array(body.joints3d[j])).length();
                assert!(off < 1e-4, "frame {n}, joint {j}: {off} m off");
            }
        }
    }
    assert!(bodies > 300, "{bodies} bodies");
}

#[test]
fn rotation_vectors_of_the_pelvis_follow_each_other_without_a_leap() {
    let mut scene = Scene::new(people::everyday(), Noise::REAL, FPS, 4);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut last = BTreeMap::new();
    let mut leaps = 0;
    for n in 0..300 {
        let (frame, _) = scene.next();
        fitter.update(&frame, &mut out);
        for body in out.bodies() {
            let turn = DVec3::from_array([3, 4, 5].map(|k| f64::from(body.angles[k])));
            let q = DQuat::from_array(body.orientation.map(f64::from));
            let Some((from, before)) = last.insert(body.id, (turn, q)) else {
                continue;
            };
            // Who was placed anew may well have turned.
            if q.dot(before).abs() > 0.995 {
                let (id, step) = (body.id, turn.distance(from));
                assert!(step < 1.5, "frame {n}, {id}: from {from} to {turn}");
                let shortest = rotation_vector(q).distance(rotation_vector(before));
                leaps += u32::from(shortest > 4.0);
            }
        }
    }
    assert!(leaps > 0, "nobody stood where the shortest ones leap");
}

#[test]
fn people_seen_for_one_frame_are_never_born() {
    // At 6 frames a second two in a row are enough, so of phantoms in every frame some would stand where another just
    // stood.
    for (fps, phantom) in [(FPS, 1.0), (6.0, 0.05)] {
        let noise = Noise {
            phantom,
            ..Noise::NONE
        };
        let mut scene = Scene::new(Vec::new(), noise, fps, 4);
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        for _ in 0..600 {
            fitter.update(&scene.next().0, &mut out);
            assert_eq!(out.count, 0);
        }
        assert_eq!(fitter.counters().births, 0);
    }
}

/// Somebody who stands at (x, z).
fn standing(seed: u64, x: f64, z: f64) -> Person {
    let here = DVec2::new(x, z);
    let leg = Leg {
        start: 0.0,
        end: 1.0,
        from: here,
        to: here,
    };
    Person::new(seed, vec![leg], Activity::Stand)
}

/// Clothes of one hue, or of none, and one saturation, each the number of a bin.
fn dress(seen: &mut Observation, hue: Option<usize>, saturation: usize) {
    seen.hue = [1.0 / APPEARANCE_BINS as f32; APPEARANCE_BINS];
    if let Some(hue) = hue {
        seen.hue = [0.0; APPEARANCE_BINS];
        seen.hue[hue] = 1.0;
    }
    seen.saturation = [0.0; APPEARANCE_BINS];
    seen.saturation[saturation] = 1.0;
}

/// People who stand still before a fitter, of whom each frame shows some.
struct Stage {
    scene: Scene,
    fitter: Fitter,
    /// Nanoseconds without frames so far.
    paused: u64,
}

impl Stage {
    fn new(cast: Vec<Person>) -> Self {
        Self::at(FPS, cast)
    }

    /// At so many frames a second.
    fn at(fps: f64, cast: Vec<Person>) -> Self {
        Self {
            scene: Scene::new(cast, Noise::NONE, fps, 1),
            fitter: Fitter::new(FitConfig::default()).unwrap(),
            paused: 0,
        }
    }

    /// A frame of those whom `shows`, which may change what is seen of them. Who everybody is published as.
    fn frame(&mut self, shows: impl Fn(usize, &mut Observation) -> bool) -> Vec<Option<u32>> {
        let (mut frame, truths) = self.scene.next();
        let mut people = Vec::new();
        for (k, truth) in truths.iter().enumerate() {
            let mut seen = frame.people[truth.observation.expect("in view")];
            if shows(k, &mut seen) {
                people.push(seen);
            }
        }
        frame.count = people.len() as u32;
        frame.people[..people.len()].copy_from_slice(&people);
        frame.capture_ns += self.paused;
        let mut out = BodyFrame::default();
        self.fitter.update(&frame, &mut out);
        let id = |x: f64| {
            let mut bodies = out.bodies().iter();
            let here = bodies.find(|b| (f64::from(b.position[0]) - x).abs() < 0.4);
            here.map(|b| b.id)
        };
        truths.iter().map(|t| id(t.joints[PELVIS].x)).collect()
    }
}

/// Somebody of canonical stature who faces the camera at (x, z), metres, and of whom everything is seen but looks, at
/// so many seconds.
fn facing(seconds: f64, x: f64, z: f64) -> ObservationFrame {
    let camera = Intrinsics::from_horizontal_fov(WIDTH, HEIGHT, 70.0);
    let s = Skeleton::builtin();
    let mut pose = Pose::facing_camera(z);
    pose.position.x = x;
    let mut posed = Posed::default();
    s.pose(&pose, s.lengths(), &mut posed);
    let mut seen = Observation {
        score: 0.99,
        ..Observation::default()
    };
    for (out, joint) in seen.joints2d.iter_mut().zip(posed.joints) {
        let [u, v] = camera.project(joint.as_vec3().to_array());
        *out = [u, v, 0.95];
    }
    for (out, joint) in seen.joints3d.iter_mut().zip(posed.joints) {
        *out = (joint - posed.joints[PELVIS]).as_vec3().to_array();
    }
    let mut frame = ObservationFrame {
        capture_ns: (seconds * 1e9).round() as u64,
        width: WIDTH,
        height: HEIGHT,
        intrinsics: camera,
        count: 1,
        ..ObservationFrame::default()
    };
    frame.people[0] = seen;
    frame
}

/// Takes looks away.
fn undress(seen: &mut Observation) {
    seen.hue = [0.0; APPEARANCE_BINS];
    seen.saturation = [0.0; APPEARANCE_BINS];
}

/// Frames that a newcomer is seen without a name, in an empty view or where somebody else was just seen.
fn frames_until_named(fps: f64, somebody_before: bool) -> Option<usize> {
    let stands = |seed, x, z| {
        let way = people::walk(0.0, 1.0, &[(x, z), (x + 0.5, z)]);
        Scene::new(
            vec![Person::new(seed, way, Activity::Wave)],
            Noise::NONE,
            fps,
            4,
        )
    };
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let (mut before, mut scene) = (stands(5, -1.5, 6.0), stands(3, 0.5, 3.5));
    let frames = if somebody_before {
        (fps * 2.0) as u64
    } else {
        0
    };
    let mut last = 0;
    for _ in 0..frames {
        let frame = before.next().0;
        // Scenes begin at one second; the second one follows the first without a pause.
        last = frame.capture_ns + (1e9 / fps) as u64 - 1_000_000_000;
        fitter.update(&frame, &mut out);
    }
    let known = fitter.counters().births;
    (0..15).find(|_| {
        let mut frame = scene.next().0;
        frame.sequence += frames;
        frame.capture_ns += last;
        fitter.update(&frame, &mut out);
        fitter.counters().births > known
    })
}

#[test]
fn newcomers_wait_only_while_somebody_is_away() {
    for fps in [60.0, FPS, 6.0] {
        assert_eq!(
            frames_until_named(fps, false),
            Some(0),
            "{fps} frames a second"
        );
    }
    for (fps, unnamed) in [
        (60.0, 12),
        (FPS, 6),
        (15.0, 3),
        (12.0, 3),
        (10.0, 1),
        (6.0, 1),
    ] {
        assert_eq!(
            frames_until_named(fps, true),
            Some(unnamed),
            "{fps} frames a second"
        );
    }
}

#[test]
fn a_missed_person_is_predicted_then_gone_then_recognised() {
    let person = Person::new(
        3,
        people::walk(0.0, 1.0, &[(0.0, 4.0), (0.0, 4.0)]),
        Activity::Wave,
    );
    let mut scene = Scene::new(vec![person], Noise::NONE, FPS, 4);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut states = Vec::new();
    for f in 0..220 {
        let (mut frame, _) = scene.next();
        if (60..160).contains(&f) {
            frame.count = 0;
        }
        fitter.update(&frame, &mut out);
        states.push(
            out.bodies()
                .first()
                .map(|b| (b.id, b.state, b.confidence[4], b.joint_states[4])),
        );
    }
    assert!(
        states[0].is_some(),
        "with nobody away there is nothing to wait for"
    );
    let (id, state, sure, joint) = states[59].unwrap();
    assert_eq!(
        (id, state, joint),
        (1, BodyState::TRACKED, JointState::OBSERVED)
    );
    let (id, state, unsure, joint) = states[62].unwrap();
    assert_eq!(
        (id, state, joint),
        (1, BodyState::PREDICTED, JointState::PREDICTED)
    );
    assert!(unsure < sure);
    assert_eq!(
        states[150], None,
        "nobody is shown for long without being seen"
    );
    assert_eq!(states[161], None);
    let (id, ..) = states[162].expect("whoever is recognised waits for three observations only");
    assert_eq!(id, 1, "the same person comes back");
    assert_eq!(states[200].unwrap().0, 1);
}

#[test]
fn whoever_walks_out_is_not_drawn_walking_on() {
    let ways = [[(0.0, 4.0), (5.0, 4.0)], [(0.5, 3.0), (-5.0, 3.0)]];
    for (seed, way) in ways.iter().enumerate() {
        let person = Person::new(3, people::walk(0.5, 1.2, way), Activity::Wave);
        let mut scene = Scene::new(vec![person], Noise::NONE, FPS, seed as u64);
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        let (mut tracked, mut outside) = (0, 0);
        for _ in 0..150 {
            let (frame, truths) = scene.next();
            fitter.update(&frame, &mut out);
            // Pixel centres are integers: the picture begins half a pixel before the first of them.
            let inside = |[u, v]: [f32; 2]| {
                (-0.5..out.width as f32 - 0.5).contains(&u)
                    && (-0.5..out.height as f32 - 0.5).contains(&v)
            };
            for body in out.bodies() {
                let predicted = body.state == BodyState::PREDICTED;
                let trunk = [NECK, PELVIS].map(|j| inside(body.joints2d[j]));
                assert!(!predicted || trunk.contains(&true), "{trunk:?}");
                tracked += usize::from(!predicted);
            }
            let truth = truths[0].joints[PELVIS].as_vec3().to_array();
            outside += usize::from(!inside(frame.intrinsics.project(truth)));
        }
        assert!(tracked > 30, "seen in {tracked} frames");
        assert!(outside > 30, "beyond the edge in {outside} frames");
        assert_eq!(out.count, 0);
        assert_eq!(fitter.counters().births, 1);
    }
}

#[test]
fn the_same_frames_give_the_same_bodies() {
    let frames: Vec<ObservationFrame> = {
        let mut scene = Scene::new(people::crossing(), Noise::REAL, FPS, 3);
        (0..90).map(|_| scene.next().0).collect()
    };
    let run = || {
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        let mut all = Vec::new();
        for frame in &frames {
            fitter.update(frame, &mut out);
            all.push(out);
        }
        all
    };
    assert!(run() == run());
}

#[test]
fn prediction_is_bounded_and_changes_nothing() {
    let mut scene = Scene::new(people::crossing(), Noise::NONE, FPS, 3);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let (mut now, mut ahead, mut later) = Default::default();
    for _ in 0..45 {
        fitter.update(&scene.next().0, &mut now);
    }
    fitter.predict(now.capture_ns, &mut ahead);
    assert!(ahead == now, "no time ahead is the frame itself");
    fitter.predict(now.capture_ns + 16_000_000, &mut ahead);
    assert_eq!(ahead.pose_ns, now.capture_ns + 16_000_000);
    let walker = now
        .bodies()
        .iter()
        .position(|b| b.velocity[0].abs() > 0.5)
        .expect("somebody walks");
    let step = ahead.bodies[walker].position[0] - now.bodies[walker].position[0];
    let expected = now.bodies[walker].velocity[0] * 0.016;
    assert!(
        (step - expected).abs() < 0.2 * expected.abs(),
        "{step} instead of {expected}"
    );
    fitter.predict(now.capture_ns + 100_000_000, &mut later);
    fitter.predict(now.capture_ns + 60_000_000_000, &mut ahead);
    assert!(ahead == later, "not farther than the bound");
    assert_eq!(ahead.pose_ns, now.capture_ns + 100_000_000);
    fitter.predict(0, &mut ahead);
    assert!(ahead == now, "never back in time");
}

#[test]
fn half_the_frame_rate_ahead_is_nearer_than_standing_still() {
    let mut scene = Scene::new(people::crossing(), Noise::NONE, FPS, 3);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let (mut now, mut ahead) = (BodyFrame::default(), BodyFrame::default());
    let (mut predicted, mut held) = (0.0, 0.0);
    for f in 0..120 {
        fitter.update(&scene.next().0, &mut now);
        fitter.predict(now.capture_ns + 33_333_333, &mut ahead);
        let truths = scene.truths(scene.time(f + 1));
        let matches = crate::scene::measure::match_bodies(&truths, &now, &Default::default());
        for (truth, b) in truths.iter().zip(matches) {
            let Some(b) = b else { continue };
            let grow = truth.height / f64::from(now.bodies[b].height);
            let x = truth.joints[14].x;
            predicted += (f64::from(ahead.bodies[b].position[0]) * grow - x).abs();
            held += (f64::from(now.bodies[b].position[0]) * grow - x).abs();
        }
    }
    assert!(predicted < 0.8 * held, "{predicted} {held}");
}

#[test]
fn times_may_misbehave() {
    let mut scene = Scene::new(people::everyday(), Noise::NONE, FPS, 3);
    let frames: Vec<ObservationFrame> = (0..80).map(|_| scene.next().0).collect();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    for frame in &frames[..40] {
        fitter.update(frame, &mut out);
    }
    let ids: Vec<u32> = out.bodies().iter().map(|b| b.id).collect();
    assert_eq!(ids.len(), 5);
    let newest = out;
    // Late frames and repeated ones change nothing.
    for k in [39, 35, 30] {
        fitter.update(&frames[k], &mut out);
        assert!(out == newest, "a late frame changed something");
    }
    // Nor does a greater number make a frame newer.
    for back in [200_000_000, 0] {
        let mut frame = frames[39];
        frame.sequence += 1;
        frame.capture_ns -= back;
        fitter.update(&frame, &mut out);
        assert!(out == newest, "a frame of the past changed something");
    }
    assert_eq!(fitter.counters().stale_frames, 5);
    // Half a second of frames dropped, then a recorder that starts its sequence over while time goes on.
    for (n, frame) in frames[55..].iter().enumerate() {
        let mut frame = *frame;
        frame.sequence = n as u64;
        fitter.update(&frame, &mut out);
    }
    let now: Vec<u32> = out.bodies().iter().map(|b| b.id).collect();
    assert_eq!(
        now, ids,
        "people keep their names over a gap and a restarted camera process"
    );
    // Another recording: names are never given twice.
    for frame in &frames {
        fitter.update(frame, &mut out);
    }
    assert_eq!(fitter.counters().restarts, 1);
    assert!(out.count == 5 && out.bodies().iter().all(|b| b.id > 5));
    // A gap longer than anybody's memory.
    let mut frame = frames[79];
    frame.capture_ns += 3_600_000_000_000;
    let births = fitter.counters().births;
    fitter.update(&frame, &mut out);
    assert!(out.count == 5 && fitter.counters().births == births + 5);
    // The end of the stream repeats the last state and says so.
    let end = ObservationFrame {
        flags: FLAG_END_OF_STREAM,
        capture_ns: frame.capture_ns,
        ..ObservationFrame::default()
    };
    fitter.update(&end, &mut out);
    assert_eq!(out.flags, FLAG_END_OF_STREAM);
}

#[test]
fn whoever_is_not_sure_is_born_at_second_sight_where_frames_are_seconds_apart() {
    let person = Person::new(
        3,
        people::walk(0.0, 1.0, &[(0.0, 4.0), (0.5, 4.0)]),
        Activity::Stand,
    );
    let mut scene = Scene::new(vec![person], Noise::NONE, 0.5, 4);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    for f in 0..6 {
        let (mut frame, _) = scene.next();
        frame.people[0].score = 0.8;
        fitter.update(&frame, &mut out);
        let ids: Vec<u32> = out.bodies().iter().map(|b| b.id).collect();
        assert_eq!(ids, [1][..usize::from(f > 0)], "frame {f}");
    }
    assert_eq!((fitter.counters().births, fitter.remembered()), (1, 1));
}

#[test]
fn where_frames_are_farther_apart_than_the_place_tells_the_second_sight_is_enough_as_well() {
    let way = people::walk(0.0, 1.0, &[(0.0, 4.0), (0.5, 4.0)]);
    let person = Person::new(3, way, Activity::Stand);
    let mut scene = Scene::new(vec![person], Noise::NONE, 0.2, 4);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    for f in 0..6 {
        let (mut frame, _) = scene.next();
        frame.people[0].score = 0.8;
        dress(&mut frame.people[0], None, 0);
        fitter.update(&frame, &mut out);
        assert_eq!(out.count, u32::from(f > 0), "frame {f}");
    }
    // Nothing tells that it is the same one.
    assert_eq!(fitter.counters().births, 5);
}

#[test]
fn what_is_forgotten_at_once_is_no_frame_of_a_slow_camera() {
    // Frames a second, seconds without frames, and who is there afterwards.
    for (fps, pause, id) in [(0.8, 0, 1), (FPS, 0, 1), (FPS, 5, 2)] {
        let mut config = FitConfig::default();
        config.identity.memory = 0.0;
        let mut fitter = Fitter::new(config).unwrap();
        let mut out = BodyFrame::default();
        let mut scene = Scene::new(vec![standing(3, 0.0, 4.0)], Noise::NONE, fps, 4);
        for f in 0..12 {
            let (mut frame, _) = scene.next();
            dress(&mut frame.people[0], Some(10), 20);
            let is_later = f >= 6;
            if is_later {
                frame.capture_ns += pause * 1_000_000_000;
            }
            fitter.update(&frame, &mut out);
            let ids: Vec<u32> = out.bodies().iter().map(|b| b.id).collect();
            let expected = if is_later { id } else { 1 };
            assert_eq!(ids, [expected], "{fps} fps, pause of {pause} s, frame {f}");
        }
    }
}

#[test]
fn times_that_do_not_rise_take_nothing_back_and_make_nobody_fast() {
    let mut scene = Scene::new(people::everyday(), Noise::NONE, FPS, 3);
    let frames: Vec<ObservationFrame> = (0..60).map(|_| scene.next().0).collect();
    // One frame of two is told 0.2 s too early; no frame has a time.
    let early = |f: usize, ns: u64| ns - 200_000_000 * (f as u64 % 2);
    let none = |_: usize, _: u64| 0;
    for told in [&early as &dyn Fn(usize, u64) -> u64, &none] {
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        let mut newest = 0;
        for (f, frame) in frames.iter().enumerate() {
            let mut frame = *frame;
            frame.capture_ns = told(f, frame.capture_ns);
            fitter.update(&frame, &mut out);
            assert!(out.capture_ns >= newest, "frame {f} takes time back");
            assert_eq!(out.pose_ns, out.capture_ns);
            newest = out.capture_ns;
            assert!(
                out.count <= 5,
                "frame {f}: {} bodies of five people",
                out.count
            );
            for body in out.bodies() {
                let speed = Vec3::from_array(body.velocity).length();
                assert!(speed < 5.0, "frame {f}: {speed} m/s");
            }
        }
        assert!(out.count == 5 && fitter.counters().stale_frames > 20);
    }
}

#[test]
fn pictures_that_have_nothing_to_do_with_each_other() {
    let mut scene = Scene::new(people::everyday(), Noise::NONE, FPS, 3);
    let config = FitConfig {
        stills: true,
        ..FitConfig::default()
    };
    let mut fitter = Fitter::new(config).unwrap();
    let mut out = BodyFrame::default();
    for _ in 0..3 {
        let (mut frame, truths) = scene.next();
        frame.capture_ns = 0;
        fitter.update(&frame, &mut out);
        let seen = truths.iter().filter(|t| t.observation.is_some()).count();
        assert_eq!(out.count as usize, seen, "everybody at once");
    }
}

#[test]
fn any_frame_rate_will_do() {
    for fps in [0.5, 0.8, 2.0, 3.0, 5.0, 12.0, 120.0] {
        let mut scene = Scene::new(people::everyday(), Noise::REAL, fps, 5);
        let frames = (8.0 * fps).max(24.0) as u64;
        let r = run(&mut scene, FitConfig::default(), frames, frames / 4, false);
        println!("{}", line(&format!("{fps} fps"), &r));
        check_everywhere(&r);
        assert!(r.idf1 > 0.9, "IDF1 {} at {fps} fps", r.idf1);
        assert_eq!(r.switches, 0, "{fps} fps");
        let (found, seen) = (r.matched as f64, r.detectable as f64);
        assert!(found > 0.9 * seen, "{found} of {seen} at {fps} fps");
    }
}

#[test]
fn whoever_hides_their_hips_and_walks_is_followed_at_few_frames_a_second() {
    for fps in [5.0, 4.0, 3.0, 2.0] {
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        for n in 0..(6.0 * fps) as u32 {
            let seconds = f64::from(n) / fps;
            // From the last frame of the first two seconds on.
            let walked = 1.2 * (seconds - 2.0 + 1.0 / fps).max(0.0);
            let mut frame = facing(1.0 + seconds, -2.5 + walked, 5.0);
            let seen = &mut frame.people[0];
            match seconds < 2.0 {
                true => dress(seen, Some(10), 20),
                false => seen.joints2d[8..].fill([0.0; 3]),
            }
            fitter.update(&frame, &mut out);
            let found: Vec<_> = out.bodies().iter().map(|b| (b.id, b.state)).collect();
            assert_eq!(found, [(1, BodyState::TRACKED)], "{fps} fps, {seconds} s");
        }
    }
}

#[test]
fn whoever_walks_up_to_the_camera_is_not_taken_through_the_lens() {
    const SPEED: f64 = 1.4;
    let (from, last, stops) = (3.2, 1.2, 0.8);
    // The camera gives no frame for so long, while the last half metre is walked.
    for gap in [0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.98] {
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        let mut update = |seconds: f64, z: f64| {
            fitter.update(&facing(1.0 + seconds, 0.0, z), &mut out);
            let [body] = out.bodies() else {
                panic!("gap of {gap} s, {z} m: {} bodies of one person", out.count);
            };
            assert_eq!((body.id, body.state), (1, BodyState::TRACKED));
            let found = f64::from(body.position[2]);
            assert!(
                (found / z - 1.0).abs() < 0.1,
                "gap of {gap} s: {found} m instead of {z}"
            );
        };
        let frames = ((from - last) / SPEED * FPS) as u32;
        for n in 0..=frames {
            let seconds = f64::from(n) / FPS;
            update(seconds, from - SPEED * seconds);
        }
        for n in 1..7 {
            update(f64::from(frames + n) / FPS + gap, stops);
        }
    }
}

#[test]
fn whoever_comes_back_turned_round_is_seen_from_behind() {
    const SHOULDERS: (usize, usize) = (2, 5);
    // Frames without them: more than a quarter of a second, and less than they are expected for.
    for gap in [12, 20, 60] {
        let mut scene = Scene::new(vec![standing(3, 0.0, 4.0)], Noise::NONE, FPS, 4);
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        for n in 0..60 + gap + 30 {
            if n == 60 {
                scene.people[0].facing += std::f64::consts::PI;
            }
            let (mut frame, truths) = scene.next();
            if (60..60 + gap).contains(&n) {
                frame.count = 0;
            }
            fitter.update(&frame, &mut out);
            if n < 60 + gap + 5 {
                continue;
            }
            let (r, l) = SHOULDERS;
            let body = &out.bodies()[0];
            let [right, left] = [r, l].map(|j| Vec3::from_array(body.joints3d[j]));
            let truth = truths[0].joints;
            let truth = (truth[l] - truth[r]).as_vec3().normalize();
            let alike = (left - right).normalize().dot(truth);
            assert!(alike > 0.8, "away for {gap} frames, frame {n}: {alike}");
        }
    }
}

#[test]
fn a_jump_is_doubted_for_a_moment_at_any_frame_rate() {
    const WRIST: usize = 4;
    for (fps, doubted, followed) in [(30.0, 2, 8), (6.0, 0, 2)] {
        let person = Person::new(
            3,
            people::walk(0.0, 1.0, &[(0.0, 4.0), (0.0, 4.0)]),
            Activity::Stand,
        );
        let mut scene = Scene::new(vec![person.of_height(1.70)], Noise::NONE, fps, 4);
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        let jump = (2.0 * fps) as usize;
        let mut gaps = Vec::new();
        for f in 0..jump + 10 {
            let (mut frame, truths) = scene.next();
            let seen = &mut frame.people[0];
            let root = truths[0].joints[PELVIS].as_vec3();
            let shoulder = Vec3::from_array(seen.joints3d[2]);
            let raised = [(3, 0.26), (WRIST, 0.50), (17, 0.60)];
            if f >= jump {
                for (joint, above) in raised {
                    let p = shoulder - above * Vec3::Y;
                    seen.joints3d[joint] = p.to_array();
                    if joint < EVIDENCE_JOINTS {
                        let [u, v] = frame.intrinsics.project((root + p).to_array());
                        seen.joints2d[joint] = [u, v, 0.9];
                    }
                }
            }
            fitter.update(&frame, &mut out);
            if f >= jump {
                let body = &out.bodies()[0];
                let [wrist, pelvis] = [WRIST, PELVIS].map(|j| Vec3::from_array(body.joints3d[j]));
                gaps.push((wrist - pelvis - (shoulder - 0.50 * Vec3::Y)).length());
            }
        }
        for gap in &gaps[..doubted] {
            assert!(*gap > 0.5, "followed at once at {fps} fps: {gaps:?}");
        }
        assert!(gaps[followed] < 0.2, "not followed at {fps} fps: {gaps:?}");
    }
}

#[test]
fn memory_of_those_who_left_is_bounded() {
    // A newcomer as soon as the last one has a name, each in new clothes and never seen again.
    let mut config = FitConfig::default();
    config.identity.memory = 3600.0;
    let mut fitter = Fitter::new(config).unwrap();
    let mut out = BodyFrame::default();
    let mut clock = 0;
    let mut update = |frame: &ObservationFrame| {
        clock += 33_333_333;
        let mut frame = *frame;
        (frame.capture_ns, frame.sequence) = (clock, clock);
        fitter.update(&frame, &mut out);
        (fitter.counters().births, fitter.remembered())
    };
    for person in 0..90 {
        let x = if person % 2 == 0 { -1.2 } else { 1.2 };
        let cast = vec![standing(person as u64, x, 4.0)];
        let mut scene = Scene::new(cast, Noise::NONE, FPS, 1);
        for _ in 0..10 {
            let (mut frame, _) = scene.next();
            // All 90 pairs; those of one hue come so far apart that the first has left.
            let (hue, saturation) = (person % 10 * 3, 3 + person % 9 * 3);
            dress(&mut frame.people[0], Some(hue), saturation);
            update(&frame);
        }
    }
    let nobody = ObservationFrame::default();
    let left = (0..90).map(|_| update(&nobody)).last();
    assert_eq!(left, Some((90, 64)));
}

/// Resident memory of this process, bytes; `None` where the system does not tell.
fn resident() -> Option<u64> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    Some(statm.split(' ').nth(1)?.parse::<u64>().ok()? * 4096)
}

#[test]
#[ignore = "long: 300,000 frames"]
fn long_memory_stays_flat() {
    let noise = Noise {
        phantom: 0.3,
        ..Noise::REAL
    };
    let cast = people::everyday().into_iter().skip(1).take(1).collect();
    let mut scene = Scene::new(cast, noise, FPS, 3);
    let frames: Vec<ObservationFrame> = (0..1000).map(|_| scene.next().0).collect();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut clock = 1;
    let mut early = None;
    for n in 0..300_000usize {
        let mut frame = frames[n % 1000];
        clock += 33_333_333;
        (frame.capture_ns, frame.sequence) = (clock, n as u64);
        fitter.update(&frame, &mut out);
        if n == 50_000 {
            early = resident();
        }
    }
    println!("{early:?} → {:?}, {:?}", resident(), fitter.counters());
    if let (Some(early), Some(late)) = (early, resident()) {
        assert!(
            late < early + (1 << 18),
            "grew from {early} to {late} bytes"
        );
    }
}

fn wild() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -2.0f32..2.0,
        4 => -1e4f32..1e4,
        1 => any::<f32>(),
        1 => Just(f32::NAN),
        1 => Just(f32::INFINITY),
        1 => Just(0.0f32),
        1 => Just(f32::MIN_POSITIVE),
        1 => Just(f32::MAX),
    ]
}

/// What is done to one frame of a sensible scene.
#[derive(Debug, Clone)]
struct Damage {
    values: Vec<(usize, usize, f32)>,
    camera: Option<[f32; 4]>,
    time: i64,
    sequence: i64,
    count: Option<u32>,
}

fn damage() -> impl Strategy<Value = Damage> {
    (
        prop::collection::vec((0usize..8, 0usize..165, wild()), 0..60),
        prop::option::weighted(0.2, [wild(), wild(), wild(), wild()]),
        prop_oneof![
            10 => Just(33_333_333i64),
            1 => Just(0i64),
            2 => -2_000_000_000i64..2_000_000_000,
            1 => any::<i64>()
        ],
        -3i64..5,
        prop::option::weighted(0.1, any::<u32>()),
    )
        .prop_map(|(values, camera, time, sequence, count)| Damage {
            values,
            camera,
            time,
            sequence,
            count,
        })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(40) })]
    #[test]
    fn no_input_yields_a_number_that_is_none(damages in prop::collection::vec(damage(), 1..40), known in any::<bool>()) {
        let mut scene = Scene::new(people::ten(), Noise::REAL, FPS, 3);
        let config = FitConfig {
            ground: known.then_some(GroundConfig { normal: [0.0, -1.0, 0.0], offset: 1.4 }),
            ..FitConfig::default()
        };
        let mut fitter = Fitter::new(config).unwrap();
        let (mut out, mut ahead) = (BodyFrame::default(), BodyFrame::default());
        let (mut time, mut sequence) = (10_000_000_000u64, 100u64);
        for d in &damages {
            let (mut frame, _) = scene.next();
            for &(p, k, v) in &d.values {
                let person = &mut frame.people[p];
                match k {
                    0..42 => person.joints2d[k / 3 % EVIDENCE_JOINTS][k % 3] = v,
                    42..105 => person.joints3d[(k - 42) / 3 % BODY_JOINTS][k % 3] = v,
                    105..135 => person.hue[k - 105] = v,
                    135..164 => person.saturation[k - 135] = v,
                    _ => person.score = v,
                }
            }
            if let Some([fx, fy, cx, cy]) = d.camera {
                frame.intrinsics = edgecap::message::Intrinsics { fx, fy, cx, cy };
            }
            time = time.saturating_add_signed(d.time);
            sequence = sequence.saturating_add_signed(d.sequence);
            frame.capture_ns = time;
            frame.sequence = sequence;
            if let Some(count) = d.count {
                frame.count = count;
            }
            fitter.update(&frame, &mut out);
            prop_assert!(is_finite(&out));
            fitter.predict(time.saturating_add(50_000_000), &mut ahead);
            prop_assert!(is_finite(&ahead));
            let mut r = Report::default();
            crate::scene::measure::limits(&out, &mut r);
            crate::scene::measure::limits(&ahead, &mut r);
            prop_assert!(r.beyond <= 5.0);
            prop_assert!(out.bodies().is_sorted_by(|a, b| a.id < b.id));
            for body in out.bodies() {
                prop_assert!(body.confidence.iter().all(|c| (0.0..=1.0).contains(c)));
                prop_assert!((0.3..3.0).contains(&body.height));
            }
        }
    }
}

#[test]
fn who_was_seen_beside_somebody_is_not_that_somebody() {
    // The same clothes, a metre apart. The second one comes later and is missed once or never, then the first is
    // missed.
    for missed in [None, Some(31), Some(32)] {
        for gap in 33..36 {
            let mut stage = Stage::new(vec![standing(3, -0.5, 4.0), standing(4, 0.5, 4.0)]);
            let mut last = Vec::new();
            for n in 0..60 {
                last = stage.frame(|k, seen| {
                    dress(seen, Some(10), 20);
                    if k == 1 {
                        seen.score = 0.9;
                    }
                    match k {
                        0 => n != gap,
                        _ => n >= 30 && missed != Some(n),
                    }
                });
            }
            assert_eq!(last, [Some(1), Some(2)], "{missed:?}, {gap}");
            assert_eq!(stage.fitter.counters().returns, 0, "{missed:?}, {gap}");
        }
    }
}

#[test]
fn without_colour_somebody_else_is_not_who_left() {
    // Before a grey camera, and in clothes that have nothing but the colour of the light.
    for hue in [None, Some(3)] {
        let mut stage = Stage::new(vec![standing(3, -1.5, 4.0), standing(4, 1.5, 4.0)]);
        let mut frames = |count: usize, who: Option<usize>| {
            let mut last = Vec::new();
            for _ in 0..count {
                last = stage.frame(|k, seen| {
                    dress(seen, hue, 0);
                    who == Some(k)
                });
            }
            (last, stage.fitter.counters().births)
        };
        assert_eq!(frames(60, Some(0)), (vec![Some(1), None], 1));
        // Who comes back soon, and where they left, is the same.
        frames(80, None);
        assert_eq!(frames(60, Some(0)), (vec![Some(1), None], 1), "{hue:?}");
        frames(600, None);
        assert_eq!(frames(30, Some(1)), (vec![None, Some(2)], 2), "{hue:?}");
    }
    // A moment later on the other side: nobody walks three metres meanwhile, even if expected on the way.
    for away in [15, 30, 60] {
        for hue in [None, Some(3)] {
            let mut stage = Stage::new(vec![standing(3, -1.5, 4.0), standing(4, 1.5, 4.0)]);
            let mut frames = |count: usize, who: Option<usize>| {
                let mut last = Vec::new();
                for _ in 0..count {
                    last = stage.frame(|k, seen| {
                        dress(seen, hue, 0);
                        who == Some(k)
                    });
                }
                last
            };
            frames(60, Some(0));
            frames(away, None);
            let case = (away, hue);
            assert_eq!(frames(30, Some(1)), [None, Some(2)], "{case:?}");
        }
    }
}

#[test]
fn looks_are_learnt_for_as_long_at_any_frame_rate() {
    for fps in [6.0, 15.0, FPS, 60.0] {
        // For the first half second, on the way in, another colour.
        for seconds in [0.2, 0.5] {
            let mut stage = Stage::at(fps, vec![standing(3, 0.0, 4.0)]);
            let mut frames = |seconds: f64, hue: Option<usize>| {
                let mut last = Vec::new();
                for _ in 0..(seconds * fps) as usize {
                    last = stage.frame(|_, seen| {
                        dress(seen, hue, 20);
                        hue.is_some()
                    });
                }
                last
            };
            frames(seconds, Some(25));
            frames(10.0, Some(10));
            frames(5.0, None);
            let case = (fps, seconds);
            assert_eq!(frames(2.0, Some(10)), [Some(1)], "{case:?}");
        }
    }
}

#[test]
fn looks_are_waited_for_only_where_they_may_tell() {
    // Somebody of that saturation is away, and then the camera, for so long, seconds, when a newcomer who shows no hips
    // comes to the other side; frames in which the newcomer has no name.
    for (saturation, away, pause, unnamed) in [
        (20, 0.0, 0.0, 6),
        (20, 5.0, 0.0, 60),
        (20, 0.1, 1.5, 60),
        (0, 5.0, 0.0, 6),
    ] {
        let mut stage = Stage::new(vec![standing(3, -2.3, 4.0), standing(4, 2.3, 4.0)]);
        for _ in 0..60 {
            stage.frame(|k, seen| {
                dress(seen, Some(10), saturation);
                k == 0
            });
        }
        let nobody = |count: usize, stage: &mut Stage| {
            for _ in 0..count {
                stage.frame(|_, _| false);
            }
        };
        nobody((away * FPS) as usize, &mut stage);
        stage.paused = (pause * 1e9) as u64;
        nobody(usize::from(pause > 0.0), &mut stage);
        assert_eq!(stage.fitter.counters().births, 1);
        let named = (0..90).find(|_| {
            stage.frame(|k, seen| {
                undress(seen);
                k == 1
            });
            stage.fitter.counters().births > 1
        });
        let case = (saturation, away, pause);
        assert_eq!(named, Some(unnamed), "{case:?}");
    }
}

#[test]
fn the_machine_s_sleep_counts() {
    const HUES: [usize; 2] = [10, 20];
    // For a moment, for less than anybody is remembered, for a night: who the same one is then, and another one.
    for (slept, who) in [(0.3, [1, 1]), (20.0, [1, 2]), (8.0 * 3600.0, [2, 2])] {
        for (hue, id) in HUES.into_iter().zip(who) {
            let mut stage = Stage::new(vec![standing(3, 0.0, 4.0)]);
            let frame = |hue, stage: &mut Stage| {
                stage.frame(|_, seen| {
                    dress(seen, Some(hue), 20);
                    true
                })
            };
            for _ in 0..60 {
                frame(HUES[0], &mut stage);
            }
            stage.fitter.slept(slept);
            for n in 0..10 {
                let now = frame(hue, &mut stage);
                assert_eq!(now, [Some(id)], "{slept} s, hue {hue}, frame {n}");
            }
            let restarts = u64::from(slept > 60.0);
            assert_eq!(stage.fitter.counters().restarts, restarts, "{slept} s");
        }
    }
    // Who left before is remembered for a minute in all.
    let mut stage = Stage::new(vec![standing(3, 0.0, 4.0)]);
    let remembered = |count, is_there, stage: &mut Stage| {
        for _ in 0..count {
            stage.frame(|_, _| is_there);
        }
        stage.fitter.remembered()
    };
    remembered(60, true, &mut stage);
    assert_eq!(remembered(300, false, &mut stage), 1);
    stage.fitter.slept(45.0);
    assert_eq!(remembered(30, false, &mut stage), 1);
    assert_eq!(remembered(180, false, &mut stage), 0);
}

/// Somebody steps out from behind another person, whom the network misses for a moment.
#[test]
fn whoever_steps_out_from_behind_is_not_the_one_in_front() {
    let stands = |seed, x, z| {
        let here = DVec2::new(x, z);
        let leg = Leg {
            start: 0.0,
            end: 1.0,
            from: here,
            to: here,
        };
        Person::new(seed, vec![leg], Activity::Stand)
    };
    let mut scene = Scene::new(
        vec![stands(3, 0.0, 4.0), stands(9, 0.3, 5.2)],
        Noise::NONE,
        FPS,
        1,
    );
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut first = None;
    for n in 0..90 {
        let (mut frame, truths) = scene.next();
        let [front, behind] = [0, 1].map(|k| truths[k].observation.expect("seen"));
        let seen: &[usize] = match n {
            0..30 => &[front],
            30..45 => &[behind],
            _ => &[front, behind],
        };
        let people: Vec<_> = seen.iter().map(|slot| frame.people[*slot]).collect();
        frame.count = people.len() as u32;
        frame.people[..people.len()].copy_from_slice(&people);
        fitter.update(&frame, &mut out);
        let at = |z: f32| {
            out.bodies()
                .iter()
                .find(|b| (b.position[2] - z).abs() < 0.4)
        };
        if n == 29 {
            first = at(4.0).map(|b| b.id);
        }
        if n >= 80 {
            assert_eq!(at(4.0).map(|b| b.id), first, "frame {n}");
            assert!(at(5.2).is_some_and(|b| Some(b.id) != first), "frame {n}");
        }
    }
}

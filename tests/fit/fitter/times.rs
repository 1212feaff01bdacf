//! Times that misbehave: late frames, gaps, frames seconds apart, no times at all, a machine that slept.

use edgecap::body::skeleton::{ANKLE_HEIGHT, BoneLengths, Pose, Posed, Skeleton};
use edgecap::fit::{FitConfig, Fitter, GroundConfig};
use edgecap::joints::{CANONICAL_STATURE, L_ANKLE, L_KNEE, PELVIS, R_ANKLE, R_KNEE};
use edgecap::message::{BodyFrame, FLAG_END_OF_STREAM, ObservationFrame};
use glam::Vec3;

use super::{FPS, Stage, dress, posing, standing};
use crate::scene::people::{self, Activity, Person};
use crate::scene::{Noise, Scene};

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
fn without_colours_whoever_left_makes_sure_of_one_newcomer() {
    let cast = vec![
        standing(3, -1.0, 4.0),
        standing(4, -0.5, 4.0),
        standing(5, 1.0, 4.0),
    ];
    let mut stage = Stage::at(0.2, cast);
    let mut frame = |shown: &[usize]| {
        stage.frame(|k, seen| {
            seen.score = 0.8;
            dress(seen, None, 0);
            shown.contains(&k)
        })
    };
    assert_eq!(frame(&[0]), [None; 3]);
    assert_eq!(frame(&[1, 2]), [None, Some(1), None], "who stands nearest");
    assert_eq!(frame(&[1, 2]), [None, Some(2), Some(3)]);
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

/// Who two at rest are, from left to right, 1.5 m apart and dressed alike but for `ripple` of the share of every bin of
/// hue, stronger and weaker by turns of so many bins. `exchanges` says in which frames each looks as the other did
/// before and comes in the other's place, and for how long, seconds, the camera had stopped by then.
fn side_by_side(
    fps: f64,
    (ripple, turns): (f32, usize),
    exchanges: impl Fn(usize) -> (bool, f64),
) -> Vec<[u32; 2]> {
    let cast = vec![standing(3, -0.75, 4.0), standing(3, 0.75, 4.0)];
    let mut scene = Scene::new(cast, Noise::NONE, fps, 4);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let each = (0..60).map(|f| {
        let (mut frame, truths) = scene.next();
        let (is_exchanged, stopped) = exchanges(f);
        let mut people = [0, 1].map(|k| {
            let mut seen = frame.people[truths[k].observation.expect("in view")];
            dress(&mut seen, None, 20);
            let phase = if (k == 1) != is_exchanged { turns } else { 0 };
            for (b, bin) in seen.hue.iter_mut().enumerate() {
                let is_strong = ((b + phase) / turns).is_multiple_of(2);
                *bin *= 1.0 + if is_strong { ripple } else { -ripple };
            }
            seen
        });
        if is_exchanged {
            people.reverse();
        }
        frame.people[..2].copy_from_slice(&people);
        frame.capture_ns += (stopped * 1e9) as u64;
        fitter.update(&frame, &mut out);
        let mut bodies = out.bodies().to_vec();
        bodies.sort_by(|a, b| a.position[0].total_cmp(&b.position[0]));
        let [left, right] = &bodies[..] else {
            panic!("frame {f}: {} bodies of two people", out.count);
        };
        [left.id, right.id]
    });
    each.collect()
}

#[test]
fn whoever_is_dressed_alike_keeps_their_name_over_a_pause() {
    for looks in [(0.0, 3), (0.1, 3), (0.2, 3), (0.1, 5), (0.2, 5)] {
        let after_a_pause = |f: usize| (f >= 45, if f >= 45 { 1.1 } else { 0.0 });
        let ids = side_by_side(FPS, looks, after_a_pause);
        assert_eq!(ids, [[1, 2]; 60], "{looks:?}, a pause of 1.1 s");
        let ids = side_by_side(0.8, looks, |f| (f % 2 == 1, 0.0));
        assert_eq!(ids, [[1, 2]; 60], "{looks:?}, frames 1.25 s apart");
    }
}

/// Bones of somebody whose thighs are long and whose shanks are short, by a tenth, metres.
fn long_thighs() -> BoneLengths {
    let mut lengths = *Skeleton::builtin().lengths();
    for (thigh, shank) in [(R_KNEE, R_ANKLE), (L_KNEE, L_ANKLE)] {
        let longer = 0.1 * lengths[thigh];
        lengths[thigh] += longer;
        lengths[shank] -= longer;
    }
    lengths
}

#[test]
fn what_is_learned_of_somebody_is_learned_where_frames_are_seconds_apart() {
    let (s, lengths) = (Skeleton::builtin(), long_thighs());
    let truth = 1.86;
    let scale = truth / f64::from(CANONICAL_STATURE);
    let mut pose = Pose::facing_camera(5.0);
    pose.position.y = 0.5;
    let mut posed = Posed::default();
    s.pose(&pose, &lengths, &mut posed);
    let config = FitConfig {
        ground: Some(GroundConfig {
            normal: [0.0, -1.0, 0.0],
            offset: (posed.joints[R_ANKLE].y + ANKLE_HEIGHT) * scale,
        }),
        ..FitConfig::default()
    };
    let mut fitter = Fitter::new(config).unwrap();
    let mut out = BodyFrame::default();
    for f in 0..60 {
        // On a step in the first picture.
        let mut pose = pose;
        if f == 0 {
            pose.position.y -= 0.25 / scale;
        }
        let mut frame = posing(1.0 + 1.1 * f64::from(f), &pose, &lengths);
        dress(&mut frame.people[0], Some(10), 20);
        fitter.update(&frame, &mut out);
        let [body] = out.bodies() else {
            panic!("frame {f}: {} bodies of one person", out.count);
        };
        assert_eq!(body.id, 1, "frame {f}");
        let height = f64::from(body.height);
        assert!(
            f < 30 || (height - truth).abs() < 0.05,
            "frame {f}: {height} m"
        );
    }
    let bones = out.bodies()[0].bone_lengths.map(f64::from);
    let [average, found, own] = [s.lengths(), &bones, &lengths].map(|l| l[9] / l[10]);
    let learned = (found - average) / (own - average);
    assert!(learned > 0.5, "{learned} of the difference");
}

#[test]
fn whoever_comes_back_has_their_own_bones_in_the_first_frame() {
    let lengths = long_thighs();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut bones_at = |seconds: f64| {
        let mut frame = posing(1.0 + seconds, &Pose::facing_camera(4.0), &lengths);
        dress(&mut frame.people[0], Some(10), 20);
        fitter.update(&frame, &mut out);
        assert_eq!((out.count, out.bodies()[0].id), (1, 1), "{seconds} s");
        out.bodies()[0].bone_lengths
    };
    for n in 0..180 {
        bones_at(f64::from(n) / FPS);
    }
    let known = bones_at(180.0 / FPS);
    let average = Skeleton::builtin().lengths()[9];
    assert!(f64::from(known[9]) > 1.04 * average, "{known:?}");
    let back = bones_at(180.0 / FPS + 1.5);
    for (j, (before, now)) in known.into_iter().zip(back).enumerate() {
        assert!(
            j == PELVIS || (now / before - 1.0).abs() < 0.01,
            "bone of joint {j}: {now} m after {before} m"
        );
    }
}

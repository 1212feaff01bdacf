//! Cameras that fall silent, are slow, or begin anew.

use std::f64::consts::TAU;

use edgecap::fit::FitConfig;
use edgecap::message::BodyFrame;
use edgecap::multiview::live::{LiveFit, Synchroniser};
use glam::DVec2;
use rand::SeedableRng;
use rand::rngs::SmallRng;

use super::{NOISY, ids, instant, instants, of_one, run, walker};
use crate::scene::people::{Activity, Leg, Person, walk};
use crate::scene::ring::{Spoil, error, observe, views};

#[test]
fn a_silent_camera_is_done_without_and_returns() {
    let person = walker(5);
    let views = views(2);
    let silent = 2.0..3.0;
    let frames = run(
        &views,
        &[(30.0, 0.0), (30.0, 0.005)],
        std::slice::from_ref(&person),
        5.0,
        &|v, t| {
            (v == 0 || !silent.contains(&t)).then_some(Spoil {
                pixels: 2.0,
                ..NOISY
            })
        },
    );
    // One view tells the rest from what is known of the person, who keeps the identity.
    of_one(&frames, &person);
    let mean = |from: f64, to: f64| {
        let each = frames.iter().filter(|(t, _)| (from..to).contains(t));
        let (sum, n) = each.fold((0.0, 0.0_f64), |(s, n), (t, f)| {
            (s + error(&f.bodies[0].joints3d, &person, *t), n + 1.0)
        });
        sum / n
    };
    let [before, without, after] = [mean(1.2, 2.0), mean(2.2, 3.0), mean(3.4, 5.0)];
    println!("before {before:.3}, without {without:.3}, after {after:.3} m");
    assert!(before < 0.05 && after < 0.05, "{before} {after}");
    assert!(without < 0.2, "{without}");
    // No instant is missing, in none has anything waited for the silent camera for long.
    for pair in frames.windows(2) {
        assert!(pair[1].0 - pair[0].0 < 0.04, "{}", pair[0].0);
    }
}

#[test]
fn slower_than_one_instant_a_second_somebody_is_still_the_same() {
    let person = walker(4);
    // The first instants are left out: in one of them a camera is alone.
    for (count, from, spoil) in [(2, 11, Spoil::default()), (3, 4, NOISY)] {
        let frames = run(
            &views(count),
            &vec![(0.8, 0.0); count],
            std::slice::from_ref(&person),
            25.0,
            &|_, _| Some(spoil),
        );
        assert!(frames.len() > 15);
        for (t, frame) in &frames[from..] {
            let ids: Vec<u32> = frame.bodies().iter().map(|b| b.id).collect();
            assert_eq!(ids, [1], "{count} views at {t:.2} s");
        }
    }
}

#[test]
fn how_long_somebody_must_be_seen_goes_by_seconds() {
    let there = walk(0.0, 1.0, &[(0.0, 4.2), (0.0, 4.2)]);
    let person = Person::new(21, there, Activity::Stand);
    // Instants a second, and those after which three views count, and two.
    for (rate, needed) in [
        (120.0, [8, 36]),
        (60.0, [5, 19]),
        (30.0, [3, 10]),
        (10.0, [2, 4]),
        (2.0, [2, 2]),
    ] {
        for (count, needed) in [3, 2].into_iter().zip(needed) {
            let views = views(count);
            let mut rng = SmallRng::seed_from_u64(3);
            let mut fit = LiveFit::new(views.clone(), FitConfig::default()).unwrap();
            let mut out = BodyFrame::default();
            for k in 1..=needed {
                let set = instant(&views, &person, f64::from(k) / rate, &mut rng);
                fit.update(&set, &mut out);
                let counts = u32::from(k == needed);
                assert_eq!(out.count, counts, "{count} views at {rate}: {k}");
            }
        }
    }
}

/// Somebody who runs round the middle, so many metres a second.
fn runner(speed: f64) -> Person {
    const CORNERS: usize = 24;
    let corner = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / CORNERS as f64).sin_cos();
        DVec2::new(1.4 * cos, 4.2 + 1.4 * sin)
    };
    let seconds = corner(0).distance(corner(1)) / speed;
    let leg = |k: usize| Leg {
        start: seconds * k as f64,
        end: seconds * (k + 1) as f64,
        from: corner(k),
        to: corner(k + 1),
    };
    Person::new(31, (0..10 * CORNERS).map(leg).collect(), Activity::Stand)
}

#[test]
fn a_runner_is_one_person_at_few_instants_a_second() {
    for (speed, rate) in [(3.0, 5.0), (2.5, 5.0), (1.5, 2.6), (3.0, 30.0)] {
        let person = runner(speed);
        for count in [2, 4] {
            let frames = instants(&views(count), rate, 8.0, &|_, _| vec![&person]);
            let known = frames.iter().filter(|(_, frame)| ids(frame) == [1]).count();
            let all = frames.len();
            println!("{speed} m/s at {rate}, {count} views: {known} of {all}");
            assert!(
                10 * known >= 9 * all,
                "{speed} m/s at {rate}, {count} views: {known} of {all}"
            );
        }
    }
}

#[test]
fn after_a_pause_whoever_stands_there_is_known_by_looks() {
    let there = walk(0.0, 1.0, &[(0.0, 4.2), (0.0, 4.2)]);
    let views = views(3);
    // Seconds that times tell, and that the machine slept.
    let ids = |after: u64, pause: f64, slept: f64| -> Vec<u32> {
        let mut rng = SmallRng::seed_from_u64(3);
        let mut fit = LiveFit::new(views.clone(), FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        let visits = [(21, 0.0, 0.0), (after, 1.0 + pause, slept)];
        let last = visits.map(|(seed, from, slept)| {
            fit.slept(slept);
            let person = Person::new(seed, there.clone(), Activity::Stand);
            for k in 0..30 {
                let t = from + f64::from(k) / 30.0;
                fit.update(&instant(&views, &person, t, &mut rng), &mut out);
            }
            assert_eq!(out.count, 1, "{seed}");
            out.bodies[0].id
        });
        last.to_vec()
    };
    for (pause, slept) in [(19.0, 0.0), (0.0, 19.0)] {
        assert_eq!(ids(21, pause, slept), [1, 1], "the same person");
        assert_eq!(ids(22, pause, slept), [1, 2], "somebody else");
    }
    assert_eq!(ids(21, 0.0, 3600.0), [1, 2], "nobody is remembered so long");
}

#[test]
fn times_that_do_not_go_on_are_left_out_and_others_start_over() {
    let person = walker(9);
    let views = views(2);
    let mut rng = SmallRng::seed_from_u64(3);
    let mut fit = LiveFit::new(views.clone(), FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut show = |t: f64, at: f64, fit: &mut LiveFit, out: &mut BodyFrame| {
        let mut together = Synchroniser::new(2);
        for (v, view) in views.iter().enumerate() {
            let mut frame = observe(
                view,
                std::slice::from_ref(&person),
                t,
                Spoil::default(),
                &mut rng,
            );
            frame.capture_ns = (at * 1e9) as u64;
            together.push(v, &frame, 0);
        }
        fit.update(&together.next(0).expect("both have come"), out);
    };
    for k in 0..20 {
        let t = k as f64 / 30.0;
        show(t, 10.0 + t, &mut fit, &mut out);
    }
    assert_eq!((out.count, out.sequence), (1, 19));
    let before = out;
    show(0.4, 10.4, &mut fit, &mut out);
    assert_eq!(out, before, "what is older changes nothing");
    fit.predict(out.capture_ns + 50_000_000, &mut out);
    assert_eq!(out.pose_ns, out.capture_ns + 50_000_000);
    for k in 0..20 {
        let t = k as f64 / 30.0;
        show(t, 2.0 + t, &mut fit, &mut out);
    }
    assert_eq!(
        (out.count, out.bodies[0].id),
        (1, 2),
        "nobody has an old identity"
    );
}

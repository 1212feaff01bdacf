//! The fit to several cameras while it happens, against people whose truth is known.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use edgecap::body::skeleton::{Pose, Posed, Skeleton, rotation_vector};
use edgecap::camera::View;
use edgecap::fit::FitConfig;
use edgecap::message::{APPEARANCE_BINS, BodyFrame, BodyState, JointState};
use edgecap::multiview::live::{FrameSet, LiveFit, Synchroniser};
use glam::{DQuat, DVec2, DVec3};
use rand::SeedableRng;
use rand::rngs::SmallRng;

use crate::scene::people::{Activity, Leg, Person, walk};
use crate::scene::ring::{Spoil, error, observe, views};

const NOISY: Spoil = Spoil {
    pixels: 4.0,
    space: 0.05,
    unseen: 0.08,
    outliers: 0.03,
    exchanged: false,
    arms_exchanged: false,
    colourless: false,
};

/// One camera: frames a second, and how much later its first frame comes, seconds.
type Shutter = (f64, f64);

fn walker(seed: u64) -> Person {
    let legs = walk(
        0.3,
        1.1,
        &[(-0.9, 3.6), (0.9, 4.6), (-0.6, 5.0), (0.5, 3.8)],
    );
    Person::new(seed, legs, Activity::Wave)
}

/// Six who walk, wave and stand within two metres of the middle.
fn six() -> Vec<Person> {
    let still = |x, z| walk(0.0, 1.0, &[(x, z), (x, z)]);
    vec![
        walker(1),
        Person::new(2, still(-1.5, 4.4), Activity::Wave),
        Person::new(3, still(1.5, 4.0), Activity::Reach),
        Person::new(4, still(0.2, 6.0), Activity::Stand),
        Person::new(
            5,
            walk(1.0, 0.9, &[(1.2, 5.4), (-1.2, 5.6), (1.0, 5.3)]),
            Activity::Stand,
        ),
        Person::new(6, still(-0.9, 2.6), Activity::Squat),
    ]
}

/// Every published frame with its time, seconds. `spoil` tells what a view sees at a time; none where it is silent.
fn run(
    views: &[View],
    shutters: &[Shutter],
    people: &[Person],
    seconds: f64,
    spoil: &dyn Fn(usize, f64) -> Option<Spoil>,
) -> Vec<(f64, BodyFrame)> {
    let mut rng = SmallRng::seed_from_u64(7);
    // What every camera shows, in the order in which it arrives, 30 ms later.
    let mut frames: Vec<(u64, usize, f64)> = Vec::new();
    for (v, (rate, offset)) in shutters.iter().enumerate() {
        for k in 0..(seconds * rate) as usize {
            let t = offset + k as f64 / rate;
            frames.push(((t * 1e9) as u64 + 30_000_000, v, t));
        }
    }
    frames.sort_by_key(|f| f.0);
    let mut together = Synchroniser::new(views.len());
    let mut fit = LiveFit::new(views.to_vec(), FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut all = Vec::new();
    for (now, v, t) in frames {
        if let Some(spoil) = spoil(v, t) {
            together.push(v, &observe(&views[v], people, t, spoil, &mut rng), now);
        }
        while let Some(set) = together.next(now) {
            fit.update(&set, &mut out);
            assert_eq!(out.pose_ns, set.capture_ns);
            all.push(((out.pose_ns - 1_000_000_000) as f64 * 1e-9, out));
        }
    }
    all
}

/// Mean error after the first second, of the one person there is, who keeps one identity; metres.
fn of_one(frames: &[(f64, BodyFrame)], person: &Person) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for (t, frame) in frames.iter().filter(|(t, _)| *t > 1.0) {
        assert_eq!(frame.count, 1, "at {t:.2} s");
        assert_eq!(frame.bodies[0].id, 1, "at {t:.2} s");
        sum += error(&frame.bodies[0].joints3d, person, *t);
        count += 1.0;
    }
    assert!(count > 30.0);
    sum / count
}

#[test]
fn exact_views_give_the_truth_and_the_stature() {
    let person = walker(3).of_height(1.86);
    for count in 2..=4 {
        let views = views(count);
        let shutters = vec![(30.0, 0.0); count];
        let frames = run(
            &views,
            &shutters,
            std::slice::from_ref(&person),
            4.0,
            &|_, _| Some(Spoil::default()),
        );
        let off = of_one(&frames, &person);
        let (_, last) = &frames[frames.len() - 1];
        let body = &last.bodies[0];
        println!("{count} views: {:.1} mm, {:.3} m", 1e3 * off, body.height);
        // Shoulders that shrug and a head that tilts by 2 cm are none of the skeleton's.
        assert!(off < 0.035, "{count} views: {off}");
        assert!(
            (body.height - 1.86).abs() < 0.03,
            "{count} views: {}",
            body.height
        );
        assert_eq!(body.state, BodyState::TRACKED);
        assert!(body.joint_states.iter().all(|s| *s == JointState::OBSERVED));
        assert!(
            last.world.is_known(),
            "cameras that hang level tell what is up"
        );
        let up = last.world.direction([0.0, -1.0, 0.0]);
        assert!((up[1] - 1.0).abs() < 1e-5, "{up:?}");
    }
}

#[test]
fn cameras_of_other_rates_and_times_with_noise_agree() {
    let person = walker(4);
    let shutters = [(30.0, 0.0), (25.0, 0.011), (29.0, 0.007), (20.0, 0.023)];
    for count in [2, 4] {
        let views = views(count);
        let frames = run(
            &views,
            &shutters[..count],
            std::slice::from_ref(&person),
            5.0,
            &|_, _| Some(NOISY),
        );
        let off = of_one(&frames, &person);
        println!("{count} views with noise: {:.1} mm", 1e3 * off);
        assert!(off < [0.06, 0.045][count / 4], "{count} views: {off}");
    }
}

#[test]
fn six_people_keep_their_identities_before_four_cameras() {
    let people = six();
    let views = views(4);
    let shutters = [(15.0, 0.0), (15.0, 0.01), (15.0, 0.02), (15.0, 0.03)];
    let frames = run(&views, &shutters, &people, 6.0, &|_, _| Some(NOISY));
    let mut owners: Vec<Option<u32>> = vec![None; people.len()];
    let (mut right, mut all) = (0, 0);
    let mut sum = 0.0;
    for (t, frame) in frames.iter().filter(|(t, _)| *t > 1.5) {
        for (person, owner) in people.iter().zip(&mut owners) {
            all += 1;
            let near = frame
                .bodies()
                .iter()
                .map(|b| (error(&b.joints3d, person, *t), b.id))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((off, id)) = near.filter(|(off, _)| *off < 0.2) else {
                continue;
            };
            if *owner.get_or_insert(id) == id {
                right += 1;
                sum += off;
            }
        }
    }
    let ids: BTreeSet<u32> = frames
        .iter()
        .flat_map(|(_, f)| f.bodies().iter().map(|b| b.id))
        .collect();
    println!(
        "{right} of {all} right, {:.1} mm, identities {ids:?}",
        1e3 * sum / f64::from(right)
    );
    assert!(
        f64::from(right) >= 0.98 * f64::from(all),
        "{right} of {all}"
    );
    assert_eq!(ids.len(), 6, "{ids:?}");
}

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

/// What all views show at `seconds`, at one instant.
fn instant(views: &[View], person: &Person, seconds: f64, rng: &mut SmallRng) -> FrameSet {
    let people = std::slice::from_ref(person);
    let frames = views
        .iter()
        .map(|view| observe(view, people, seconds, Spoil::default(), rng));
    let frames: Vec<_> = frames.collect();
    FrameSet {
        capture_ns: frames[0].capture_ns,
        file_time: false,
        stage_times: frames[0].stage_times,
        views: frames.iter().map(|f| Some(f.people().to_vec())).collect(),
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

#[test]
fn rotation_vectors_of_the_pelvis_follow_each_other_without_a_leap() {
    let person = walker(6);
    let shutters = [(30.0, 0.0); 3];
    let frames = run(
        &views(3),
        &shutters,
        std::slice::from_ref(&person),
        6.0,
        &|_, _| Some(Spoil::default()),
    );
    let mut last: Option<(DVec3, DQuat)> = None;
    let mut leaps = 0;
    for (t, frame) in &frames {
        for body in frame.bodies() {
            let turn = DVec3::from_array([3, 4, 5].map(|k| f64::from(body.angles[k])));
            let q = DQuat::from_array(body.orientation.map(f64::from));
            if let Some((from, before)) = last.replace((turn, q)) {
                let step = turn.distance(from);
                assert!(step < 1.5, "{t:.2} s: from {from} to {turn}");
                let shortest = rotation_vector(q).distance(rotation_vector(before));
                leaps += u32::from(shortest > 4.0);
            }
        }
    }
    assert!(leaps > 0, "the shortest ones do not leap here");
}

#[test]
fn a_view_that_takes_left_for_right_is_outvoted() {
    let person = walker(6);
    let views = views(3);
    let shutters = [(30.0, 0.0); 3];
    let see = |exchanged: bool| {
        let frames = run(
            &views,
            &shutters,
            std::slice::from_ref(&person),
            4.0,
            &|v, t| {
                Some(Spoil {
                    exchanged: exchanged && v == 1 && (t * 0.7).fract() > 0.4,
                    pixels: 3.0,
                    ..Spoil::default()
                })
            },
        );
        of_one(&frames, &person)
    };
    let [without, with] = [see(false), see(true)];
    println!(
        "{:.1} mm, with exchanges {:.1} mm",
        1e3 * without,
        1e3 * with
    );
    assert!(with < 1.3 * without + 0.003, "{without} {with}");
}

#[test]
fn shoulders_point_the_way_hips_do_whatever_most_views_say() {
    let person = walker(6);
    let frames = run(
        &views(3),
        &[(30.0, 0.0); 3],
        std::slice::from_ref(&person),
        3.0,
        &|v, _| {
            Some(Spoil {
                arms_exchanged: v < 2,
                pixels: 3.0,
                ..Spoil::default()
            })
        },
    );
    let off = of_one(&frames, &person);
    println!("arms exchanged in two of three views: {:.1} mm", 1e3 * off);
    assert!(off < 0.035, "{off}");
}

#[test]
fn whoever_leaves_and_returns_is_recognised_by_looks() {
    let there = walk(0.0, 1.2, &[(0.0, 4.0), (0.5, 4.2)]);
    let views = views(3);
    let people = [
        Person::new(21, there.clone(), Activity::Stand),
        Person::new(
            22,
            walk(0.0, 1.0, &[(-1.2, 4.6), (-1.0, 4.6)]),
            Activity::Wave,
        ),
    ];
    let mut rng = SmallRng::seed_from_u64(3);
    let mut fit = LiveFit::new(views.clone(), FitConfig::default()).unwrap();
    let mut together = Synchroniser::new(3);
    let mut out = BodyFrame::default();
    let mut ids = Vec::new();
    for k in 0..300 {
        let t = k as f64 / 30.0;
        // For four seconds the first is away, and comes back elsewhere.
        let (from, moved) = match t {
            t if t < 2.0 => (0, t),
            t if t < 6.0 => (1, t),
            _ => (0, t),
        };
        for (v, view) in views.iter().enumerate() {
            let frame = observe(view, &people[from..], moved, Spoil::default(), &mut rng);
            together.push(v, &frame, (t * 1e9) as u64);
        }
        while let Some(set) = together.next((t * 1e9) as u64) {
            fit.update(&set, &mut out);
            ids.push(out.bodies().iter().map(|b| b.id).collect::<Vec<_>>());
        }
    }
    assert_eq!(ids[50].len(), 2);
    assert_eq!(ids[150].len(), 1, "one is away");
    assert_eq!(ids[299], ids[50], "and is known when back");
    assert!(fit.remembered() <= 3);
}

/// Somebody who stands at (x, z), metres; equal seeds are built and dressed alike.
fn standing(seed: u64, x: f64, z: f64) -> Person {
    Person::new(seed, walk(0.0, 1.0, &[(x, z), (x, z)]), Activity::Stand)
}

/// What is published after every one of `rate` instants a second. `show` says whom a view sees at a time.
fn instants<'a>(
    views: &[View],
    rate: f64,
    seconds: f64,
    show: &dyn Fn(usize, f64) -> Vec<&'a Person>,
) -> Vec<(f64, BodyFrame)> {
    let mut rng = SmallRng::seed_from_u64(3);
    let mut fit = LiveFit::new(views.to_vec(), FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut all = Vec::new();
    for k in 0..(seconds * rate) as usize {
        let t = k as f64 / rate;
        let seen = views.iter().enumerate().map(|(v, view)| {
            let each = show(v, t).into_iter().flat_map(|person| {
                let person = std::slice::from_ref(person);
                let frame = observe(view, person, t, Spoil::default(), &mut rng);
                frame.people().to_vec()
            });
            Some(each.collect())
        });
        let set = FrameSet {
            capture_ns: 1_000_000_000 + (t * 1e9) as u64,
            file_time: false,
            stage_times: Default::default(),
            views: seen.collect(),
        };
        fit.update(&set, &mut out);
        all.push((t, out));
    }
    all
}

fn ids(frame: &BodyFrame) -> Vec<u32> {
    frame.bodies().iter().map(|b| b.id).collect()
}

#[test]
fn whoever_comes_while_somebody_is_missed_is_somebody_else() {
    let views = views(2);
    let first = standing(21, -1.0, 4.2);
    // Seconds without anybody, and where somebody else is then: far away, and near or in the same place in other
    // clothes.
    let cases = [
        (0.3, 1.2),
        (0.8, 1.2),
        (2.0, 1.2),
        (0.3, -0.6),
        (0.8, -0.5),
        (0.3, -1.0),
        (0.8, -0.9),
    ];
    for (away, x) in cases {
        let other = standing(22, x, 4.2);
        let frames = instants(&views, 20.0, 3.0 + away, &|_, t| match t {
            t if t < 1.5 => vec![&first],
            t if t < 1.5 + away => vec![],
            _ => vec![&other],
        });
        assert_eq!(ids(&frames[29].1), [1]);
        let all: BTreeSet<u32> = frames.iter().flat_map(|(_, f)| ids(f)).collect();
        assert_eq!(all, BTreeSet::from([1, 2]), "{away} s, {x} m");
        let (t, last) = &frames[frames.len() - 1];
        assert_eq!(ids(last), [2], "{away} s, {x} m");
        let off = error(&last.bodies[0].joints3d, &other, *t);
        assert!(off < 0.05, "{away} s, {x} m: {off}");
    }
}

#[test]
fn whoever_comes_behind_somebody_missed_is_somebody_else() {
    let views = views(2);
    // As the first view sees it, whom colours do not help.
    let behind = (DVec3::new(0.0, 0.0, 4.2) - views[0].position) * DVec3::new(1.0, 0.0, 1.0);
    let aside = behind.normalize();
    let at = |seed: u64, by: f64| grey(standing(seed, by * aside.x, 4.2 + by * aside.z));
    let (first, other) = (at(21, -1.0), at(22, 1.0));
    for away in [0.3, 0.8] {
        let frames = instants(&views, 20.0, 3.0 + away, &|_, t| match t {
            t if t < 1.5 => vec![&first],
            t if t < 1.5 + away => vec![],
            _ => vec![&other],
        });
        let (t, last) = &frames[frames.len() - 1];
        assert_eq!(ids(last), [2], "{away} s");
        let off = error(&last.bodies[0].joints3d, &other, *t);
        assert!(off < 0.05, "{away} s: {off}");
    }
}

#[test]
fn whom_one_view_follows_does_not_take_somebody_else_in_another() {
    let views = views(2);
    let first = standing(21, -1.0, 4.2);
    // The second view loses them and sees somebody else alone, farther off, and near by in other clothes.
    for (x, z) in [(0.9, 5.4), (1.5, 2.8), (-0.8, 4.7)] {
        let other = standing(22, x, z);
        let frames = instants(&views, 20.0, 4.0, &|v, t| match v {
            1 if t > 1.6 => vec![&other],
            1 if t > 1.5 => vec![],
            _ => vec![&first],
        });
        for (t, frame) in &frames[30..] {
            assert_eq!(ids(frame), [1], "{x} {z}: {t} s");
            let off = error(&frame.bodies[0].joints3d, &first, *t);
            assert!(off < 0.2, "{x} {z}: {t} s, {off} m");
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

/// The same person as a camera without colours shows them.
fn grey(mut person: Person) -> Person {
    person.clothes[1] = [0.0; APPEARANCE_BINS];
    person.clothes[1][0] = 1.0;
    person
}

#[test]
fn without_colours_nobody_is_recognised_by_looks() {
    let views = views(3);
    let first = grey(standing(21, -1.2, 4.2));
    let stays = grey(standing(23, 0.0, 5.6));
    let show = |other: &Person, away: f64| -> Vec<u32> {
        let frames = instants(&views, 20.0, 3.0 + away, &|_, t| match t {
            t if t < 1.5 => vec![&first, &stays],
            t if t < 1.5 + away => vec![&stays],
            _ => vec![other, &stays],
        });
        assert_eq!(ids(&frames[29].1), [1, 2]);
        ids(&frames[frames.len() - 1].1)
    };
    // 2.4 m away after four seconds: whoever that is.
    let elsewhere = grey(standing(21, 1.2, 4.2));
    assert_eq!(show(&elsewhere, 4.0), [2, 3]);
    assert_eq!(show(&first, 2.0), [1, 2], "a moment ago, in the same place");
}

#[test]
fn without_colours_somebody_is_found_at_an_instant_in_four_seconds() {
    let views = views(2);
    let person = grey(standing(21, 0.0, 4.2));
    let mut rng = SmallRng::seed_from_u64(3);
    let mut fit = LiveFit::new(views.clone(), FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    for k in 0..5 {
        let set = instant(&views, &person, 4.0 * f64::from(k), &mut rng);
        fit.update(&set, &mut out);
        assert_eq!(out.count, u32::from(k > 0), "instant {k}");
    }
}

#[test]
fn without_colours_whoever_left_makes_sure_of_one_newcomer() {
    let views = views(3);
    let [left, near, far] = [0.0, -0.4, 1.2].map(|x| grey(standing(21, x, 4.2)));
    let frames = instants(&views, 0.25, 12.0, &|_, t| match t < 1.0 {
        true => vec![&left],
        false => vec![&near, &far],
    });
    let counts: Vec<u32> = frames.iter().map(|(_, frame)| frame.count).collect();
    assert_eq!(counts, [0, 1, 2]);
    let (t, frame) = &frames[1];
    let off = error(&frame.bodies[0].joints3d, &near, *t);
    assert!(off < 0.05, "who stands nearest: {off} m");
}

/// The same person in other light, which makes other colours of the clothes.
fn lit(mut person: Person) -> Person {
    person.clothes = standing(22, 0.0, 0.0).clothes;
    person
}

/// The same person, half of whose torso in the picture is somebody else's.
fn mixed(mut person: Person, other: &Person) -> Person {
    let bins = person.clothes.iter_mut().flatten();
    for (own, other) in bins.zip(other.clothes.iter().flatten()) {
        *own = 0.5 * (*own + other);
    }
    person
}

#[test]
fn looks_stay_as_they_are_while_somebody_stands_before_a_person() {
    // One behind the other as two of the views see them.
    let [first, other] = [(21, 0.0, 4.2), (22, -0.12, 4.53)].map(|(s, x, z)| standing(s, x, z));
    let behind = mixed(standing(21, 0.0, 4.2), &other);
    let before = mixed(standing(22, -0.12, 4.53), &first);
    let back = standing(21, 1.0, 4.4);
    let frames = instants(&views(3), 20.0, 10.0, &|_, t| match t {
        t if t < 1.0 => vec![&first],
        t if t < 4.0 => vec![&behind, &before],
        t if t < 9.0 => vec![&other],
        _ => vec![&back, &other],
    });
    let [alone, together, away] = [19, 79, 150].map(|k| ids(&frames[k].1));
    assert_eq!((alone, together, away), (vec![1], vec![1, 2], vec![2]));
    let (_, last) = &frames[frames.len() - 1];
    assert_eq!(ids(last), [1, 2], "known when back");
}

#[test]
fn whom_two_views_see_where_one_follows_them_is_the_same_in_any_light() {
    for count in [3, 4] {
        let first = standing(21, -0.6, 4.2);
        let other_light = lit(standing(21, -0.6, 4.2));
        let frames = instants(&views(count), 20.0, 3.0, &|v, t| match t {
            _ if v == 0 || t < 1.5 => vec![&first],
            t if t < 2.0 => vec![],
            _ => vec![&other_light],
        });
        for (t, frame) in frames.iter().filter(|(t, _)| *t >= 2.0) {
            assert_eq!(ids(frame), [1], "{count} views, {t} s");
            let off = error(&frame.bodies[0].joints3d, &first, *t);
            assert!(off < 0.05, "{count} views, {t} s: {off} m");
        }
    }
}

#[test]
fn whoever_has_walked_where_rays_meet_all_the_way_is_the_same_in_any_light() {
    let views = views(2);
    let across = || {
        let ends = [(-1.5, 4.2), (1.5, 4.2)];
        let legs = walk(0.3, 1.1, &ends.repeat(2));
        Person::new(21, legs, Activity::Stand)
    };
    let (first, other_light) = (across(), lit(across()));
    let show = |other: &Person| {
        instants(&views, 20.0, 7.0, &|v, t| match t {
            _ if v == 0 || t < 1.5 => vec![&first],
            t if t < 1.7 => vec![],
            _ => vec![other],
        })
    };
    for (t, frame) in show(&other_light).iter().filter(|(t, _)| *t > 4.5) {
        assert_eq!(ids(frame), [1], "{t} s");
        let off = error(&frame.bodies[0].joints3d, &first, *t);
        assert!(off < 0.05, "{t} s: {off} m");
    }
    // They go by somebody who stands there.
    for (x, z) in [(-0.6, 4.2), (0.0, 4.8), (1.2, 5.0)] {
        let other = standing(22, x, z);
        for (t, frame) in show(&other).iter().filter(|(t, _)| *t > 1.7) {
            assert_eq!(ids(frame), [1], "{x} {z}: {t} s");
            let off = |person| error(&frame.bodies[0].joints3d, person, *t);
            assert!(off(&first) < off(&other), "{x} {z}: {t} s");
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
fn angles_and_lengths_give_the_joints() {
    let person = walker(8);
    let frames = run(
        &views(3),
        &[(30.0, 0.0); 3],
        std::slice::from_ref(&person),
        2.0,
        &|_, _| Some(NOISY),
    );
    let body = &frames[frames.len() - 1].1.bodies[0];
    let a = body.angles.map(f64::from);
    let pose = Pose {
        position: DVec3::new(a[0], a[1], a[2]),
        rotation: DQuat::from_scaled_axis(DVec3::new(a[3], a[4], a[5])),
        angles: std::array::from_fn(|k| a[6 + k]),
    };
    let mut posed = Posed::default();
    Skeleton::builtin().pose(&pose, &body.bone_lengths.map(f64::from), &mut posed);
    for (p, q) in posed.joints.iter().zip(body.joints3d) {
        assert!(p.distance(DVec3::from(q.map(f64::from))) < 1e-4);
    }
    assert!(body.velocity.iter().all(|v| v.abs() < 3.0));
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

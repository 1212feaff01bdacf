//! Who comes, who is missed and who returns.

use std::collections::BTreeSet;

use edgecap::fit::FitConfig;
use edgecap::message::BodyFrame;
use edgecap::multiview::live::{LiveFit, Synchroniser};
use glam::DVec3;
use rand::SeedableRng;
use rand::rngs::SmallRng;

use super::{grey, ids, instants, standing};
use crate::scene::people::{Activity, Person, walk};
use crate::scene::ring::{Spoil, error, observe, views};

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

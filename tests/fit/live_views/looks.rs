//! What looks tell: without colours, in other light, behind somebody else.

use edgecap::fit::FitConfig;
use edgecap::message::BodyFrame;
use edgecap::multiview::live::LiveFit;
use rand::SeedableRng;
use rand::rngs::SmallRng;

use super::{grey, ids, instant, instants, standing};
use crate::scene::people::{Activity, Person, walk};
use crate::scene::ring::{error, views};

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

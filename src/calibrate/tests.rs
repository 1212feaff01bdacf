//! Rooms whose cameras are known exactly.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use super::*;
use crate::body::skeleton::{ANKLE_HEIGHT, Skeleton};
use crate::camera::Brown;
use crate::joints::{L_HIP, MIRRORED, MIRRORED_EVIDENCE, R_ELBOW, R_HIP, R_SHOULDER};
use crate::message::Observation;

/// A camera that stands at `position` and looks at `target`; the world's z is up.
fn looking(name: &str, position: DVec3, target: DVec3) -> View {
    let z = (target - position).normalize();
    let x = z.cross(DVec3::Z).normalize();
    View {
        name: name.to_owned(),
        size: [1280, 720],
        focal: DVec2::splat(1000.0),
        centre: DVec2::new(640.0, 360.0),
        distortion: Brown {
            radial: [-0.05, 0.02, 0.0],
            tangential: [0.0; 2],
        },
        rotation: DMat3::from_cols(x, z.cross(x), z).transpose(),
        position,
    }
}

fn room() -> Vec<View> {
    let target = DVec3::new(0.3, 0.2, 0.9);
    [
        ("north", DVec3::new(0.0, 4.5, 2.2)),
        ("east", DVec3::new(4.0, 0.5, 1.6)),
        ("south", DVec3::new(-0.8, -4.2, 2.6)),
        ("west", DVec3::new(-4.4, -0.4, 1.9)),
    ]
    .map(|(name, at)| looking(name, at, target))
    .to_vec()
}

/// Somebody of `stature` who walks an eight over the floor z = 0, arms and legs swinging.
fn walker(t: f64, stature: f64) -> world::Joints {
    let phase = TAU * t / 8.0;
    let place = DVec3::new(1.1 * phase.sin(), 1.0 * (2.0 * phase).sin(), 0.0);
    let heading = (2.0 * (2.0 * phase).cos()).atan2(1.1 * phase.cos());
    strider(t, stature, place, heading)
}

/// Somebody at `place` who looks along `heading`, arms and legs swinging.
fn strider(t: f64, stature: f64, place: DVec3, heading: f64) -> world::Joints {
    let rest = world::rest_joints(Skeleton::builtin()).map(Option::unwrap);
    let floor = (rest[10].y + rest[13].y) / 2.0 - ANKLE_HEIGHT;
    let swing = (TAU * t / 1.1).sin();
    std::array::from_fn(|j| {
        let mut p = rest[j];
        // Joints swing about hip or shoulder like one piece: bones keep their lengths.
        let pivot = match j {
            3 | 4 => Some((2, swing)),
            6 | 7 => Some((5, -swing)),
            9 | 10 => Some((8, -swing)),
            12 | 13 => Some((11, swing)),
            _ => None,
        };
        if let Some((about, angle)) = pivot {
            p = rest[about] + DMat3::from_rotation_x(0.5 * angle) * (p - rest[about]);
        }
        // The skeleton's y is up.
        let p = DVec3::new(p.x, -p.z, p.y - floor) * stature / 1.7;
        Some(DMat3::from_rotation_z(heading) * p + place)
    })
}

#[test]
fn who_stands_still_stands_on_the_floor() {
    let places = (0..9).map(|k| DVec3::new(f64::from(k % 3) - 1.0, f64::from(k / 3) - 1.0, 0.0));
    let people = places.map(|place| strider(0.0, 1.8, place, 0.0));
    let floor = world::floor(&people.collect::<Vec<_>>(), 1.8).unwrap();
    assert!(floor.by_feet);
    assert!(floor.origin.z.abs() < 1e-3, "{}", floor.origin);
}

struct Noise {
    /// Pixels.
    jitter: f64,
    /// Share of frames of one view in which arms and legs change sides.
    exchanged: f64,
    /// How far joints are off where a view lifts people, metres; none where it does not.
    lifted: Option<f64>,
}

fn seen(
    views: &[View],
    people: &[world::Joints],
    noise: &Noise,
    random: &mut SmallRng,
) -> Vec<Detections> {
    let gauss = |random: &mut SmallRng| {
        let (a, b): (f64, f64) = (
            random.random_range(1e-9..1.0),
            random.random_range(0.0..TAU),
        );
        (-2.0 * a.ln()).sqrt() * b.cos()
    };
    let mut all = Vec::new();
    for (v, view) in views.iter().enumerate() {
        let mut detections = Vec::new();
        for joints in people {
            let mut seen = Observation::default();
            for (out, joint) in seen.joints2d.iter_mut().zip(joints) {
                let Some(pixel) = view.project(joint.unwrap()) else {
                    continue;
                };
                let off = DVec2::new(gauss(random), gauss(random)) * noise.jitter;
                let p = pixel + off;
                if p.x > 0.0 && p.y > 0.0 && p.x < 1280.0 && p.y < 720.0 {
                    *out = [p.x as f32, p.y as f32, 0.9];
                }
            }
            if let Some(off) = noise.lifted {
                let pelvis = (joints[R_HIP].unwrap() + joints[L_HIP].unwrap()) / 2.0;
                for (out, joint) in seen.joints3d.iter_mut().zip(joints) {
                    let noise = DVec3::from_array(std::array::from_fn(|_| off * gauss(random)));
                    let at = view.rotation * (joint.unwrap() - pelvis) + noise;
                    *out = at.as_vec3().to_array();
                }
            }
            if v == 1 && random.random_bool(noise.exchanged) {
                for &[r, l] in &MIRRORED[..MIRRORED_EVIDENCE] {
                    seen.joints2d.swap(r, l);
                }
            }
            detections.push(Sight::new(&without_place(view.clone()), &seen));
        }
        all.push(detections);
    }
    all
}

/// Greatest errors of direction (degrees) and place (metres) after the rigid motion that brings the first camera's
/// direction and all places together best; here the world's axes differ only by a turn about z and a shift.
fn errors(found: &[View], truth: &[View]) -> (f64, f64) {
    let mean = |v: &[View]| v.iter().map(|v| v.position).sum::<DVec3>() / v.len() as f64;
    let (a, b) = (mean(found), mean(truth));
    let (mut sin, mut cos) = (0.0, 0.0);
    for (f, t) in found.iter().zip(truth) {
        let (p, q) = (f.position - a, t.position - b);
        sin += p.x * q.y - p.y * q.x;
        cos += p.x * q.x + p.y * q.y;
    }
    let turn = DMat3::from_rotation_z(sin.atan2(cos));
    let each = found.iter().zip(truth).map(|(f, t)| {
        let off = turn * (f.position - a) - (t.position - b);
        let between = f.rotation * turn.transpose() * t.rotation.transpose();
        let trace = between.x_axis.x + between.y_axis.y + between.z_axis.z;
        let angle = ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos();
        (angle.to_degrees(), off.length())
    });
    each.fold((0.0, 0.0), |m, e| (f64::max(m.0, e.0), f64::max(m.1, e.1)))
}

const EXACT: Noise = Noise {
    jitter: 0.0,
    exchanged: 0.0,
    lifted: None,
};

fn film(views: &[View], statures: &[f64], noise: &Noise) -> Vec<Vec<Detections>> {
    film_of(80, views, statures, noise)
}

/// Frames at 10 a second.
fn film_of(frames: usize, views: &[View], statures: &[f64], noise: &Noise) -> Vec<Vec<Detections>> {
    let mut random = SmallRng::seed_from_u64(5);
    let frame = |k: usize| {
        let people: Vec<_> = statures
            .iter()
            .enumerate()
            .map(|(n, s)| walker(k as f64 / 10.0 + 3.1 * n as f64, *s))
            .collect();
        seen(views, &people, noise, &mut random)
    };
    (0..frames).map(frame).collect()
}

fn without_place(view: View) -> View {
    View {
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
        ..view
    }
}

fn lenses(views: &[View]) -> Vec<View> {
    views.iter().cloned().map(without_place).collect()
}

#[test]
fn exact_sights_give_the_room() {
    let views = room();
    let frames = film(&views, &[1.8], &EXACT);
    let room = calibrate(&lenses(&views), &frames, 10.0, 1.8).unwrap();
    let (degrees, metres) = errors(&room.views, &views);
    assert!(degrees < 0.5 && metres < 0.03, "{degrees}° {metres} m");
    for (found, truth) in room.views.iter().zip(&views) {
        let off = found.position.z - truth.position.z;
        assert!(off.abs() < 0.05, "{}: height {off} m off", found.name);
    }
    for q in &room.quality {
        assert!(q.held_out_rms_px.unwrap() < 1.0, "{q:?}");
    }
    let apart = views[0].position.distance(views[1].position);
    let room = calibrate(&lenses(&views), &frames, 10.0, 1.7).unwrap();
    let measured = room.with_distance(0, 1, apart);
    assert!(
        (measured.stature - 1.8).abs() < 0.02,
        "{}",
        measured.stature
    );
    let (degrees, metres) = errors(&measured.views, &views);
    assert!(degrees < 0.5 && metres < 0.03, "{degrees}° {metres} m");
}

/// A tape measure in feet is no reason to doubt a camera.
#[test]
fn a_distance_changes_sizes_and_not_how_well_views_agree() {
    let views = room();
    let mut frames = film(&views, &[1.7], &EXACT);
    let spoiled = Noise {
        jitter: 40.0,
        ..EXACT
    };
    let spoiled = film(&views, &[1.7], &spoiled);
    for k in (0..frames.len()).step_by(8) {
        frames[k][1] = spoiled[k][1].clone();
    }
    let found = calibrate(&lenses(&views), &frames, 10.0, 1.7).unwrap();
    assert!(found.quality.iter().any(|q| q.far_percent > 0.0));
    let apart = found.views[0].position.distance(found.views[1].position);
    for factor in [0.1, 0.8, 1.25, 10.0] {
        let scaled = found.clone().with_distance(0, 1, factor * apart);
        assert!((scaled.stature - factor * 1.7).abs() < 1e-9);
        for (own, one) in scaled.views.iter().zip(&found.views) {
            assert!(own.position.distance(factor * one.position) < 1e-9);
        }
        for (own, one) in scaled.quality.iter().zip(&found.quality) {
            assert!((own.height_m - factor * one.height_m).abs() < 1e-9);
            let (height_m, own) = (one.height_m, own.clone());
            assert_eq!(ViewQuality { height_m, ..own }, *one);
        }
    }
}

#[test]
fn noise_and_exchanged_sides_and_a_second_person_do_not_matter_much() {
    let views = room();
    let noise = Noise {
        jitter: 5.0,
        exchanged: 0.4,
        lifted: None,
    };
    for statures in [&[1.7][..], &[1.75, 1.6]] {
        let frames = film(&views, statures, &noise);
        let room = calibrate(&lenses(&views), &frames, 10.0, statures[0]).unwrap();
        let (degrees, metres) = errors(&room.views, &views);
        assert!(
            degrees < 1.0 && metres < 0.08,
            "{statures:?}: {degrees}° {metres} m"
        );
    }
}

#[test]
fn somebody_taller_who_is_seen_too_seldom_to_count_is_told_of() {
    let views = room();
    for (other, taller) in [(1.95, Some(1.95)), (1.6, None)] {
        let mut frames = film(&views, &[1.75, other], &EXACT);
        for all in frames[30..].iter_mut().flatten() {
            all.truncate(1);
        }
        let room = calibrate(&lenses(&views), &frames, 10.0, 1.75).unwrap();
        let off = room.taller.zip(taller).map(|(f, t)| f64::abs(f - t));
        assert_eq!(room.taller.is_some(), taller.is_some(), "{room:?}");
        assert!(off.is_none_or(|off| off < 0.05), "{:?}", room.taller);
        let (degrees, metres) = errors(&room.views, &views);
        assert!(degrees < 1.0 && metres < 0.08, "{degrees}° {metres} m");
    }
}

/// A track ends where somebody leaves: each visit is shorter than half of what the other one is seen.
#[test]
fn who_leaves_and_comes_back_is_counted_as_one() {
    let views = room();
    let mut frames = film_of(150, &views, &[1.5, 1.78], &EXACT);
    for (_, frame) in frames.iter_mut().enumerate().filter(|f| f.0 % 50 >= 35) {
        frame.iter_mut().for_each(|all| all.truncate(1));
    }
    let room = calibrate(&lenses(&views), &frames, 10.0, 1.78).unwrap();
    assert_eq!(room.taller, None);
    let (degrees, metres) = errors(&room.views, &views);
    assert!(degrees < 1.0 && metres < 0.08, "{degrees}° {metres} m");
}

#[test]
fn sizes_that_are_about_one_count_together() {
    let sizes = |all: &[(f64, std::ops::Range<usize>)]| Sizes {
        all: all
            .iter()
            .map(|(size, at)| (*size, at.clone().collect()))
            .collect(),
        longest: all.iter().map(|(_, at)| at.len()).max().unwrap_or(0),
    };
    // One track that measures too much, three visits of somebody, and who is seen all the time.
    let one = sizes(&[
        (1.06, 0..30),
        (1.04, 30..90),
        (1.03, 130..190),
        (1.02, 230..290),
        (0.7, 0..300),
    ]);
    assert_eq!(one.of_room(), Ok(1.03));
    assert_eq!(one.tallest(150), Some(1.03));
    assert_eq!(one.tallest(30), Some(1.06));
    assert_eq!(one.tallest_followed(), Some(1.06));
    // Two at one time are not seen twice as long.
    assert_eq!(sizes(&[(1.01, 0..80), (1.0, 0..80)]).frames(1.0), 80);
    // Nor are two who differ one.
    assert_eq!(sizes(&[(1.1, 0..40), (1.0, 40..80)]).tallest(60), None);
    // Three of one height who walk through one after another take the word from nobody who stays as long as each.
    let in_turn = sizes(&[
        (1.95, 0..60),
        (1.7, 60..120),
        (1.7, 120..180),
        (1.7, 180..240),
    ]);
    assert_eq!(in_turn.of_room(), Ok(1.95));
    // Several scraps are no person who was followed.
    let scraps = sizes(&[(1.3, 0..15), (1.3, 40..55), (1.0, 0..80)]);
    assert_eq!(scraps.tallest_followed(), Some(1.0));
}

/// What is up, only somebody tells who leans to one side: there the floor comes out above a camera that stands low.
#[test]
fn a_camera_that_stands_low_may_come_out_a_little_below_the_floor() {
    let target = DVec3::new(0.0, 0.0, 0.9);
    let views = [
        ("north", DVec3::new(1.6, 4.2, 1.5)),
        ("south", DVec3::new(1.3, -4.3, 1.5)),
        ("low", DVec3::new(-4.5, 0.0, 0.15)),
    ]
    .map(|(name, at)| looking(name, at, target));
    let noise = Noise {
        jitter: 1.0,
        exchanged: 0.0,
        lifted: Some(0.02),
    };
    let mut random = SmallRng::seed_from_u64(7);
    let lean = DMat3::from_rotation_y(5_f64.to_radians());
    let frames: Vec<_> = (0..80)
        .map(|k| {
            let upright = strider(f64::from(k) / 10.0, 1.7, DVec3::ZERO, 0.4);
            let leaning = upright.map(|joint| joint.map(|p| lean * p));
            seen(&views, &[leaning], &noise, &mut random)
        })
        .collect();
    let room = calibrate(&lenses(&views), &frames, 10.0, 1.7).unwrap();
    assert!(!room.floor_by_feet);
    let height = room.quality[2].height_m;
    assert!((-0.75..0.0).contains(&height), "{height}");
    // Below what a tilt explains there is no camera.
    for (z, by_feet, wanted) in [
        (-0.5, false, false),
        (-0.9, false, true),
        (-0.15, true, false),
        (-0.5, true, true),
    ] {
        let camera = DVec3::new(-4.5, 0.0, z);
        assert_eq!(is_sunk(camera, by_feet), wanted, "{z} {by_feet}");
    }
}

/// One camera looks up at people from clearly below what they walk on.
#[test]
fn a_camera_below_the_floor_is_refused() {
    let mut views = room();
    let target = DVec3::new(0.3, 0.2, 0.9);
    views[3] = looking("west", DVec3::new(-4.4, -0.4, -1.2), target);
    let lifting = Noise {
        lifted: Some(0.02),
        ..EXACT
    };
    let frames = film(&views, &[1.8], &lifting);
    let error = calibrate(&lenses(&views), &frames, 10.0, 1.8).unwrap_err();
    let CalibrateError::UnderFloor(camera, metres) = &error else {
        panic!("{error}");
    };
    assert_eq!(camera, "west");
    assert!((metres - 1.2).abs() < 0.1, "{metres}");
}

/// A view names two people the other way round than the others do.
#[test]
fn the_order_in_which_a_view_names_people_does_not_matter() {
    let views = &room()[..2];
    let noise = Noise {
        jitter: 3.0,
        exchanged: 0.0,
        lifted: Some(0.05),
    };
    let mut frames = film_of(290, views, &[1.75, 1.6], &noise);
    frames.iter_mut().for_each(|frame| frame[1].reverse());
    let room = calibrate(&lenses(views), &frames, 10.0, 1.75).unwrap();
    let (degrees, metres) = errors(&room.views, views);
    assert!(degrees < 1.0 && metres < 0.08, "{degrees}° {metres} m");
}

#[test]
fn nobody_has_to_walk_about_where_views_lift_people() {
    let views = &room()[..3];
    let noise = Noise {
        jitter: 8.0,
        exchanged: 0.2,
        lifted: Some(0.08),
    };
    let mut random = SmallRng::seed_from_u64(7);
    let frames: Vec<_> = (0..80)
        .map(|k| {
            let t = f64::from(k) / 10.0;
            let at = |x, y| DVec3::new(x, y, 0.0);
            let people = [
                strider(t, 1.7, at(0.3, 0.2), 0.4),
                strider(t + 0.4, 1.6, at(-0.8, -0.5), 2.0),
            ];
            seen(views, &people, &noise, &mut random)
        })
        .collect();
    let room = calibrate(&lenses(views), &frames, 10.0, 1.7).unwrap();
    let (degrees, metres) = errors(&room.views, views);
    assert!(degrees < 3.0 && metres < 0.2, "{degrees}° {metres} m");
}

/// From far away a room goes together in two ways, one of them worse: both are found, whether or not starts are given
/// up that are on the way to where another one has led.
#[test]
fn a_start_that_is_given_up_would_have_led_to_no_other_answer() {
    let target = DVec3::new(0.3, 0.2, 0.9);
    let away = |view: &View, far: f64| {
        let at = target + far * (view.position - target);
        let lens = looking(&view.name, at, target);
        View {
            focal: far * lens.focal,
            distortion: Brown::default(),
            ..lens
        }
    };
    for (views, far, jitter, answers) in [(4, 1.0, 8.0, 1), (2, 2.0, 8.0, 2), (3, 8.0, 8.0, 2)] {
        let views: Vec<View> = room()[..views].iter().map(|v| away(v, far)).collect();
        let noise = Noise { jitter, ..EXACT };
        let frames = film(&views, &[1.7], &noise);
        let lenses = lenses(&views);
        let settled = |on_the_way: f64| {
            let found = rig::answers(&lenses, &frames, 10.0, on_the_way).unwrap();
            let each = found.into_iter().map(|c| settle(&lenses, c, &frames, 10.0));
            let mut all: Vec<(f64, Vec<Pose>)> = each.map(Result::unwrap).collect();
            all.sort_by(|a, b| b.0.total_cmp(&a.0));
            all
        };
        let (all, few) = (settled(0.0), settled(rig::ON_THE_WAY));
        let counts = [all.len(), few.len()];
        assert_eq!(counts, [answers; 2], "{} views, {far}", views.len());
        for ((most, one), (worth, other)) in all.iter().zip(&few) {
            assert!((worth / most - 1.0).abs() < 1e-6, "{worth}, not {most}");
            assert!(rig::are_alike(one, other, 1e-3), "{one:?}, not {other:?}");
        }
    }
}

#[test]
fn bodies_that_stretch_are_not_solid() {
    let rest = |stretch: f64| -> world::Joints {
        let mut joints = world::rest_joints(Skeleton::builtin());
        joints[R_ELBOW] = joints[R_SHOULDER].map(|p| p + DVec3::X * 0.3 * stretch);
        joints
    };
    let same: Vec<_> = (0..20)
        .map(|_| world::rest_joints(Skeleton::builtin()))
        .collect();
    assert!(world::solidity(&same) > 0.99, "{}", world::solidity(&same));
    let stretched: Vec<_> = (0..20).map(|k| rest(1.0 + 0.1 * f64::from(k))).collect();
    assert!(world::solidity(&stretched) < 0.9);
    assert_eq!(world::solidity(&[]), 0.0);
}

#[test]
fn too_little_is_said() {
    let views = room();
    let frames = film(&views, &[1.7], &EXACT);
    let few = calibrate(&lenses(&views), &frames[..9], 10.0, 1.7);
    assert_eq!(few.unwrap_err(), CalibrateError::Nobody(9));
    let mut blind = frames.clone();
    for frame in &mut blind {
        frame[2].clear();
    }
    let unlinked = calibrate(&lenses(&views), &blind, 10.0, 1.7);
    assert_eq!(
        unlinked.unwrap_err(),
        CalibrateError::NotLinked("south".into())
    );
}

/// Frames that are kept apart are spoiled: cameras stand to each other as they do without, and the figures of these
/// frames tell.
#[test]
fn frames_that_are_kept_apart_do_not_place_cameras() {
    let views = room();
    let of = |jitter: f64| {
        let noise = Noise {
            jitter,
            exchanged: 0.0,
            lifted: None,
        };
        film(&views, &[1.8], &noise)
    };
    let (exact, spoiled) = (of(0.0), of(30.0));
    let mut mixed = exact.clone();
    for (k, _) in held_out(&exact, 10.0).iter().enumerate().filter(|h| *h.1) {
        mixed[k] = spoiled[k].clone();
    }
    let found = |frames: &[Vec<Detections>]| calibrate(&lenses(&views), frames, 10.0, 1.8).unwrap();
    let (exact, mixed) = (found(&exact), found(&mixed));
    // All frames tell the room's size and floor.
    let apart = |room: &Room, v: usize| room.views[v].position.distance(room.views[0].position);
    let size = apart(&mixed, 1) / apart(&exact, 1);
    for v in 1..views.len() {
        let turn = |room: &Room| room.views[v].rotation * room.views[0].rotation.transpose();
        let off = (turn(&exact) - turn(&mixed)).to_cols_array();
        assert!(off.iter().all(|o| o.abs() < 1e-9), "{off:?}");
        assert!((apart(&mixed, v) / apart(&exact, v) / size - 1.0).abs() < 1e-9);
    }
    for (a, b) in exact.quality.iter().zip(&mixed.quality) {
        assert!(b.rms_px < 1.0 + a.rms_px, "{b:?}");
        assert!(b.held_out_rms_px.unwrap() > 10.0, "{b:?}");
    }
}

#[test]
fn frames_that_are_kept_apart_lie_together_and_are_a_fifth() {
    for (frames, rate) in [(20, 30.0), (80, 10.0), (240, 30.0), (3000, 30.0), (60, 1.0)] {
        let sight = film(&room()[..1], &[1.7], &EXACT)[0][0].clone();
        let all = held_out(&vec![vec![sight; 2]; frames], rate);
        let held: Vec<usize> = (0..frames).filter(|k| all[*k]).collect();
        assert_eq!(5 * held.len(), frames, "{frames} at {rate}");
        let ends = held.windows(2).filter(|w| w[1] > w[0] + 1).count();
        let stretch = held.len() / (ends + 1);
        // As long as it may be: two seconds, or a fifth of all.
        let wanted = (2.0 * rate).min(frames as f64 / 5.0);
        assert!(stretch as f64 >= wanted, "{frames} at {rate}: {stretch}");
    }
}

/// All that the other views see lies in the middle fifth of the files' frames.
#[test]
fn views_that_share_a_part_of_the_time_are_placed_by_it() {
    let views = &room()[..3];
    let all = film_of(150, views, &[1.8], &EXACT);
    for blind in [&[1, 2][..], &[2]] {
        let mut frames = all.clone();
        for (_, frame) in frames
            .iter_mut()
            .enumerate()
            .filter(|f| !(60..90).contains(&f.0))
        {
            blind.iter().for_each(|v| frame[*v].clear());
        }
        let held = held_out(&frames, 10.0);
        let with_all = (60..90).filter(|k| held[*k]).count();
        assert_eq!(with_all, 6, "{blind:?}");
        let alone = (0..60).filter(|k| held[*k]).count();
        assert_eq!(
            alone > 0,
            blind.len() == 1,
            "frames that are not shared are not kept apart"
        );
        let room = calibrate(&lenses(views), &frames, 10.0, 1.8).unwrap();
        let (degrees, metres) = errors(&room.views, views);
        assert!(
            degrees < 1.5 && metres < 0.1,
            "{blind:?}: {degrees}° {metres} m"
        );
    }
}

#[test]
fn who_cannot_be_followed_is_told_by_what_views_shared() {
    let views = room();
    let frames = film(&views, &[1.7], &EXACT);
    // So far apart that nothing both see is one person.
    let apart = (0..views.len()).map(|v| Pose {
        position: DVec3::X * 100.0 * v as f64,
        ..Pose::ORIGIN
    });
    let apart: Vec<Pose> = apart.collect();
    assert_eq!(
        people(&lenses(&views), &apart, &frames, 10.0).err(),
        Some(CalibrateError::Untracked {
            seen: 0,
            shared: 80
        })
    );
}

#[test]
fn a_view_whose_sights_go_with_nobody_s_is_told() {
    let views = room();
    let frames = film(&views, &[1.7], &EXACT);
    let alone_percent =
        |frames: &[Vec<Detections>], met: usize| alone_percent(&views, frames, 1.7, 0, met);
    assert_eq!(alone_percent(&frames, 80), 0.0);
    assert_eq!(alone_percent(&frames, 60), 25.0);
    let mut lonely = frames.clone();
    for frame in &mut lonely[40..] {
        frame[1..].iter_mut().for_each(Vec::clear);
    }
    // Where nobody else saw anybody nothing was lost.
    assert_eq!(alone_percent(&lonely, 40), 0.0);
}

/// Two views that overlap in part see somebody each, whom the other's picture does not show.
#[test]
fn who_is_outside_the_other_picture_is_not_missed_there() {
    let views = [-3.0, 3.0].map(|x| {
        let target = DVec3::new(x, 0.0, 0.9);
        looking("door", DVec3::new(x, 6.0, 1.8), target)
    });
    let lifting = Noise {
        lifted: Some(0.0),
        ..EXACT
    };
    let mut random = SmallRng::seed_from_u64(3);
    let people = |x: f64, y: f64| strider(0.0, 1.7, DVec3::new(x, y, 0.0), 0.4);
    let mut of = |left: world::Joints, right: world::Joints| -> Vec<Detections> {
        let [a, b] = [(0, left), (1, right)]
            .map(|(v, person)| seen(&views[v..=v], &[person], &lifting, &mut random).remove(0));
        vec![a, b]
    };
    let apart = vec![of(people(-4.0, 0.0), people(4.0, 0.0)); 40];
    assert_eq!(alone_percent(&views, &apart, 1.7, 0, 0), 0.0);
    let both = vec![of(people(0.0, -3.0), people(0.3, -3.0)); 40];
    assert_eq!(alone_percent(&views, &both, 1.7, 0, 0), 100.0);
}

#[test]
fn cameras_beside_each_other_are_told_to_be_moved() {
    let target = DVec3::new(0.0, 0.0, 0.9);
    let views = [
        looking("left", DVec3::new(0.0, 4.5, 1.8), target),
        looking("right", DVec3::new(0.4, 4.5, 1.8), target),
    ];
    let noise = Noise {
        jitter: 1.0,
        exchanged: 0.0,
        lifted: None,
    };
    let frames = film(&views, &[1.7], &noise);
    let error = calibrate(&lenses(&views), &frames, 10.0, 1.7).unwrap_err();
    let CalibrateError::NoAngle(_, _, degrees) = error else {
        panic!("{error}");
    };
    assert!((2.0..9.0).contains(&degrees), "{degrees}");
}

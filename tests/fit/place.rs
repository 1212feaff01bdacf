//! Stage III against exact truth: how tall and how far away people are, the floor and the world.

use crate::scene::measure::run;
use crate::scene::people::{self, Activity, Counter, Person};
use crate::scene::{Noise, Scene};
use edgecap::body::skeleton::Skeleton;
use edgecap::fit::config::GroundConfig;
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{L_ANKLE, PELVIS, R_ANKLE};
use edgecap::message::{BodyFrame, FLAG_FILE_TIME, World, WorldState};

const FPS: f64 = 30.0;

#[test]
fn the_height_comes_from_settings_or_floor() {
    let cast = |h: f64| {
        let legs = people::walk(
            0.0,
            1.0,
            &[(-0.8, 3.5), (0.8, 4.5), (-0.5, 4.0), (0.6, 3.6)],
        );
        vec![Person::new(2, legs, Activity::Stand).of_height(h)]
    };
    let known = FitConfig {
        height: Some(1.85),
        ..FitConfig::default()
    };
    let r = run(
        &mut Scene::new(cast(1.85), Noise::REAL, FPS, 6),
        known,
        200,
        60,
        false,
    );
    assert!(
        r.depth.get() < 0.05,
        "known height: depth off by {}",
        r.depth.get()
    );
    let floor = FitConfig {
        ground: Some(GroundConfig {
            normal: [0.0, -1.0, 0.0],
            offset: crate::scene::CAMERA_HEIGHT,
        }),
        ..FitConfig::default()
    };
    for height in [1.55, 1.85] {
        let mut scene = Scene::new(cast(height), Noise::REAL, FPS, 6);
        let mut fitter = Fitter::new(floor.clone()).unwrap();
        let mut out = BodyFrame::default();
        for _ in 0..200 {
            fitter.update(&scene.next().0, &mut out);
        }
        let found = f64::from(out.bodies()[0].height);
        assert!(
            (found - height).abs() < 0.06 * height,
            "{height} taken for {found}"
        );
    }
}

/// Greatest and mean error of the root's distance, as a share, of somebody of known height behind a counter, from the
/// first half second on. Panics where the person is lost or named anew.
fn depth_behind_a_counter(counter: Counter, noise: Noise, seed: u64) -> (f64, f64) {
    let legs = people::walk(0.0, 0.6, &[(-0.5, 4.0), (0.7, 4.4), (-0.2, 3.8)]);
    let person = Person::new(seed, legs, Activity::Reach)
        .of_height(1.70)
        .behind(counter);
    let mut scene = Scene::new(vec![person], noise, FPS, seed);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let (mut worst, mut sum, mut n) = (0.0f64, 0.0, 0.0);
    for f in 0..240 {
        let (frame, truths) = scene.next();
        fitter.update(&frame, &mut out);
        if f < 15 || truths[0].observation.is_none() {
            continue;
        }
        let [body] = out.bodies() else {
            panic!("frame {f}: {} bodies of one person", out.count);
        };
        assert_eq!(body.id, 1, "frame {f}: another name");
        let z = truths[0].joints[PELVIS].z;
        let error = (f64::from(body.position[2]) / z - 1.0).abs();
        worst = worst.max(error);
        sum += error;
        n += 1.0;
    }
    (worst, sum / n)
}

#[test]
fn invented_legs_move_nobody_away() {
    let noise = Noise {
        phantom: 0.0,
        ..Noise::REAL
    };
    let mut wrong = Vec::new();
    // Stage II may draw whole legs, or believe the picture; hardest is what contradicts only a little.
    for (legs3d, most) in [(1.0, [0.18, 0.06]), (0.6, [0.3, 0.12]), (0.2, [0.2, 0.07])] {
        for (from, to) in [(0.0, 5.0), (2.0, 6.0), (0.0, 99.0)] {
            let counter = Counter {
                from,
                to,
                legs2d: 0.2,
                legs3d,
            };
            for seed in 1..=4 {
                let (worst, mean) = depth_behind_a_counter(counter, noise, seed);
                println!("{counter:?}, seed {seed}: worst {worst:.3}, mean {mean:.3}");
                if worst > most[0] || mean > most[1] {
                    wrong.push((legs3d, from, to, seed, worst, mean));
                }
            }
            let (worst, mean) = depth_behind_a_counter(counter, Noise::NONE, 1);
            if worst > most[0] {
                wrong.push((legs3d, from, to, 0, worst, mean));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// Five people of canonical stature who stand about, so that feet in the picture tell metres.
fn standing() -> Scene {
    let cast = people::everyday()
        .into_iter()
        .map(|p| p.of_height(1.70))
        .collect();
    Scene::new(cast, Noise::REAL, FPS, 5)
}

#[test]
fn standing_feet_tell_the_floor() {
    let mut scene = standing();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    for _ in 0..300 {
        fitter.update(&scene.next().0, &mut out);
    }
    let ground = fitter.ground().expect("five people stand about");
    let tilt = ground.normal.dot(-glam::DVec3::Y).acos().to_degrees();
    println!("{ground:?}, tilt {tilt:.1}°");
    assert!(tilt < 5.0);
    assert!((ground.offset - crate::scene::CAMERA_HEIGHT).abs() < 0.15);
}

#[test]
fn bodies_stand_on_the_floor_of_the_world() {
    let mut scene = standing();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut before: Option<[f32; 3]> = None;
    let mut heights = Vec::new();
    for _ in 0..600 {
        fitter.update(&scene.next().0, &mut out);
        if out.world.state == WorldState::NONE {
            assert_eq!(before, None, "a world does not vanish");
            assert!(out.bodies().iter().all(|b| out.in_world(b).is_none()));
            continue;
        }
        assert_eq!(out.world.state, WorldState::ESTIMATED);
        // A point five metres in front of the camera.
        let ahead = out.world.point([0.0, 0.0, 5.0]);
        if let Some(last) = before.replace(ahead) {
            let step = (0..3)
                .map(|i| (ahead[i] - last[i]).powi(2))
                .sum::<f32>()
                .sqrt();
            assert!(step < 0.08 / FPS as f32, "the world jumped by {step} m");
        }
        for body in out.bodies() {
            let there = out.in_world(body).unwrap();
            let sole = there.joints3d[R_ANKLE][1].min(there.joints3d[L_ANKLE][1]) - 0.085;
            heights.push(f64::from(sole.abs()));
        }
    }
    heights.sort_by(f64::total_cmp);
    let (median, most) = (
        heights[heights.len() / 2],
        heights[heights.len() * 95 / 100],
    );
    println!("soles above the floor: median {median:.3} m, 95 % within {most:.3} m");
    assert!(median < 0.06 && most < 0.25);
    // Another camera, another world.
    let (mut frame, _) = scene.next();
    frame.intrinsics.fx *= 1.1;
    fitter.update(&frame, &mut out);
    assert_eq!(out.world, World::default());
}

#[test]
fn a_given_floor_is_the_world_at_once() {
    let ground = GroundConfig {
        normal: [0.0, -2.0, 0.0],
        offset: crate::scene::CAMERA_HEIGHT,
    };
    let config = FitConfig {
        ground: Some(ground),
        ..FitConfig::default()
    };
    let mut scene = Scene::new(people::everyday(), Noise::NONE, FPS, 5);
    let mut fitter = Fitter::new(config).unwrap();
    let mut out = BodyFrame::default();
    fitter.update(&scene.next().0, &mut out);
    assert_eq!(out.world.state, WorldState::GIVEN);
    let below = out
        .world
        .point([0.0, crate::scene::CAMERA_HEIGHT as f32, 0.0]);
    assert!(below.iter().all(|v| v.abs() < 1e-6), "{below:?}");
    let ahead = out.world.point([1.0, 0.0, 5.0]);
    assert!((ahead[0] - 1.0).abs() < 1e-6 && (ahead[2] + 5.0).abs() < 1e-6);
}

#[test]
fn a_given_floor_tells_the_height_in_the_first_frame() {
    let truth = 1.20;
    let ground = GroundConfig {
        normal: [0.0, -1.0, 0.0],
        offset: crate::scene::CAMERA_HEIGHT,
    };
    for stills in [false, true] {
        let here = people::walk(0.0, 1.0, &[(0.3, 4.5), (0.3, 4.5)]);
        let mut child = Person::new(2, here, Activity::Stand).of_height(truth);
        child.lengths = *Skeleton::builtin().lengths();
        let mut scene = Scene::new(vec![child], Noise::NONE, FPS, 5);
        let config = FitConfig {
            ground: Some(ground),
            stills,
            ..FitConfig::default()
        };
        let mut fitter = Fitter::new(config).unwrap();
        let mut out = BodyFrame::default();
        for n in 0..3 {
            fitter.update(&scene.next().0, &mut out);
            let found = f64::from(out.bodies()[0].height);
            assert!(
                (found - truth).abs() < 0.06 * truth,
                "stills: {stills}, frame {n}: {found} m"
            );
        }
    }
}

#[test]
fn a_gap_leaves_the_floor_where_it_was() {
    let mut scene = standing();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    for _ in 0..300 {
        fitter.update(&scene.next().0, &mut out);
    }
    assert_eq!(out.world.state, WorldState::ESTIMATED);
    let ahead = out.world.point([0.0, 0.0, 5.0]);
    let known = out.bodies().last().expect("five people").id;
    // Longer than people are remembered.
    let mut later = |flags: u32| {
        let (mut frame, _) = scene.next();
        frame.capture_ns += 70_000_000_000;
        frame.flags = flags;
        fitter.update(&frame, &mut out);
        out
    };
    let back = later(0);
    assert_eq!(back.world.state, WorldState::ESTIMATED);
    let moved = (0..3).map(|i| (back.world.point([0.0, 0.0, 5.0])[i] - ahead[i]).abs());
    assert!(moved.fold(0.0, f32::max) < 0.01, "the world jumped");
    assert!(back.count > 0 && back.bodies().iter().all(|b| b.id > known));
    // A film has a clock of its own, and shows another place.
    assert_eq!(later(FLAG_FILE_TIME).world, World::default());
}

/// Adults and a child on one floor, no settings: feet tell how tall each is beside the others.
#[test]
fn a_shared_floor_tells_statures() {
    let heights = [1.84, 1.62, 1.15];
    let cast = heights
        .iter()
        .zip([-0.9, 0.0, 0.9])
        .enumerate()
        .map(|(k, (&height, x))| {
            let z = 4.0 + 0.3 * k as f64;
            let legs = people::walk(
                0.0,
                0.8,
                &[(x, z), (x + 0.3, z + 1.5), (x, z - 0.6), (x, z)],
            );
            Person::new(k as u64 + 2, legs, Activity::Stand).of_height(height)
        })
        .collect();
    let mut scene = Scene::new(cast, Noise::REAL, FPS, 6);
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let mut last: Option<Vec<(u32, f32)>> = None;
    for frame in 0..900 {
        let (observed, _) = scene.next();
        fitter.update(&observed, &mut out);
        let now: Vec<(u32, f32)> = out.bodies().iter().map(|b| (b.id, b.height)).collect();
        for &(id, height) in &now {
            let before = last.iter().flatten().find(|b| b.0 == id);
            let grown = before.map_or(0.0, |b| (height / b.1 - 1.0).abs());
            assert!(grown < 0.06 / FPS as f32, "frame {frame}: {grown}");
        }
        last = Some(now);
    }
    // By place from left to right.
    let mut bodies = out.bodies().to_vec();
    assert_eq!(bodies.len(), 3);
    bodies.sort_by(|a, b| a.joints2d[PELVIS][0].total_cmp(&b.joints2d[PELVIS][0]));
    for (body, truth) in bodies.iter().zip(heights) {
        println!("{truth} m: {:.2} m", body.height);
        let off = (f64::from(body.height) / truth - 1.0).abs();
        assert!(off < 0.08, "{truth} m is taken for {:.2} m", body.height);
    }
}

/// Who stands behind a counter has legs that the network invents: they tell nothing, to nobody.
#[test]
fn invented_legs_tell_no_stature() {
    for legs3d in [1.0, 0.6, 0.2] {
        let counter = Counter {
            from: 0.0,
            to: 99.0,
            legs2d: 0.2,
            legs3d,
        };
        let walk = |x: f64| {
            let round = [(x, 4.0), (x + 0.3, 5.0), (x, 3.6)];
            people::walk(0.0, 0.8, &round.repeat(5))
        };
        let cast = vec![
            Person::new(2, walk(-0.9), Activity::Stand).of_height(1.70),
            Person::new(3, walk(0.0), Activity::Stand).of_height(1.70),
            Person::new(4, walk(0.9), Activity::Reach)
                .of_height(1.70)
                .behind(counter),
        ];
        let mut scene = Scene::new(cast, Noise::REAL, FPS, 6);
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let mut out = BodyFrame::default();
        for _ in 0..600 {
            fitter.update(&scene.next().0, &mut out);
        }
        assert!(fitter.ground().is_some());
        assert_eq!(
            out.count, 3,
            "{legs3d}: whoever is not there has no stature"
        );
        for body in out.bodies() {
            let off = (body.height / 1.70 - 1.0).abs();
            assert!(
                off < 0.06,
                "{legs3d}: 1.70 m is taken for {:.2} m",
                body.height
            );
        }
    }
}

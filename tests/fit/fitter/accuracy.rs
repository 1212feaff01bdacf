//! Errors, jitter and limits, at any frame rate; angles that give the joints.

use std::collections::BTreeMap;

use edgecap::body::skeleton::{Pose, Posed, Skeleton, rotation_vector};
use edgecap::fit::{FitConfig, Fitter};
use edgecap::message::{BodyFrame, ObservationFrame};
use glam::{DQuat, DVec3, Vec3};

use super::{FPS, check_everywhere};
use crate::scene::measure::{Report, line, run};
use crate::scene::people;
use crate::scene::{Noise, Scene};

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

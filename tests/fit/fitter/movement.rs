//! Movement that is easily lost: out of the picture, up to the lens, turned round, in jumps.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use edgecap::body::skeleton::{Pose, Skeleton};
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{
    EVIDENCE_JOINTS, L_ANKLE, L_KNEE, NECK, PELVIS, R_ANKLE, R_ELBOW, R_HAND, R_KNEE, R_SHOULDER,
    R_WRIST, SHOULDERS,
};
use edgecap::message::{BodyFrame, BodyState};
use glam::{DQuat, Vec3};

use super::{FPS, dress, facing, posing, standing};
use crate::scene::people::{self, Activity, Person};
use crate::scene::{Noise, Scene, angle};

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
            let [r, l] = SHOULDERS;
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
            let shoulder = Vec3::from_array(seen.joints3d[R_SHOULDER]);
            let raised = [(R_ELBOW, 0.26), (R_WRIST, 0.50), (R_HAND, 0.60)];
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
                let [wrist, pelvis] = [R_WRIST, PELVIS].map(|j| Vec3::from_array(body.joints3d[j]));
                gaps.push((wrist - pelvis - (shoulder - 0.50 * Vec3::Y)).length());
            }
        }
        for gap in &gaps[..doubted] {
            assert!(*gap > 0.5, "followed at once at {fps} fps: {gaps:?}");
        }
        assert!(gaps[followed] < 0.2, "not followed at {fps} fps: {gaps:?}");
    }
}

/// Somebody who runs on the spot, 1.4 strides a second, turned away from the camera by so much, at so many seconds.
fn running(seconds: f64, turned: f64) -> Pose {
    let phase = TAU * 1.4 * seconds;
    let mut pose = Pose::facing_camera(4.0);
    pose.position.y = 0.4;
    pose.rotation *= DQuat::from_rotation_y(turned);
    for (side, sign) in [("r", 1.0), ("l", -1.0)] {
        let mut set = |name: &str, value: f64| {
            pose.angles[angle(&format!("{side}_{name}"))] = value;
        };
        set("hip_flexion", 0.1 + 0.7 * sign * phase.sin());
        set("knee_flexion", 0.5 + 0.45 * sign * (phase + 1.8).sin());
        set("shoulder_flexion", -0.5 * sign * phase.sin());
        set("elbow_flexion", 0.4);
    }
    pose
}

#[test]
fn legs_are_not_exchanged_for_a_prediction_that_reaches_too_far() {
    // Knees and ankles, and those of the other side.
    const LEGS: [(usize, usize); 4] = [
        (R_KNEE, L_KNEE),
        (R_ANKLE, L_ANKLE),
        (L_KNEE, R_KNEE),
        (L_ANKLE, R_ANKLE),
    ];
    // Frames a second, and how many of a hundred are without anybody.
    for (fps, gap) in [(5.0, 0), (FPS, 6)] {
        for turned in [0.0, FRAC_PI_4, FRAC_PI_2] {
            let mut fitter = Fitter::new(FitConfig::default()).unwrap();
            let mut out = BodyFrame::default();
            for n in 0..(20.0 * fps) as usize {
                let seconds = n as f64 / fps;
                let pose = running(seconds, turned);
                let mut frame = posing(1.0 + seconds, &pose, Skeleton::builtin().lengths());
                let truth = frame.people[0].joints3d.map(Vec3::from_array);
                dress(&mut frame.people[0], Some(10), 20);
                let since = n % 101;
                frame.count = u32::from(n < 101 || since >= gap);
                fitter.update(&frame, &mut out);
                // Joints that jump are held back for three frames.
                if n >= 101 && gap > 0 && since < gap + 4 {
                    continue;
                }
                let case = format!("{fps} fps, turned by {turned}, frame {n}");
                let body = out.bodies().first().expect(&case);
                let found = body.joints3d.map(Vec3::from_array);
                let (mut as_is, mut exchanged) = (0.0, 0.0);
                for (joint, other) in LEGS {
                    let at = found[joint] - found[PELVIS];
                    as_is += at.distance(truth[joint]);
                    exchanged += at.distance(truth[other]);
                }
                assert!(as_is < exchanged, "{case}: {as_is} m, {exchanged} m");
            }
        }
    }
}

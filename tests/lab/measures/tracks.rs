//! Measures over time: identities, jitter, the truth's own motion.

use edgecap::joints::{BODY_JOINTS, CANONICAL_STATURE, PELVIS};
use edgecap::lab::eval::{EvalOptions, Identity, Jitter, Predictions, evaluate};

use super::{body, exact, line, synthetic};
use crate::near;

/// Seconds between the frames of [`line`].
const STEP: f64 = 0.04;

#[test]
fn idf1_and_switches() {
    let mut i = Identity::default();
    let one = |a: f64, b: f64| vec![vec![a, b], vec![b, a]];
    // Two people for four frames; identities 7 and 8, exchanged in the last frame.
    for _ in 0..3 {
        i.add(&[1, 2], &[7, 8], &one(0.9, 0.1), 0.5);
    }
    i.add(&[1, 2], &[7, 8], &one(0.1, 0.9), 0.5);
    // One more frame in which the second is missed and a stranger appears.
    i.add(&[1, 2], &[8, 9], &[vec![0.9, 0.0], vec![0.0, 0.0]], 0.5);
    let s = i.score();
    assert_eq!(
        (s.truth, s.predicted, s.matched, s.switches),
        (10, 10, 9, 2)
    );
    // Best mapping: 1 → 7 and 2 → 8, right three times each; 1 → 8 and 2 → 7 would be right three times in all.
    near(s.idf1, 12.0 / 20.0);
    assert_eq!((s.truth_identities, s.predicted_identities), (2, 3));
}

#[test]
fn a_match_that_still_holds_is_kept() {
    let mut i = Identity::default();
    i.add(&[1], &[7], &[vec![0.9]], 0.5);
    // A second body lies nearer, but 7 still lies on the person: no switch.
    i.add(&[1], &[7, 8], &[vec![0.6], vec![0.9]], 0.5);
    assert_eq!(i.score().switches, 0);
}

#[test]
fn jitter_is_the_mean_acceleration() {
    let mut j = Jitter::default();
    // x = ½ · 4 · t²: 4 m/s² at any step.
    for (k, t) in [0.0, 0.1, 0.2, 0.4].into_iter().enumerate() {
        let x: f64 = 2.0 * t * t;
        j.add(1, k as u64, t, &[[x, 0.0, 0.0]; BODY_JOINTS]);
    }
    near(j.mean().unwrap(), 4.0);
    // A gap of one frame starts anew: too few frames on either side.
    let mut gap = Jitter::default();
    for k in [0_u64, 1, 3, 4] {
        gap.add(1, k, k as f64, &[[1.0; 3]; BODY_JOINTS]);
    }
    assert_eq!(gap.mean(), None);
}

#[test]
fn true_motion_is_of_the_time_that_predicted_tracks_last() {
    // Faster and faster; joints are right, but the identity changes after four of seven frames.
    let moving = |k: u64| {
        let x = 0.001 * (k * k * k) as f64;
        body().map(|p| [p[0] + x, p[1], p[2] + 4.0])
    };
    let joints2d: Vec<[f64; 2]> = (0..BODY_JOINTS)
        .map(|j| [10.0 * j as f64, 5.0 * j as f64])
        .collect();
    let mut truth = synthetic(|_| ()).unwrap();
    let first = truth.frames.remove(0);
    let mut lines = Vec::new();
    for k in 0..7 {
        let mut frame = first.clone();
        frame.frame = Some(k);
        frame.seconds = Some(STEP * k as f64);
        frame.people[0].joints3d = Some(moving(k).map(Some));
        truth.frames.push(frame);
        let person = serde_json::json!({
            "id": if k < 4 { 5 } else { 6 }, "state": "tracked", "position": [0.0, 0.0, 4.0],
            "orientation": [0.0, 0.0, 0.0, 1.0], "angles": vec![0.0; 29], "joints3d": moving(k).to_vec(),
            "joints2d": joints2d, "confidence": vec![0.9; BODY_JOINTS], "height": 1.8,
        });
        lines.push(line(k, "", &person.to_string()));
    }
    let predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
    assert!(predictions.bodies);
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    assert_eq!(report.identity.unwrap().switches, 1);
    assert!(report.jitter.unwrap() > 1.0, "{:?}", report.jitter);
    near(report.jitter.unwrap(), report.true_motion.unwrap());
}

#[test]
fn observations_and_the_truth_move_at_one_size() {
    const STATURE: f64 = 1.4;
    let moving = |k: u64| body().map(|p| p.map(|x| x * (1.0 + 0.01 * (k * k) as f64)));
    let mut truth = synthetic(|_| ()).unwrap();
    let first = truth.frames.remove(0);
    let mut lines = Vec::new();
    for k in 0..4 {
        let joints = moving(k);
        let mut frame = first.clone();
        frame.frame = Some(k);
        frame.seconds = Some(STEP * k as f64);
        frame.people[0].joints3d = Some(joints.map(Some));
        frame.people[0].stature = Some(STATURE);
        truth.frames.push(frame);
        let scale = f64::from(CANONICAL_STATURE) / STATURE;
        let own = joints.map(|p| std::array::from_fn(|i| scale * (p[i] - joints[PELVIS][i])));
        let solid: Vec<[f64; 3]> = own.to_vec();
        let person = serde_json::json!({"score": 0.9, "joints2d": exact(), "joints3d": solid});
        lines.push(line(k, "", &person.to_string()));
    }
    let predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    near(report.pose3d.unwrap().mpjpe_mm, 0.0);
    assert!(report.jitter.unwrap() > 1.0, "{:?}", report.jitter);
    near(report.jitter.unwrap(), report.true_motion.unwrap());
}

/// Photos in a row have no times of their own: predictions assume some.
#[test]
fn motion_is_timed_by_the_truth_where_it_knows() {
    let moving = |k: u64| body().map(|p| p.map(|x| x * (1.0 + 0.01 * (k * k) as f64)));
    let mut truth = synthetic(|_| ()).unwrap();
    let first = truth.frames.remove(0);
    let mut lines = Vec::new();
    for k in 0..4 {
        let mut frame = first.clone();
        frame.frame = Some(k);
        frame.seconds = Some(STEP * k as f64);
        frame.people[0].joints3d = Some(moving(k).map(Some));
        truth.frames.push(frame);
        let solid = moving(k).to_vec();
        let person = serde_json::json!({"score": 0.9, "joints2d": exact(), "joints3d": solid});
        lines.push(line(k, "", &person.to_string()));
    }
    let mut predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
    let motion = |predictions: &Predictions| {
        let report = evaluate(predictions, &truth, &EvalOptions::default()).unwrap();
        (report.jitter.unwrap(), report.true_motion.unwrap())
    };
    let right = motion(&predictions);
    assert!(right.0 > 1.0, "{right:?}");
    for frame in &mut predictions.frames {
        frame.time_ns /= 5;
    }
    assert_eq!(motion(&predictions), right);
}

/// A body of `run`, seen at the joints of [`exact`] and so far to the right of them, pixels.
fn tracked(id: u64, right: f32, solid: &[[f64; 3]; BODY_JOINTS]) -> String {
    let joints2d = exact().map(|[u, v, c]| [u + right, v, c]);
    serde_json::json!({
        "id": id, "position": [0.0, 0.0, 4.0], "joints2d": joints2d, "joints3d": solid.to_vec(), "height": 1.7,
    })
    .to_string()
}

#[test]
fn whoever_is_beside_the_one_labelled_person_is_no_wrong_identity() {
    let mut truth = synthetic(|_| ()).unwrap();
    let people = [tracked(5, 0.0, &body()), tracked(6, 300.0, &body())].join(",");
    let predictions = Predictions::parse(&line(0, "", &people), "p").unwrap();
    assert!(predictions.bodies);
    for (single, expected) in [(true, 1.0), (false, 2.0 / 3.0)] {
        truth.single = single;
        let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
        near(report.identity.unwrap().idf1, expected);
    }
}

#[test]
fn a_body_before_somebody_hidden_is_that_of_whoever_is_seen() {
    let mut truth = synthetic(|_| ()).unwrap();
    let mut hidden = synthetic(|p| {
        p["id"] = 2.into();
        p["visibility"] = vec![3; BODY_JOINTS].into();
    })
    .unwrap()
    .frames
    .remove(0)
    .people
    .remove(0);
    assert!(hidden.crowd);
    hidden.points.iter_mut().for_each(|k| k.u += 14.0);
    truth.frames[0].people.push(hidden);
    let identity = |bodies: &[String]| {
        let predictions = Predictions::parse(&line(0, "", &bodies.join(",")), "p").unwrap();
        let report = evaluate(&predictions, &truth, &EvalOptions::default());
        let identity = report.unwrap().identity.unwrap();
        (identity.truth, identity.predicted, identity.matched)
    };
    // Nearer to who is hidden, but no other body is on who is seen.
    let between = tracked(6, 8.0, &body());
    assert_eq!(identity(std::slice::from_ref(&between)), (1, 1, 1));
    assert_eq!(
        identity(&[tracked(5, 0.0, &body()), between]),
        (1, 1, 1),
        "the other one is of who is hidden"
    );
}

#[test]
fn bodies_and_a_truth_without_a_place_are_compared_by_their_poses() {
    let pelvis = body()[PELVIS];
    let pose: [[f64; 3]; BODY_JOINTS] = body().map(|p| std::array::from_fn(|i| p[i] - pelvis[i]));
    let mut truth = synthetic(|_| ()).unwrap();
    let first = truth.frames.remove(0);
    let mut lines = Vec::new();
    for k in 0..4 {
        let mut frame = first.clone();
        frame.frame = Some(k);
        frame.seconds = Some(STEP * k as f64);
        frame.people[0].joints3d = Some(pose.map(Some));
        truth.frames.push(frame);
        // Faster and faster away from the camera, which such a truth does not tell.
        let z = 4.0 + 0.01 * (k * k) as f64;
        let solid = pose.map(|p| [p[0], p[1], p[2] + z]);
        lines.push(line(k, "", &tracked(5, 0.0, &solid)));
    }
    let predictions = Predictions::parse(&lines.join("\n"), "p").unwrap();
    let report = evaluate(&predictions, &truth, &EvalOptions::default()).unwrap();
    near(report.jitter.unwrap(), 0.0);
    near(report.true_motion.unwrap(), 0.0);
    let pose = report.pose3d.unwrap();
    near(pose.mpjpe_mm, 0.0);
    assert_eq!(pose.root_mm, None);
}

//! Stage III on what is exactly true of the bundled clip, whose people come from elsewhere than the fit's own skeleton.

use edgecap::body::skeleton::Skeleton;
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{BODY_JOINTS, CANONICAL_STATURE, EVIDENCE_JOINTS, PARENTS, PELVIS};
use edgecap::lab::synth::demo;
use edgecap::lab::synth::truth::{SELF_OCCLUDED, Truth, TruthFrame, TruthPerson, VISIBLE};
use edgecap::message::{BodyFrame, Intrinsics, Observation, ObservationFrame};
use edgecap::record::{CameraSource, ObservationReader};
use glam::{Vec2, Vec3};

use crate::program::{output, stderr};

/// Joints about the pelvis at canonical stature, as Stage II gives them.
fn canonical(joints: &[[f32; 3]; BODY_JOINTS], stature: f32) -> [Vec3; BODY_JOINTS] {
    let root = Vec3::from_array(joints[PELVIS]);
    joints.map(|p| (Vec3::from_array(p) - root) * (CANONICAL_STATURE / stature))
}

/// Stages I and II without any error; what something else hides is not seen.
fn observed(person: &TruthPerson) -> Observation {
    let mut seen = Observation {
        score: 0.98,
        joints3d: canonical(&person.joints3d, person.stature).map(|p| p.to_array()),
        ..Observation::default()
    };
    for j in 0..EVIDENCE_JOINTS {
        let [u, v] = person.joints2d[j];
        let sure = match person.visibility[j] {
            VISIBLE | SELF_OCCLUDED => 0.9,
            _ => 0.0,
        };
        seen.joints2d[j] = [u, v, sure];
    }
    seen
}

/// Whether enough of somebody can be seen, or lies behind the own body, that a network would tell of them.
fn is_findable(person: &TruthPerson) -> bool {
    let evidence = person.visibility[..EVIDENCE_JOINTS].iter();
    let is_there = |v: &&u8| matches!(**v, VISIBLE | SELF_OCCLUDED);
    evidence.filter(is_there).count() >= 4
}

fn frame(truth: &Truth, at: &TruthFrame) -> ObservationFrame {
    let c = at.camera;
    let mut out = ObservationFrame {
        sequence: at.frame,
        capture_ns: at.time_ns,
        width: truth.width,
        height: truth.height,
        intrinsics: Intrinsics {
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
        },
        ..ObservationFrame::default()
    };
    for person in at.people.iter().filter(|p| is_findable(p)) {
        out.people[out.count as usize] = observed(person);
        out.count += 1;
    }
    out
}

#[test]
fn the_skeletons_bones_are_as_long_as_those_that_stage_two_is_shown() {
    let truth = demo::truth();
    let people: Vec<&TruthPerson> = truth.frames.iter().flat_map(|f| &f.people).collect();
    for j in (0..BODY_JOINTS).filter(|&j| j != PELVIS) {
        let length = |p: &&TruthPerson| {
            let at = canonical(&p.joints3d, p.stature);
            f64::from((at[j] - at[PARENTS[j]]).length())
        };
        let mean = people.iter().map(length).sum::<f64>() / people.len() as f64;
        let own = Skeleton::builtin().lengths()[j];
        assert!(
            (own / mean - 1.0).abs() < 0.05,
            "bone {j}: {own:.3} m, people have {mean:.3} m"
        );
    }
}

#[test]
fn perfect_observations_end_near_the_truth() {
    let truth = demo::truth();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let (mut sum, mut bodies) = (0.0, 0);
    for at in &truth.frames {
        fitter.update(&frame(&truth, at), &mut out);
        for body in out.bodies() {
            let found = canonical(&body.joints3d, body.height);
            // Nobody stands where somebody else does: the nearest body is the person.
            let error = at
                .people
                .iter()
                .map(|p| {
                    let [u, v] = body.joints2d[PELVIS];
                    let [tu, tv] = p.joints2d[PELVIS];
                    ((u - tu).hypot(v - tv), p)
                })
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map(|(_, p)| {
                    let there = canonical(&p.joints3d, p.stature);
                    let off = (0..BODY_JOINTS).map(|j| (found[j] - there[j]).length());
                    off.sum::<f32>() / BODY_JOINTS as f32
                });
            let Some(error) = error else { continue };
            sum += f64::from(error);
            bodies += 1;
        }
    }
    let mean = sum / f64::from(bodies);
    println!(
        "{bodies} bodies, {:.1} mm off at canonical stature",
        1e3 * mean
    );
    assert!(bodies > 450, "{bodies} bodies");
    assert!(mean < 0.03, "{mean} m");
}

/// What the network reports of the clip is fitted; what bodies say of their joints is held against the truth.
#[test]
#[ignore = "long: the demo at full size"]
fn long_bodies_are_as_sure_as_they_are_right() {
    let folder = tempfile::tempdir().unwrap();
    let lines = folder.path().join("observations.jsonl");
    let done = output(&[
        "infer",
        "--input",
        "demo",
        "--jsonl",
        lines.to_str().unwrap(),
    ]);
    assert!(done.status.success(), "{}", stderr(&done));
    let file = std::io::BufReader::new(std::fs::File::open(&lines).unwrap());
    let camera = CameraSource::Recorded { fov_degrees: 60.0 };
    let mut reader = ObservationReader::new(file, "demo".to_owned(), camera);
    let truth = demo::truth();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let (mut seen, mut out) = (ObservationFrame::default(), BodyFrame::default());
    // By tenths of what is said: how often, the sum of what was said, and what was within 150 mm.
    let mut bins = [[0.0_f64; 3]; 10];
    while reader.read(&mut seen).unwrap() {
        fitter.update(&seen, &mut out);
        let people = &truth.frames[seen.sequence as usize].people;
        for body in out.bodies() {
            let apart = |p: &&TruthPerson| {
                let off = |j: usize| Vec2::from(body.joints2d[j]).distance(p.joints2d[j].into());
                (0..EVIDENCE_JOINTS).map(off).sum::<f32>()
            };
            let nearest = people
                .iter()
                .min_by(|a, b| apart(a).total_cmp(&apart(b)))
                .expect("people");
            for j in (0..BODY_JOINTS).filter(|j| *j != PELVIS) {
                let about = |joints: &[[f32; 3]; BODY_JOINTS]| {
                    Vec3::from(joints[j]) - Vec3::from(joints[PELVIS])
                };
                let off = about(&body.joints3d).distance(about(&nearest.joints3d));
                let said = f64::from(body.confidence[j]);
                let [count, sum, right] = &mut bins[((said * 10.0) as usize).min(9)];
                *count += 1.0;
                *sum += said;
                *right += f64::from(u8::from(off < 0.15));
            }
        }
    }
    let total: f64 = bins.iter().map(|b| b[0]).sum();
    let mut error = 0.0;
    for [count, sum, right] in bins {
        println!(
            "said {:.2}, right {:.2}, of {count}",
            sum / count,
            right / count
        );
        error += (sum - right).abs() / total;
    }
    assert!(total > 8000.0, "{total} joints");
    assert!(error < 0.05, "expected calibration error {error}");
}

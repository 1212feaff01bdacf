//! Stage III on what is exactly true of the bundled clip, whose people come from elsewhere than the fit's own skeleton.

use edgecap::body::skeleton::Skeleton;
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{BODY_JOINTS, CANONICAL_STATURE, EVIDENCE_JOINTS, PARENTS, PELVIS};
use edgecap::lab::synth::demo;
use edgecap::lab::synth::truth::{SELF_OCCLUDED, Truth, TruthFrame, TruthPerson, VISIBLE};
use edgecap::message::{BodyFrame, Intrinsics, Observation, ObservationFrame};
use glam::Vec3;

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
    for person in at.people.iter().filter(|p| p.findable(4)) {
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

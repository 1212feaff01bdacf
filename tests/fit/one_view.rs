//! One view alone: `edgecap multiview` with one `--view`, against Stage III on the same observations.

use edgecap::camera::calibration::write_pose2sim;
use edgecap::camera::{Brown, View};
use edgecap::fit::{FitConfig, Fitter};
use edgecap::joints::{BODY_JOINTS, HEAD_TOP, PELVIS};
use edgecap::message::{BodyFrame, BodyState, Intrinsics, JointState, ObservationFrame};
use edgecap::multiview::{stage_three, to_view};
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter, RowReader};
use glam::{DVec2, Vec3};
use rand::SeedableRng;
use rand::rngs::SmallRng;

use crate::program::{assert_fails, output, stderr};
use crate::scene::people::{self, Activity, Person};
use crate::scene::ring::{Spoil, observe, views};
use crate::scene::{Noise, Scene};

const FRAMES: usize = 90;

fn about_pelvis(joints: &[Vec3; BODY_JOINTS]) -> [Vec3; BODY_JOINTS] {
    joints.map(|j| j - joints[PELVIS])
}

#[test]
fn a_body_is_as_right_as_stage_three() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (view, run) = (at("cam.jsonl"), at("run"));
    let walker = people::everyday().swap_remove(0);
    let mut scene = Scene::new(vec![walker], Noise::MEASURED, 30.0, 4);
    let mut file = RecordWriter::<ObservationsRow>::create(view.as_ref(), Format::Jsonl).unwrap();
    let mut fitter = Fitter::new(FitConfig::default()).unwrap();
    let mut out = BodyFrame::default();
    let (mut truth, mut stage_three) = (Vec::new(), Vec::new());
    for _ in 0..FRAMES {
        let (message, people) = scene.next();
        file.write(&message, "").unwrap();
        fitter.update(&message, &mut out);
        truth.push(about_pelvis(&people[0].joints.map(|p| p.as_vec3())));
        let body = out.bodies().iter().find(|b| b.id == 1);
        stage_three.push(body.map(|b| about_pelvis(&b.joints3d.map(Vec3::from))));
    }
    file.finish().unwrap();
    let args = ["multiview", "--view", &view, "--out", &run];
    let done = output(&args);
    assert!(done.status.success(), "{}", stderr(&done));
    let lines = std::fs::File::open(at("run/bodies.jsonl")).unwrap();
    let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(lines), "bodies");
    let (mut ours, mut theirs, mut frame) = (Vec::new(), Vec::new(), 0);
    while let Some(row) = rows.read().unwrap() {
        if let (Some(body), Some(three)) =
            (row.people.iter().find(|b| b.id == 1), stage_three[frame])
        {
            let own = about_pelvis(&body.joints3d.map(Vec3::from));
            for j in 0..BODY_JOINTS {
                ours.push(own[j].distance(truth[frame][j]));
                theirs.push(three[j].distance(truth[frame][j]));
            }
        }
        frame += 1;
    }
    assert_eq!(frame, FRAMES);
    assert!(ours.len() > FRAMES / 2 * BODY_JOINTS, "{}", ours.len());
    let mean = |all: &[f32]| all.iter().sum::<f32>() / all.len() as f32;
    let (ours, theirs) = (mean(&ours), mean(&theirs));
    println!("mesh body {ours} m, Stage III {theirs} m");
    assert!(
        ours < 1.02 * theirs,
        "mesh body {ours} m, Stage III {theirs} m"
    );
}

/// Somebody far from the middle, recorded by the right lens and by the one that a usual webcam has.
#[test]
fn joints_in_space_are_those_of_the_calibrated_lens() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let view = views(1).remove(0);
    let calibration = at("Calib.toml");
    std::fs::write(&calibration, write_pose2sim(std::slice::from_ref(&view))).unwrap();
    let place = people::walk(0.0, 1.0, &[(-2.5, 4.4), (-2.5, 4.4)]);
    let person = [Person::new(2, place, Activity::Wave)];
    let narrow = Intrinsics::from_horizontal_fov(view.size[0], view.size[1], 40.0);
    let [width, height] = [narrow.fx, narrow.fy].map(f64::from);
    let usual = View {
        focal: DVec2::new(width, height),
        centre: DVec2::new(narrow.cx.into(), narrow.cy.into()),
        distortion: Brown::default(),
        ..view.clone()
    };
    let names = ["right", "usual"];
    let joints = names.map(|name| {
        let record = at(&format!("{name}.jsonl"));
        let mut file =
            RecordWriter::<ObservationsRow>::create(record.as_ref(), Format::Jsonl).unwrap();
        let mut rng = SmallRng::seed_from_u64(1);
        for k in 0..30 {
            let t = f64::from(k) / 30.0;
            let mut frame = observe(&view, &person, t, Spoil::default(), &mut rng);
            if name == "usual" {
                to_view(&usual, &view.intrinsics(), &mut frame.people[..1]);
                frame.intrinsics = narrow;
            }
            file.write(&frame, "").unwrap();
        }
        file.finish().unwrap();
        let (camera, out) = (format!("{}={record}", view.name), at(name));
        let args = ["multiview", "--calibration", &calibration];
        let done = output(&[&args[..], &["--view", &camera, "--out", &out]].concat());
        assert!(done.status.success(), "{}", stderr(&done));
        let lines = std::fs::File::open(at(&format!("{name}/bodies.jsonl"))).unwrap();
        let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(lines), "bodies");
        let mut all: Vec<Vec3> = Vec::new();
        while let Some(row) = rows.read().unwrap() {
            all.extend(row.people.iter().flat_map(|b| b.joints3d.map(Vec3::from)));
        }
        all
    });
    let [right, usual] = &joints;
    assert!(right.len() == usual.len() && right.len() > 20 * BODY_JOINTS);
    let apart = right.iter().zip(usual).map(|(a, b)| a.distance(*b));
    let apart = apart.fold(0.0, f32::max);
    assert!(apart < 0.005, "{apart} m");
}

#[test]
fn a_joint_that_the_view_saw_is_observed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (view, run) = (at("cam.jsonl"), at("run"));
    let walker = people::everyday().swap_remove(0);
    let mut scene = Scene::new(vec![walker], Noise::NONE, 30.0, 4);
    let mut file = RecordWriter::<ObservationsRow>::create(view.as_ref(), Format::Jsonl).unwrap();
    let mut seen = Vec::new();
    for _ in 0..20 {
        let (mut message, _) = scene.next();
        message.people[0].joints2d[HEAD_TOP] = [0.0; 3];
        seen.push(message.people[0].joints2d.map(|j| j[2] >= 0.1));
        file.write(&message, "").unwrap();
    }
    file.finish().unwrap();
    let done = output(&["multiview", "--no-dct", "--view", &view, "--out", &run]);
    assert!(done.status.success(), "{}", stderr(&done));
    let lines = std::fs::File::open(at("run/bodies.jsonl")).unwrap();
    let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(lines), "bodies");
    let mut tracked = 0;
    for seen in seen {
        let frame = rows.read().unwrap().unwrap().message();
        let bodies = frame.bodies().iter();
        for body in bodies.filter(|b| b.state == BodyState::TRACKED) {
            let wanted = seen.map(|is_seen| match is_seen {
                true => JointState::OBSERVED,
                false => JointState::OCCLUDED,
            });
            assert_eq!(body.joint_states[..wanted.len()], wanted);
            tracked += 1;
        }
    }
    assert!(tracked >= 10, "{tracked}");
}

/// When bodies are of somebody who was seen at these times, nanoseconds.
fn times_of_bodies(times: &[u64], more: &[&str]) -> Vec<u64> {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (view, run) = (at("cam.jsonl"), at("run"));
    let walker = people::everyday().swap_remove(0);
    let mut scene = Scene::new(vec![walker], Noise::NONE, 30.0, 4);
    let mut file = RecordWriter::<ObservationsRow>::create(view.as_ref(), Format::Jsonl).unwrap();
    for &capture_ns in times {
        let (message, _) = scene.next();
        let message = ObservationFrame {
            capture_ns,
            ..message
        };
        file.write(&message, "").unwrap();
    }
    file.finish().unwrap();
    let args = ["multiview", "--no-dct", "--view", &view, "--out", &run];
    let done = output(&[&args, more].concat());
    assert!(done.status.success(), "{}", stderr(&done));
    let lines = std::fs::File::open(at("run/bodies.jsonl")).unwrap();
    let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(lines), "bodies");
    std::iter::from_fn(|| Some(rows.read().unwrap()?.time_ns)).collect()
}

#[test]
fn the_rate_that_is_given_makes_the_times() {
    let told: Vec<u64> = (0..8).map(|k| 1_000_000_000 + k * 40_000_000).collect();
    assert_eq!(times_of_bodies(&told, &[]), told);
    let wanted: Vec<u64> = (0..8).map(|k| k * 100_000_000).collect();
    assert_eq!(times_of_bodies(&told, &["--fps", "10"]), wanted);
}

#[test]
fn times_in_no_order_are_those_of_the_rate() {
    let ms = [0, 40, 80, 80, 160, 150, 240, 280];
    let times = times_of_bodies(&ms.map(|ms| 1_000_000 * ms), &[]);
    let wanted: Vec<u64> = (0..8).map(|k| k * 40_000_000).collect();
    assert_eq!(times, wanted);
}

#[test]
fn a_lens_that_distorts_is_undone_for_stage_three() {
    let lens = View {
        distortion: Brown {
            radial: [-0.25, 0.05, 0.0],
            tangential: [0.0; 2],
        },
        ..views(2).swap_remove(0)
    };
    let pinhole = View {
        distortion: Brown::default(),
        ..lens.clone()
    };
    let aside = people::walk(0.0, 1.0, &[(-1.6, 4.2), (-1.6, 4.2)]);
    let person = Person::new(5, aside, Activity::Wave);
    let bodies = |view: &View| {
        let mut rng = SmallRng::seed_from_u64(1);
        let frames = (0..20).map(|k| {
            let people = std::slice::from_ref(&person);
            let t = f64::from(k) / 30.0;
            observe(view, people, t, Spoil::default(), &mut rng)
        });
        let frames: Vec<ObservationFrame> = frames.collect();
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let frames = frames.iter().map(|f| (f.capture_ns, f.people()));
        stage_three(&mut fitter, view, frames)
    };
    let [found, wanted] = [&lens, &pinhole].map(bodies);
    let pairs = found.iter().flatten().zip(wanted.iter().flatten());
    let off = pairs.flat_map(|(a, b)| {
        let joints = a.joints3d.iter().zip(&b.joints3d);
        joints.map(|(p, q)| Vec3::from(*p).distance(Vec3::from(*q)))
    });
    let off: Vec<f32> = off.collect();
    assert!(off.len() >= 15 * BODY_JOINTS, "{}", off.len());
    let most = off.into_iter().fold(0.0, f32::max);
    assert!(most < 0.005, "{most} m");
}

#[test]
fn several_views_want_a_calibration_and_one_is_not_held_out() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (first, second, run) = (at("a.jsonl"), at("b.jsonl"), at("run"));
    let held = [
        "multiview",
        "--view",
        &first,
        "--hold-out",
        "a",
        "--out",
        &run,
    ];
    assert_fails(&held, 64, &["several views", "--hold-out a"]);
    let two = [
        "multiview",
        "--view",
        &first,
        "--view",
        &second,
        "--out",
        &run,
    ];
    assert_fails(
        &two,
        64,
        &["--calibration for several views", "'calibrate' makes one"],
    );
    let many: Vec<String> = (0..33).map(|k| format!("--view=c{k}={first}")).collect();
    let many = many.iter().map(String::as_str);
    for verb in ["multiview", "calibrate"] {
        let args: Vec<&str> = [verb, "--out", &run]
            .into_iter()
            .chain(many.clone())
            .collect();
        assert_fails(&args, 64, &["at most 32 --view, found 33"]);
    }
    assert_fails(
        &["multiview", "--view", &first, "--out", &run],
        66,
        &["a.jsonl"],
    );
}

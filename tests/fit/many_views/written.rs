//! What the verb writes, and in which axes.

use edgecap::camera::calibration::write_pose2sim;
use edgecap::joints::{BODY_JOINTS, HEAD_TOP, R_ANKLE, R_KNEE};
use edgecap::lab::multiview::own::own;
use edgecap::lab::synth::detector::Flaws;
use edgecap::message::{Body, BodyState};
use edgecap::npz::Archive;
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter, RowReader};
use glam::{DMat3, DVec3};

use super::{files, run};
use crate::program::{assert_fails, output, stderr};
use crate::scene::{Noise, Scene, people};

#[test]
fn the_verb_writes_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 3, 12);
    let (calibration, run) = (at("Calib.toml"), at("run"));
    let views = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec![
        "multiview",
        "--calibration",
        &calibration,
        "--out",
        &run,
        "--obj",
        "3",
    ];
    let exports = ["walk.bvh", "walk.glb", "walk.csv"].map(at);
    args.extend(exports.iter().flat_map(|to| ["--export", to]));
    args.extend(views.iter().flat_map(|v| ["--view", v]));
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    let mut left: Vec<String> = std::fs::read_dir(&run)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    left.sort();
    assert_eq!(
        left,
        [
            "bodies.jsonl",
            "bodies.npz",
            "joints.trc",
            "meshes.glb",
            "person1_000003.obj",
            "report.json"
        ]
    );
    let arrays = std::fs::File::open(at("run/bodies.npz")).unwrap();
    let mut arrays = Archive::new(arrays).unwrap();
    for (name, shape) in [
        ("poses", vec![12, 72]),
        ("trans", vec![12, 3]),
        ("betas", vec![12, 10]),
    ] {
        assert_eq!(
            arrays.numbers(name).unwrap().unwrap().shape,
            shape,
            "{name}"
        );
    }
    let lines = std::fs::File::open(at("run/bodies.jsonl")).unwrap();
    let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(lines), "bodies");
    let truth = own(5, 3, 12, Flaws::NONE);
    let mut count = 0;
    while let Some(row) = rows.read().unwrap() {
        let [body] = &row.people[..] else {
            panic!("one person")
        };
        let knee = DVec3::from(body.joints3d[R_KNEE].map(f64::from));
        assert!(
            knee.distance(truth.joints[count][R_KNEE]) < 0.1,
            "{count}: {knee}"
        );
        count += 1;
    }
    assert_eq!(count, 12);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at("run/report.json")).unwrap()).unwrap();
    assert!(
        report["views"][0]["median_percent"].as_f64().unwrap() < 4.0,
        "{report}"
    );
    let [bvh, glb, csv] = exports.each_ref().map(|to| std::fs::read(to).unwrap());
    assert!(bvh.starts_with(b"HIERARCHY") && glb.starts_with(b"glTF"));
    // Joints of 12 frames of one person, under a line of headings.
    assert_eq!(String::from_utf8(csv).unwrap().lines().count(), 1 + 12 * 21);
    // A full folder is not written into.
    assert_fails(&args, 73, &["holds files"]);
}

/// A calibration may have any axis up; exports and readers take y of the world for it.
#[test]
fn who_stands_in_a_calibration_with_z_up_stands_in_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let mut views = files(folder.path(), 3, 12);
    let y_to_z = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    for view in &mut views {
        view.rotation *= y_to_z.transpose();
        view.position = y_to_z * view.position;
    }
    std::fs::write(at("Calib.toml"), write_pose2sim(&views)).unwrap();
    run(folder.path(), "Calib.toml", &views);
    let lines = std::fs::File::open(at("run/bodies.jsonl")).unwrap();
    let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(lines), "bodies");
    let row = rows.read().unwrap().unwrap();
    let [head, ankle] =
        [HEAD_TOP, R_ANKLE].map(|j| DVec3::from(row.people[0].joints3d[j].map(f64::from)));
    let tall = head - ankle;
    assert!(tall.z > 1.2, "{tall}");
    let in_world = row.message().world.direction(tall.as_vec3().to_array());
    assert!(in_world[1] > 1.2, "{in_world:?}");
}

/// A body's confidence is a probability, which Stage III has for every joint.
#[test]
fn bodies_of_one_view_are_as_sure_as_those_of_stage_three() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (view, run, fitted) = (at("cam.jsonl"), at("run"), at("fitted.jsonl"));
    let walker = people::everyday().swap_remove(0);
    let mut scene = Scene::new(vec![walker], Noise::MEASURED, 30.0, 4);
    let mut file = RecordWriter::<ObservationsRow>::create(view.as_ref(), Format::Jsonl).unwrap();
    for _ in 0..60 {
        file.write(&scene.next().0, "").unwrap();
    }
    file.finish().unwrap();
    for args in [
        ["multiview", "--view", &view, "--out", &run],
        ["fit", "--input", &view, "--jsonl", &fitted],
    ] {
        let done = output(&args);
        assert!(done.status.success(), "{}", stderr(&done));
    }
    let sure = |path: &str| -> Vec<(u32, Body)> {
        let lines = std::fs::File::open(path).unwrap();
        let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(lines), "bodies");
        let (mut all, mut frame) = (Vec::new(), 0);
        while let Some(row) = rows.read().unwrap() {
            all.extend(row.message().bodies().iter().map(|b| (frame, *b)));
            frame += 1;
        }
        all
    };
    let (ours, theirs) = (sure(&at("run/bodies.jsonl")), sure(&fitted));
    let (mut compared, mut least) = (0, 1.0_f32);
    for (frame, body) in &theirs {
        let is_same = |(f, b): &&(u32, Body)| f == frame && b.id == body.id;
        let own = ours.iter().find(is_same);
        let Some((_, own)) = own.filter(|_| body.state == BodyState::TRACKED) else {
            continue;
        };
        for (j, (own, wanted)) in own.confidence.iter().zip(body.confidence).enumerate() {
            assert!(
                (own - wanted).abs() < 0.1,
                "frame {frame}, joint {j}: {own}, not {wanted}"
            );
            (compared, least) = (compared + 1, least.min(*own));
        }
    }
    assert!(compared > 30 * BODY_JOINTS, "{compared}");
    assert!(least < 0.7, "no joint is doubtful: {least}");
}

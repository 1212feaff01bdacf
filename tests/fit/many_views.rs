//! Bodies from several views, against bodies of the same model whose shape and pose are known: noise, a detector's
//! bias, outliers, joints not seen, and sides exchanged are put in.

use std::path::Path;

use edgecap::body::mesh::MeshBody;
use edgecap::camera::View;
use edgecap::camera::calibration::write_pose2sim;
use edgecap::joints::{BODY_JOINTS, PELVIS};
use edgecap::lab::multiview::own::{RATE, Walker, observe, own, ring, steady};
use edgecap::lab::multiview::{Line, TablesOptions, Trial, tables};
use edgecap::lab::synth::detector::{ARMS, Flaws, LEGS, exchange};
use edgecap::message::{Body, BodyState, JointState, Observation, ObservationFrame};
use edgecap::multiview::{
    Mask, MultiviewFit, MultiviewOptions, Run, Sight, bodies, fit, matched, stature, track,
};
use edgecap::npz::Archive;
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter, RowReader};
use glam::{DMat3, DVec3};

use crate::program::{assert_fails, output, stderr};
use crate::scene::people;
use crate::scene::{Noise, Scene};

const L_ANKLE: usize = 13;
const L_FOOT_TIP: usize = 20;

fn fitted(trial: &Trial, paths: bool) -> MultiviewFit {
    let options = MultiviewOptions {
        rate: trial.rate,
        paths,
        hierarchy: true,
    };
    trial.fit(options, None, &|_| ())
}

/// Mean distance of evidence joints, and of the rest meshes' vertices without their offset, millimetres.
fn errors(trial: &Trial, found: &MultiviewFit) -> (f64, f64) {
    let errors = trial.errors(found);
    let shape = errors.shape.expect("of the same model");
    (1e3 * errors.joints, 1e3 * shape)
}

#[test]
fn what_is_seen_exactly_is_found() {
    let trial = own(1, 3, 10, Flaws::NONE);
    let found = fitted(&trial, false);
    assert_eq!((found.people.len(), found.people[0].frames.len()), (1, 10));
    let (joints, shape) = errors(&trial, &found);
    assert!(
        joints < 8.0 && shape < 12.0,
        "{joints:.1} mm, shape {shape:.1} mm"
    );
}

#[test]
fn joints_that_no_view_tells_are_seen_where_the_joint_before_them_is() {
    let trial = own(1, 3, 3, Flaws::NONE);
    let mut found = fitted(&trial, false);
    let person = &mut found.people[0];
    let moments = person.frames.iter_mut().map(|f| &mut f.moment);
    for sight in moments.flat_map(|m| m.sights.iter_mut().flatten()) {
        sight.rays[L_ANKLE] = None;
    }
    let bodies = bodies(person, 1.7, trial.rate);
    assert_eq!(bodies.len(), 3);
    for (frame, body) in bodies {
        let unseen = |j: &usize| body.joint_states[*j] != JointState::OBSERVED;
        let unseen: Vec<usize> = (0..BODY_JOINTS).filter(unseen).collect();
        assert_eq!(unseen, [L_ANKLE, L_FOOT_TIP], "frame {frame}");
        assert!(body.confidence[L_FOOT_TIP] < body.confidence[PELVIS]);
    }
}

#[test]
fn a_detector_s_mistakes_are_outvoted() {
    let trial = own(2, 3, 40, steady(2));
    let (joints, shape) = errors(&trial, &fitted(&trial, true));
    println!("joints {joints:.1} mm, shape {shape:.1} mm");
    assert!(
        joints < 35.0 && shape < 20.0,
        "{joints:.1} mm, shape {shape:.1} mm"
    );
    let mut exchanged = trial.clone();
    for views in exchanged.seen.iter_mut().skip(10).take(12) {
        for seen in &mut views[0] {
            exchange(seen, LEGS);
        }
    }
    let found = fitted(&exchanged, true);
    let (healed, _) = errors(&exchanged, &found);
    let limbs: usize = found.people[0].frames.iter().map(|f| f.moment.healed).sum();
    println!("legs of one view exchanged in 30 %: {healed:.1} mm, {limbs} healed");
    assert!(
        healed < 1.1 * joints + 1.0,
        "{healed:.1} mm with exchanges, {joints:.1} mm without"
    );
}

/// With errors as measured, which stay for a second and exchange limbs themselves, in frames here and there.
#[test]
fn exchanges_are_healed_whatever_the_detector() {
    let trial = own(3, 3, 40, Flaws::MEASURED);
    let (joints, _) = errors(&trial, &fitted(&trial, true));
    let mut exchanged = trial.clone();
    for (k, views) in exchanged.seen.iter_mut().enumerate() {
        if k * 7 % 10 < 3 {
            for seen in &mut views[0] {
                exchange(seen, ARMS);
                exchange(seen, LEGS);
            }
        }
    }
    let (healed, _) = errors(&exchanged, &fitted(&exchanged, true));
    println!("{healed:.1} mm with exchanges, {joints:.1} mm without");
    assert!(healed < 1.05 * joints, "{healed} mm, not {joints} mm");
}

#[test]
fn everyone_keeps_their_identity() {
    let places = [
        DVec3::new(-0.9, 0.0, 0.0),
        DVec3::new(0.9, 0.0, 0.4),
        DVec3::new(0.0, 0.0, -1.1),
    ];
    let people: Vec<Walker> = (0..3)
        .map(|k| Walker::new(20, 10 + k, places[k as usize]))
        .collect();
    let views = ring(4);
    let trial = Trial {
        seen: observe(&views, &people, steady(3), 3),
        views,
        ..own(3, 1, 1, Flaws::NONE)
    };
    let found = fitted(&trial, false);
    assert_eq!(found.people.len(), 3);
    let mut taken = Vec::new();
    for p in &found.people {
        assert_eq!(p.frames.len(), 20, "person {}", p.id);
        let nearest = |f: &edgecap::multiview::PersonFrame| {
            let at = f.body.pose.pelvis;
            let off = |k: usize| people[k].poses[f.frame].pelvis.distance(at);
            (0..3)
                .min_by(|a, b| off(*a).total_cmp(&off(*b)))
                .expect("three people")
        };
        let who: Vec<usize> = p.frames.iter().map(nearest).collect();
        assert!(
            who.iter().all(|w| *w == who[0]),
            "person {} changes: {who:?}",
            p.id
        );
        taken.push(who[0]);
    }
    taken.sort_unstable();
    assert_eq!(taken, [0, 1, 2]);
}

/// What a spurious detection and a real person's make together lies on the real one's rays, and lives from them.
#[test]
fn a_ghost_takes_nothing_from_a_person() {
    let (views, person) = (ring(4), [Walker::new(1, 40, DVec3::ZERO)]);
    let mut filmed = views.clone();
    filmed[0].position.y += 0.06; // so its rays pass beside where the others see the person
    let seen =
        |by: &[View]| -> Vec<Vec<Observation>> { observe(by, &person, Flaws::NONE, 1).remove(0) };
    let sights: Vec<Vec<Sight>> = views
        .iter()
        .zip(seen(&filmed))
        .map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
        .collect();
    let mut frames = vec![sights; 20];
    // View 3 sees, once, what would lie on the person's rays of view 0 at 0.94 of their distance.
    let mut aside = views[3].clone();
    aside.position = filmed[0].position + (aside.position - views[0].position) / 0.94;
    let ghost = seen(&[aside]);
    frames[0][3].extend(ghost[0].iter().map(|o| Sight::new(&views[3], o)));
    let people = track(&views, &frames, RATE);
    assert_eq!(people.len(), 1);
    for (frame, moment) in &people[0].moments[4..] {
        let views = moment.sights.iter().flatten().count();
        assert_eq!(views, 4, "frame {frame}");
    }
}

#[test]
fn a_detection_is_held_against_one_body() {
    let places = [DVec3::new(-0.25, 0.0, 0.0), DVec3::new(0.25, 0.0, 0.1)];
    let people = [0, 1].map(|k| Walker::new(1, 30 + k, places[k as usize]));
    let (views, joints) = (ring(1), people.each_ref().map(|p| p.joints[0]));
    let seen = observe(&views, &people[1..], Flaws::NONE, 1);
    let seen: Vec<Sight> = seen[0][0]
        .iter()
        .map(|o| Sight::new(&views[0], o))
        .collect();
    let found = matched(&views[0], &seen, &joints);
    assert!(found[0].is_none() && found[1].is_some());
    assert_eq!(matched(&views[0], &[], &joints), [None, None]);
    assert!(matched(&views[0], &seen, &[]).is_empty());
}

/// Calibration and records of `frames` frames of one person, as files.
pub fn files(folder: &Path, count: usize, frames: usize) -> Vec<View> {
    let Trial { views, seen, .. } = own(5, count, frames, steady(5));
    std::fs::write(folder.join("Calib.toml"), write_pose2sim(&views)).unwrap();
    record(folder, &views, &seen);
    views
}

/// Frame `k` of 30 a second as a view saw it.
pub fn seen_by(view: &View, k: usize, people: &[Observation]) -> ObservationFrame {
    let mut message = ObservationFrame {
        sequence: k as u64,
        capture_ns: k as u64 * 33_333_333,
        width: view.size[0],
        height: view.size[1],
        intrinsics: view.intrinsics(),
        count: people.len() as u32,
        ..ObservationFrame::default()
    };
    message.people[..people.len()].copy_from_slice(people);
    message
}

/// A record of every view, called like it.
fn record(folder: &Path, views: &[View], seen: &[Vec<Vec<Observation>>]) {
    for (v, view) in views.iter().enumerate() {
        let path = folder.join(format!("{}.jsonl", view.name));
        let mut file = RecordWriter::<ObservationsRow>::create(&path, Format::Jsonl).unwrap();
        for (k, frame) in seen.iter().enumerate() {
            let mut message = seen_by(view, k, &frame[v]);
            // As of live cameras of one machine.
            message.publish_ns = message.capture_ns + 40_000_000;
            file.write(&message, "").unwrap();
        }
        file.finish().unwrap();
    }
}

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
        let knee = DVec3::from(body.joints3d[9].map(f64::from));
        assert!(
            knee.distance(truth.joints[count][9]) < 0.1,
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
    let (calibration, run) = (at("Calib.toml"), at("run"));
    std::fs::write(&calibration, write_pose2sim(&views)).unwrap();
    let seen = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
    args.extend(seen.iter().flat_map(|v| ["--view", v]));
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    let lines = std::fs::File::open(at("run/bodies.jsonl")).unwrap();
    let mut rows = RowReader::<_, BodiesRow>::new(std::io::BufReader::new(lines), "bodies");
    let row = rows.read().unwrap().unwrap();
    let [head, ankle] = [0, 10].map(|j| DVec3::from(row.people[0].joints3d[j].map(f64::from)));
    let tall = head - ankle;
    assert!(tall.z > 1.2, "{tall}");
    let in_world = row.message().world.direction(tall.as_vec3().to_array());
    assert!(in_world[1] > 1.2, "{in_world:?}");
}

#[test]
fn views_that_do_not_go_together_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let views = files(folder.path(), 3, 30);
    let (first, second, run) = (at("0.jsonl"), at("120.jsonl"), at("run"));
    let refused = |calibration: &str, second: &str, code: i32, words: &[&str]| {
        let args = [
            "multiview",
            "--calibration",
            calibration,
            "--view",
            &first,
            "--view",
            second,
            "--out",
            &run,
        ];
        assert_fails(&args, code, words);
        assert!(!Path::new(&run).exists(), "a failed run leaves no folder");
    };
    let calibration = at("Calib.toml");
    let text = std::fs::read_to_string(&second).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let other = |name: &str, text: &str| {
        std::fs::create_dir_all(folder.path().join(name)).unwrap();
        let path = at(&format!("{name}/120.jsonl"));
        std::fs::write(&path, text).unwrap();
        path
    };
    refused(
        &calibration,
        &other("empty", ""),
        65,
        &["120.jsonl", "found none"],
    );
    let turned = text.replace("\"height\":1080", "\"height\":720");
    refused(
        &calibration,
        &other("turned", &turned),
        65,
        &["1080x1080", "1080x720"],
    );
    let faster: String = lines
        .iter()
        .enumerate()
        .map(|(k, l)| {
            l.replace(
                &format!("\"time_ns\":{}", k * 33_333_333),
                &format!("\"time_ns\":{}", k * 20_000_000),
            ) + "\n"
        })
        .collect();
    let (faster, run) = (other("faster", &faster), at("run"));
    let frame_by_frame = [
        "multiview",
        "--calibration",
        &calibration,
        "--view",
        &first,
        "--view",
        &faster,
        "--sync",
        "none",
        "--out",
        &run,
    ];
    assert_fails(&frame_by_frame, 65, &["one rate", "30.00", "50.00"]);
    let short = other("short", &lines[..4].join("\n"));
    let frame_by_frame = frame_by_frame.map(|arg| if arg == faster { &short } else { arg });
    assert_fails(&frame_by_frame, 65, &["one length", "30", "4"]);
    refused(&calibration, &at("nowhere/120.jsonl"), 66, &["nowhere"]);
    let missing = ["hall.jsonl", "No such file or directory (os error 2)"];
    refused(&calibration, &at("nowhere/hall.jsonl"), 66, &missing);
    refused(&at("nowhere.toml"), &second, 66, &["nowhere.toml"]);
    let mut twice = views.clone();
    (twice[1].rotation, twice[1].position) = (twice[0].rotation, twice[0].position);
    std::fs::write(at("twice.toml"), write_pose2sim(&twice)).unwrap();
    refused(&at("twice.toml"), &second, 65, &["twice.toml", "one place"]);
    let unknown = other("unknown", &text);
    std::fs::rename(&unknown, at("unknown/7.jsonl")).unwrap();
    refused(
        &calibration,
        &at("unknown/7.jsonl"),
        64,
        &["0, 120, 240", "7.jsonl"],
    );
    let copy = format!("120={first}");
    refused(&calibration, &copy, 64, &["of its own", "0 and 120"]);
    // Somebody flipped all pictures.
    let mut seen = own(5, 3, 30, steady(5)).seen;
    for (view, people) in seen.iter_mut().flat_map(|frame| views.iter().zip(frame)) {
        for joint in people.iter_mut().flat_map(|p| &mut p.joints2d) {
            joint[0] = view.size[0] as f32 - 1.0 - joint[0];
        }
    }
    let flipped = folder.path().join("flipped");
    std::fs::create_dir(&flipped).unwrap();
    record(&flipped, &views, &seen);
    let names = ["0", "120", "240"].map(|v| at(&format!("flipped/{v}.jsonl")));
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
    args.extend(names.iter().flat_map(|name| ["--view", name]));
    assert_fails(&args, 65, &["mirrored", "hflip"]);
}

/// A calibration as Qualisys writes it; all lenses with `k1`.
fn qualisys(views: &[View], k1: f64) -> String {
    let camera = |v: &View| {
        let rows = (0..3).map(|r| {
            let row = v.rotation.row(r) * if r == 0 { 1.0 } else { -1.0 };
            (1..4)
                .zip(row.to_array())
                .fold(String::new(), |text, (c, x)| {
                    format!("{text} r{}{c}=\"{x}\"", r + 1)
                })
        });
        let (place, focal, centre) = (1e3 * v.position, 64.0 * v.focal, 64.0 * v.centre);
        let [right, bottom] = v.size.map(|s| s - 1);
        format!(
            "<camera active=\"1\" serial=\"{}\"><fov_video_max left=\"0\" top=\"0\" right=\"{right}\" \
             bottom=\"{bottom}\"/><transform x=\"{}\" y=\"{}\" z=\"{}\"{}/><intrinsic focalLengthU=\"{}\" \
             focalLengthV=\"{}\" centerPointU=\"{}\" centerPointV=\"{}\" radialDistortion1=\"{k1}\" \
             radialDistortion2=\"0\" tangentalDistortion1=\"0\" tangentalDistortion2=\"0\"/></camera>",
            v.name,
            place.x,
            place.y,
            place.z,
            rows.collect::<String>(),
            focal.x,
            focal.y,
            centre.x,
            centre.y,
        )
    };
    let all: String = views.iter().map(camera).collect();
    format!("<?xml version=\"1.0\"?><calibration><cameras>{all}</cameras></calibration>")
}

/// Distortion 64 times too strong: as it is written nobody is found at all.
#[test]
fn lenses_in_which_nobody_is_found_are_read_the_other_way() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let views = files(folder.path(), 3, 12);
    let (calibration, run) = (at("all.qca.txt"), at("run"));
    std::fs::write(&calibration, qualisys(&views, -64.0 * 0.1)).unwrap();
    let names = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
    args.extend(names.iter().flat_map(|name| ["--view", name]));
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    let said = stderr(&out);
    assert!(
        said.contains("divided by 64") && said.contains("the second is used"),
        "{said}"
    );
}

/// With one view, and live, rays do not tell which reading is right.
#[test]
fn a_second_reading_of_lenses_is_said_where_it_cannot_be_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let mut views = files(folder.path(), 3, 12);
    let (calibration, millimetres) = (at("all.qca.txt"), at("mm.toml"));
    std::fs::write(&calibration, qualisys(&views, -64.0 * 0.1)).unwrap();
    views.iter_mut().for_each(|v| v.position *= 1e3);
    std::fs::write(&millimetres, write_pose2sim(&views)).unwrap();
    let live = [
        "fit",
        "--cameras",
        "0,nowhere",
        "--calibration",
        &calibration,
    ];
    let live = output(&live);
    assert_eq!(live.status.code(), Some(64), "{}", stderr(&live));
    let of_one = |calibration: &str, run: &str| {
        let (first, out) = (at("0.jsonl"), at(run));
        let args = [
            "--view",
            &first,
            "--calibration",
            calibration,
            "--out",
            &out,
        ];
        output(&[&["multiview"][..], &args].concat())
    };
    let one = of_one(&calibration, "run");
    for said in [&live, &one].map(stderr) {
        assert!(
            said.contains("all.qca.txt") && said.contains("distortion divided by 64"),
            "{said}"
        );
    }
    let said = stderr(&of_one(&millimetres, "other"));
    assert!(said.contains("taken for millimetres"), "{said}");
}

/// A camera that was moved far after its calibration: none of its sights is anybody's.
#[test]
fn a_view_that_sees_nobody_of_the_others_people_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let mut views = files(folder.path(), 4, 12);
    views[1].rotation = DMat3::from_rotation_y(0.3) * views[1].rotation;
    let (calibration, run) = (at("Calib.toml"), at("run"));
    std::fs::write(&calibration, write_pose2sim(&views)).unwrap();
    let names: Vec<String> = views
        .iter()
        .map(|v| at(&format!("{}.jsonl", v.name)))
        .collect();
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
    args.extend(names.iter().flat_map(|name| ["--view", name]));
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    let table = String::from_utf8(out.stdout).unwrap();
    let line = table
        .lines()
        .find(|l| l.starts_with(&views[1].name))
        .unwrap();
    assert!(line.contains("check its place"), "{table}");
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at("run/report.json")).unwrap()).unwrap();
    assert_eq!(
        (&report["views"][1]["sights"], &report["views"][1]["told"]),
        (&0.into(), &12.into())
    );
}

/// Twelve people walk by far behind, whom one view shows and the others do not.
#[test]
fn a_view_that_sees_bystanders_behind_the_others_people_is_not_doubted() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let Trial {
        views, mut seen, ..
    } = own(5, 3, 12, Flaws::NONE);
    std::fs::write(at("Calib.toml"), write_pose2sim(&views)).unwrap();
    let behind = |k: usize| DVec3::new(0.9 * (k as f64 - 5.5), 0.0, -14.0 - 0.7 * k as f64);
    let crowd: Vec<Walker> = (0..12)
        .map(|k| Walker::new(12, 40 + k as u64, behind(k)))
        .collect();
    let beside = observe(&views[..1], &crowd, Flaws::NONE, 6);
    for (frame, more) in seen.iter_mut().zip(beside) {
        frame[0].extend(more.into_iter().flatten());
    }
    record(folder.path(), &views, &seen);
    let (calibration, run) = (at("Calib.toml"), at("run"));
    let names = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
    args.extend(names.iter().flat_map(|name| ["--view", name]));
    let out = output(&args);
    assert!(out.status.success(), "{}", stderr(&out));
    let table = String::from_utf8(out.stdout).unwrap();
    assert!(!table.contains("check its place"), "{table}");
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at("run/report.json")).unwrap()).unwrap();
    let of = |name: &str| report["views"][0][name].as_u64().unwrap();
    assert_eq!((of("sights"), of("shown")), (12, 12));
    assert!(of("told") > 120, "{report}");
}

/// Cameras that show people down to the belt.
#[test]
fn upper_bodies_alone_are_said_to_be_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let Trial {
        views, mut seen, ..
    } = own(5, 3, 12, Flaws::NONE);
    std::fs::write(at("Calib.toml"), write_pose2sim(&views)).unwrap();
    for seen in seen.iter_mut().flatten().flatten() {
        seen.joints2d[8..].fill([0.0; 3]);
    }
    record(folder.path(), &views, &seen);
    let (calibration, run) = (at("Calib.toml"), at("run"));
    let names = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
    args.extend(names.iter().flat_map(|name| ["--view", name]));
    assert_fails(&args, 65, &["neck and hips", "12 frames"]);
}

#[test]
fn a_camera_that_is_named_has_to_be_the_only_one_of_its_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let views = files(folder.path(), 2, 12);
    let one = at("One.toml");
    std::fs::write(&one, write_pose2sim(&views[..1])).unwrap();
    let record = at("120.jsonl");
    let of = |view: &str, run: &str| {
        let (view, out) = (view.to_owned(), at(run));
        [
            "multiview",
            "--calibration",
            &one,
            "--view",
            &view,
            "--out",
            &out,
        ]
        .map(str::to_owned)
    };
    let wrong = of(&format!("nosuch={record}"), "wrong");
    let wrong = wrong.each_ref().map(String::as_str);
    assert_fails(&wrong, 64, &["nosuch", "cameras 0"]);
    // The file alone tells nothing.
    let unnamed = of(&record, "run");
    let out = output(&unnamed.each_ref().map(String::as_str));
    assert_ne!(out.status.code(), Some(64), "{}", stderr(&out));
}

/// What views saw, in the order of the frames.
fn sights(trial: &Trial) -> Vec<Vec<Vec<Sight>>> {
    let of_frame = |seen: &Vec<Vec<Observation>>| {
        let each = trial.views.iter().zip(seen);
        each.map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
            .collect()
    };
    trial.seen.iter().map(of_frame).collect()
}

/// A camera that was zoomed in after its calibration sees people larger than they are.
#[test]
fn a_view_that_counts_less_has_no_part_in_the_shape() {
    let mut trial = own(1, 3, 10, Flaws::NONE);
    let centre = trial.views[2].centre.as_vec2().to_array();
    let zoomed = trial.seen.iter_mut().flat_map(|views| &mut views[2]);
    for joint in zoomed.flat_map(|seen| &mut seen.joints2d) {
        for (place, middle) in joint.iter_mut().zip(centre) {
            *place = middle + 1.25 * (*place - middle);
        }
    }
    let (body, frames) = (MeshBody::shipped(), sights(&trial));
    let options = MultiviewOptions {
        rate: trial.rate,
        paths: false,
        hierarchy: true,
    };
    let fitted = |used: [bool; 3]| {
        let run = Run::new(None, &|_| ());
        let found = fit(body, &trial.views, &used, &frames, options, run);
        (found.weights[2], stature(body, &found.people[0].betas))
    };
    let ((weight, with), (_, without)) = (fitted([true; 3]), fitted([true, true, false]));
    println!("weight {weight:.3}, {with:.3} m, {without:.3} m without");
    assert!(weight < 0.3, "{weight}");
    assert!((with - without).abs() < 0.005, "{with} m, not {without} m");
}

/// Of two people, one of whom stands behind the other in a view, the one before has the outline there: where masks show
/// what is to be seen of the other, do not know whose it is, or show nothing of it.
#[test]
fn nobody_is_given_the_outline_of_whoever_stands_before_them() {
    const FRAMES: usize = 4;
    let views = ring(3);
    let people = [0.0, -1.1].map(|z| Walker::new(FRAMES, 7, DVec3::new(0.0, 0.0, z)));
    let trial = Trial {
        seen: observe(&views, &people, Flaws::NONE, 7),
        views,
        ..own(7, 1, 1, Flaws::NONE)
    };
    let shown = |frame: usize, view: usize, hidden: u8, unknown: Option<u8>| {
        let camera = &trial.views[view];
        let depth = |k: &usize| camera.to_camera(people[*k].poses[frame].pelvis).z;
        let mut order = [0, 1];
        order.sort_by(|a, b| depth(b).total_cmp(&depth(a)));
        let mut all = people[0].mask(frame, camera);
        all.owners.fill(0);
        all.unknown = unknown;
        for k in order {
            let own = people[k].mask(frame, camera).owners;
            let is_hidden = view == 0 && k == order[0];
            let value = if is_hidden { hidden } else { 1 + k as u8 };
            for (to, _) in all.owners.iter_mut().zip(own).filter(|(_, own)| *own == 1) {
                *to = value;
            }
        }
        all
    };
    let options = MultiviewOptions {
        rate: trial.rate,
        paths: false,
        hierarchy: true,
    };
    let (body, frames) = (MeshBody::shipped(), sights(&trial));
    for (hidden, unknown) in [(2, None), (255, Some(255)), (0, None)] {
        let drawn: Vec<Vec<Mask>> = (0..FRAMES)
            .map(|k| (0..3).map(|v| shown(k, v, hidden, unknown)).collect())
            .collect();
        let masks = |frame: usize, view: usize| Some(drawn[frame][view].clone());
        let run = Run::new(Some(&masks), &|_| ());
        let found = fit(body, &trial.views, &[true; 3], &frames, options, run);
        assert_eq!(found.people.len(), 2);
        for person in &found.people {
            for f in &person.frames {
                let is_before = f.body.pose.pelvis.z > -0.3;
                let outlined: Vec<bool> = f.moment.contours.iter().map(Option::is_some).collect();
                let frame = f.frame;
                assert_eq!(outlined, [is_before, true, true], "{hidden}, frame {frame}");
            }
        }
    }
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

#[test]
fn what_the_views_have_not_is_refused_before_the_fit() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 3, 12);
    let (calibration, run) = (at("Calib.toml"), at("run"));
    let (first, second) = (at("0.jsonl"), at("120.jsonl"));
    let base = [
        "multiview",
        "--calibration",
        &calibration,
        "--view",
        &first,
        "--view",
        &second,
        "--out",
        &run,
    ];
    for (more, words) in [
        (["--obj", "12"], &["frames 0 to 11", "12"]),
        (["--hold-out", "240"], &["views 0, 120", "240"]),
        (["--hold-out", "120"], &["two views", "1 of 2"]),
    ] {
        assert_fails(&[&base[..], &more].concat(), 64, words);
    }
}

/// The experiments of `eval --multiview`, few of them: every row is there, and in the direction in which it should be.
#[test]
#[ignore = "long: minutes"]
fn long_tables_of_views_and_paths() {
    let tables = tables(
        TablesOptions {
            seeds: 1,
            frames: 24,
        },
        &|_, _| (),
    );
    println!("{tables}");
    let at = |views: usize, paths: bool| {
        let of = |l: &&Line| l.views == views && l.paths == paths && l.hierarchy && !l.masks;
        tables.synth.iter().find(of).unwrap().errors
    };
    assert_eq!((tables.synth.len(), tables.model.len()), (24, 8));
    for paths in [false, true] {
        let joints = [1, 2, 3, 4].map(|views| at(views, paths).joints);
        assert!(
            joints.is_sorted_by(|fewer, more| fewer > more),
            "{joints:?}"
        );
    }
    for views in [1, 2, 3, 4] {
        let [every_frame, smooth] = [false, true].map(|paths| at(views, paths).joints);
        assert!(
            smooth < every_frame,
            "{views} views: {smooth}, {every_frame}"
        );
    }
    for line in tables.model.iter().chain(&tables.exchanged) {
        assert!(
            line.errors.found > 0.95 && line.errors.joints < 0.04,
            "{line:?}"
        );
    }
    assert!(tables.times.is_some());
}

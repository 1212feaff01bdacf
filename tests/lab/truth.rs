//! Ground truth as public toolboxes export it: archives with known errors, damaged ones, and the sets' own tools.

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS, PELVIS};
use edgecap::lab::eval::{
    EvalOptions, JointOrder, Person, PredictedFrame, Predictions, Protocol, ReadOptions, Report,
    TruthSet, Units, evaluate,
};
use npyz::WriterBuilder;

use crate::tools;

type Pose = [[f64; 3]; BODY_JOINTS];

/// A man who stands with one arm raised, relative to his pelvis, metres, camera axes.
const FIGURE: Pose = [
    [0.01, -0.80, 0.02],
    [0.00, -0.52, 0.03],
    [-0.18, -0.50, 0.02],
    [-0.40, -0.62, -0.06],
    [-0.45, -0.86, -0.10],
    [0.18, -0.50, 0.04],
    [0.22, -0.22, 0.10],
    [0.25, 0.03, 0.02],
    [-0.12, 0.08, 0.00],
    [-0.14, 0.50, -0.05],
    [-0.15, 0.90, 0.04],
    [0.12, 0.08, 0.01],
    [0.13, 0.50, -0.02],
    [0.14, 0.90, 0.08],
    [0.00, 0.00, 0.00],
    [0.00, -0.25, 0.02],
    [0.00, -0.66, 0.00],
    [-0.47, -0.95, -0.11],
    [0.26, 0.10, 0.00],
    [-0.17, 0.97, -0.12],
    [0.16, 0.97, -0.08],
];

/// Where Human3.6M's 17 joints are among ours; it has a nose, which we have not.
const H36M: [usize; 17] = [14, 8, 9, 10, 11, 12, 13, 15, 1, 16, 0, 5, 6, 7, 2, 3, 4];
const NOSE: usize = 9;
/// The same for MPI-INF-3DHP's 28; 21 stands for those that we have not.
const DHP_28: [usize; 28] = [
    21, 21, 21, 15, 14, 1, 16, 0, 21, 5, 6, 7, 18, 21, 2, 3, 4, 17, 11, 12, 13, 21, 20, 8, 9, 10,
    21, 19,
];

fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-6, "{a} instead of {b}");
}

fn at(pose: &Pose, [x, y, z]: [f64; 3]) -> Pose {
    pose.map(|p| [p[0] + x, p[1] + y, p[2] + z])
}

/// Pixels of a camera with a focal length of 500 px and its axis at (256, 160).
fn seen([x, y, z]: [f64; 3]) -> [f64; 2] {
    [256.0 + 500.0 * x / z, 160.0 + 500.0 * y / z]
}

/// A person as `infer` predicts it: relative to the pelvis, seen where the truth is.
fn observed(solid: Pose, pose: &Pose) -> Person {
    Person {
        id: None,
        score: 0.98,
        joints2d: std::array::from_fn(|j| {
            let [u, v] = seen(pose[j]);
            [u as f32, v as f32, 1.0]
        }),
        height: None,
        joints3d: solid,
    }
}

fn predicted(frames: Vec<(&str, Vec<Person>)>) -> Predictions {
    let frames = frames.into_iter().zip(0..);
    let frame = |((source, people), k): ((&str, Vec<Person>), u64)| PredictedFrame {
        frame: k,
        time_ns: 40_000_000 * k,
        source: source.into(),
        size: [512.0, 320.0],
        people,
    };
    Predictions {
        frames: frames.map(frame).collect(),
        bodies: false,
    }
}

/// Arrays of an archive as NumPy would write them, compressed.
#[derive(Default)]
struct Arrays(Vec<(String, Vec<u8>)>);

impl Arrays {
    fn array<T: npyz::AutoSerialize + Copy>(
        mut self,
        name: &str,
        shape: &[u64],
        data: &[T],
    ) -> Self {
        let mut bytes = Vec::new();
        let mut npy = npyz::WriteOptions::new()
            .default_dtype()
            .shape(shape)
            .writer(&mut bytes)
            .begin_nd()
            .unwrap();
        npy.extend(data.iter().copied()).unwrap();
        npy.finish().unwrap();
        self.0.push((name.into(), bytes));
        self
    }

    fn texts(mut self, name: &str, texts: &[&str]) -> Self {
        let longest = texts.iter().map(|t| t.chars().count()).max().unwrap();
        let dtype = npyz::DType::new_scalar(format!("<U{longest}").parse().unwrap());
        let mut bytes = Vec::new();
        let mut npy = npyz::WriteOptions::new()
            .dtype(dtype)
            .shape(&[texts.len() as u64])
            .writer(&mut bytes)
            .begin_nd()
            .unwrap();
        npy.extend(texts.iter().map(|t| (*t).to_owned())).unwrap();
        npy.finish().unwrap();
        self.0.push((name.into(), bytes));
        self
    }

    fn bytes(&self) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in &self.0 {
            let options = zip::write::SimpleFileOptions::default();
            zip.start_file(format!("{name}.npy"), options).unwrap();
            zip.write_all(bytes).unwrap();
        }
        zip.finish().unwrap().into_inner()
    }

    fn read(&self, options: &ReadOptions) -> Result<TruthSet, String> {
        read(&self.bytes(), options)
    }

    fn truth(&self) -> TruthSet {
        self.read(&ReadOptions::default()).unwrap()
    }
}

fn read(bytes: &[u8], options: &ReadOptions) -> Result<TruthSet, String> {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    TruthSet::read(file.path(), options).map_err(|e| {
        let said = e.to_string();
        assert!(said.contains(file.path().to_str().unwrap()), "{said}");
        said
    })
}

fn measure(predictions: &Predictions, truth: &TruthSet) -> Report {
    evaluate(predictions, truth, &EvalOptions::default()).unwrap()
}

/// `imgname`, `S` and `part` of people alone in their pictures, in Human3.6M's order.
fn toolbox(people: &[(&str, Pose)]) -> Arrays {
    let (mut solid, mut flat) = (Vec::new(), Vec::new());
    for (_, pose) in people {
        for (k, &j) in H36M.iter().enumerate() {
            // A nose that lies anywhere must not matter.
            let p = if k == NOSE { [0.3, -0.3, 4.0] } else { pose[j] };
            solid.extend([p[0], p[1], p[2], 1.0]);
            let [u, v] = seen(p);
            flat.extend([u, v, 1.0]);
        }
    }
    let n = people.len() as u64;
    let names: Vec<&str> = people.iter().map(|(name, _)| *name).collect();
    Arrays::default()
        .texts("imgname", &names)
        .array("center", &[n, 2], &vec![0.0; 2 * people.len()])
        .array("S", &[n, 17, 4], &solid)
        .array("part", &[n, 17, 3], &flat)
}

fn h36m() -> ReadOptions {
    ReadOptions {
        joint_order: Some(JointOrder::H36m),
        ..ReadOptions::default()
    }
}

#[test]
fn toolbox_archives_give_the_errors_that_were_made() {
    let here = at(&FIGURE, [0.1, 0.0, 4.0]);
    let truth = toolbox(&[("S9/a.jpg", here), ("S9/b.jpg", here), ("S9/c.jpg", here)]);
    let truth = truth.read(&h36m()).unwrap();
    assert!(truth.single && !truth.video);
    assert_eq!(truth.frames[0].sequence, "S9");
    // A wrist 100 mm off; somebody 10 % larger; nobody found.
    let mut wrist = FIGURE;
    wrist[4][2] += 0.1;
    let larger = FIGURE.map(|p| p.map(|x| 1.1 * x));
    let predictions = predicted(vec![
        ("photos/a.jpg", vec![observed(wrist, &here)]),
        ("photos/b.jpg", vec![observed(larger, &here)]),
        ("photos/c.jpg", vec![]),
    ]);
    let report = measure(&predictions, &truth);
    let pose = report.pose3d.clone().unwrap();
    assert_eq!((pose.people, pose.truth), (2, 3));
    // Human3.6M's joints but the nose, all relative to the pelvis.
    let joints: Vec<usize> = (0..17).filter(|&k| k != NOSE).map(|k| H36M[k]).collect();
    let size = |j: &usize| FIGURE[*j].iter().map(|x| x * x).sum::<f64>().sqrt();
    let grown: Vec<f64> = joints.iter().map(|j| 0.1 * size(j)).collect();
    near(
        pose.mpjpe_mm,
        1e3 * (0.1 + grown.iter().sum::<f64>()) / 32.0,
    );
    assert_eq!(pose.joints, 32);
    near(pose.pck150, 1.0);
    // Pelvis and spine are no evidence joints and count for nothing here.
    let evidence = joints.iter().filter(|j| **j < EVIDENCE_JOINTS);
    let grown: Vec<f64> = evidence.map(|j| 0.1 * size(j)).collect();
    let below = |t: f64| {
        let right = grown.iter().filter(|e| **e < t).count();
        let exact = if t > 0.0 { 13 } else { 0 } + usize::from(t > 0.1);
        (right + exact) as f64 / 28.0
    };
    let auc: f64 = (0..=30).map(|k| below(0.005 * f64::from(k))).sum();
    near(pose.auc, auc / 31.0);
    // Nothing tells how tall they are.
    assert_eq!(pose.canonical_mpjpe_mm, None);
    let text = report.to_string();
    let row = text.lines().find(|l| l.contains("1.70 m")).unwrap();
    assert!(row.ends_with('–'), "{row}");
    // Size is nothing to Procrustes: alone, the larger one has no error left.
    let only = predicted(vec![("b.jpg", vec![observed(larger, &here)])]);
    let pose = measure(&only, &truth).pose3d.unwrap();
    assert!(pose.pa_mpjpe_mm < 1e-6 && pose.mpjpe_mm > 50.0, "{pose:?}");
}

#[test]
fn all_32_joints_of_human36m_are_the_17_and_others() {
    let moving = [0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27];
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let (mut solid, mut flat) = (vec![[9.0, 9.0, 9.0]; 32], vec![[1.0, 1.0]; 32]);
    for (&k, &j) in moving.iter().zip(&H36M) {
        (solid[k], flat[k]) = (here[j], seen(here[j]));
    }
    let truth = Arrays::default()
        .texts("imgname", &["a.jpg"])
        .array("S", &[1, 32, 3], &solid.concat())
        .array("part", &[1, 32, 2], &flat.concat())
        .truth();
    let joints = truth.frames[0].people[0].joints3d.unwrap();
    for j in H36M.into_iter().filter(|j| *j != H36M[NOSE]) {
        assert_eq!(joints[j], Some(here[j]), "joint {j}");
    }
    assert_eq!(joints[16], None, "the nose is not the head");
}

/// MuPoTS-3D as the converter writes it: millimetres, two people a row, 28 or 17 joints.
fn crowd(joints: &[usize], rows: &[(&str, [Option<Pose>; 2])]) -> Arrays {
    let (mut solid, mut flat, mut valid) = (Vec::new(), Vec::new(), Vec::new());
    for pose in rows.iter().flat_map(|(_, people)| people) {
        valid.push(i64::from(pose.is_some()));
        for &j in joints {
            let p = pose.and_then(|p| p.get(j).copied()).unwrap_or([0.1; 3]);
            solid.extend(p.map(|x| (1e3 * x) as f32));
            flat.extend(seen(p));
        }
    }
    let (n, count) = (rows.len() as u64, joints.len() as u64);
    let names: Vec<&str> = rows.iter().map(|(name, _)| *name).collect();
    Arrays::default()
        .texts("imgname", &names)
        .texts("units", &["mm"])
        .texts("joint_order", &["mpi_inf_3dhp"])
        .array("positions_3d", &[n, 2, count, 3], &solid)
        .array("positions_2d", &[n, 2, count, 2], &flat)
        .array("valid", &[n, 2], &valid)
}

#[test]
fn mupots_is_scored_by_sequence_with_true_bones() {
    let (left, right) = (at(&FIGURE, [-1.0, 0.0, 4.0]), at(&FIGURE, [1.0, 0.0, 4.0]));
    let rows = [
        ("TS1/img_000000.jpg", [Some(left), Some(right)]),
        ("TS1/img_000001.jpg", [Some(left), None]),
        ("TS2/img_000000.jpg", [Some(right), None]),
    ];
    for joints in [&DHP_28[..], &(0..17).collect::<Vec<_>>()] {
        let truth = crowd(joints, &rows).truth();
        assert!(!truth.single);
        let people: Vec<usize> = truth.frames.iter().map(|f| f.people.len()).collect();
        assert_eq!(people, [2, 1, 1]);
        // Half the size, which bones of true length undo; in the second sequence a leg is lifted off by the hip.
        let half = FIGURE.map(|p| p.map(|x| 0.5 * x));
        let mut lifted = half;
        for j in [9, 10, 19] {
            lifted[j] = [lifted[8][0], lifted[8][1], lifted[8][2] - 0.2];
        }
        // Knee and ankle in one place: the lower leg has no direction.
        let predictions = predicted(vec![
            ("mupots/TS1/img_000000.jpg", vec![observed(half, &left)]),
            ("mupots/TS1/img_000001.jpg", vec![observed(half, &left)]),
            ("mupots/TS2/img_000000.jpg", vec![observed(lifted, &right)]),
        ]);
        let report = measure(&predictions, &truth);
        let score = |p: Protocol| *report.mupots.iter().find(|m| m.protocol == p).unwrap();
        let (all, matched) = (score(Protocol::All), score(Protocol::Matched));
        assert_eq!((all.sequences, matched.sequences), (2, 2));
        // 14 joints each: one of three people of TS1 is missed, two joints of TS2 are wrong.
        near(matched.pck150, 40.0 / 42.0);
        near(all.pck150, 40.0 / 56.0);
        near(matched.pck150_per_sequence, (1.0 + 12.0 / 14.0) / 2.0);
        near(all.pck150_per_sequence, (2.0 / 3.0 + 12.0 / 14.0) / 2.0);
        assert!(
            report.to_string().contains("mean of 2 sequences"),
            "{report}"
        );
    }
    let second = ReadOptions {
        split: Some("TS2".into()),
        ..ReadOptions::default()
    };
    assert_eq!(crowd(&DHP_28, &rows).read(&second).unwrap().frames.len(), 1);
}

#[test]
fn whoever_is_found_beside_somebody_without_a_label_is_not_wrong() {
    let (left, right) = (at(&FIGURE, [-1.0, 0.0, 4.0]), at(&FIGURE, [1.0, 0.0, 4.0]));
    let archive = || {
        let rows = [
            ("TS1/a.jpg", [Some(left), Some(right)]),
            ("TS1/b.jpg", [Some(left), None]),
        ];
        crowd(&DHP_28, &rows)
    };
    let both = || vec![observed(FIGURE, &left), observed(FIGURE, &right)];
    let predictions = predicted(vec![("TS1/a.jpg", both()), ("TS1/b.jpg", both())]);
    let false_people = |truth: &TruthSet| {
        let row = measure(&predictions, truth).finding[1];
        assert_eq!((row.people, row.found), (3, 3));
        row.false_people
    };
    // The second one may be there in the second picture, too.
    let truth = archive().truth();
    assert_eq!(
        [truth.frames[0].partial, truth.frames[1].partial],
        [false, true]
    );
    assert_eq!(false_people(&truth), 0);
    // The archive says that nobody else is.
    let whole = archive().array("partial", &[2], &[0_u8, 0]).truth();
    assert_eq!(false_people(&whole), 1);
    // Others may be anywhere.
    let partial = archive().array("partial", &[1], &[1_u8]).truth();
    assert!(partial.frames.iter().all(|f| f.partial));
    let report = measure(&predictions, &partial);
    assert!(report.coco.is_none() && report.finding.is_empty());
    assert!(!report.recall_by_company.is_empty());
}

/// SPIN's 24 as it exports MPI-INF-3DHP, 21 for those that we have not; the jaw is the set's head.
const SPIN: [usize; 24] = [
    10, 9, 8, 11, 12, 13, 4, 3, 2, 5, 6, 7, 1, 21, 14, 21, 15, 16, 0, 21, 21, 21, 21, 21,
];

#[test]
fn spin_s_exports_are_read_in_spin_s_order() {
    let here = at(&FIGURE, [0.1, 0.0, 4.0]);
    let (mut solid, mut flat) = (Vec::new(), Vec::new());
    for j in SPIN {
        let [x, y, z] = FIGURE.get(j).copied().unwrap_or_default();
        let known = f64::from(u8::from(j < BODY_JOINTS));
        let [u, v] = here.get(j).map_or([0.0; 2], |p| seen(*p));
        solid.extend([x, y, z, known]);
        flat.extend([u, v, known]);
    }
    let archive = Arrays::default()
        .texts("imgname", &["S1/a.jpg"])
        .array("S", &[1, 24, 4], &solid)
        .array("part", &[1, 24, 3], &flat);
    let read = |joint_order: Option<JointOrder>| {
        archive.read(&ReadOptions {
            joint_order,
            ..ReadOptions::default()
        })
    };
    let said = read(None).unwrap_err();
    for word in ["24 joints", "--joint-order smpl", "--joint-order spin"] {
        assert!(said.contains(word), "{word} in: {said}");
    }
    let said = read(Some(JointOrder::Smpl)).unwrap_err();
    assert!(said.contains("another skeleton"), "{said}");
    let truth = read(Some(JointOrder::Spin)).unwrap();
    let joints = truth.frames[0].people[0].joints3d.unwrap();
    for j in 0..BODY_JOINTS {
        let wanted = (j <= 15).then_some(FIGURE[j]);
        assert_eq!(joints[j], wanted, "joint {j}");
    }
    let predictions = predicted(vec![("a.jpg", vec![observed(FIGURE, &here)])]);
    let pose = measure(&predictions, &truth).pose3d.unwrap();
    assert_eq!((pose.people, pose.joints), (1, 16));
    near(pose.mpjpe_mm, 0.0);
    near(pose.pck150, 1.0);
    // Its pelvis is the origin, which is no place in camera space.
    let mut bodies = predicted(vec![("a.jpg", vec![observed(here, &here)])]);
    bodies.bodies = true;
    let pose = measure(&bodies, &truth).pose3d.unwrap();
    near(pose.mpjpe_mm, 0.0);
    assert_eq!(pose.root_mm, None);
}

#[test]
fn a_picture_of_another_folder_is_another_picture() {
    let left = at(&FIGURE, [-1.0, 0.0, 4.0]);
    let folders = [
        "TS1/img_000000.jpg",
        "TS2/img_000000.jpg",
        "TS3/img_000000.jpg",
    ];
    let truth = crowd(&DHP_28, &folders.map(|name| (name, [Some(left), None]))).truth();
    let seen = vec![observed(FIGURE, &left)];
    let report = measure(
        &predicted(vec![("mupots/TS2/img_000000.jpg", seen.clone())]),
        &truth,
    );
    assert_eq!((report.frames, report.frames_without_prediction), (3, 2));
    let twice = predicted(vec![
        ("old/TS2/img_000000.jpg", seen.clone()),
        ("new/TS2/img_000000.jpg", seen),
    ]);
    let said = evaluate(&twice, &truth, &EvalOptions::default()).unwrap_err();
    let said = said.to_string();
    assert!(
        said.contains("old/TS2") && said.contains("new/TS2"),
        "{said}"
    );
}

#[test]
fn frames_are_numbered_in_their_own_video() {
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let archive = |names: &[&str]| {
        let mut arrays = toolbox(&vec![("a.jpg", here); names.len()]);
        arrays.0.retain(|(n, _)| n != "imgname");
        arrays.texts("sequence", names)
    };
    let split = |name: &str| ReadOptions {
        split: Some(name.into()),
        ..h36m()
    };
    let indices = |arrays: Arrays, name: &str| -> Vec<u64> {
        let truth = arrays.read(&split(name)).unwrap();
        truth.frames.iter().filter_map(|f| f.frame).collect()
    };
    let names = ["walk", "walk", "run", "walk", "run"];
    assert_eq!(indices(archive(&names), "walk"), [0, 1, 2]);
    assert_eq!(indices(archive(&names), "run"), [0, 1]);
    let numbers = [7_i64, 9, 0, 10, 4];
    let numbered = || archive(&names).array("frames", &[5], &numbers);
    assert_eq!(indices(numbered(), "walk"), [7, 9, 10]);
    assert_eq!(indices(numbered(), "run"), [0, 4]);
    let falling = archive(&names).array("frames", &[5], &[7_i64, 6, 0, 10, 4]);
    let said = falling.read(&split("run")).unwrap_err();
    assert!(said.contains("rise in every sequence"), "{said}");
    // Frame 0 of which of them?
    let said = archive(&names).read(&h36m()).unwrap_err();
    assert!(
        said.contains("--split") && said.contains("'walk', 'run'"),
        "{said}"
    );
    assert!(archive(&["walk"; 3]).read(&h36m()).is_ok());
}

#[test]
fn rows_of_one_picture_are_people_in_it() {
    let (left, right) = (at(&FIGURE, [-1.0, 0.0, 4.0]), at(&FIGURE, [1.0, 0.0, 4.0]));
    let truth = toolbox(&[("a.jpg", left), ("b.jpg", left), ("a.jpg", right)]);
    let truth = truth.read(&h36m()).unwrap();
    let people: Vec<_> = truth
        .frames
        .iter()
        .map(|f| (&f.source[..], f.people.len()))
        .collect();
    assert_eq!(people, [("a.jpg", 2), ("b.jpg", 1)]);
    assert!(!truth.single);
}

#[test]
fn pictures_of_one_name_in_two_sequences_are_two() {
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let archive = || toolbox(&[("a.jpg", here), ("a.jpg", here)]).texts("sequence", &["S1", "S2"]);
    let sources = |truth: &TruthSet| -> Vec<String> {
        let frames = truth.frames.iter();
        frames.map(|f| f.source.clone()).collect()
    };
    let truth = archive().read(&h36m()).unwrap();
    assert_eq!(sources(&truth), ["S1/a.jpg", "S2/a.jpg"]);
    assert!(truth.single);
    let predictions = predicted(vec![("photos/S2/a.jpg", vec![observed(FIGURE, &here)])]);
    let report = measure(&predictions, &truth);
    assert_eq!((report.frames, report.frames_without_prediction), (2, 1));
    let second = ReadOptions {
        split: Some("S2".into()),
        ..h36m()
    };
    assert_eq!(sources(&archive().read(&second).unwrap()), ["a.jpg"]);
}

#[test]
fn videos_in_world_axes_are_seen_through_their_camera() {
    // The camera stands 5 m before the world's origin, 1 m up, looking along the world's y; the world's z is up.
    let pose = [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, -1.0, 1.0],
        [0.0, 1.0, 0.0, 5.0],
    ];
    let matrix = [[500.0, 0.0, 256.0], [0.0, 500.0, 160.0], [0.0, 0.0, 1.0]];
    let world = |p: [f64; 3]| [p[0], p[2] - 5.0, 1.0 - p[1]];
    let there = |k: f64| at(&FIGURE, [0.1 * k, 0.1, 5.0]);
    let mut solid: Vec<f64> = Vec::new();
    for k in 0..3 {
        solid.extend((0..17).flat_map(|j| world(there(f64::from(k))[j])));
    }
    // One joint is not known.
    solid[3 * 16..3 * 17].fill(f64::NAN);
    let truth = Arrays::default()
        .array("positions_3d", &[3, 17, 3], &solid)
        .array("frames", &[3], &[4_i32, 5, 7])
        .array("camera_pose", &[3, 4], &pose.concat())
        .array("camera_matrix", &[3, 3], &matrix.concat());
    let order = ReadOptions {
        joint_order: Some(JointOrder::MpiInf3dhp),
        ..ReadOptions::default()
    };
    let truth = truth.read(&order).unwrap();
    assert!(truth.video && truth.single);
    let indices: Vec<_> = truth.frames.iter().filter_map(|f| f.frame).collect();
    assert_eq!(indices, [4, 5, 7]);
    let person = &truth.frames[0].people[0];
    let joints = person.joints3d.unwrap();
    assert_eq!((person.id, joints[16]), (Some(0), None));
    for (j, joint) in joints.iter().enumerate().take(16) {
        for (a, b) in joint.unwrap().into_iter().zip(there(0.0)[j]) {
            near(a, b);
        }
        if j < EVIDENCE_JOINTS {
            let k = person.points[j];
            near(k.u, seen(there(0.0)[j])[0]);
            near(k.v, seen(there(0.0)[j])[1]);
        }
    }
    // Bodies in camera space, 0.25 m too far right.
    let mut predictions = predicted(vec![]);
    predictions.bodies = true;
    for (k, frame) in [4, 5, 7].into_iter().enumerate() {
        let body = at(&there(k as f64), [0.25, 0.0, 0.0]);
        predictions.frames.push(PredictedFrame {
            frame,
            time_ns: 40_000_000 * frame,
            source: String::new(),
            size: [512.0, 320.0],
            people: vec![Person {
                id: Some(3),
                ..observed(body, &there(k as f64))
            }],
        });
    }
    let pose = measure(&predictions, &truth).pose3d.unwrap();
    assert_eq!(pose.people, 3);
    near(pose.mpjpe_mm, 0.0);
    near(pose.root_mm.unwrap(), 250.0);
    assert_eq!(joints[PELVIS].unwrap()[2], 5.0);
}

#[test]
fn what_is_wrong_with_an_archive_is_said() {
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let good = || toolbox(&[("a.jpg", here), ("b.jpg", here)]);
    let without = |name: &str| {
        let mut arrays = good();
        arrays.0.retain(|(n, _)| n != name);
        arrays
    };
    let (auto, own) = (ReadOptions::default(), h36m());
    let dhp = ReadOptions {
        joint_order: Some(JointOrder::MpiInf3dhp),
        ..ReadOptions::default()
    };
    let mm = ReadOptions {
        units: Some(Units::Mm),
        ..h36m()
    };
    let other = ReadOptions {
        split: Some("TS9".into()),
        ..h36m()
    };
    let pose = |xx: f64, x: f64| [xx, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let matrix = |fx: f64, cx: f64| [fx, 0.0, cx, 0.0, 500.0, 160.0, 0.0, 0.0, 1.0];
    let cases: Vec<(Arrays, &ReadOptions, &[&str])> = vec![
        (
            without("S"),
            &auto,
            &["positions_3d", "only imgname, center, part"],
        ),
        (Arrays::default(), &auto, &["no array at all"]),
        (good(), &auto, &["17 joints", "--joint-order"]),
        (good(), &dhp, &["another skeleton", "--joint-order"]),
        (good(), &mm, &["--units m"]),
        (good(), &other, &["TS9", "--split"]),
        (without("part"), &auto, &["--joint-order"]),
        (
            without("part").texts("joint_order", &["h36m"]),
            &auto,
            &["camera_matrix"],
        ),
        (
            good().texts("joint_order", &["lsp"]),
            &auto,
            &["h36m, mpi-inf-3dhp", "lsp"],
        ),
        (
            good().texts("sequence", &["1", "2", "3"]),
            &mm,
            &["2 strings", "3 strings"],
        ),
        (
            without("imgname").texts("imgname", &["a", "b", "c"]),
            &own,
            &["imgname", "3 strings"],
        ),
        (
            without("imgname").array("imgname", &[2], &[1.0, 2.0]),
            &own,
            &["imgname", "strings", "f8"],
        ),
        (
            without("S").texts("S", &["a"]),
            &auto,
            &["'S'", "numbers", "U1"],
        ),
        (
            without("S").array("S", &[2, 51], &[0.0; 102]),
            &auto,
            &["[2, 51]"],
        ),
        (
            without("S").array("S", &[2, 17, 5], &[0.0; 170]),
            &auto,
            &["[2, 17, 5]"],
        ),
        (
            without("S").array("S", &[0, 17, 3], &[0.0; 0]),
            &auto,
            &["[0, 17, 3]"],
        ),
        (
            without("S").array("S", &[2, 16, 3], &[0.0; 96]),
            &auto,
            &["[2, 1, 16]", "[2, 1, 17]"],
        ),
        (
            Arrays::default().array("S", &[1, 16, 3], &[0.0; 48]).array(
                "part",
                &[1, 16, 2],
                &[0.0; 32],
            ),
            &dhp,
            &["16 joints", "17 or 28"],
        ),
        (
            good().array("valid", &[3], &[1_u8; 3]),
            &mm,
            &["valid", "[2, 1]", "[3]"],
        ),
        (
            good().array("partial", &[3], &[1_u8; 3]),
            &own,
            &["partial", "[1] or [2]", "[3]"],
        ),
        (
            Arrays::default().array("S", &[1, 16, 3], &[0.0; 48]).array(
                "part",
                &[1, 16, 2],
                &[0.0; 32],
            ),
            &auto,
            &["16 joints", "17 or 28"],
        ),
        (
            without("imgname").array("frames", &[2], &[1.0, 0.5]),
            &mm,
            &["frames", "rise"],
        ),
        (
            good().array("camera_matrix", &[3, 3], &[0.0; 9]),
            &mm,
            &["camera_matrix", "fx"],
        ),
        (
            good().array("camera_pose", &[4, 4], &[0.0; 16]),
            &mm,
            &["camera_pose", "[3, 4]"],
        ),
        (
            good().array("camera_pose", &[3, 4], &[1.0; 12]),
            &mm,
            &["camera_pose", "rotation"],
        ),
        (
            good().array("camera_pose", &[3, 4], &pose(-1.0, 0.0)),
            &mm,
            &["camera_pose", "mirror"],
        ),
        (
            good().array("camera_pose", &[3, 4], &pose(1.0, f64::NAN)),
            &mm,
            &["camera_pose", "NaN"],
        ),
        (
            good().array("camera_matrix", &[3, 3], &matrix(f64::NAN, 256.0)),
            &mm,
            &["camera_matrix", "NaN"],
        ),
        (
            good().array("camera_matrix", &[3, 3], &matrix(500.0, f64::INFINITY)),
            &mm,
            &["camera_matrix", "inf"],
        ),
    ];
    for (arrays, options, words) in cases {
        let said = arrays.read(options).expect_err(&format!("{words:?}"));
        for word in words {
            assert!(said.contains(word), "{word} in: {said}");
        }
        assert!(!said.contains('\n') && said.contains("expected"), "{said}");
    }
    // Upside down: y points up.
    let flipped = at(&FIGURE.map(|p| [p[0], -p[1], p[2]]), [0.0, 0.0, 4.0]);
    let mut arrays = toolbox(&[("a.jpg", flipped)]);
    let upright = toolbox(&[("a.jpg", here)]);
    let part = |a: &Arrays| a.0.iter().position(|(n, _)| n == "part").unwrap();
    let k = part(&arrays);
    arrays.0[k] = upright.0[part(&upright)].clone();
    let said = arrays.read(&h36m()).unwrap_err();
    assert!(said.contains("y down"), "{said}");
}

#[test]
fn an_archive_cut_anywhere_is_refused() {
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let whole = toolbox(&[("a.jpg", here)]).bytes();
    assert!(read(&whole, &h36m()).is_ok());
    for cut in (4..whole.len()).step_by(37) {
        let said = read(&whole[..cut], &h36m()).unwrap_err();
        assert!(said.contains("cut short"), "{cut}: {said}");
    }
    // A byte changed anywhere is noticed, or lies where nothing depends on it; it never brings the program down.
    for k in (0..whole.len()).step_by(11) {
        let mut bytes = whole.clone();
        bytes[k] ^= 0x55;
        if let Ok(truth) = read(&bytes, &h36m()) {
            let intact = read(&whole, &h36m()).unwrap();
            let solid = |t: &TruthSet| t.frames[0].people[0].joints3d;
            assert_eq!(solid(&truth), solid(&intact), "byte {k}");
        }
    }
}

fn edgecap(folder: &Path) -> Command {
    let mut command = Command::cargo_bin("edgecap").unwrap();
    command.current_dir(folder);
    command
}

#[test]
fn the_command_reads_archives_and_refuses_others_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let here = at(&FIGURE, [0.0, 0.0, 4.0]);
    let good = toolbox(&[("a.jpg", here)]).bytes();
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    put("good.npz", &good);
    put("short.npz", &good[..good.len() / 2]);
    put("annot.mat", b"MATLAB 5.0 MAT-file, Platform: GLNXA64");
    put("downtown.pkl", b"(dp1\nS'sequence'\n");
    put("noise", &[0xff, 0xfe, 0, 1]);
    let solid = FIGURE.to_vec();
    let flat: Vec<_> = (0..EVIDENCE_JOINTS).map(|j| seen(here[j])).collect();
    let flat: Vec<_> = flat.iter().map(|p| [p[0], p[1], 1.0]).collect();
    let line = serde_json::json!({
        "frame": 0, "time_ns": 0, "source": "a.jpg", "width": 512, "height": 320,
        "people": [{"score": 0.7, "joints2d": flat, "joints3d": solid}],
    });
    put("p.jsonl", line.to_string().as_bytes());
    let eval = |truth: &str, more: &[&str]| {
        let mut command = edgecap(folder.path());
        command.args(["eval", "--predictions", "p.jsonl", "--truth", truth]);
        command.args(more).assert()
    };
    let out = eval("good.npz", &["--joint-order", "h36m", "--json", "-"]).success();
    let report: serde_json::Value = serde_json::from_slice(&out.get_output().stdout).unwrap();
    assert!(
        report["pose3d"]["mpjpe_mm"].as_f64().unwrap() < 1e-3,
        "{report}"
    );
    for (truth, word) in [
        ("good.npz", "--joint-order"),
        ("short.npz", "cut short"),
        ("annot.mat", "mat_to_npz.py"),
        ("downtown.pkl", "threedpw_to_npz.py"),
        ("noise", "neither"),
    ] {
        let failed = eval(truth, &[]).code(65);
        let said = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(said.lines().count() == 1 && said.contains(word), "{said}");
    }
    eval("none.npz", &[]).code(66);
    put("people.json", b"[]");
    eval("people.json", &["--units", "mm"]).code(65);
    eval("p.jsonl", &["--format", "npz"]).code(65);
}

/// Four photos with true joints; their folder is no part of the project.
fn real_photos() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/real3d");
    let there = folder.join("annotations.json").exists();
    if !there {
        eprintln!("skipped: no {}", folder.display());
    }
    there.then_some(folder)
}

#[test]
fn photos_with_true_joints_are_measured_alike_from_both_formats() {
    let Some(photos) = real_photos() else { return };
    let folder = tempfile::tempdir().unwrap();
    let infer = ["infer", "--jsonl", "p.jsonl", "--input"];
    let mut command = edgecap(folder.path());
    command.args(infer).arg(&photos).assert().success();
    let labels = std::fs::read_to_string(photos.join("annotations.json")).unwrap();
    let labels: Vec<serde_json::Value> = serde_json::from_str(&labels).unwrap();
    assert_eq!(labels.len(), 4);
    for set in ["h36m", "mpi_inf_3dhp"] {
        let own: Vec<_> = labels.iter().filter(|l| l["set"] == set).cloned().collect();
        let numbers = |key: &str| -> Vec<f64> {
            let joints = own.iter().flat_map(|l| l[key].as_array().unwrap());
            let values = joints.flat_map(|j| j.as_array().unwrap());
            values.map(|x| x.as_f64().unwrap()).collect()
        };
        let n = own.len() as u64;
        let names: Vec<&str> = own.iter().map(|l| l["file"].as_str().unwrap()).collect();
        let archive = Arrays::default()
            .texts("imgname", &names)
            .texts("joint_order", &[set])
            .array("S", &[n, 17, 4], &numbers("joints3d_camera_m"))
            .array("part", &[n, 17, 3], &numbers("joints2d"));
        std::fs::write(folder.path().join("t.npz"), archive.bytes()).unwrap();
        let text = serde_json::to_string(&own).unwrap();
        std::fs::write(folder.path().join("t.json"), text).unwrap();
        let report = |truth: &str| -> serde_json::Value {
            let mut command = edgecap(folder.path());
            command.args([
                "eval",
                "--predictions",
                "p.jsonl",
                "--json",
                "-",
                "--truth",
                truth,
            ]);
            let out = command.assert().success();
            serde_json::from_slice(&out.get_output().stdout).unwrap()
        };
        let (json, npz) = (report("t.json"), report("t.npz"));
        assert_eq!(json, npz, "{set}");
        assert_eq!(json["frames"], 2);
        assert_eq!(json["frames_without_prediction"], 0);
        eprintln!("{set}: PCK {}, 3D {}", json["pck"], json["pose3d"]);
    }
}

#[test]
fn the_sets_own_protocol_gives_the_same_figures() {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".into());
    let has = std::process::Command::new(&python)
        .args(["-c", "import numpy, scipy.io"])
        .stderr(std::process::Stdio::null())
        .status();
    if !has.is_ok_and(|s| s.success()) {
        let why = format!("no {python} with numpy and scipy (name one in PYTHON)");
        tools::skip("scipy", &why);
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference/mupots.py");
    let program = assert_cmd::cargo::cargo_bin("edgecap");
    let mut command = Command::new(&python);
    command.arg(script).arg(program).assert().success();
}

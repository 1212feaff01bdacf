//! Bodies from several views, against bodies of the same model whose shape and pose are known: noise, a detector's bias,
//! outliers, joints not seen, and sides exchanged are put in.

use std::path::Path;

use edgecap::body::BodyModel;
use edgecap::body::mesh::{MeshBody, MeshPose, PosedTree, Skin};
use edgecap::camera::calibration::write_pose2sim;
use edgecap::camera::{Brown, View};
use edgecap::joints::{EVIDENCE_JOINTS, MIRROR};
use edgecap::message::{Observation, ObservationFrame};
use edgecap::multiview::{
    Detections, MultiviewFit, MultiviewOptions, PosePrior, Sight, evidence_joints, fit,
};
use edgecap::npz::Archive;
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter, RowReader};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use crate::program::{assert_fails, output, stderr};
use crate::scene::gauss;

const RATE: f64 = 30.0;

/// Cameras round the origin, 4.2 m away and 1.6 m high; the world's y points up.
pub fn ring(count: usize) -> Vec<View> {
    [0.0, 120.0, 240.0, 60.0, 300.0, 180.0f64][..count]
        .iter()
        .map(|degrees| {
            let a = degrees.to_radians();
            let position = DVec3::new(4.2 * a.sin(), 1.6, 4.2 * a.cos());
            let z = (DVec3::new(0.0, 1.0, 0.0) - position).normalize();
            let x = z.cross(DVec3::Y).normalize();
            View {
                name: format!("{degrees}"),
                size: [1080, 1080],
                focal: DVec2::splat(1150.0),
                centre: DVec2::splat(540.0),
                distortion: Brown {
                    radial: [-0.05, 0.02, 0.0],
                    tangential: [0.0005, -0.0003],
                },
                rotation: DMat3::from_cols(x, z.cross(x), z).transpose(),
                position,
            }
        })
        .collect()
}

/// Somebody who walks about a place, waves and turns, 1/30 s a frame.
fn motion(frames: usize, seed: u64, place: DVec3) -> Vec<MeshPose> {
    let mut rng = SmallRng::seed_from_u64(seed);
    let speed = rng.random_range(0.7..1.3);
    let heading = rng.random_range(0.0..6.0);
    let mean = PosePrior::shipped().mean();
    (0..frames)
        .map(|k| {
            let t = k as f64 / RATE * speed;
            let step = (4.0 * t).sin();
            let mut rotations = mean;
            let mut bend = |joint: usize, x: f64, z: f64| {
                rotations[joint] =
                    DQuat::from_rotation_z(z) * DQuat::from_rotation_x(x) * rotations[joint];
            };
            bend(1, -0.1 - 0.35 * step, 0.0);
            bend(2, -0.1 + 0.35 * step, 0.0);
            bend(4, 0.25 + 0.25 * (4.0 * t + 1.2).sin(), 0.0);
            bend(5, 0.25 - 0.25 * (4.0 * t + 1.2).sin(), 0.0);
            bend(16, 0.0, 0.25 * (2.2 * t).sin());
            bend(17, 0.0, 0.3 * (1.7 * t).cos());
            bend(3, 0.05 * step, 0.08 * (1.3 * t).sin());
            rotations[0] = DQuat::from_rotation_y(heading + 0.8 * (0.6 * t).sin());
            MeshPose {
                pelvis: place
                    + DVec3::new(
                        0.4 * (0.9 * t).sin(),
                        0.92 + 0.02 * (8.0 * t).cos(),
                        0.3 * (0.7 * t).cos(),
                    ),
                rotations,
            }
        })
        .collect()
}

#[derive(Clone, Copy)]
struct Spoil {
    /// Pixels per axis.
    noise: f64,
    /// Of joints against the model's, metres per axis.
    bias: f64,
    /// Part of joints that are anywhere.
    outliers: f64,
    /// Part of the first view's frames with legs exchanged.
    exchanged: f64,
}

const DETECTOR: Spoil = Spoil {
    noise: 5.0,
    bias: 0.012,
    outliers: 0.03,
    exchanged: 0.0,
};

struct Person {
    betas: Vec<f64>,
    poses: Vec<MeshPose>,
    joints: Vec<[DVec3; EVIDENCE_JOINTS]>,
}

fn person(frames: usize, seed: u64, place: DVec3) -> Person {
    let body = MeshBody::shipped();
    let mut rng = SmallRng::seed_from_u64(100 + seed);
    let betas: Vec<f64> = (0..10).map(|_| 0.9 * gauss(&mut rng)).collect();
    let (shape, poses) = (body.person(&betas), motion(frames, seed, place));
    let mut posed = PosedTree::default();
    let joints = poses
        .iter()
        .map(|pose| {
            body.kinematics(pose, &shape, &mut posed);
            evidence_joints(body, &posed)
        })
        .collect();
    Person {
        betas,
        poses,
        joints,
    }
}

fn observe(
    views: &[View],
    people: &[Person],
    spoil: Spoil,
    seed: u64,
) -> Vec<Vec<Vec<Observation>>> {
    let mut rng = SmallRng::seed_from_u64(seed);
    let mut bias = [DVec3::ZERO; EVIDENCE_JOINTS];
    for b in &mut bias[2..] {
        *b = spoil.bias * DVec3::new(gauss(&mut rng), gauss(&mut rng), gauss(&mut rng));
    }
    let frames = people[0].joints.len();
    let run = (frames as f64 * spoil.exchanged) as usize;
    (0..frames)
        .map(|k| {
            let each = views.iter().enumerate().map(|(v, view)| {
                let mut seen: Vec<Observation> = people
                    .iter()
                    .map(|person| {
                        let mut o = Observation {
                            score: 0.8,
                            ..Observation::default()
                        };
                        for (j, off) in bias.iter().enumerate() {
                            let mut p = view.project(person.joints[k][j] + *off).expect("in front");
                            p += spoil.noise * DVec2::new(gauss(&mut rng), gauss(&mut rng));
                            if rng.random_bool(spoil.outliers) {
                                p += DVec2::new(
                                    rng.random_range(-110.0..110.0),
                                    rng.random_range(-110.0..110.0),
                                );
                            }
                            let sure = if rng.random_bool(0.05) {
                                0.0
                            } else {
                                rng.random_range(0.5..0.95)
                            };
                            o.joints2d[j] = [p.x as f32, p.y as f32, sure];
                        }
                        if v == 0 && k >= frames / 4 && k < frames / 4 + run {
                            for right in [8, 9, 10] {
                                o.joints2d.swap(right, MIRROR[right]);
                            }
                        }
                        o
                    })
                    .collect();
                // In no order.
                if seen.len() > 1 {
                    let by = rng.random_range(0..seen.len());
                    seen.rotate_left(by);
                }
                seen
            });
            each.collect()
        })
        .collect()
}

/// Mean distance of evidence joints, and of the rest meshes' vertices without their offset, millimetres.
fn errors(found: &MultiviewFit, truth: &Person) -> (f64, f64) {
    let body = MeshBody::shipped();
    let person = &found.people[0];
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for f in &person.frames {
        for (a, b) in evidence_joints(body, &f.body.posed)
            .iter()
            .zip(&truth.joints[f.frame])
        {
            sum += a.distance(*b);
            count += 1.0;
        }
    }
    let rest = |betas: &[f64]| -> Vec<DVec3> {
        let skin = Skin::new(body, &body.person(betas));
        let all: Vec<DVec3> = skin.rest().map(|v| v.as_dvec3()).collect();
        let mean = all.iter().sum::<DVec3>() / all.len() as f64;
        all.iter().map(|v| *v - mean).collect()
    };
    let (a, b) = (rest(&person.betas), rest(&truth.betas));
    let shape = a.iter().zip(&b).map(|(a, b)| a.distance(*b)).sum::<f64>() / a.len() as f64;
    (1e3 * sum / count, 1e3 * shape)
}

fn run(count: usize, people: &[Person], spoil: Spoil, paths: bool, seed: u64) -> MultiviewFit {
    let views = ring(count);
    let frames: Vec<Vec<Detections>> = observe(&views, people, spoil, seed)
        .iter()
        .map(|frame| {
            let each = views.iter().zip(frame);
            each.map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
                .collect()
        })
        .collect();
    let options = MultiviewOptions { rate: RATE, paths };
    fit(
        MeshBody::shipped(),
        &views,
        &vec![true; count],
        &frames,
        options,
        &|_| (),
    )
}

#[test]
fn what_is_seen_exactly_is_found() {
    let exact = Spoil {
        noise: 0.0,
        bias: 0.0,
        outliers: 0.0,
        exchanged: 0.0,
    };
    let truth = person(10, 1, DVec3::ZERO);
    let found = run(3, std::slice::from_ref(&truth), exact, false, 1);
    assert_eq!((found.people.len(), found.people[0].frames.len()), (1, 10));
    let (joints, shape) = errors(&found, &truth);
    assert!(
        joints < 8.0 && shape < 12.0,
        "{joints:.1} mm, shape {shape:.1} mm"
    );
    assert_eq!(truth.poses.len(), 10);
}

#[test]
fn a_detector_s_mistakes_are_outvoted() {
    let truth = person(40, 2, DVec3::ZERO);
    let people = std::slice::from_ref(&truth);
    let (joints, shape) = errors(&run(3, people, DETECTOR, true, 2), &truth);
    println!("joints {joints:.1} mm, shape {shape:.1} mm");
    assert!(
        joints < 35.0 && shape < 20.0,
        "{joints:.1} mm, shape {shape:.1} mm"
    );
    let exchanged = Spoil {
        exchanged: 0.3,
        ..DETECTOR
    };
    let found = run(3, people, exchanged, true, 2);
    let (healed, _) = errors(&found, &truth);
    let limbs: usize = found.people[0].frames.iter().map(|f| f.moment.healed).sum();
    println!("legs of one view exchanged in 30 %: {healed:.1} mm, {limbs} healed");
    assert!(
        healed < 1.1 * joints + 1.0,
        "{healed:.1} mm with exchanges, {joints:.1} mm without"
    );
}

#[test]
fn everyone_keeps_their_identity() {
    let places = [
        DVec3::new(-0.9, 0.0, 0.0),
        DVec3::new(0.9, 0.0, 0.4),
        DVec3::new(0.0, 0.0, -1.1),
    ];
    let people: Vec<Person> = (0..3)
        .map(|k| person(20, 10 + k, places[k as usize]))
        .collect();
    let found = run(4, &people, DETECTOR, false, 3);
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

/// Calibration and records of `frames` frames of one person, as files.
pub fn files(folder: &Path, count: usize, frames: usize) -> Vec<View> {
    let (views, truth) = (ring(count), person(frames, 5, DVec3::ZERO));
    std::fs::write(folder.join("Calib.toml"), write_pose2sim(&views)).unwrap();
    let seen = observe(&views, std::slice::from_ref(&truth), DETECTOR, 5);
    for (v, view) in views.iter().enumerate() {
        let path = folder.join(format!("{}.jsonl", view.name));
        let mut file = RecordWriter::<ObservationsRow>::create(&path, Format::Jsonl).unwrap();
        for (k, frame) in seen.iter().enumerate() {
            let mut message = ObservationFrame {
                sequence: k as u64,
                capture_ns: k as u64 * 33_333_333,
                width: view.size[0],
                height: view.size[1],
                intrinsics: view.intrinsics(),
                count: 1,
                ..ObservationFrame::default()
            };
            message.people[0] = frame[v][0];
            file.write(&message, "").unwrap();
        }
        file.finish().unwrap();
    }
    views
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
    let truth = person(12, 5, DVec3::ZERO);
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
    // A full folder is not written into.
    assert_fails(&args, 64, &["holds files"]);
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
        &other("short", &lines[..4].join("\n")),
        65,
        &["one length", "30", "4"],
    );
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
    refused(&calibration, &at("nowhere/120.jsonl"), 66, &["nowhere"]);
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
}

/// The table of docs/multiview.md: `cargo test --release --test fit -- --ignored long_views --nocapture`.
#[test]
#[ignore = "long: minutes"]
fn long_views_and_paths() {
    for count in [2, 3, 4] {
        for paths in [false, true] {
            let (mut joints, mut shape, mut seconds) = (0.0, 0.0, 0.0);
            const SEEDS: u64 = 5;
            for seed in 0..SEEDS {
                let truth = person(60, seed, DVec3::ZERO);
                let start = std::time::Instant::now();
                let found = run(count, std::slice::from_ref(&truth), DETECTOR, paths, seed);
                seconds += start.elapsed().as_secs_f64();
                let (j, s) = errors(&found, &truth);
                joints += j / SEEDS as f64;
                shape += s / SEEDS as f64;
            }
            let each = 1e3 * seconds / (60.0 * SEEDS as f64);
            println!(
                "{count} views, paths {paths}: joints {joints:.1} mm, shape {shape:.1} mm, {each:.0} ms a frame"
            );
            if count >= 3 {
                assert!(joints < 30.0, "{joints}");
            }
        }
    }
}

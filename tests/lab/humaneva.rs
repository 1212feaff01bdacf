//! HumanEva's archives: what is written is read, cameras are found, and fitted bodies are where people were.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::Mutex;

use edgecap::camera::{Brown, View};
use edgecap::lab::humaneva::archive::{CAMERAS, COCO_JOINTS, JOINTS, SIZE};
use edgecap::lab::humaneva::{HumanEva, HumanEvaOptions, Spread, cameras, tables, tables_by};
use edgecap::lab::multiview::own::{Walker, ring};
use glam::{DVec2, DVec3};

const FRAMES: usize = 24;
const NAMES: [&str; 2] = ["Train/S1|Walking 1 chunk0", "Train/S2|Walking 1 chunk0"];
/// The set's joints among the evidence joints; pelvis and hips are made.
const FROM_OWN: [usize; JOINTS] = [0, 1, 5, 6, 7, 2, 3, 4, 11, 12, 13, 8, 9, 10, 0];
/// COCO's from shoulders to ankles, likewise; the face is at the neck.
const COCO_FROM_OWN: [usize; COCO_JOINTS] = [1, 1, 1, 1, 1, 5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10];

fn npy(descr: &str, shape: &[usize], data: &[u8]) -> Vec<u8> {
    let sides: Vec<String> = shape.iter().map(|n| format!("{n},")).collect();
    let header = format!(
        "{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}), }}\n",
        sides.join(" ")
    );
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(data);
    out
}

fn archive(path: &Path, arrays: &[(&str, Vec<u8>)]) {
    let mut zip = zip::ZipWriter::new(File::create(path).unwrap());
    for (name, bytes) in arrays {
        let options = zip::write::SimpleFileOptions::default();
        zip.start_file(format!("{name}.npy"), options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap();
}

fn floats(all: impl Iterator<Item = f64>) -> Vec<u8> {
    all.flat_map(|x| (x as f32).to_le_bytes()).collect()
}

/// The cameras of a person: three of a ring with lenses of their own.
fn views(person: usize) -> Vec<View> {
    let each = ring(CAMERAS).into_iter().enumerate();
    each.map(|(k, view)| View {
        size: SIZE,
        focal: DVec2::new(710.0 + 9.0 * k as f64, 716.0 - 5.0 * person as f64),
        centre: DVec2::new(318.0 + k as f64, 236.0),
        distortion: Brown {
            radial: [-0.18, 0.12, 0.0],
            tangential: [0.001, -0.0007],
        },
        position: view.position * (1.0 + 0.05 * person as f64),
        ..view
    })
    .collect()
}

fn set(joints: &[DVec3; 14]) -> [DVec3; JOINTS] {
    let mut all = FROM_OWN.map(|j| joints[j]);
    let hips = joints[8].midpoint(joints[11]);
    all[0] = hips;
    // The set's hips are near each other.
    for k in [8, 11] {
        all[k] = hips + (all[k] - hips) * (0.095 / 0.209);
    }
    all
}

/// Writes both archives of two people who walk about; the detector makes no mistake but misses a view now and then.
fn write(folder: &Path) {
    let walkers: Vec<Walker> = (0..2)
        .map(|k| Walker::new(FRAMES, 3 + k, DVec3::ZERO))
        .collect();
    let (mut joints, mut pixels) = (Vec::new(), Vec::new());
    let (mut of, mut seen, mut camera) = (Vec::new(), Vec::new(), Vec::<u8>::new());
    for (person, walker) in walkers.iter().enumerate() {
        let views = views(person);
        for (f, own) in walker.joints.iter().enumerate() {
            let all = set(own);
            joints.extend(all);
            for (c, view) in views.iter().enumerate() {
                pixels.extend(all.map(|p| view.project(p).unwrap()));
                if f % 9 != 4 || c > 0 {
                    of.extend(all);
                    seen.extend(COCO_FROM_OWN.map(|j| view.project(own[j]).unwrap()));
                    camera.push(c as u8);
                }
            }
        }
    }
    let points = |all: &[DVec3]| floats(all.iter().flat_map(|p| p.to_array()));
    let flat = |all: &[DVec2]| floats(all.iter().flat_map(|p| p.to_array()));
    let text: Vec<u8> = NAMES
        .iter()
        .flat_map(|n| n.chars().flat_map(|c| u32::from(c).to_le_bytes()))
        .collect();
    let lengths: Vec<u8> = [FRAMES as i64; 2]
        .iter()
        .flat_map(|n| n.to_le_bytes())
        .collect();
    archive(
        &folder.join("humaneva1_gt.npz"),
        &[
            (
                "joints3d_m_world",
                npy("<f4", &[2 * FRAMES, JOINTS, 3], &points(&joints)),
            ),
            (
                "gt2d_px",
                npy("<f4", &[2 * FRAMES, CAMERAS, JOINTS, 2], &flat(&pixels)),
            ),
            ("names", npy("<U25", &[2], &text)),
            ("lengths", npy("<i8", &[2], &lengths)),
        ],
    );
    let count = camera.len();
    archive(
        &folder.join("humaneva1_alphapose_aligned.npz"),
        &[
            (
                "joints3d_m_world",
                npy("<f4", &[count, JOINTS, 3], &points(&of)),
            ),
            (
                "alphapose2d_px",
                npy("<f4", &[count, COCO_JOINTS, 2], &flat(&seen)),
            ),
            ("camera", npy("|u1", &[count], &camera)),
        ],
    );
}

#[test]
fn cameras_and_people_of_small_archives_are_found() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let data = HumanEva::read(folder.path()).unwrap();
    let [first, second] = &data.pieces[..] else {
        panic!("{} pieces", data.pieces.len());
    };
    assert_eq!([first.subject(), second.subject()], ["S1", "S2"]);
    assert_eq!(first.joints.len(), FRAMES);
    assert!((0..FRAMES).all(|f| first.is_sound(f)));
    let mut upside_down = first.clone();
    upside_down.joints[2][14] = upside_down.joints[2][0];
    assert!(!upside_down.is_sound(2) && upside_down.is_sound(3));
    let told = |f: usize| second.detected[f].map(|d| d.is_some());
    assert_eq!([told(3), told(4)], [[true; 3], [false, true, true]]);
    for (k, found) in cameras::all(&data).unwrap().iter().enumerate() {
        let truth = &views(k / CAMERAS)[k % CAMERAS];
        let off = found.view.position.distance(truth.position);
        assert!(
            found.rms_px < 0.01 && off < 0.01,
            "{k}: {} px, {off} m",
            found.rms_px
        );
        assert!(
            (found.view.focal - truth.focal).length() < 3.0,
            "{:?}",
            found.view
        );
    }
    let options = HumanEvaOptions {
        least: 10,
        ..HumanEvaOptions::default()
    };
    let tables = tables(&data, options, &|_, _| ()).unwrap();
    assert_eq!(tables.lines.len(), 12);
    println!("{tables}");
    assert!(!tables.to_string().contains("left out"));
    for line in &tables.lines {
        assert_eq!(line.pieces, 2);
        assert!(line.found > 0.9, "{line:?}");
        if line.views > 1 {
            assert!(line.limbs.unwrap().mean < 0.03, "{line:?}");
        }
    }
}

/// As in a build without weights.
#[test]
fn without_a_lifter_there_is_nothing_of_one_camera() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let data = HumanEva::read(folder.path()).unwrap();
    let heard = Mutex::new((0, 0));
    let hear = |done: u64, of: u64| *heard.lock().unwrap() = (done, of);
    let options = HumanEvaOptions {
        least: 10,
        most: 12,
    };
    let tables = tables_by(None, &data, options, &hear).unwrap();
    let views: Vec<usize> = tables.lines.iter().map(|l| l.views).collect();
    assert_eq!(views, [2, 2, 3, 3, 2, 2, 3, 3]);
    let (done, of) = *heard.lock().unwrap();
    assert_eq!(
        (done, of),
        (32, 32),
        "four sets, two pieces, two sources, two ways"
    );
    let text = tables.to_string();
    assert!(text.contains("One view is left out"), "{text}");
}

#[test]
fn nothing_measured_is_no_figure() {
    assert_eq!(Spread::new(&[]), None);
    // Whoever asks for few frames gets them, and of pieces that are too short nothing is said.
    let least = |most: usize| HumanEvaOptions::of_frames(most).least;
    assert_eq!([least(10), least(500), least(usize::MAX)], [10, 30, 30]);
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let data = HumanEva::read(folder.path()).unwrap();
    let whole = HumanEvaOptions::default();
    assert!(whole.least > FRAMES);
    let said = tables(&data, whole, &|_, _| ()).unwrap_err().to_string();
    assert!(
        said.contains("30 frames") && said.contains("--frames"),
        "{said}"
    );
}

#[test]
fn a_camera_that_is_not_there_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let (joints, pixels) = (vec![0; 4 * 3 * JOINTS], vec![0; 4 * 2 * COCO_JOINTS]);
    archive(
        &folder.path().join("humaneva1_alphapose_aligned.npz"),
        &[
            ("joints3d_m_world", npy("<f4", &[1, JOINTS, 3], &joints)),
            ("alphapose2d_px", npy("<f4", &[1, COCO_JOINTS, 2], &pixels)),
            ("camera", npy("|u1", &[1], &[3])),
        ],
    );
    let said = HumanEva::read(folder.path()).unwrap_err().to_string();
    assert!(
        said.contains("'camera'") && said.contains("found 3"),
        "{said}"
    );
}

/// Writes an archive anew in which number `at` of an array of f32 is `value`.
fn damage(path: &Path, array: &str, at: usize, value: f32) {
    let mut read = zip::ZipArchive::new(File::open(path).unwrap()).unwrap();
    let names = read.file_names().map(|name| name.unwrap().into_owned());
    let names: Vec<String> = names.collect();
    let mut arrays: Vec<(String, Vec<u8>)> = Vec::new();
    for name in names {
        let mut bytes = Vec::new();
        read.by_name(&name)
            .unwrap()
            .read_to_end(&mut bytes)
            .unwrap();
        let name = name.strip_suffix(".npy").unwrap().to_owned();
        if name == array {
            let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            let number = header + 4 * at..header + 4 * at + 4;
            bytes[number].copy_from_slice(&value.to_le_bytes());
        }
        arrays.push((name, bytes));
    }
    let arrays: Vec<(&str, Vec<u8>)> = arrays.iter().map(|(n, b)| (&n[..], b.clone())).collect();
    archive(path, &arrays);
}

#[test]
fn numbers_that_are_none_are_refused_in_truth_and_left_out_of_detections() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for array in ["joints3d_m_world", "gt2d_px"] {
        for value in [f32::NAN, f32::INFINITY] {
            write(folder.path());
            damage(&path("humaneva1_gt.npz"), array, 7, value);
            let said = HumanEva::read(folder.path()).unwrap_err().to_string();
            let expected = format!("expected '{array}' to be finite numbers, found {value}");
            assert!(said.contains(&expected), "{said}");
        }
    }
    write(folder.path());
    // The second detection, that of the first frame by the second camera.
    let at = 2 * COCO_JOINTS + 3;
    damage(
        &path("humaneva1_alphapose_aligned.npz"),
        "alphapose2d_px",
        at,
        f32::NAN,
    );
    let data = HumanEva::read(folder.path()).unwrap();
    let told = |f: usize| data.pieces[0].detected[f].map(|d| d.is_some());
    assert_eq!([told(0), told(1)], [[true, false, true], [true; 3]]);
}

#[test]
fn the_verb_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let eval = |code: i32| {
        let mut command = assert_cmd::Command::cargo_bin("edgecap").unwrap();
        let failed = command
            .args(["eval", "--humaneva"])
            .arg(folder.path())
            .assert()
            .code(code);
        String::from_utf8_lossy(&failed.get_output().stderr).into_owned()
    };
    let error = eval(66);
    assert!(
        error.contains("humaneva1_gt.npz") && error.lines().count() == 1,
        "{error}"
    );
    write(folder.path());
    let lengths = npy(
        "<i8",
        &[2],
        &[[9_i64, 9].map(i64::to_le_bytes)].concat().concat(),
    );
    archive(
        &folder.path().join("humaneva1_gt.npz"),
        &[("lengths", lengths)],
    );
    let error = eval(65);
    assert!(
        error.contains("'names'") && error.lines().count() == 1,
        "{error}"
    );
}

#[test]
fn cameras_of_the_real_set_are_found() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/humaneva");
    if !folder.is_dir() {
        println!("skipped: {} is not here", folder.display());
        return;
    }
    let data = HumanEva::read(&folder).unwrap();
    let frames: usize = data.pieces.iter().map(|p| p.joints.len()).sum();
    assert_eq!([data.pieces.len(), frames], [77, 9577]);
    for camera in cameras::all(&data).unwrap() {
        println!("{}: {:.3} px", camera.view.name, camera.rms_px);
        assert!(
            camera.rms_px < 0.4,
            "{} is off by {} px",
            camera.view.name,
            camera.rms_px
        );
    }
}

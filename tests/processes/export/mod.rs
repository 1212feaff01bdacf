//! `edgecap export`: every format is read back by a reader that shares nothing with its writer.

mod blender;
mod bvh;
mod three;

use std::collections::BTreeMap;
use std::io::Cursor;
use std::ops::Range;
use std::path::{Path, PathBuf};

use edgecap::body::skeleton::{Pose, Posed, RIG_BONES, Skeleton, bone_rotations, rotation_vector};
use edgecap::joints::{BODY_JOINTS, JOINT_NAMES, PELVIS};
use edgecap::message::{Body, BodyFrame, BodyState, Intrinsics, JointState, World, WorldState};
use edgecap::record::{BodiesRow, Format, RecordWriter};
use glam::{DQuat, DVec3};

use self::bvh::Bvh;
use crate::program::{assert_fails, output, stderr};

const FRAMES: usize = 60;
/// Who is in which frames.
const PEOPLE: [(u32, Range<usize>); 2] = [(3, 0..60), (7, 20..41)];

fn lengths(id: u32) -> [f64; BODY_JOINTS] {
    let mut lengths = *Skeleton::builtin().lengths();
    lengths
        .iter_mut()
        .for_each(|l| *l *= 1.0 + 0.01 * f64::from(id));
    lengths
}

/// Somebody who walks, turns and bends every joint.
fn posed(id: u32, frame: usize) -> (Pose, Posed) {
    let (skeleton, t) = (Skeleton::builtin(), frame as f64 / 30.0);
    let mut pose = Pose::facing_camera(4.0 + 0.2 * f64::from(id));
    pose.position.x = 0.4 * t - 1.0;
    pose.position.y = 0.9;
    pose.rotation = DQuat::from_rotation_y(4.0 * t) * pose.rotation;
    for (k, angle) in pose.angles.iter_mut().enumerate() {
        let [low, high] = skeleton.angles()[k].limits;
        *angle = 0.5 * (low + high) + 0.45 * (high - low) * (t * 2.0 + k as f64).sin();
    }
    let mut posed = Posed::default();
    skeleton.pose(&pose, &lengths(id), &mut posed);
    (pose, posed)
}

fn body(id: u32, frame: usize) -> Body {
    let (pose, posed) = posed(id, frame);
    let turn = rotation_vector(pose.rotation);
    let mut body = Body {
        id,
        state: BodyState::TRACKED,
        score: 0.75,
        height: 1.7,
        position: pose.position.as_vec3().to_array(),
        orientation: pose.rotation.as_quat().to_array(),
        joints3d: posed.joints.map(|p| p.as_vec3().to_array()),
        joints2d: [[320.5, 200.25]; BODY_JOINTS],
        confidence: [0.5; BODY_JOINTS],
        joint_states: [JointState::OBSERVED; BODY_JOINTS],
        bone_lengths: lengths(id).map(|l| l as f32),
        bone_rotations: bone_rotations(&posed).map(|q| q.as_quat().to_array()),
        ..Body::default()
    };
    let all = [pose.position.to_array(), turn.to_array()].concat();
    for (to, from) in body.angles.iter_mut().zip(all.iter().chain(&pose.angles)) {
        *to = *from as f32;
    }
    body
}

fn world() -> World {
    World {
        rotation: [0.15f32.cos(), 0.0, 0.0, 0.15f32.sin()],
        translation: [0.0, 1.9, 0.0],
        state: WorldState::GIVEN,
    }
}

/// A record of two people; a floor is known from the tenth frame on.
fn record(folder: &Path, format: Format) -> PathBuf {
    record_of(folder, format, 0..FRAMES)
}

/// The same of some frames.
fn record_of(folder: &Path, format: Format, frames: Range<usize>) -> PathBuf {
    let path = folder.join("bodies.record");
    let mut writer = RecordWriter::<BodiesRow>::create(&path, format).unwrap();
    for frame in frames {
        let there = PEOPLE.iter().filter(|(_, when)| when.contains(&frame));
        let bodies: Vec<Body> = there.map(|(id, _)| body(*id, frame)).collect();
        let mut message = BodyFrame {
            sequence: 100 + frame as u64,
            pose_ns: 5_000_000_000 + frame as u64 * 100_000_000 / 3,
            width: 1280,
            height: 720,
            intrinsics: Intrinsics::from_horizontal_fov(1280, 720, 60.0),
            count: bodies.len() as u32,
            world: if frame < 10 {
                World::default()
            } else {
                world()
            },
            ..BodyFrame::default()
        };
        message.bodies[..bodies.len()].copy_from_slice(&bodies);
        writer.write(&message, "").unwrap();
    }
    writer.finish().unwrap();
    path
}

fn export(record: &Path, to: &Path, more: &[&str]) -> String {
    let (record, to) = (record.to_str().unwrap(), to.to_str().unwrap());
    let out = output(&[&["export", record, "--to", to], more].concat());
    assert!(out.status.success(), "{}", stderr(&out));
    String::from_utf8(out.stdout).unwrap()
}

/// Where a joint is on the floor, by the skeleton's own kinematics.
fn truth(id: u32, frame: usize) -> [DVec3; BODY_JOINTS] {
    let world = world();
    let turn = DQuat::from_array(world.rotation.map(f64::from)).normalize();
    let origin = DVec3::from_array(world.translation.map(f64::from));
    posed(id, frame).1.joints.map(|p| turn * p + origin)
}

/// Which joint a node of a humanoid is at, and which one its end is.
fn joint_of(name: &str) -> usize {
    let joint = match name {
        "hips" => "pelvis",
        "spine" => "spine",
        // Shoulders begin where the neck does.
        "neck" | "rightShoulder" | "leftShoulder" => "neck",
        "head" => "head",
        "head end" => "head_top",
        "rightUpperArm" => "r_shoulder",
        "rightLowerArm" => "r_elbow",
        "rightHand" => "r_wrist",
        "rightHand end" => "r_hand",
        "leftUpperArm" => "l_shoulder",
        "leftLowerArm" => "l_elbow",
        "leftHand" => "l_wrist",
        "leftHand end" => "l_hand",
        "rightUpperLeg" => "r_hip",
        "rightLowerLeg" => "r_knee",
        "rightFoot" => "r_ankle",
        "rightFoot end" => "r_foot_tip",
        "leftUpperLeg" => "l_hip",
        "leftLowerLeg" => "l_knee",
        "leftFoot" => "l_ankle",
        "leftFoot end" => "l_foot_tip",
        other => panic!("a node {other}"),
    };
    JOINT_NAMES.iter().position(|n| *n == joint).unwrap()
}

/// Holds named places against the truth: all 21 joints, each within a millimetre.
fn near(places: &[(String, DVec3)], id: u32, frame: usize) {
    let truth = truth(id, frame);
    let mut seen = [false; BODY_JOINTS];
    for (name, place) in places {
        let joint = joint_of(name);
        let off = (*place - truth[joint]).length();
        assert!(off < 1e-3, "{name} of {id} in frame {frame}: {off} m off");
        seen[joint] = true;
    }
    assert_eq!(seen, [true; BODY_JOINTS]);
}

#[test]
fn bvh_has_every_joint_within_a_millimetre_of_the_skeleton_s_own_kinematics() {
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path(), Format::Binary);
    let said = export(&record, &folder.path().join("two.bvh"), &[]);
    assert!(
        said.contains("two.3.bvh") && said.contains("two.7.bvh"),
        "{said}"
    );
    for (id, when) in PEOPLE {
        let text = std::fs::read_to_string(folder.path().join(format!("two.{id}.bvh"))).unwrap();
        let bvh = Bvh::read(&text);
        // Files begin together: whoever comes later stands still until then.
        assert_eq!(bvh.rows.len(), when.end);
        assert!((bvh.step - 1.0 / 30.0).abs() < 1e-6, "{}", bvh.step);
        for frame in 0..when.end {
            near(&bvh.places(frame), id, frame.max(when.start));
        }
        // Programs blend between frames: no number jumps by half a turn, as from one reading of a rotation to another.
        for (a, b) in bvh.rows.iter().zip(&bvh.rows[1..]) {
            let most = a[3..].iter().zip(&b[3..]).map(|(a, b)| (a - b).abs());
            assert!(most.fold(0.0, f64::max) < 120.0);
        }
    }
    let one = folder.path().join("one.bvh");
    export(&record, &one, &["--person", "7"]);
    let read = |path: PathBuf| Bvh::read(&std::fs::read_to_string(path).unwrap()).rows;
    let (one, seven) = (read(one), read(folder.path().join("two.7.bvh")));
    // Alone from their first frame on, and everything else the same.
    assert_eq!(one, seven[PEOPLE[1].1.start..]);
}

/// A node's place in a moment, by the animation's own samples.
fn glb_places(
    document: &gltf::Document,
    blob: &[u8],
    id: u32,
    step: usize,
) -> (Vec<(String, DVec3)>, f32) {
    use gltf::animation::util::ReadOutputs;
    let mut turns: BTreeMap<usize, DQuat> = BTreeMap::new();
    let mut moves: BTreeMap<usize, DVec3> = BTreeMap::new();
    let mut times: BTreeMap<usize, f32> = BTreeMap::new();
    for channel in document.animations().next().unwrap().channels() {
        let reader = channel.reader(|_| Some(blob));
        let node = channel.target().node().index();
        match reader.read_outputs().unwrap() {
            ReadOutputs::Rotations(all) => {
                let q = all.into_f32().nth(step).unwrap_or([0.0, 0.0, 0.0, 1.0]);
                turns.insert(node, DQuat::from_array(q.map(f64::from)));
                let time = reader.read_inputs().unwrap().nth(step);
                times.insert(node, time.unwrap_or(-1.0));
            }
            ReadOutputs::Translations(mut all) => {
                let p = all.nth(step).unwrap_or_default();
                moves.insert(node, DVec3::from_array(p.map(f64::from)));
            }
            _ => {}
        }
    }
    let name = format!("person {id}");
    let person = document.nodes().find(|n| n.name() == Some(&name)).unwrap();
    let time = times[&person.children().next().unwrap().index()];
    let mut places = Vec::new();
    let mut left = vec![(person, DQuat::IDENTITY, DVec3::ZERO)];
    while let Some((node, turn, at)) = left.pop() {
        let (rest, _, _) = node.transform().decomposed();
        let rest = DVec3::from_array(rest.map(f64::from));
        let own = moves.get(&node.index()).copied().unwrap_or(rest);
        let at = at + turn * own;
        let turn = turn * turns.get(&node.index()).copied().unwrap_or(DQuat::IDENTITY);
        if node.name() != Some(&name) {
            places.push((node.name().unwrap().to_owned(), at));
        }
        left.extend(node.children().map(|child| (child, turn, at)));
    }
    (places, time)
}

#[test]
fn glb_is_valid_and_its_animation_puts_the_joints_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path(), Format::Jsonl);
    let path = folder.path().join("two.glb");
    export(&record, &path, &[]);
    let bytes = std::fs::read(&path).unwrap();
    // Checks references, bounds and required parts.
    let gltf = gltf::Gltf::from_slice(&bytes).unwrap();
    let blob = gltf.blob.as_deref().unwrap();
    assert_eq!((gltf.skins().count(), gltf.meshes().count()), (2, 2));
    assert_eq!(RIG_BONES, 18);
    for (step, frame) in [(0, 0), (17, 17), (59, 59)] {
        let (places, time) = glb_places(&gltf.document, blob, 3, step);
        assert_eq!(places.len(), RIG_BONES);
        let truth = truth(3, frame);
        for (name, place) in &places {
            let off = (*place - truth[joint_of(name)]).length();
            assert!(off < 1e-3, "{name} in frame {frame}: {off} m off");
        }
        if step == 17 {
            assert!((time - 17.0 / 30.0).abs() < 1e-4);
        }
    }
    for mesh in gltf.meshes() {
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(blob));
        let vertices = reader.read_positions().unwrap().count() as u32;
        assert!(
            reader
                .read_indices()
                .unwrap()
                .into_u32()
                .all(|i| i < vertices)
        );
        for weights in reader.read_weights(0).unwrap().into_f32() {
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
        assert!(
            reader
                .read_joints(0)
                .unwrap()
                .into_u16()
                .flatten()
                .all(|j| usize::from(j) < RIG_BONES)
        );
    }
}

#[test]
fn trc_csv_and_npz_hold_the_joints() {
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path(), Format::Binary);
    let file = |name: &str| folder.path().join(name);
    for name in ["seven.trc", "seven.csv"] {
        export(&record, &file(name), &["--person", "7"]);
    }
    let text = std::fs::read_to_string(file("seven.trc")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let head: Vec<&str> = lines[2].split('\t').collect();
    assert_eq!(head[2..5], ["21", "21", "m"]);
    let markers: Vec<&str> = lines[3].split('\t').collect();
    let names: Vec<&str> = markers[2..].iter().step_by(3).copied().collect();
    assert_eq!(names[..BODY_JOINTS], JOINT_NAMES);
    for (row, line) in lines[6..].iter().enumerate() {
        let line = line.strip_suffix('\t').unwrap();
        let numbers: Vec<f64> = line.split('\t').map(|n| n.parse().unwrap()).collect();
        assert_eq!(numbers.len(), 2 + 3 * BODY_JOINTS);
        assert!((numbers[1] - (20 + row) as f64 / 30.0).abs() < 1e-5);
        for (found, wanted) in numbers[2..].chunks(3).zip(truth(7, 20 + row)) {
            assert!((DVec3::from_slice(found) - wanted).length() < 1e-4);
        }
    }
    assert_eq!(lines.len(), 6 + 21);

    let text = std::fs::read_to_string(file("seven.csv")).unwrap();
    let rows: Vec<Vec<&str>> = text.lines().map(|l| l.split(',').collect()).collect();
    assert_eq!(rows.len(), 1 + 21 * BODY_JOINTS);
    let column = |name: &str| rows[0].iter().position(|c| *c == name).unwrap();
    let row = &rows[1 + 5 * BODY_JOINTS + 4];
    assert_eq!(row.len(), rows[0].len());
    assert_eq!(
        (row[column("frame")], row[column("joint")]),
        ("125", "r_wrist")
    );
    assert_eq!(
        (row[column("person")], row[column("u_px")]),
        ("7", "320.50")
    );
    let z: f32 = row[column("z_m")].parse().unwrap();
    assert!((z - body(7, 25).joints3d[4][2]).abs() < 1e-4);
    let y: f64 = row[column("floor_y_m")].parse().unwrap();
    assert!((y - truth(7, 25)[4].y).abs() < 1e-4);

    export(&record, &file("all.npz"), &[]);
    let bytes = std::fs::read(file("all.npz")).unwrap();
    let mut archive = edgecap::npz::Archive::new(Cursor::new(bytes)).unwrap();
    let joints = archive.numbers("joints3d").unwrap().unwrap();
    assert_eq!(joints.shape, [FRAMES, 2, BODY_JOINTS, 3]);
    let at = ((30 * 2 + 1) * BODY_JOINTS + PELVIS) * 3;
    assert_eq!(joints.data[at + 2] as f32, body(7, 30).joints3d[PELVIS][2]);
    assert!(
        joints.data[(2 + 1) * BODY_JOINTS * 3].is_nan(),
        "7 is not in frame 1"
    );
    let frames = archive.numbers("frame").unwrap().unwrap();
    assert_eq!(frames.data[59], 159.0);
    assert_eq!(archive.numbers("person").unwrap().unwrap().data, [3.0, 7.0]);
}

#[test]
fn a_plot_has_a_line_for_each_person_in_each_panel() {
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path(), Format::Binary);
    let file = folder.path().join("curves.svg");
    let out = output(&[
        "plot",
        record.to_str().unwrap(),
        "--to",
        file.to_str().unwrap(),
    ]);
    assert!(out.status.success(), "{}", stderr(&out));
    let text = std::fs::read_to_string(&file).unwrap();
    let svg = roxmltree::Document::parse(&text).unwrap();
    let all = svg.descendants();
    let curves: Vec<&str> = all
        .filter(|n| n.attribute("stroke-width") == Some("1.5"))
        .map(|n| n.attribute("d").unwrap())
        .collect();
    assert_eq!(curves.len(), 13 * PEOPLE.len());
    let points = |d: &str| d.matches(['M', 'L']).count();
    assert_eq!((points(curves[0]), points(curves[1])), (60, 21));
    let words = |w: &str| svg.descendants().any(|n| n.text() == Some(w));
    assert!(words("#3") && words("#7") && words("left knee flexion, degrees"));
    let other = folder.path().join("curves.csv");
    let args = [
        "plot",
        record.to_str().unwrap(),
        "--to",
        other.to_str().unwrap(),
    ];
    assert_fails(&args, 64, &[".svg"]);
}

#[test]
fn what_cannot_be_exported_is_said_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path(), Format::Binary);
    let path = |name: &str| folder.path().join(name).display().to_string();
    let record = record.to_str().unwrap();
    let fails = |args: &[&str], code, words: &[&str]| {
        assert_fails(&[&["export"], args].concat(), code, words);
    };
    fails(
        &[record, "--to", &path("a.fbx")],
        64,
        &["a.fbx", ".bvh", ".glb"],
    );
    fails(
        &[record, "--to", &path("a")],
        64,
        &["expected a name that ends in"],
    );
    fails(
        &[record, "--to", &path("a.bvh"), "--person", "4"],
        65,
        &["id 4", "3, 7"],
    );
    fails(&[&path("absent"), "--to", &path("a.csv")], 66, &["absent"]);
    std::fs::write(path("empty"), "").unwrap();
    fails(
        &[&path("empty"), "--to", &path("a.csv")],
        65,
        &["found nobody in 0 frames"],
    );
    std::fs::write(path("other"), "{\"x\": 1}\n").unwrap();
    fails(&[&path("other"), "--to", &path("a.csv")], 65, &["line 1"]);
    fails(&[record, "--to", "/proc/a.csv"], 73, &["/proc/a.csv"]);
    let out = output(&["export", record, "--to", "/proc/a.bvh"]);
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(73), "{said}");
    let more = "/proc/a.bvh: 1 more file could not be written";
    assert!(said.contains(more), "{said}");
    let names = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(names, 3, "nothing is left of what failed");
}

//! `docs/body.md` says how joints come of angles and lengths: its code does what it says, and its tables name every
//! field.

use std::path::Path;
use std::process::{Command, Output};

use edgecap::body::skeleton::{Pose, Posed, Skeleton, rotation_vector};
use edgecap::joints::{ANGLE_NAMES, BODY_JOINTS, DOF, JOINT_NAMES};
use glam::DQuat;

use crate::program::{stderr, tools};

const PAGE: &str = include_str!("../../docs/body.md");

/// The first piece of the page's code in a language.
fn code(language: &str) -> &'static str {
    let code = PAGE.split(&format!("```{language}\n")).nth(1).unwrap();
    code.split("```").next().unwrap()
}

/// Angles, lengths and joints of somebody with bones of their own who bends every joint.
fn somebody() -> ([f32; DOF], [f32; BODY_JOINTS], [[f32; 3]; BODY_JOINTS]) {
    let skeleton = Skeleton::builtin();
    let mut pose = Pose::facing_camera(4.5);
    pose.position.x = -0.4;
    pose.rotation = DQuat::from_rotation_y(2.0) * pose.rotation;
    for (k, angle) in pose.angles.iter_mut().enumerate() {
        let [low, high] = skeleton.angles()[k].limits;
        *angle = 0.5 * (low + high) + 0.45 * (high - low) * (k as f64).sin();
    }
    let mut lengths = *skeleton.lengths();
    for (j, length) in lengths.iter_mut().enumerate() {
        *length *= 0.9 + 0.01 * j as f64;
    }
    let mut posed = Posed::default();
    skeleton.pose(&pose, &lengths, &mut posed);
    let joints = posed.joints;
    let root = [
        pose.position.to_array(),
        rotation_vector(pose.rotation).to_array(),
    ]
    .concat();
    let mut angles = [0.0; DOF];
    for (to, from) in angles.iter_mut().zip(root.iter().chain(&pose.angles)) {
        *to = *from as f32;
    }
    (
        angles,
        lengths.map(|l| l as f32),
        joints.map(|j| j.as_vec3().to_array()),
    )
}

/// The joints that a program prints are those of [`somebody`].
fn are_the_joints(out: &Output) {
    assert!(out.status.success(), "{}", stderr(out));
    let found: Vec<[f32; 3]> = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(found.len(), BODY_JOINTS);
    for (j, (found, wanted)) in found.iter().zip(somebody().2).enumerate() {
        let off = (0..3).map(|k| (found[k] - wanted[k]).abs());
        let off = off.fold(0.0, f32::max);
        assert!(off < 1e-4, "{}: {found:?}, not {wanted:?}", JOINT_NAMES[j]);
    }
}

#[test]
fn its_python_gives_the_joints() {
    if !tools::has("python3") {
        return;
    }
    let (angles, lengths, _) = somebody();
    let script = format!(
        "{}\nimport json\nnames = {JOINT_NAMES:?}\n\
         found = joints({angles:?}, {lengths:?}, names)\nprint(json.dumps([found[n] for n in names]))",
        code("python")
    );
    let out = Command::new("python3").args(["-c", &script]).output();
    are_the_joints(&out.unwrap());
}

#[test]
fn its_cpp_gives_the_joints() {
    if !tools::has("c++") {
        return;
    }
    let (angles, lengths, _) = somebody();
    let row = |values: &[f32]| format!("{values:?}").replace(['[', ']'], "");
    let text = format!(
        "{}\n#include <cstdio>\nint main() {{\n\
         const float angles[29] = {{{}}};\nconst float lengths[21] = {{{}}};\n\
         const char *before = \"[[\";\n\
         for (const Point &p : joints(angles, lengths)) {{\n\
         std::printf(\"%s%.9g, %.9g, %.9g]\", before, p[0], p[1], p[2]);\nbefore = \", [\";\n}}\n\
         std::puts(\"]\");\n}}\n",
        code("cpp"),
        row(&angles),
        row(&lengths)
    );
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("joints.cpp"), text).unwrap();
    let run = |program: &Path, args: &[&str]| Command::new(program).args(args).output().unwrap();
    let (source, program) = (path("joints.cpp"), path("joints"));
    let out = run(
        "c++".as_ref(),
        &[
            "-std=c++11",
            "-Wall",
            "-Wextra",
            "-Wpedantic",
            "-Werror",
            source.to_str().unwrap(),
            concat!("-I", env!("CARGO_MANIFEST_DIR"), "/clients/c/include"),
            "-o",
            program.to_str().unwrap(),
        ],
    );
    assert!(out.status.success(), "{}", stderr(&out));
    are_the_joints(&run(&program, &[]));
}

#[test]
fn the_names_of_clients_are_those_of_the_skeleton() {
    let names = Skeleton::builtin().angles().iter().map(|a| a.name.as_str());
    assert_eq!(names.collect::<Vec<_>>(), ANGLE_NAMES[6..]);
    for name in ANGLE_NAMES {
        // The page writes "…_rotation" for what begins as the row before.
        let (_, end) = name.rsplit_once('_').unwrap();
        assert!(
            PAGE.contains(&format!("`{name}`")) || PAGE.contains(&format!("`…_{end}`")),
            "{name}"
        );
    }
}

/// Public fields of a struct, by its source.
fn fields(source: &str, of: &str) -> Vec<String> {
    let (_, body) = source.split_once(&format!("pub struct {of} {{")).unwrap();
    let (body, _) = body.split_once("\n}").unwrap();
    let names = body.lines().filter_map(|l| l.trim().strip_prefix("pub "));
    names
        .map(|line| line.split_once(':').unwrap().0.to_owned())
        .collect()
}

#[test]
fn its_tables_name_every_field() {
    let body = include_str!("../../clients/rust/src/message/body.rs");
    let observation = include_str!("../../clients/rust/src/message/observation.rs");
    for (source, of) in [
        (body, "BodyFrame"),
        (body, "Body"),
        (body, "World"),
        (observation, "ObservationFrame"),
        (observation, "Observation"),
    ] {
        let (_, section) = PAGE.split_once(&format!("\n## {of}\n")).expect(of);
        let section = section.split("\n## ").next().unwrap();
        let named = fields(source, of);
        assert!(named.len() > 2, "{of}: {named:?}");
        for field in named.iter().filter(|f| *f != "reserved") {
            assert!(section.contains(&format!("`{field}`")), "{of}: {field}");
        }
    }
}

/// A number of the page: with a real minus.
fn number(text: &str) -> f64 {
    text.trim().replace('\u{2212}', "-").parse().unwrap()
}

#[test]
fn its_table_is_the_skeleton() {
    let skeleton = Skeleton::builtin();
    let table = PAGE
        .split("| joint | parent | bone at rest")
        .nth(1)
        .unwrap();
    let rows = table
        .lines()
        .skip(2)
        .take_while(|line| line.starts_with('|'));
    let (mut joints, mut listed) = (0, Vec::new());
    for row in rows {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [name, _, rest, angles] = cells[..] else {
            panic!("{row}")
        };
        let name = name.trim_matches('`');
        let joint = JOINT_NAMES.iter().position(|n| *n == name).unwrap();
        joints += 1;
        if rest.is_empty() {
            continue;
        }
        let bone = skeleton.directions()[joint] * skeleton.lengths()[joint];
        for (shown, is) in rest.split(',').map(number).zip(bone.to_array()) {
            assert!((shown - is).abs() < 6e-4, "{name}: {shown}, not {is}");
        }
        for angle in angles.split(';').map(str::trim).filter(|a| !a.is_empty()) {
            let words: Vec<&str> = angle.split(' ').collect();
            let [index, shown, axis, limits] = words[..] else {
                panic!("{row}: {angle}")
            };
            let index: usize = index.parse().unwrap();
            let is = &skeleton.angles()[index - 6];
            let ending = shown.trim_matches('`').trim_start_matches('…');
            assert!(is.name.ends_with(ending), "{shown}, not {}", is.name);
            let [low, high] = is.limits.map(f64::to_degrees);
            let limits = match limits.strip_prefix('±') {
                Some(most) => [-number(most), number(most)],
                None => {
                    let (low, high) = limits.split_once('…').unwrap();
                    [number(low), number(high)]
                }
            };
            assert!((limits[0] - low).abs() < 0.01 && (limits[1] - high).abs() < 0.01);
            let sign = if axis.starts_with('+') { 1.0 } else { -1.0 };
            let along = "xyz".find(&axis[axis.len() - 1..]).unwrap();
            assert_eq!(is.axis.to_array()[along], sign, "{angle}");
            listed.push(index);
        }
    }
    listed.sort_unstable();
    assert_eq!(joints, BODY_JOINTS);
    assert_eq!(listed, (6..DOF).collect::<Vec<_>>());
}

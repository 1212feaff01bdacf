//! three.js loads what was exported, and puts the joints where they are; Khronos' validator finds nothing to say. Needs
//! Node.js, and `three` and `gltf-validator` from npm in the folder that `EDGECAP_NODE_MODULES` names.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use glam::{DQuat, DVec3};

use super::{FRAMES, RIG_BONES, export, joint_of, record, truth};
use crate::program::tools;
use edgecap::body::BodyModel;
use edgecap::body::mesh::{MeshBody, MeshPose, NAMES, PosedTree, Skin};
use edgecap::export::{Axes, MeshTrack, encode_meshes};
use edgecap::joints::BODY_JOINTS;
use edgecap::record::Format;

/// What three.js finds at each moment: where nodes are, metres.
type Found = BTreeMap<String, BTreeMap<String, [f64; 3]>>;

fn has_modules() -> bool {
    let modules = "EDGECAP_NODE_MODULES";
    if std::env::var_os(modules).is_none() {
        eprintln!("skipped: {modules} names no folder with three and gltf-validator");
        return false;
    }
    tools::has("node")
}

/// Loads a file in which the validator finds no fault.
fn loaded(glb: &Path, moments: &[String]) -> Found {
    let script = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/reference/three_joints.mjs"
    );
    let out = Command::new("node")
        .arg(script)
        .arg(glb)
        .args(moments)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    let line = |key: &str| {
        let found = said.lines().find_map(|l| l.strip_prefix(key));
        found.unwrap_or_else(|| panic!("{said}{}", String::from_utf8_lossy(&out.stderr)))
    };
    let issues: serde_json::Value = serde_json::from_str(line("ISSUES ")).unwrap();
    for kind in ["numErrors", "numWarnings", "numInfos"] {
        assert_eq!(issues[kind], 0, "{issues}");
    }
    serde_json::from_str(line("JOINTS ")).unwrap()
}

#[test]
#[ignore = "long: packages of npm"]
fn long_three_js_moves_a_mesh_body() {
    if !has_modules() {
        return;
    }
    let body = MeshBody::shipped();
    let person = body.person(&[1.0, -1.0]);
    let mut pose = body.rest_pose();
    pose.pelvis = DVec3::new(0.3, 1.0, -0.2);
    pose.rotations[0] = DQuat::from_rotation_y(0.8);
    pose.rotations[18] = DQuat::from_rotation_z(1.1);
    pose.rotations[4] = DQuat::from_rotation_x(0.6);
    let rest = MeshPose {
        pelvis: pose.pelvis,
        ..body.rest_pose()
    };
    let track = MeshTrack {
        id: 1,
        person: &person,
        poses: vec![(0.0, &rest), (0.1, &pose)],
    };
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("meshes.glb");
    let file = encode_meshes(body, &[track], &Axes::default(), 10.0, 0.1);
    std::fs::write(&glb, file.unwrap()).unwrap();
    let moments = ["0".to_owned(), "0.0999999".to_owned()];
    let found = loaded(&glb, &moments);
    for (moment, pose) in moments.iter().zip([&rest, &pose]) {
        let mut posed = PosedTree::default();
        body.kinematics(pose, &person, &mut posed);
        let nodes = &found[moment];
        for (name, at) in NAMES.into_iter().zip(posed.joints()) {
            let off = DVec3::from_array(nodes[name]).distance(*at);
            assert!(off < 1e-3, "{name} at {moment} s: {off} m off");
        }
        let mut vertices = Vec::new();
        Skin::new(body, &person).pose(body, pose, &posed, &mut vertices);
        let heights = vertices.iter().map(|v| f64::from(v.y));
        let (least, most) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| {
            (a.min(y), b.max(y))
        });
        let [low, high, _] = nodes["body_1"];
        assert!(
            (least - low).abs() < 1e-3 && (high - most).abs() < 1e-3,
            "skin from {low} to {high} m, mesh from {least} to {most} m at {moment} s"
        );
    }
}

#[test]
#[ignore = "long: packages of npm"]
fn long_three_js_has_every_joint_within_a_millimetre() {
    if !has_modules() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path(), Format::Binary);
    let glb = folder.path().join("one.glb");
    export(&record, &glb, &["--person", "3"]);
    // Whoever is in the last frame stays.
    let frames = [0, 17, 40, FRAMES - 1, FRAMES + 9];
    let moments = frames.map(|f| (f as f64 / 30.0).to_string());
    let found = loaded(&glb, &moments);
    for (frame, moment) in frames.into_iter().zip(&moments) {
        let mut nodes = found[moment].clone();
        let truth = truth(3, frame.min(FRAMES - 1));
        let skin: Vec<_> = nodes
            .extract_if(.., |name, _| name.starts_with("mannequin"))
            .collect();
        assert_eq!(nodes.len(), RIG_BONES, "{nodes:?}");
        for (name, place) in &nodes {
            let off = (DVec3::from_array(*place) - truth[joint_of(name)]).length();
            assert!(off < 1e-3, "{name} in frame {frame}: {off} m off");
        }
        // The skin goes with its bones: it is as low and as high as the joints, and some flesh.
        let [(_, [low, high, _])] = skin[..] else {
            panic!("expected one mannequin, found {skin:?}")
        };
        let heights = truth[..BODY_JOINTS].iter().map(|p| p.y);
        let (least, most) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| {
            (a.min(y), b.max(y))
        });
        assert!(
            (least - low).abs() < 0.2 && (high - most).abs() < 0.2,
            "skin from {low} to {high} m, joints from {least} to {most} m, frame {frame}"
        );
    }
}

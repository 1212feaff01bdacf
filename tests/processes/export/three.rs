//! three.js loads what was exported, and puts the joints where they are; Khronos' validator finds nothing to say. Needs
//! Node.js, and `three` and `gltf-validator` from npm in the folder that `EDGECAP_NODE_MODULES` names.

use std::collections::BTreeMap;
use std::process::Command;

use glam::DVec3;

use super::{FRAMES, export, joint_of, record, truth};
use crate::program::tools;
use edgecap::joints::BODY_JOINTS;
use edgecap::record::Format;

#[test]
#[ignore = "long: packages of npm"]
fn long_three_js_has_every_joint_within_a_millimetre() {
    let modules = "EDGECAP_NODE_MODULES";
    if std::env::var_os(modules).is_none() {
        eprintln!("skipped: {modules} names no folder with three and gltf-validator");
        return;
    }
    if !tools::has("node") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path(), Format::Binary);
    let glb = folder.path().join("one.glb");
    export(&record, &glb, &["--person", "3"]);
    let script = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/reference/three_joints.mjs"
    );
    let frames = [0, 17, 40, FRAMES - 1];
    let moments = frames.map(|f| (f as f64 / 30.0).to_string());
    let out = Command::new("node")
        .arg(script)
        .arg(&glb)
        .args(&moments)
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
    let found: BTreeMap<String, BTreeMap<String, [f64; 3]>> =
        serde_json::from_str(line("JOINTS ")).unwrap();
    for (frame, moment) in frames.into_iter().zip(&moments) {
        let mut nodes = found[moment].clone();
        let truth = truth(3, frame);
        let skin: Vec<_> = nodes
            .extract_if(.., |name, _| name.starts_with("mannequin"))
            .collect();
        assert_eq!(nodes.len(), 16, "{nodes:?}");
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

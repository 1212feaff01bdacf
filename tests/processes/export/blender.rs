//! Blender imports what was exported, and puts the joints where they are. Needs Debian's blender.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use glam::DVec3;

use super::{FRAMES, RIG_BONES, export, joint_of, near, record, record_of, truth};
use crate::program::tools;
use edgecap::record::Format;

type Places = Vec<(String, DVec3)>;

/// Every joint's place in some frames, metres, y up; `None` where its Python has no NumPy, which glTF needs.
fn imported(file: &Path, frames: &[usize]) -> Option<BTreeMap<usize, Places>> {
    let script = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/reference/blender_joints.py"
    );
    let out = Command::new("blender")
        .args([
            "--background",
            "--factory-startup",
            "--python-exit-code",
            "1",
        ])
        .args(["--python", script, "--"])
        .arg(file)
        .arg("30")
        .args(frames.iter().map(ToString::to_string))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    if !out.status.success() && said.contains("NO NUMPY") {
        eprintln!("skipped: {}: Blender's Python has no NumPy", file.display());
        return None;
    }
    let line = said.lines().find_map(|l| l.strip_prefix("JOINTS "));
    let line = line.unwrap_or_else(|| panic!("{said}{}", String::from_utf8_lossy(&out.stderr)));
    let found: BTreeMap<String, BTreeMap<String, [f64; 3]>> = serde_json::from_str(line).unwrap();
    let places = found.into_iter().map(|(frame, bones)| {
        let bones = bones.into_iter();
        let places = bones.map(|(name, place)| (name, DVec3::from_array(place)));
        (frame.parse().unwrap(), places.collect())
    });
    Some(places.collect())
}

#[test]
#[ignore = "long: Blender"]
fn long_blender_has_every_joint_within_a_millimetre() {
    if !tools::has("blender") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path(), Format::Binary);
    let frames = [0, 17, 40, 59];
    let bvh = folder.path().join("one.bvh");
    export(&record, &bvh, &["--person", "3"]);
    for (frame, places) in imported(&bvh, &frames).expect("BVH needs no NumPy") {
        near(&places, 3, frame);
    }
    let glb = folder.path().join("one.glb");
    export(&record, &glb, &["--person", "3"]);
    // Whoever is in the last frame stays.
    let frames = [0, 17, 40, FRAMES - 1, FRAMES, FRAMES + 9];
    for (frame, places) in imported(&glb, &frames).unwrap_or_default() {
        near_bones(places, frame.min(FRAMES - 1));
    }
    // Of a photo Blender shows the frame after it: its own first one.
    let photo = record_of(folder.path(), Format::Binary, 10..11);
    export(&photo, &glb, &["--person", "3"]);
    for (_, places) in imported(&glb, &[0, 1]).unwrap_or_default() {
        near_bones(places, 10);
    }
}

/// Holds the bones of person 3 against the truth. Of ends glTF knows nothing: their length is Blender's guess.
fn near_bones(places: Places, frame: usize) {
    let bones = places.into_iter();
    let bones: Places = bones.filter(|(name, _)| !name.ends_with(" end")).collect();
    assert_eq!(bones.len(), RIG_BONES, "{bones:?}");
    let truth = truth(3, frame);
    for (name, place) in bones {
        let off = (place - truth[joint_of(&name)]).length();
        assert!(off < 1e-3, "{name} in frame {frame}: {off} m off");
    }
}

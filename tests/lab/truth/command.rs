//! `edgecap eval` on archives: what it refuses, real photos, the sets' own tools.

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use edgecap::joints::EVIDENCE_JOINTS;

use super::{Arrays, FIGURE, at, seen, toolbox};
use crate::tools;

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

//! `edgecap eval` from the command line, and that pictures of a folder can be told apart in what it reads.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use edgecap::capture::{Frame, PhotoSource, Source};
use edgecap::joints::{BODY_JOINTS, EVIDENCE_JOINTS};

fn eval(folder: &Path, args: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = Command::cargo_bin("edgecap").unwrap();
    command.current_dir(folder).arg("eval").args(args).assert()
}

fn joints() -> Vec<[f64; 3]> {
    let at = |j: usize| [10.0 * j as f64, 5.0 * j as f64, 1.0];
    (0..EVIDENCE_JOINTS).map(at).collect()
}

fn write_predictions(path: &Path) {
    let person = serde_json::json!({
        "score": 0.7, "joints2d": joints(), "joints3d": vec![[0.0; 3]; BODY_JOINTS],
    });
    let line = |k: u64, name: &str, people: &[&serde_json::Value]| {
        serde_json::json!({
            "frame": k, "time_ns": 0, "source": format!("photos/{name}"), "width": 512, "height": 320, "people": people,
        })
        .to_string()
    };
    let text = [line(0, "a.jpg", &[&person]), line(1, "b.jpg", &[])].join("\n");
    fs::write(path, text).unwrap();
}

#[test]
fn table_and_json_hold_the_same_figures() {
    let folder = tempfile::tempdir().unwrap();
    write_predictions(&folder.path().join("p.jsonl"));
    let truth = serde_json::json!([
        {"file": "a.jpg", "split": "test", "joints": joints()},
        {"file": "b.jpg", "split": "test", "joints": joints()},
    ]);
    fs::write(folder.path().join("t.json"), truth.to_string()).unwrap();
    let args = [
        "--predictions",
        "p.jsonl",
        "--truth",
        "t.json",
        "--split",
        "test",
    ];
    let table = eval(
        folder.path(),
        &[&args[..], &["--json", "out.json"]].concat(),
    )
    .success();
    let table = String::from_utf8_lossy(&table.get_output().stdout).into_owned();
    assert!(
        table.contains("PCK@0.2") && table.contains("50.0 %"),
        "{table}"
    );
    let json = fs::read_to_string(folder.path().join("out.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["pck"], 0.5);
    assert_eq!(json["frames"], 2);
    let printed = eval(folder.path(), &[&args[..], &["--json", "-"]].concat()).success();
    let printed: serde_json::Value = serde_json::from_slice(&printed.get_output().stdout).unwrap();
    assert_eq!(printed, json);
}

#[test]
fn pictures_of_nobody_need_no_truth() {
    let folder = tempfile::tempdir().unwrap();
    write_predictions(&folder.path().join("p.jsonl"));
    let out = eval(folder.path(), &["--predictions", "p.jsonl", "--no-people"]).success();
    let out = String::from_utf8_lossy(&out.get_output().stdout).into_owned();
    assert!(out.contains("50.0 %"), "{out}");
}

#[test]
fn bad_input_is_one_line_and_a_code() {
    let folder = tempfile::tempdir().unwrap();
    write_predictions(&folder.path().join("p.jsonl"));
    fs::write(folder.path().join("t.json"), "[]").unwrap();
    let codes = [
        (&["--predictions", "none.jsonl", "--no-people"][..], 66),
        (&["--predictions", "t.json", "--no-people"], 65),
        (&["--predictions", "p.jsonl", "--truth", "t.json"], 65),
        (&["--predictions", "p.jsonl"], 64),
    ];
    for (args, code) in codes {
        let failed = eval(folder.path(), args).code(code);
        let error = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(code == 64 || error.lines().count() == 1, "{error}");
    }
}

#[test]
fn every_photo_of_a_folder_has_its_own_name() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["one.png", "two.png"] {
        let picture = image::RgbImage::from_pixel(4, 3, image::Rgb([9, 8, 7]));
        picture.save(folder.path().join(name)).unwrap();
    }
    let mut source = PhotoSource::folder(folder.path(), None).unwrap();
    let mut frame = Frame::default();
    let mut names = Vec::new();
    while source.next_into(&mut frame).unwrap() {
        names.push(source.picture());
    }
    let ends = |n: &String, end: &str| n.ends_with(&format!("/{end}"));
    assert!(
        ends(&names[0], "one.png") && ends(&names[1], "two.png"),
        "{names:?}"
    );
}

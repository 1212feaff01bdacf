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
    // Whatever standard output is called, the table is not among the figures.
    for name in ["-", "/dev/stdout", "/proc/self/fd/1"] {
        let printed = eval(folder.path(), &[&args[..], &["--json", name]].concat()).success();
        let printed = serde_json::from_slice::<serde_json::Value>(&printed.get_output().stdout);
        assert_eq!(printed.unwrap(), json, "{name}");
    }
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
    fs::write(folder.path().join("empty.jsonl"), "").unwrap();
    let lsp = serde_json::json!([{"file": "a.jpg", "split": "train", "joints": joints()}]);
    fs::write(folder.path().join("lsp.json"), lsp.to_string()).unwrap();
    let coco = serde_json::json!({
        "images": [{"id": 1, "file_name": "a.jpg"}],
        "categories": [{"id": 1, "keypoints": ["left_hip"]}],
        "annotations": [
            {"image_id": 1, "category_id": 1, "keypoints": [1, 2, 2], "bbox": [0, 0, 9, 9], "area": 50.0},
        ],
    });
    fs::write(folder.path().join("coco.json"), coco.to_string()).unwrap();
    let measured = ["--predictions", "p.jsonl", "--truth", "coco.json"];
    let no_number = [&measured[..], &["--min-height", "nan"]].concat();
    let below_zero = [&measured[..], &["--min-height=-1"]].concat();
    // Nobody has so many joints: everybody would be left out.
    let too_many = [&measured[..], &["--min-joints", "15"]].concat();
    let codes = [
        (&["--predictions", "none.jsonl", "--no-people"][..], 66),
        (&["--predictions", "t.json", "--no-people"], 65),
        (&["--predictions", "p.jsonl", "--truth", "t.json"], 65),
        (&["--predictions", "p.jsonl"], 64),
        (&["--predictions", "empty.jsonl", "--no-people"], 65),
        (
            &[
                "--predictions",
                "p.jsonl",
                "--truth",
                "lsp.json",
                "--split",
                "test",
            ],
            65,
        ),
        // Options that would do nothing.
        (
            &[
                "--predictions",
                "p.jsonl",
                "--truth",
                "coco.json",
                "--split",
                "test",
            ],
            65,
        ),
        (
            &[
                "--predictions",
                "p.jsonl",
                "--truth",
                "lsp.json",
                "--frames",
                "30",
            ],
            64,
        ),
        (
            &["--predictions", "p.jsonl", "--no-people", "--split", "test"],
            64,
        ),
        (
            &[
                "--predictions",
                "p.jsonl",
                "--no-people",
                "--format",
                "coco",
            ],
            64,
        ),
        (
            &["--predictions", "p.jsonl", "--no-people", "--joints", "all"],
            64,
        ),
        (
            &[
                "--predictions",
                "p.jsonl",
                "--no-people",
                "--min-joints",
                "3",
            ],
            64,
        ),
        (
            &["--predictions", "p.jsonl", "--no-people", "--units", "mm"],
            64,
        ),
        (&["--multiview", "--joints", "all"], 64),
        (&no_number[..], 64),
        (&below_zero[..], 64),
        (&too_many[..], 64),
    ];
    for (args, code) in codes {
        let failed = eval(folder.path(), args).code(code);
        let error = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(code == 64 || error.lines().count() == 1, "{error}");
    }
}

/// The bundled clip's frames have numbers, as photos have.
#[test]
fn a_film_is_not_measured_by_photos_nor_photos_by_a_film_nor_a_film_by_another() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_predictions(&at("photos.jsonl"));
    let clip = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/demo/truth.json");
    let film = serde_json::json!({
        "frame": 0, "time_ns": 0, "source": "demo.avi", "width": 512, "height": 320, "people": [],
    });
    fs::write(at("film.jsonl"), film.to_string()).unwrap();
    let photos = serde_json::json!([{"file": "a.jpg", "split": "test", "joints": joints()}]);
    fs::write(at("photos.json"), photos.to_string()).unwrap();
    let other = film.to_string().replace("demo.avi", "hall.mp4");
    fs::write(at("other.jsonl"), other).unwrap();
    let scaled = film.to_string().replace("320", "288");
    fs::write(at("scaled.jsonl"), scaled).unwrap();
    let clip = clip.to_str().unwrap();
    for (predictions, truth, word) in [
        ("photos.jsonl", clip, "photos/a.jpg"),
        ("film.jsonl", "photos.json", "infer"),
        ("other.jsonl", clip, "expected predictions of demo.avi"),
        ("scaled.jsonl", clip, "found 512x288"),
    ] {
        let args = ["--predictions", predictions, "--truth", truth];
        let failed = eval(folder.path(), &args).code(65);
        let error = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(
            error.lines().count() == 1 && error.contains(word),
            "{error}"
        );
    }
}

/// Pictures of all of them have the same names, and truth names them without the folder in which it lies itself.
#[test]
fn several_folders_of_stills_are_one_set() {
    let folder = tempfile::tempdir().unwrap();
    let person = serde_json::json!({
        "id": 1, "stature": 1.7, "joints3d": vec![[0.1, 0.2, 4.0]; BODY_JOINTS],
        "joints2d": (0..BODY_JOINTS).map(|j| [10.0 * j as f64, 5.0 * j as f64]).collect::<Vec<_>>(),
        "visibility": vec![1; BODY_JOINTS],
    });
    for (set, people) in [("s1", vec![&person]), ("s2", vec![])] {
        let at = folder.path().join(set);
        fs::create_dir(&at).unwrap();
        let picture = |k: u64| format!("{k:06}.jpg");
        let frames = (0..3_u64)
            .map(|k| serde_json::json!({"frame": k, "file": picture(k), "people": people}));
        let truth = serde_json::json!({"frames": frames.collect::<Vec<_>>(), "fps": 0.0});
        fs::write(at.join("truth.json"), truth.to_string()).unwrap();
        let seen = serde_json::json!({
            "score": 0.7, "joints2d": joints(), "joints3d": vec![[0.0; 3]; BODY_JOINTS],
        });
        let line = |k: u64| {
            serde_json::json!({
                "frame": k, "time_ns": k, "source": format!("{set}/{}", picture(k)), "width": 512, "height": 320,
                "people": if set == "s1" { vec![&seen] } else { Vec::new() },
            })
            .to_string()
        };
        let lines: Vec<String> = (0..3).map(line).collect();
        fs::write(folder.path().join(format!("{set}.jsonl")), lines.join("\n")).unwrap();
    }
    let measured = |folder: &Path, truth: [&str; 2], predictions: [&str; 2]| {
        let args = [
            &["--json", "-", "--predictions"][..],
            &predictions,
            &["--truth"],
            &truth,
        ];
        let out = eval(folder, &args.concat()).success();
        serde_json::from_slice::<serde_json::Value>(&out.get_output().stdout).unwrap()
    };
    let out = measured(
        folder.path(),
        ["s1/truth.json", "s2/truth.json"],
        ["s1.jsonl", "s2.jsonl"],
    );
    assert_eq!(
        (&out["frames"], &out["frames_without_prediction"]),
        (&6.into(), &0.into())
    );
    assert_eq!(out["finding"][1]["found"], 3);
    // Wherever it is read from.
    let inside = measured(
        &folder.path().join("s1"),
        ["truth.json", "../s2/truth.json"],
        ["../s1.jsonl", "../s2.jsonl"],
    );
    assert_eq!(inside, out);
    fs::create_dir(folder.path().join("s1/x")).unwrap();
    let below = measured(
        &folder.path().join("s1/x"),
        ["../truth.json", "../../s2/truth.json"],
        ["../../s1.jsonl", "../../s2.jsonl"],
    );
    assert_eq!(below, out);
}

#[test]
fn truth_that_does_not_do_is_told_in_the_options_words() {
    let folder = tempfile::tempdir().unwrap();
    write_predictions(&folder.path().join("p.jsonl"));
    let coco = serde_json::json!({"images": [], "annotations": [], "categories": []});
    fs::write(folder.path().join("coco.json"), coco.to_string()).unwrap();
    fs::write(folder.path().join("list.json"), "[]").unwrap();
    let film = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/demo/truth.json");
    let film = film.to_str().unwrap();
    for (truth, word) in [
        (&[film, film][..], "films are measured one at a time"),
        (
            &["coco.json", "--split", "test"],
            "--format coco, which has none",
        ),
        (
            &["list.json", "--format", "coco"],
            "ground truth of --format coco",
        ),
    ] {
        let args = [&["--predictions", "p.jsonl", "--truth"], truth].concat();
        let failed = eval(folder.path(), &args).code(65);
        let error = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
        assert!(
            error.lines().count() == 1 && error.contains(word),
            "{error}"
        );
    }
}

#[test]
fn synth_refuses_what_would_do_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for args in [
        &["--format", "png", "--quality", "5"][..],
        &["--stills", "--fps", "60"],
    ] {
        let mut command = Command::cargo_bin("edgecap").unwrap();
        command.current_dir(folder.path());
        command.args([
            "synth", "--frames", "1", "--width", "32", "--height", "32", "--out", "o",
        ]);
        command.args(args).assert().code(64);
        assert!(!folder.path().join("o").exists());
    }
}

/// Minutes of work are not begun where they cannot be kept, and not lost where they cannot be written.
#[test]
fn a_result_without_a_place_is_told_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    write_predictions(&folder.path().join("p.jsonl"));
    let nowhere = ["--json", "p.jsonl/figures.json"];
    let unread = ["--predictions", "none.jsonl", "--no-people"];
    eval(folder.path(), &[&unread[..], &nowhere].concat()).code(73);
    let mut bench = Command::cargo_bin("edgecap").unwrap();
    bench.current_dir(folder.path());
    let args = ["bench", "--networks", "none", "--save", "p.jsonl/b.json"];
    bench.args(args).assert().code(73);
    let full = [
        "--predictions",
        "p.jsonl",
        "--no-people",
        "--json",
        "/dev/full",
    ];
    let failed = eval(folder.path(), &full).code(74);
    let said = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(said.contains("the disk is full: make room"), "{said}");
    let table = String::from_utf8_lossy(&failed.get_output().stdout).into_owned();
    assert!(table.contains("50.0 %"), "{table}");
}

#[test]
fn a_record_that_was_cut_off_is_measured_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.jsonl");
    write_predictions(&path);
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, &text[..text.len() - 9]).unwrap();
    let args = ["--predictions", "p.jsonl", "--no-people", "--json", "-"];
    let out = eval(folder.path(), &args).success();
    let figures: serde_json::Value = serde_json::from_slice(&out.get_output().stdout).unwrap();
    assert_eq!(figures["quiet"]["pictures"], 1);
    let said = String::from_utf8_lossy(&out.get_output().stderr).into_owned();
    assert!(said.contains("p.jsonl: cut off inside a frame"), "{said}");
}

/// As `infer` ends there.
#[test]
fn bench_tells_an_instruction_set_that_is_none() {
    let mut bench = Command::cargo_bin("edgecap").unwrap();
    bench.args(["bench", "--networks", "selecsls", "--seconds", "0"]);
    let failed = bench.env("EDGECAP_ISA", "abacus").assert().code(64);
    let said = String::from_utf8_lossy(&failed.get_output().stderr).into_owned();
    assert!(
        said.lines().count() == 1 && said.matches("abacus").count() == 1,
        "{said}"
    );
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

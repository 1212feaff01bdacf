//! Views and options that do not go together.

use std::path::Path;

use edgecap::camera::calibration::write_pose2sim;
use edgecap::lab::multiview::own::{own, steady};

use super::{files, record};
use crate::program::{assert_fails, output, stderr};

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
    let short = other("short", &lines[..4].join("\n"));
    let frame_by_frame = frame_by_frame.map(|arg| if arg == faster { &short } else { arg });
    assert_fails(&frame_by_frame, 65, &["one length", "30", "4"]);
    refused(&calibration, &at("nowhere/120.jsonl"), 66, &["nowhere"]);
    let missing = ["hall.jsonl", "No such file or directory (os error 2)"];
    refused(&calibration, &at("nowhere/hall.jsonl"), 66, &missing);
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
    let copy = format!("120={first}");
    refused(&calibration, &copy, 64, &["of its own", "0 and 120"]);
    // Somebody flipped all pictures.
    let mut seen = own(5, 3, 30, steady(5)).seen;
    for (view, people) in seen.iter_mut().flat_map(|frame| views.iter().zip(frame)) {
        for joint in people.iter_mut().flat_map(|p| &mut p.joints2d) {
            joint[0] = view.size[0] as f32 - 1.0 - joint[0];
        }
    }
    let flipped = folder.path().join("flipped");
    std::fs::create_dir(&flipped).unwrap();
    record(&flipped, &views, &seen);
    let names = ["0", "120", "240"].map(|v| at(&format!("flipped/{v}.jsonl")));
    let mut args = vec!["multiview", "--calibration", &calibration, "--out", &run];
    args.extend(names.iter().flat_map(|name| ["--view", name]));
    assert_fails(&args, 65, &["mirrored", "hflip"]);
}

#[test]
fn a_camera_that_is_named_has_to_be_the_only_one_of_its_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let views = files(folder.path(), 2, 12);
    let one = at("One.toml");
    std::fs::write(&one, write_pose2sim(&views[..1])).unwrap();
    let record = at("120.jsonl");
    let of = |view: &str, run: &str| {
        let (view, out) = (view.to_owned(), at(run));
        [
            "multiview",
            "--calibration",
            &one,
            "--view",
            &view,
            "--out",
            &out,
        ]
        .map(str::to_owned)
    };
    let wrong = of(&format!("nosuch={record}"), "wrong");
    let wrong = wrong.each_ref().map(String::as_str);
    assert_fails(&wrong, 64, &["nosuch", "cameras 0"]);
    // The file alone tells nothing.
    let unnamed = of(&record, "run");
    let out = output(&unnamed.each_ref().map(String::as_str));
    assert_ne!(out.status.code(), Some(64), "{}", stderr(&out));
}

#[test]
fn what_the_views_have_not_is_refused_before_the_fit() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 3, 12);
    let (calibration, run) = (at("Calib.toml"), at("run"));
    let (first, second) = (at("0.jsonl"), at("120.jsonl"));
    let base = [
        "multiview",
        "--calibration",
        &calibration,
        "--view",
        &first,
        "--view",
        &second,
        "--out",
        &run,
    ];
    for (more, words) in [
        (["--obj", "12"], &["frames 0 to 11", "12"]),
        (["--hold-out", "240"], &["views 0, 120", "240"]),
        (["--hold-out", "120"], &["two views", "1 of 2"]),
    ] {
        assert_fails(&[&base[..], &more].concat(), 64, words);
    }
}

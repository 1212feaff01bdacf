//! What somebody meets who uses the program for the first time: results that are found, words that help.

use std::process::Stdio;

use edgecap::message::{BodyFrame, Intrinsics, ObservationFrame};
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter};

use crate::program::{Running, assert_fails, edgecap, eventually, output, stderr, stdout, stream};

const SMALL: [&str; 4] = ["--size", "256x160", "--threads", "1"];

#[test]
fn observations_of_a_file_have_a_place_and_a_line_says_where() {
    let folder = tempfile::tempdir().unwrap();
    let photo = folder.path().join("écran 甲.png");
    image::RgbImage::new(64, 64).save(&photo).unwrap();
    let run = || {
        edgecap()
            .current_dir(folder.path())
            .args(["infer", "--input", "écran 甲.png"])
            .args(SMALL)
            .output()
            .unwrap()
    };
    for _ in 0..2 {
        let run = run();
        let said = stderr(&run);
        assert!(run.status.success(), "{said}");
        assert!(
            said.contains("1 frame, 0 with people → edgecap-out/écran_甲.observations.jsonl"),
            "{said}"
        );
    }
    let results = std::fs::read_dir(folder.path().join("edgecap-out")).unwrap();
    assert_eq!(results.count(), 1);
    let named = edgecap()
        .current_dir(folder.path())
        .args([
            "infer",
            "--input",
            "écran 甲.png",
            "--name",
            &stream("line"),
            "--jsonl",
            "o.jsonl",
        ])
        .args(SMALL)
        .output()
        .unwrap();
    let said = stderr(&named);
    assert!(said.contains("1 frame, 0 with people → o.jsonl"), "{said}");
}

#[test]
fn pictures_of_other_kinds_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(at("a.webp"), b"RIFF\x10\0\0\0WEBPVP8 ").unwrap();
    let out = at("out.jsonl");
    let args = ["infer", "--input", &at("a.webp"), "--jsonl", &out];
    assert_fails(&args, 65, &["found WebP", "convert it to JPEG or PNG"]);
    let folder_of = folder.path().to_str().unwrap();
    let args = ["infer", "--input", folder_of, "--jsonl", &out];
    assert_fails(
        &args,
        66,
        &["found none but 1 picture of another kind (a.webp"],
    );
    image::RgbImage::new(64, 64).save(at("b.png")).unwrap();
    let mut args = vec!["infer", "--input", folder_of, "--jsonl", "/dev/null"];
    args.extend(SMALL);
    let run = output(&args);
    assert!(run.status.success(), "{}", stderr(&run));
    assert!(
        stderr(&run).contains("left out: 1 picture of another kind (a.webp"),
        "{}",
        stderr(&run)
    );
}

#[test]
fn settings_with_which_no_run_starts_are_not_right() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edgecap.toml");
    let two = "[[camera]]\ninput = \"/dev/video97\"\n[[camera]]\ninput = \"/dev/video97\"\n";
    let room = "[multiview]\n\nroom = \"a b\"\n";
    for (text, place, words) in [
        ("[[camera]]\nname = \"a b\"\n", "2:1", "'a b'"),
        (
            "[[camera]]\n  name = \"a b\"\n",
            "2:3",
            "choose another with 'name'",
        ),
        (room, "3:1", "choose another with 'room'"),
        (
            "[multiview]\ncalibration = \"none.toml\"\n",
            "2:1",
            "calibration: expected a file or folder",
        ),
        (
            "[[camera]]\ninput = \"none.avi\"\nlive = true\n",
            "2:1",
            "input: expected a camera or a film",
        ),
        (
            two,
            "4:1",
            "input: camera0 and camera1: expected a device for each",
        ),
    ] {
        std::fs::write(&file, text).unwrap();
        let args = ["config", "check", "--config", file.to_str().unwrap()];
        let place = format!("edgecap.toml:{place}: ");
        assert_fails(&args, 78, &[&place, words]);
    }
}

#[test]
fn what_was_probably_meant_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let film = at("x.avi");
    std::fs::write(&film, b"RIFF\xFF\xFF\xFF\xFFAVI LIST").unwrap();
    let advice = format!("give it as --input {film}");
    assert_fails(&[&film], 64, &[&advice]);
    assert_fails(&["infer", &film], 64, &[&advice]);
    assert_fails(&["infer", "--input", &film, &film], 64, &["into a folder"]);
    for url in ["rtsp://host/1", "http://host/x.mp4"] {
        assert_fails(
            &["run", "--input", url],
            64,
            &[url, "network stream", "--input -"],
        );
    }
    let lacks = &["not provided: --view"];
    assert_fails(&["calibrate", "--out", &at("c.toml")], 64, lacks);
    for args in [
        &["export", &film, "--to", &at("a.csv")][..],
        &["view", "--listen", "127.0.0.1:0", "--record", &film],
    ] {
        assert_fails(args, 65, &["found a film", "edgecap run --input"]);
    }
    let bodies = at("bodies.jsonl");
    let mut writer = RecordWriter::<BodiesRow>::create(bodies.as_ref(), Format::Jsonl).unwrap();
    let mut frame = BodyFrame {
        count: 1,
        ..BodyFrame::default()
    };
    frame.bodies[0].id = 1;
    writer.write(&frame, "").unwrap();
    writer.finish().unwrap();
    let told = &["expected observations, found bodies", "edgecap infer"];
    assert_fails(
        &["fit", "--input", &bodies, "--jsonl", &at("b.jsonl")],
        65,
        told,
    );
    let views = [
        "calibrate",
        "--view",
        &bodies,
        "--view",
        &at("other"),
        "--out",
        &at("c.toml"),
    ];
    std::fs::copy(&bodies, at("other")).unwrap();
    assert_fails(&views, 65, told);
    let settings = at("edgecap.toml");
    std::fs::write(&settings, "[bridges]\nosc = \"localhost:9000\"\n").unwrap();
    let args = ["config", "check", "--config", &settings];
    assert_fails(&args, 78, &["2:7", "such as 127.0.0.1:9000"]);
    std::fs::write(&settings, "[bridges]\nvmc = \"127.0.0.1:65529\"\n").unwrap();
    assert_fails(&args, 78, &["2:7", "expected a port up to 65528"]);
}

#[test]
fn what_cannot_be_is_told_before_any_work() {
    assert_fails(&["bench", "--networks", "foo"], 64, &["foo"]);
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(at("x.avi"), b"RIFF\xFF\xFF\xFF\xFFAVI LIST").unwrap();
    let args = [
        "multiview",
        "--calibration",
        &at("x.avi"),
        "--view",
        "a",
        "--view",
        "b",
    ];
    assert_fails(
        &[&args[..], &["--out", &at("out")]].concat(),
        65,
        &["x.avi"],
    );
    let glb = "/proc/nowhere/a.glb";
    let args = [
        "run",
        "--input",
        "demo",
        "--export",
        glb,
        "--jsonl",
        "/dev/null",
    ];
    assert_fails(&args, 73, &[glb]);
}

#[test]
fn digests_say_what_they_are_of() {
    let file = std::fs::read_to_string("models/edgecap.ecm.blake3").unwrap();
    let file = file.split_whitespace().next().unwrap();
    let info = stdout(&output(&["model", "info"]));
    assert!(info.contains(&format!("{file} (the file)")), "{info}");
    let verified = stdout(&output(&["model", "verify"]));
    assert!(verified.contains(&format!("{file} (file)")), "{verified}");
    assert!(verified.contains("(contents)"), "{verified}");
}

#[test]
fn nobody_who_listens_is_no_failure() {
    let mut child = edgecap()
        .args(["model", "info"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let run = child.wait_with_output().unwrap();
    assert!(run.status.success(), "{}", stderr(&run));
    assert_eq!(stderr(&run), "");
}

#[test]
fn the_truth_about_another_clip_stays() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (one, other) = (at("a.avi"), at("b.avi"));
    let synth = |clip: &str, more: &[&str]| {
        let args = ["synth", "--clip", clip, "--frames", "1", "--people", "0"];
        output(&[&args[..], &["--width", "64", "--height", "64"], more].concat())
    };
    let folder = at("truth");
    let named: &[&str] = &["--out", &folder];
    assert!(synth(&one, named).status.success() && synth(&one, named).status.success());
    let refused = synth(&other, named);
    assert_eq!(refused.status.code(), Some(73));
    assert!(
        stderr(&refused).contains("that about a.avi"),
        "{}",
        stderr(&refused)
    );
    assert!(!std::path::Path::new(&other).exists());
}

#[test]
fn status_tells_whoever_publishes() {
    let place = crate::program::short_folder();
    let bodies = place.path().join("bodies.record");
    let mut writer = RecordWriter::<BodiesRow>::create(&bodies, Format::Binary).unwrap();
    writer.write(&BodyFrame::default(), "").unwrap();
    writer.finish().unwrap();
    let seen = place.path().join("seen.record");
    let mut writer = RecordWriter::<ObservationsRow>::create(&seen, Format::Binary).unwrap();
    let frame = ObservationFrame {
        width: 64,
        height: 48,
        intrinsics: Intrinsics {
            fx: 64.0,
            fy: 64.0,
            cx: 32.0,
            cy: 24.0,
        },
        ..ObservationFrame::default()
    };
    writer.write(&frame, "").unwrap();
    writer.finish().unwrap();
    let runtime = place.path().join("run");
    let start = |record: &std::path::Path, name: &str| {
        let child = edgecap()
            .env("EDGECAP_RUNTIME_DIR", &runtime)
            .args(["replay", "--loop", "--name", name])
            .arg(record)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        Running(child.unwrap())
    };
    let (played, told) = (stream("played"), stream("told"));
    let _both = (start(&bodies, &played), start(&seen, &told));
    let status = |more: &[&str]| {
        let mut status = edgecap();
        status
            .env("EDGECAP_RUNTIME_DIR", &runtime)
            .arg("status")
            .args(more);
        status.output().unwrap()
    };
    // Readers look at other places, too: more may run on this machine.
    eventually("both streams", || {
        let text = stdout(&status(&[]));
        let tells = |name: &str, kind: &str| {
            text.contains(&format!(
                "{name}: {kind} are published, but not by a run of cameras"
            ))
        };
        (tells(&played, "bodies") && tells(&told, "observations")).then_some(())
    });
    let json = stdout(&status(&["--json"]));
    assert!(
        json.contains("\"streams\"") && json.contains(&played),
        "{json}"
    );
}

#[test]
fn clips_beside_each_other_have_their_own_truth() {
    let folder = tempfile::tempdir().unwrap();
    for clip in ["long", "short"] {
        let film = folder.path().join(clip).with_extension("avi");
        let args = ["synth", "--frames", "1", "--people", "0", "--width", "64"];
        let to = ["--height", "64", "--clip", film.to_str().unwrap()];
        let made = output(&[&args[..], &to].concat());
        assert!(made.status.success(), "{}", stderr(&made));
        let truth = std::fs::read_to_string(film.with_extension("truth.json")).unwrap();
        assert!(truth.contains(&format!("\"{clip}.avi\"")), "{truth}");
    }
}

#[test]
fn help_about_help_is_help() {
    for ask in ["--help", "-h"] {
        let told = output(&["help", ask]);
        assert!(told.status.success(), "{}", stderr(&told));
        assert_eq!(stdout(&told), stdout(&output(&["help"])));
    }
}

#[test]
fn help_says_what_reads_a_record_of_bodies() {
    let help = stdout(&output(&["run", "--help"]));
    let words = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let record = words.split("--record <FILE>").nth(1).unwrap();
    assert!(
        record.contains(
            "of bodies (run, fit) 'export', 'plot', 'replay', 'events', 'eval' and 'view"
        ),
        "{record}"
    );
}

#[test]
fn help_says_where_results_go() {
    for verb in ["run", "infer"] {
        let help = stdout(&output(&[verb, "--help"]));
        assert!(help.contains("edgecap-out/"), "{verb}: {help}");
    }
}

//! Options and settings with values that mean nothing or never end, or that would do nothing.

use crate::program::{assert_fails, edgecap, output, stderr};

/// A user who mistypes a number or a path is told which, and what would do.
#[test]
fn what_was_expected_is_said_in_the_users_words() {
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.ecm");
    std::fs::write(&bad, "no model").unwrap();
    let bad = bad.to_str().unwrap();
    let record = folder.path().join("bodies.jsonl");
    let run = [
        "run",
        "--input",
        "demo",
        "--jsonl",
        record.to_str().unwrap(),
    ];
    let run = |more: &[&'static str]| [&run[..], more].concat();
    for (args, code, words) in [
        (
            run(&["--rate", "59.94"]),
            64,
            ["--rate", "expected a whole number from 1 to 240"],
        ),
        (
            run(&["--events", "/nowhere.toml"]),
            78,
            ["--events", "/nowhere.toml"],
        ),
        (
            vec!["events", "--settings", "/nowhere.toml"],
            78,
            ["--settings", "/nowhere.toml"],
        ),
        (
            vec!["fit", "--rate", "0"],
            64,
            ["--rate", "expected a whole number from 1 to 240"],
        ),
        (
            run(&["--fit-config", "/nowhere.toml"]),
            78,
            ["/nowhere.toml", "expected settings of the fit"],
        ),
        (
            vec!["bench", "--model", bad, "--threads", "1"],
            65,
            ["bad.ecm", "no model"],
        ),
        (
            vec!["replay", "x.record", "--speed", "-1"],
            64,
            ["--speed", "expected a factor from 0.01 to 100"],
        ),
        (
            vec!["record", "x.record", "--seconds", "-1"],
            64,
            ["--seconds <SECONDS>", "-1 is not in"],
        ),
        (
            vec!["synth", "--clip", "s1.mp4"],
            64,
            ["s1.mp4", "ends in .avi"],
        ),
        (vec!["model"], 64, ["requires a subcommand", "verify"]),
    ] {
        assert_fails(&args, code, &words);
    }
    assert!(!record.exists());
}

#[test]
fn command_lines_that_mean_nothing() {
    for args in [
        &["infer", "--size", "100x100"][..],
        &["run", "--rate", "0"],
        &["fly"],
        &["fit", "--input", "x"],
    ] {
        assert_eq!(output(args).status.code(), Some(64), "{args:?}");
    }
}

#[test]
fn options_that_would_do_nothing_are_refused() {
    let record = ["fit", "--input", "x.jsonl", "--jsonl", "/dev/null"];
    for more in [["--events", "x"], ["--rate", "30"], ["--name", "hall"]] {
        assert_fails(&[&record[..], &more].concat(), 64, &[more[0], "--input"]);
    }
    assert_fails(&["fit", "--camera", "lens.toml"], 64, &["--input"]);
    let run = ["run", "--input", "demo", "--jsonl", "/dev/null"];
    for more in [
        ["--metrics", "127.0.0.1:0"],
        ["--rate", "60"],
        ["--max-fps", "5"],
        ["--fps", "10"],
        ["--capture-size", "64x64"],
        ["--control", "gain=1"],
    ] {
        assert_fails(
            &[&run[..], &more].concat(),
            64,
            &[more[0], "expected a camera"],
        );
    }
}

#[test]
fn a_setting_out_of_its_range_is_named_with_its_file_and_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (config, out) = (at("fit.toml"), at("out.jsonl"));
    std::fs::write(&config, "height = 1.8\n[filter2d]\nmin_cutoff = 0\n").unwrap();
    let words = ["fit.toml:3:1: expected filter2d.min_cutoff from", "found 0"];
    let args = ["fit", "--input", "x", "--jsonl", &out, "--config", &config];
    assert_fails(&args, 78, &words);
    let args = ["run", "--input", "demo", "--jsonl", &out, "--fit-config"];
    assert_fails(&[&args[..], &[&config]].concat(), 78, &words);
}

#[test]
fn files_that_do_not_end_are_refused_before_they_fill_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    let lines = folder.path().join("lines.jsonl");
    std::fs::write(&lines, "").unwrap();
    let lines = lines.to_str().unwrap();
    let out = folder.path().join("out.jsonl");
    let out = out.to_str().unwrap();
    let fit = ["fit", "--input", lines, "--jsonl", out];
    let refused =
        |args: &[&str], code| assert_fails(args, code, &["/dev/zero", "expected at most"]);
    refused(&[&fit[..], &["--config", "/dev/zero"]].concat(), 78);
    refused(&[&fit[..], &["--camera", "/dev/zero"]].concat(), 65);
}

/// For run, infer and fit `--camera` is the lens, for the others the camera.
#[test]
fn a_camera_where_a_lens_is_expected() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (seen, to) = (path("seen.jsonl"), path("to.jsonl"));
    std::fs::write(&seen, "").unwrap();
    let lens = ["--jsonl", &to, "--camera", "hall"];
    for verb in ["run", "infer", "fit"] {
        let input = if verb == "fit" { &seen } else { "demo" };
        let args = [&[verb, "--input", input][..], &lens].concat();
        assert_fails(&args, 66, &["hall", "--camera", "lens", "--name"]);
    }
}

#[test]
fn a_log_that_cannot_be_chosen_is_told() {
    use std::os::unix::ffi::OsStrExt;
    let said = |wanted: &[u8]| {
        let out = edgecap()
            .args(["model", "contract", "--arch", "selecsls"])
            .env("EDGECAP_LOG", std::ffi::OsStr::from_bytes(wanted))
            .output()
            .unwrap();
        assert!(out.status.success());
        let said = stderr(&out);
        let mut told = said.lines().filter(|line| line.contains("EDGECAP_LOG="));
        let line = told.next().unwrap_or_default().to_owned();
        assert!(told.next().is_none(), "{said}");
        line
    };
    for (wanted, why) in [
        (
            &b"edgecap="[..],
            "edgecap=: 'edgecap=' has no level; expected error",
        ),
        (
            b"info,edgecap::capture=",
            "'edgecap::capture=' has no level",
        ),
        (b"edgecap=inof", "expected error, warn, info"),
        (b"inf\xff", "inf\u{fffd}: not in UTF-8; expected error"),
    ] {
        let told = said(wanted);
        assert!(told.contains(why), "{told}");
    }
    assert_eq!(said(b"warn,"), "");
}

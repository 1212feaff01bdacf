//! Wrong input gets one clear line and a sysexits code, and nothing is left behind.

use edgecap::message::{BodyFrame, Intrinsics, ObservationFrame};
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter};

use crate::program::{assert_fails, edgecap, output, stderr, stream};

#[test]
fn inputs_that_are_not_there() {
    let empty = tempfile::tempdir().unwrap();
    let folder = empty.path().to_str().unwrap();
    for verb in ["infer", "run"] {
        assert_fails(
            &[
                verb,
                "--input",
                "/nowhere/clip.y4m",
                "--name",
                &stream("none"),
            ],
            66,
            &["/nowhere/clip.y4m"],
        );
        assert_fails(
            &[verb, "--input", folder, "--name", &stream("empty")],
            66,
            &[folder],
        );
        let name = stream("camera");
        let mut args = vec![verb, "--input", "/dev/video97", "--name", &name];
        if verb == "run" {
            // Else it waits for the camera.
            args.push("--no-wait");
        }
        assert_fails(&args, 69, &["/dev/video97"]);
    }
    // No camera comes below /dev/shm, nor under the name of a film.
    for film in ["/dev/shm/none.avi", "/dev/shm/none", "/dev/none.avi"] {
        let args = ["run", "--input", film, "--name", &stream("no-film")];
        assert_fails(&args, 66, &[film, "no such file"]);
    }
    let here = tempfile::tempdir().unwrap();
    let out = crate::program::edgecap()
        .current_dir(here.path())
        .args([
            "run",
            "--input",
            "/nowhere/clip.y4m",
            "--name",
            &stream("here"),
        ])
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(66));
    let left = std::fs::read_dir(here.path()).unwrap().count();
    assert_eq!(left, 0, "a failed run leaves no folder");
}

/// A folder opens as a file does: without a look at what was opened it fails as a disk would.
#[test]
fn a_folder_is_no_record() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let take = at("take");
    std::fs::create_dir(&take).unwrap();
    let name = stream("folder");
    for args in [
        &["events", "--input", &take][..],
        &["view", "--record", &take, "--listen", "127.0.0.1:0"],
        &["plot", &take, "--to", &at("plot.svg")],
        &["export", &take, "--to", &at("take.bvh")],
        &["fit", "--input", &take, "--jsonl", &at("bodies.jsonl")],
        &["multiview", "--view", &take, "--out", &at("shapes")],
        &["replay", &take, "--name", &name],
    ] {
        let expected =
            format!("cannot open {take}: expected a record, found a folder; check the path");
        assert_fails(args, 66, &[&expected]);
    }
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 1, "only the folder is left");
}

/// Tried again, it would lead nowhere again.
#[test]
fn an_input_that_cannot_exist_ends_a_film_that_would_play_without_end() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let below = file.join("clip.y4m");
    let below = below.to_str().unwrap();
    let args = ["--input", below, "--name", &stream("nowhere")];
    for verb in [
        &["run"][..],
        &["infer"],
        &["run", "--live"],
        &["infer", "--live"],
    ] {
        assert_fails(&[verb, &args].concat(), 66, &[below, "check the path"]);
    }
}

#[test]
fn content_that_is_no_picture() {
    let folder = tempfile::tempdir().unwrap();
    for (file, bytes) in [
        ("a.jpg", &b"not a picture"[..]),
        ("b.png", b"\x89PNG\r\n\x1a\n"),
        ("c.y4m", b"YUV4MPEG2 W16 H"),
        ("d.avi", b"RIFF"),
    ] {
        let path = folder.path().join(file);
        std::fs::write(&path, bytes).unwrap();
        let out = folder.path().join("out.jsonl");
        assert_fails(
            &[
                "infer",
                "--input",
                path.to_str().unwrap(),
                "--jsonl",
                out.to_str().unwrap(),
            ],
            65,
            &[file],
        );
        assert!(!out.exists(), "{file}: half a result is left");
    }
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 4, "only the inputs are left");
}

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

/// The system would end the process with a signal.
#[test]
fn a_file_that_may_not_grow_any_further_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("bodies.jsonl");
    let run = edgecap();
    let mut limited = std::process::Command::new("sh");
    limited.envs(
        run.get_envs()
            .filter_map(|(key, value)| Some((key, value?))),
    );
    let script =
        "ulimit -f 20; exec \"$0\" run --input demo --size 256x160 --threads 1 --jsonl \"$1\"";
    limited.args(["-c", script]).arg(run.get_program()).arg(&to);
    let out = limited.output().unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(74), "{said}");
    let told: Vec<&str> = said
        .lines()
        .filter(|l| l.starts_with("edgecap: "))
        .collect();
    assert_eq!(told.len(), 1, "{said}");
    assert!(told[0].contains("bodies.jsonl: writing stopped"), "{said}");
    let kept = std::fs::read_to_string(&to).unwrap();
    assert!(kept.ends_with("}\n"), "whole lines are kept");
}

#[test]
fn outputs_that_cannot_be_written() {
    let out = ["--jsonl", "/proc/nowhere/out.jsonl"];
    assert_fails(
        &["infer", "--input", "demo", out[0], out[1]],
        73,
        &["/proc/nowhere/out.jsonl"],
    );
    assert_fails(
        &[
            "run",
            "--input",
            "demo",
            "--name",
            &stream("out"),
            out[0],
            out[1],
        ],
        73,
        &["/proc/nowhere/out.jsonl"],
    );
}

#[test]
fn a_calibration_on_no_pictures() {
    let import = ["model", "import", "weights.safetensors", "-o", "out.ecm"];
    let none = [&import[..], &["--pictures", "0"]].concat();
    assert_fails(&none, 64, &["--pictures", "0"]);
}

#[test]
fn a_model_that_is_corrupt() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.ecm");
    std::fs::write(&path, [0x40u8; 4096]).unwrap();
    let out = folder.path().join("out.jsonl");
    assert_fails(
        &[
            "infer",
            "--input",
            "demo",
            "--model",
            path.to_str().unwrap(),
            "--jsonl",
            out.to_str().unwrap(),
        ],
        65,
        &["bad.ecm"],
    );
}

#[test]
fn stage2_weights_that_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.jsonl");
    let fails = |stage2: &str, model: &str, code, says: &[&str]| {
        let mut args = vec!["infer", "--input", "demo", "--model", model];
        if !stage2.is_empty() {
            args.extend(["--stage2", stage2]);
        }
        args.extend(["--jsonl", out.to_str().unwrap()]);
        assert_fails(&args, code, says);
        assert!(!out.exists(), "{args:?} left its output behind");
    };
    let (stage1, stage2) = (
        "models/weights/stage1.safetensors",
        "models/weights/stage2.safetensors",
    );
    fails(
        "/nowhere/lift.safetensors",
        stage1,
        66,
        &["/nowhere/lift.safetensors"],
    );
    fails("", stage1, 65, &["--stage2"]);
    let cut = folder.path().join("cut.safetensors");
    let whole = std::fs::read(stage2).unwrap();
    std::fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    fails(
        cut.to_str().unwrap(),
        stage1,
        65,
        &["Stage II", "cut.safetensors"],
    );
    // Stage I's weights are no Stage II.
    fails(stage1, stage1, 65, &["Stage II", stage1]);
}

#[test]
fn command_lines_that_mean_nothing() {
    for args in [
        &["infer", "--size", "100x100"][..],
        &["run", "--rate", "0"],
        &["fly"],
        &["fit", "--input", "x"],
    ] {
        assert_eq!(
            crate::program::output(args).status.code(),
            Some(64),
            "{args:?}"
        );
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
fn a_record_that_is_cut_off_inside_its_first_frame_holds_none() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (seen, bodies, to) = (at("seen.record"), at("bodies.record"), at("to.jsonl"));
    let mut writer =
        RecordWriter::<ObservationsRow>::create(seen.as_ref(), Format::Binary).unwrap();
    writer.write(&ObservationFrame::default(), "").unwrap();
    writer.finish().unwrap();
    let mut writer = RecordWriter::<BodiesRow>::create(bodies.as_ref(), Format::Binary).unwrap();
    writer.write(&BodyFrame::default(), "").unwrap();
    writer.finish().unwrap();
    for record in [&seen, &bodies] {
        let bytes = std::fs::read(record).unwrap();
        std::fs::write(record, &bytes[..bytes.len() - 1]).unwrap();
    }
    let fit = ["fit", "--input", &seen, "--jsonl", &to];
    assert_fails(&fit, 65, &["seen.record", "cut off inside its first frame"]);
    assert!(!folder.path().join("to.jsonl").exists());
    let export = ["export", &bodies, "--to", &at("x.csv")];
    assert_fails(&export, 65, &["bodies.record"]);
    let view = ["view", "--record", &bodies, "--listen", "127.0.0.1:0"];
    let cut = "cut off inside its first frame";
    assert_fails(&view, 65, &["bodies.record", cut]);
    let again = at("again.record");
    std::fs::copy(&seen, &again).unwrap();
    let views = [("a", &seen), ("b", &again)].map(|(name, file)| format!("--view={name}={file}"));
    let calibrate = ["calibrate", "--out", &to, &views[0], &views[1]];
    assert_fails(&calibrate, 65, &["seen.record", cut]);
    let multiview = ["multiview", "--out", &at("run"), "--view", &seen];
    assert_fails(&multiview, 65, &["seen.record", cut]);
}

#[test]
fn times_that_do_not_rise_are_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (seen, to) = (at("seen.jsonl"), at("to.jsonl"));
    let mut writer = RecordWriter::<ObservationsRow>::create(seen.as_ref(), Format::Jsonl).unwrap();
    for sequence in 0..4 {
        let frame = ObservationFrame {
            sequence,
            width: 640,
            height: 480,
            intrinsics: Intrinsics::from_horizontal_fov(640, 480, 60.0),
            ..ObservationFrame::default()
        };
        writer.write(&frame, "").unwrap();
    }
    writer.finish().unwrap();
    let fit = ["fit", "--input", &seen, "--jsonl", &to];
    for (more, warnings) in [(&[][..], 1), (&["--stills"], 0)] {
        let out = output(&[&fit[..], more].concat());
        let said = stderr(&out);
        assert!(out.status.success(), "{said}");
        let told = said
            .matches("expected times that rise, found frame 2")
            .count();
        assert_eq!(told, warnings, "{said}");
        assert!(said.contains(&format!("4 frames → {to}")), "{said}");
        let lines = std::fs::read_to_string(&to).unwrap();
        assert_eq!(lines.lines().count(), 4);
    }
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

#[test]
fn what_the_user_can_mend_is_no_fault_of_the_program() {
    for variable in ["EDGECAP_ISA", "EDGECAP_ALGORITHM"] {
        let out = crate::program::edgecap()
            .args(["infer", "--input", "demo", "--jsonl", "/dev/null"])
            .env(variable, "abacus")
            .output()
            .unwrap();
        let text = stderr(&out);
        assert_eq!(out.status.code(), Some(64), "{text}");
        assert!(text.contains(variable), "{text}");
    }
    assert_fails(
        &["synth", "--frames", "1", "--out", "/dev/full"],
        73,
        &["/dev/full"],
    );
    assert_fails(
        &[
            "infer",
            "--input",
            "demo",
            "--size",
            "64x64",
            "--jsonl",
            "/dev/full",
        ],
        74,
        &["/dev/full", "full"],
    );
}

#[test]
fn networks_and_pictures_that_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path.to_str().unwrap().to_owned()
    };
    assert_fails(
        &["model", "contract", "--arch", "nonesuch"],
        64,
        &["nonesuch", "selecsls"],
    );
    let broken = file("broken.toml", "name = \"x\"\nlayers = [");
    assert_fails(
        &["model", "contract", "--arch", &broken],
        65,
        &["broken.toml:2:"],
    );
    let shipped = std::fs::read_to_string("models/selecsls.toml").unwrap();
    let pool = "kernel = 3, stride = 2 },\n  { kind = \"maxpool\", name = \"trap\", \
                kernel = 4611686018427387905, stride = 1 },";
    let trap = file(
        "trap.toml",
        &shipped.replacen("kernel = 3, stride = 2 },", pool, 1),
    );
    assert_fails(
        &["model", "contract", "--arch", &trap],
        65,
        &["trap.toml", "4611686018427387905"],
    );
    let picture = file("broken.jpg", "no picture");
    let maps = folder.path().join("maps.npz");
    let maps = maps.to_str().unwrap();
    assert_fails(
        &[
            "model",
            "run",
            "models/edgecap.ecm",
            "--image",
            &picture,
            "--npz",
            maps,
        ],
        65,
        &["broken.jpg"],
    );
    let stage1 = "models/weights/stage1.safetensors";
    let model = folder.path().join("x.ecm");
    let import = ["model", "import", stage1, "-o", model.to_str().unwrap()];
    let calibrate = |pictures: &str, code| {
        let arguments = [&import[..], &["--calibrate", pictures]].concat();
        assert_fails(&arguments, code, &[pictures]);
    };
    calibrate("/nowhere", 66);
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    calibrate(empty.to_str().unwrap(), 66);
    assert!(!model.exists());
}

/// Whichever verb meets it.
#[test]
fn the_same_mistake_has_the_same_code() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (full, none, out) = (at("full"), at("none"), at("out"));
    std::fs::create_dir(&full).unwrap();
    std::fs::write(at("full/mine.txt"), "keep").unwrap();
    for args in [
        &["synth", "--out", &full][..],
        &["synth", "--views", "2", "--out", &full],
        &["multiview", "--view", "a", "--out", &full],
    ] {
        assert_fails(args, 73, &["expected a new or empty folder", &full]);
    }
    for model in [&none, &full] {
        for args in [
            &["model", "info", model][..],
            &["model", "verify", model],
            &["model", "import", model, "-o", &out],
            &["model", "import", model, "--check"],
            &[
                "model",
                "run",
                model,
                "--image",
                "docs/demo.jpg",
                "--npz",
                &out,
            ],
            &["bench", "--model", model, "--threads", "1"],
            &[
                "infer", "--input", "demo", "--model", model, "--jsonl", &out,
            ],
        ] {
            assert_fails(args, 66, &[model]);
        }
    }
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 1, "only the folder is left");
}

#[test]
fn what_was_asked_for_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    // Names of other films and of pictures are no folders.
    for name in ["x.mp4", "x.webm", "x.png"] {
        let to = path(name);
        let args = ["infer", "--input", "demo", "--overlay", &to];
        assert_fails(&args, 64, &[name, "ends in .avi"]);
        assert!(!folder.path().join(name).exists());
    }
    let empty = path("empty.jsonl");
    std::fs::write(&empty, "").unwrap();
    let to = path("bodies.jsonl");
    let no_bodies = "expected a record of bodies, found no frame in it";
    assert_fails(&["events", "--input", &empty], 65, &[no_bodies]);
    let args = ["fit", "--input", &empty, "--jsonl", &to];
    assert_fails(
        &args,
        65,
        &["expected a record of observations, found no frame"],
    );
    // Observations are no bodies.
    let seen = path("seen.record");
    let mut writer =
        RecordWriter::<ObservationsRow>::create(seen.as_ref(), Format::Binary).unwrap();
    writer.write(&ObservationFrame::default(), "").unwrap();
    writer.finish().unwrap();
    let args = ["export", &seen, "--to", &path("x.csv")];
    assert_fails(&args, 65, &["found observations", "edgecap fit --input"]);
    let png = path("x.png");
    assert_fails(&["plot", &to, "--to", &png], 64, &["ends in .svg"]);
    assert_fails(&["run", "--sise", "64x64"], 64, &["--sise", "'--size'"]);
    assert_fails(&["infer", "--threads", "no"], 64, &["'no'", "--threads"]);
}

#[test]
fn a_recording_of_nobody_ends_in_time_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("x.record");
    let name = stream("record-nobody");
    let args = [
        "record",
        to.to_str().unwrap(),
        "--camera",
        &name,
        "--seconds",
        "1",
    ];
    assert_fails(&args, 69, &[&name, "nothing was recorded"]);
    assert!(!to.exists());
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
fn a_contract_says_what_is_yours() {
    let said = |more: &[&str]| stderr(&output(&[&["model", "contract"], more].concat()));
    let (first, second) = (said(&[]), said(&["--stage2"]));
    for key in ["trained_on", "batchnorm_eps"] {
        assert!(
            first.contains(key) && second.contains(key),
            "{first}{second}"
        );
    }
    for key in ["reference_size", "outputs", "bones_at", "encodings_trained"] {
        assert!(
            first.contains(key) && !second.contains(key),
            "{key}: {second}"
        );
    }
}

/// Names of files need not be UTF-8.
#[test]
fn arguments_of_other_bytes_are_answered_as_any_other() {
    use std::os::unix::ffi::OsStrExt;
    let other = std::ffi::OsStr::from_bytes(b"x\xff");
    let out = edgecap()
        .args(["run", "film.avi"])
        .arg(other)
        .output()
        .unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(64), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    let out = edgecap()
        .args(["run", "--input"])
        .arg(other)
        .output()
        .unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(64), "{said}");
    assert!(said.contains("--input: expected a path in UTF-8"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    // What settings hold, too.
    for option in [
        "--jsonl",
        "--record",
        "--model",
        "--stage2",
        "--flight",
        "--calibration",
    ] {
        let run = edgecap()
            .args(["run", "--input", "demo", option])
            .arg(other)
            .output();
        let run = run.unwrap();
        let said = stderr(&run);
        assert_eq!(run.status.code(), Some(64), "{said}");
        let words = format!("{option}: expected a path in UTF-8");
        assert!(said.contains(&words), "{said}");
        assert_fails(&["run", "--input", "demo", option, ""], 64, &[option]);
    }
}

/// Paths may be of any bytes for the most part: what must be text is named.
#[test]
fn options_that_must_be_text_are_named_where_they_are_of_other_bytes() {
    use std::os::unix::ffi::OsStrExt;
    let other = std::ffi::OsStr::from_bytes(b"x\xff");
    let refused = |args: &[&std::ffi::OsStr], option: &str| {
        let out = edgecap().args(args).output().unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(64), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        let words = format!("{option}: expected text in UTF-8, found x\u{fffd}; name it otherwise");
        assert!(said.contains(&words), "{said}");
    };
    for (verb, option) in [
        ("run", "--name"),
        ("run", "--camera"),
        ("watch", "--name"),
        ("view", "--camera"),
        ("calibrate", "--view"),
        ("multiview", "--view"),
        ("fit", "--fit-config"),
    ] {
        let words = [verb, option].map(std::ffi::OsStr::new);
        refused(&[words[0], words[1], other], option);
        let joined = [format!("{option}=").as_bytes(), other.as_bytes()].concat();
        refused(&[words[0], std::ffi::OsStr::from_bytes(&joined)], option);
    }
    // Not the path before it, which may be so.
    let words = ["multiview", "--out", "--view"].map(std::ffi::OsStr::new);
    refused(&[words[0], words[1], other, words[2], other], "--view");
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

/// A pipe can be read once, so that nothing on it plays over and over.
#[test]
fn a_pipe_does_not_play_like_a_camera() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe").to_str().unwrap().to_owned();
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    for verb in ["run", "infer"] {
        let args = [verb, "--live", "--input", &pipe];
        assert_fails(&args, 64, &["--live", "expected a file, found the pipe"]);
        assert_fails(
            &[verb, "--live", "--input", "-"],
            64,
            &["found standard input"],
        );
    }
}

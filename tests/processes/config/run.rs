//! How a run or `fit` takes the settings: it obeys them, says of them what a check says, and blames them for nothing
//! else.

use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use edgecap::message::BodyFrame;
use edgecap_client::Subscriber;

use crate::program::stand_in::StandIn;
use crate::program::{self, Running, edgecap, eventually, signal};

/// Linux lets no argument of a process be so long.
#[test]
fn a_run_takes_settings_of_any_length() {
    let folder = tempfile::tempdir().unwrap();
    let camera = StandIn::new(30.0);
    let name = program::stream("long-settings");
    let corner = |n: u32| {
        let a = f64::from(n) * std::f64::consts::TAU / 64.0;
        format!("[{:?}, {:?}]", a.cos(), a.sin())
    };
    let corners: Vec<String> = (0..64).map(corner).collect();
    let zone = |n| format!("{{ name = \"{n}\", corners = [{}] }}", corners.join(", "));
    let zones: Vec<String> = (0..110).map(zone).collect();
    let text = format!(
        "[network]\nsize = \"64x64\"\nthreads = 1\n\
        [[camera]]\nname = {name:?}\ninput = {:?}\nevents = {{ zone = [{}] }}\n",
        camera.input(),
        zones.join(", ")
    );
    assert!(text.len() > 128 << 10);
    let file = folder.path().join("edgecap.toml");
    std::fs::write(&file, text).unwrap();
    let run = Running::start(&["run", "--config", file.to_str().unwrap()]);
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    eventually("bodies", || {
        assert!(!run.has_ended());
        bodies.next(Duration::from_millis(100)).unwrap().map(drop)
    });
    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", program::stderr(&out));
}

/// What was typed is of the command line.
#[test]
fn a_run_says_of_the_file_what_a_check_says() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edgecap.toml");
    let film = "[[camera]]\ninput = \"demo\"\n";
    let camera = format!("{film}live = true\n");
    let said = |args: &[&str], more: &[&str]| {
        let mut verb = edgecap();
        verb.args(args).arg("--config").arg(&file).args(more);
        let out = verb.current_dir(folder.path()).output().unwrap();
        (out.status.code(), program::stderr(&out))
    };
    let bridges = "[bridges]\nvmc = \"127.0.0.1:39539\"\n";
    let vmc = ["--vmc", "127.0.0.1:39539"];
    let figures = format!("{camera}[metrics]\naddress = \"127.0.0.1:19746\"\n");
    for (text, typed) in [
        (camera.repeat(2) + bridges, Some((camera.repeat(2), vmc))),
        (film.repeat(2), None),
        (
            format!("{film}max_fps = 5.0\n"),
            Some((film.to_owned(), ["--max-fps", "5"])),
        ),
        (
            format!("{camera}name = \"a b\"\n"),
            Some((camera.clone(), ["--name", "a b"])),
        ),
        (
            format!("{film}fit = \"none.toml\"\n"),
            Some((film.to_owned(), ["--fit-config", "none.toml"])),
        ),
        (format!("{film}jsonl = \"a\"\nrecord = \"a\"\n"), None),
        (
            format!("{figures}[bridges]\nview = \"127.0.0.1:19746\"\n"),
            Some((figures.clone(), ["--view", "127.0.0.1:19746"])),
        ),
        ("[[camera]]\ninput = \"/dev/video97\"\n".repeat(2), None),
    ] {
        std::fs::write(&file, &text).unwrap();
        let checked = said(&["config", "check"], &[]);
        assert_eq!(checked.0, Some(78), "{text}: {}", checked.1);
        assert!(checked.1.contains("edgecap.toml:"), "{text}: {}", checked.1);
        assert_eq!(said(&["run"], &[]), checked, "{text}");
        let Some((text, typed)) = typed else {
            continue;
        };
        std::fs::write(&file, &text).unwrap();
        let (code, told) = said(&["run"], &typed);
        let of_a_file = typed[0] == "--fit-config";
        assert_eq!(code, Some(if of_a_file { 78 } else { 64 }), "{told}");
        assert!(!told.contains("edgecap.toml:"), "{told}");
    }
    // Its process has said why.
    let both = format!("{camera}[network]\nsize = \"64x64\"\nquality = \"fast\"\n");
    std::fs::write(&file, both).unwrap();
    let (code, told) = said(&["run"], &["--name", &program::stream("both")]);
    assert_eq!(code, Some(78), "{told}");
}

/// The lens of the file reaches the process that needs it: a calibration for another shape ends it.
#[test]
fn a_run_obeys_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edgecap.toml");
    let text = "[[camera]]\ninput = \"demo\"\nlive = true\nname = \"NAME\"\nlens = { fx = 500, cx = 250, cy = 250, width = 500, height = 500 }\n[network]\nsize = \"256x160\"\n";
    std::fs::write(&file, text.replace("NAME", &program::stream("lens"))).unwrap();
    let run = |path: &Path| {
        edgecap()
            .args(["run", "--config"])
            .arg(path)
            .output()
            .unwrap()
    };
    let out = run(&file);
    assert_eq!(out.status.code(), Some(78), "{}", program::stderr(&out));
    assert!(program::stderr(&out).contains("calibrated for 500x500"));
}

#[test]
fn settings_of_the_fit_stand_with_and_without_their_header() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (file, none, out) = (at("fit.toml"), at("none.jsonl"), at("bodies.jsonl"));
    for (text, code, words) in [
        ("height = 1.8", 66, "none.jsonl"),
        ("[fit]\nheight = 1.8", 66, "none.jsonl"),
        ("[fit.terms]\ncontact = 0.5", 66, "none.jsonl"),
        ("heigth = 1.8", 78, "fit.toml:1:1: unknown key 'heigth'"),
        (
            "[fit]\nheigth = 1.8",
            78,
            "fit.toml:2:1: unknown key 'heigth'",
        ),
        ("[fit]\n[network]", 78, "unknown key 'network'"),
    ] {
        std::fs::write(&file, text).unwrap();
        for option in ["--fit-config", "--config"] {
            let args = ["fit", "--input", &none, "--jsonl", &out, option, &file];
            program::assert_fails(&args, code, &[words]);
        }
    }
}

/// A service would be started again and again.
#[test]
fn what_settings_name_and_nobody_can_have_ends_a_run_for_good() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edgecap.toml");
    let run = |text: &str, more: &[&str]| {
        std::fs::write(&file, text).unwrap();
        let config = ["run", "--config", file.to_str().unwrap()];
        let small = ["--size", "64x64", "--threads", "1"];
        let out = edgecap().args(config).args(small).args(more).output();
        let out = out.unwrap();
        (out.status.code(), program::stderr(&out))
    };
    let camera = StandIn::new(30.0);
    let name = program::stream("named");
    let film = format!("[[camera]]\nname = {name:?}\n");
    let camera = format!("{film}input = {:?}\n", camera.input());
    // Nobody can have what lies below a file.
    let blocked = folder.path().join("file");
    std::fs::write(&blocked, "").unwrap();
    let at = |name: &str| blocked.join(name).to_str().unwrap().to_owned();
    let (lens, record, flight) = (at("none.toml"), at("a.bin"), at("last"));
    for (text, word) in [
        (format!("{camera}lens = \"none.toml\"\n"), "none.toml"),
        (format!("{camera}lens = {lens:?}\n"), "none.toml"),
        (format!("{camera}lens = \".\"\n"), "directory"),
        (format!("{camera}record = {record:?}\n"), "a.bin"),
        (format!("{camera}[bridges]\nflight = {flight:?}\n"), "last"),
        (
            format!("{camera}[network]\nmodel = \"none.ecm\"\n"),
            "none.ecm",
        ),
        (
            format!("{camera}[network]\nstage2 = \"none.st\"\n"),
            "none.st",
        ),
        (
            format!("{film}input = \"none.avi\"\nlive = true\n"),
            "none.avi",
        ),
    ] {
        let (code, said) = run(&text, &[]);
        assert_eq!(code, Some(78), "{text}: {said}");
        let told = said.lines().filter(|l| l.starts_with("edgecap: "));
        assert_eq!(told.count(), 1, "{text}: {said}");
        assert!(said.contains(word), "{text}: {said}");
    }
    // What is typed is of the command line.
    let (code, said) = run(&camera, &["--name", &name, "--camera", "/none.toml"]);
    assert_eq!(code, Some(66), "{said}");
    let (code, said) = run(&camera, &["--name", &name, "--record", &record]);
    assert_eq!(code, Some(73), "{said}");
}

/// A service would be told of what it does not need, and not be started again where it could be.
#[test]
fn a_run_that_ends_over_something_else_does_not_blame_the_settings() {
    let folder = tempfile::tempdir().unwrap();
    let blocked = folder.path().join("file");
    std::fs::write(&blocked, "").unwrap();
    let record = blocked.join("a.bin");
    let record = record.to_str().unwrap();
    let file = folder.path().join("edgecap.toml");
    let room = "[multiview]\ncalibration = \"gone.toml\"\nroom = \"a b\"\n";
    let model = "[network]\nmodel = \"gone.ecm\"\n";
    let name = program::stream("other-mistake");
    let lens = ["--input", "demo", "--camera", "away.toml"];
    for (text, typed, code, word) in [
        (room, &["--input", "away.avi"][..], 66, "away.avi"),
        (room, &["--input", "demo", "--record", record], 73, "a.bin"),
        (room, &lens, 66, "away.toml"),
        (room, &[&lens[..], &["--live"]].concat(), 66, "away.toml"),
        (model, &lens, 66, "away.toml"),
        (model, &["--input", "away.avi"], 66, "away.avi"),
    ] {
        std::fs::write(&file, text).unwrap();
        let mut run = edgecap();
        run.args(["run", "--size", "64x64", "--threads", "1", "--name", &name]);
        let run = run.arg("--config").arg(&file).args(typed);
        let out = run.current_dir(folder.path()).output().unwrap();
        let said = program::stderr(&out);
        assert_eq!(out.status.code(), Some(code), "{text}{typed:?}: {said}");
        assert!(said.contains(word), "{text}{typed:?}: {said}");
        assert!(!said.contains("gone."), "{text}{typed:?}: {said}");
    }
}

/// Whoever mends the folder starts the service again without a change of its settings.
#[test]
fn a_runtime_folder_that_others_may_write_is_no_mistake_of_the_settings() {
    let place = program::short_folder();
    let runtime = place.path().join("run");
    std::fs::create_dir(&runtime).unwrap();
    std::fs::set_permissions(&runtime, std::fs::Permissions::from_mode(0o777)).unwrap();
    let file = place.path().join("edgecap.toml");
    let camera = "[[camera]]\ninput = \"demo\"\nlive = true\n";
    let small = "[network]\nsize = \"64x64\"\nthreads = 1\n";
    for name in ["", "name = \"hall\"\n"] {
        std::fs::write(&file, format!("{camera}{name}{small}")).unwrap();
        for verb in [&["config", "check"][..], &["run"]] {
            let mut command = edgecap();
            command.args(verb).arg("--config").arg(&file);
            command.env("EDGECAP_RUNTIME_DIR", &runtime);
            let out = command.output().unwrap();
            let said = program::stderr(&out);
            assert_eq!(out.status.code(), Some(77), "{verb:?}: {said}");
            assert!(said.contains("runtime folder "), "{verb:?}: {said}");
            assert!(!said.contains("edgecap.toml:"), "{verb:?}: {said}");
        }
    }
}

/// Who reads bodies of a kiosk takes those of the clip for people who are there.
#[test]
fn no_clip_takes_the_place_of_a_camera_of_settings_or_of_a_service() {
    if edgecap::capture::list_cameras().is_ok() {
        eprintln!("skipped: this machine has a camera");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edgecap.toml");
    let manager = folder.path().join("notify");
    let _manager = UnixDatagram::bind(&manager).unwrap();
    let name = program::stream("no-clip");
    let settings = format!("[[camera]]\nname = {name:?}\n");
    for (text, is_service) in [(&*settings, false), ("", true)] {
        std::fs::write(&file, text).unwrap();
        let mut run = edgecap();
        run.args(["run", "--config", file.to_str().unwrap(), "--name", &name]);
        run.args(["--size", "64x64", "--threads", "1"]);
        if is_service {
            run.env("NOTIFY_SOCKET", &manager);
        }
        let run = run.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut run = Running(run.unwrap());
        run.says("waiting for the camera");
        signal(run.pid(), "TERM");
        let out = run.wait(Duration::from_secs(60));
        assert!(out.status.success(), "{}", program::stderr(&out));
    }
}

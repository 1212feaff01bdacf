//! `edgecap.toml`: mistakes with their places, where the file is found, what overrides what.

use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::Duration;

use edgecap::message::BodyFrame;
use edgecap_client::Subscriber;

use crate::program::stand_in::StandIn;
use crate::program::{self, Running, edgecap, eventually, signal, stdout};

const SAMPLE: &str = include_str!("../../deploy/edgecap.toml");

/// `edgecap config …` with this text as the file.
fn config(verb: &str, text: &str, more: &[&str]) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edgecap.toml");
    std::fs::write(&file, text).unwrap();
    let config = ["config", verb, "--config", file.to_str().unwrap()];
    edgecap().args(config).args(more).output().unwrap()
}

/// The sample with everything that is commented out switched on.
fn whole_sample() -> String {
    let setting = |line: &str| {
        let rest = line.strip_prefix('#')?;
        rest.starts_with(|c: char| c.is_ascii_lowercase())
            .then(|| rest.to_owned())
    };
    SAMPLE
        .lines()
        .map(|line| setting(line).unwrap_or_else(|| line.to_owned()) + "\n")
        .collect()
}

#[test]
fn mistakes_are_named_with_their_place_and_what_was_probably_meant() {
    for (text, place, words) in [
        (
            "[[camera]]\nnmae = \"a\"",
            "2:1",
            "'nmae'; did you mean 'name'?",
        ),
        ("\n[netwrok]", "2:2", "'netwrok'; did you mean 'network'?"),
        (
            "[network]\nzebra = 1",
            "2:1",
            "unknown key 'zebra'; expected one of",
        ),
        (
            "[fit.identity]\n  memry = 3",
            "2:3",
            "'memry'; did you mean 'memory'?",
        ),
        (
            "[[camera]]\nlens = { fov = 70 }",
            "2:10",
            "'fov'; did you mean 'fov_degrees'?",
        ),
        (
            "[[camera]]\nlens = { fov_degrees = 700 }",
            "2:8",
            "1 to 179 degrees",
        ),
        ("[[camera]]\nfps = \"fast\"", "2:7", "expected f64"),
        (
            "[[camera]]\nfps = 0.01",
            "2:1",
            "expected pictures per second",
        ),
        (
            "[[camera]]\ncapture_size = \"big\"",
            "2:16",
            "expected WIDTHxHEIGHT",
        ),
        (
            "[[camera]]\nrate = 1000",
            "2:8",
            "expected a whole number from 1 to 240",
        ),
        (
            "[[camera]]\nrate = 59.94",
            "2:8",
            "expected a whole number from 1 to 240",
        ),
        (
            "[[camera]]\nmax_fps = nan",
            "2:1",
            "max_fps: expected a finite",
        ),
        ("[[camera]]\n\nfps = -inf", "3:1", "fps: expected a finite"),
        ("[[camera]]\nheight = 18", "2:1", "metres"),
        (
            "[[camera]]\nfloor = { normal = [0, 0, 0], offset = 1 }",
            "2:1",
            "ground.normal",
        ),
        (
            "[[camera]]\n[camera.fit.filter2d]\nmin_cutoff = 0",
            "3:1",
            "filter2d.min_cutoff",
        ),
        (
            "[[camera]]\nname = \"a\"\n[[camera]]\nname = \"a\"",
            "4:1",
            "another camera is called 'a'",
        ),
        ("[network]\nthreads = 0", "2:1", "0 is not in 1..=256"),
        (
            "[network]\nthreads = 100000",
            "2:11",
            "threads: 100000 is not in 1..=256",
        ),
        (
            "[network]\nthreads = 0xfffff",
            "2:11",
            "threads: 1048575 is not in 1..=256",
        ),
        ("[network]\nsize = \"500x320\"", "2:8", "multiples of 16"),
        ("[fit]\nheight = 18", "2:1", "height"),
        (
            "[metrics]\naddress = \"0.0.0.0:9733\"",
            "2:11",
            "this machine itself",
        ),
        ("[[camera]]\ninput = \"\"", "2:1", "expected a name"),
        ("[[camera]]\nrecord = \"\"", "2:1", "expected a name"),
        (
            "[[camera]]\nevents = { zone = [{ name = \"a\", corners = [[0, 0], [1, 1], [2, 2]] }] }",
            "2:1",
            "on one line",
        ),
        ("camera = 3", "1:10", "camera.0: expected tables"),
        ("[network]\nsize = ", "2:8", ""),
        (
            "[network]\nthreads = 1\nthreads = 2",
            "3:1",
            "duplicate key",
        ),
    ] {
        let out = config("check", text, &[]);
        let err = program::stderr(&out);
        assert_eq!(out.status.code(), Some(78), "{text}: {err}");
        assert_eq!(err.lines().count(), 1, "{text}: {err}");
        let at = format!("edgecap.toml:{place}: ");
        assert!(err.contains(&at) && err.contains(words), "{text}:\n{err}");
    }
}

#[test]
fn what_config_can_do_is_listed_where_nothing_is_asked_of_it() {
    let words = ["requires a subcommand", "check, print, sample"];
    program::assert_fails(&["config"], 64, &words);
}

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

#[test]
fn the_sample_is_right_and_holds_every_key() {
    let printed = |text: &str| {
        let out = config("print", text, &[]);
        assert!(out.status.success(), "{}", program::stderr(&out));
        stdout(&out)
    };
    // What is printed names every key that there is, those without a value behind '#'.
    let keys = |text: &str| -> Vec<String> {
        let mut section = String::new();
        let mut keys: Vec<String> = text
            .lines()
            .filter_map(|line| {
                if line.starts_with('[') {
                    section = line.trim_matches(['[', ']']).to_owned();
                    return None;
                }
                let key = line.trim_start_matches('#').split(" =").next()?;
                let is_key = !key.is_empty()
                    && key
                        .chars()
                        .all(|c| c.is_ascii_lowercase() || "_0123456789".contains(c));
                (is_key && line.contains(" =")).then(|| format!("{section}.{key}"))
            })
            .collect();
        keys.sort();
        keys
    };
    let bare = printed(SAMPLE);
    assert_eq!(
        keys(SAMPLE),
        keys(&bare),
        "deploy/edgecap.toml must hold exactly the keys of the verbs' options"
    );
    // What stands behind '#' is right, too, and where there is a default it is that.
    let whole = whole_sample()
        .replace("fit = \"fit.toml\"\n", "")
        .replace("\nheight =", "\n#height =")
        .replace("\nfloor =", "\n#floor =")
        .replace("\nground =", "\n#ground =");
    let value = |line: &str| {
        line.rsplit_once(" # ")
            .map(|(value, _)| value.trim().to_owned())
    };
    let of = |text: &str| -> Vec<String> {
        let fit = text.split("\n[fit]").nth(1).unwrap();
        let fit = fit.split("\n[metrics]").next().unwrap();
        fit.lines().filter_map(value).collect()
    };
    assert_eq!(of(&printed(&whole)), of(&bare));
    let out = config(
        "check",
        &whole_sample()
            .replace("fit = \"fit.toml\"\n", "")
            .replace("model =", "#")
            .replace("stage2 =", "#")
            // It excludes the size.
            .replace("\nquality =", "\n#quality =")
            .replace("\ncalibration =", "\n#calibration ="),
        &[],
    );
    assert!(out.status.success(), "{}", program::stderr(&out));
}

#[test]
fn flags_win_over_the_file_and_everything_says_where_it_came_from() {
    let text = "[[camera]]\nname = \"hall\"\ninput = \"demo\"\nfps = 25.0\nlens = { fov_degrees = 75.3 }\n\
                [network]\nthreads = 2\nflip_test = true\n[fit.identity]\nmemory = 30.0\n";
    let out = config("print", text, &["--fps", "10", "--size", "384x240"]);
    let said = stdout(&out);
    let line = |start: &str| {
        let found = said.lines().find(|l| l.starts_with(start));
        let words: Vec<&str> = found
            .unwrap_or_else(|| panic!("{start}: {said}"))
            .split_whitespace()
            .collect();
        words.join(" ")
    };
    assert_eq!(line("name "), "name = \"hall\" # line 2");
    assert_eq!(line("fps "), "fps = 10.0 # typed");
    assert_eq!(line("lens "), "lens = { fov_degrees = 75.3 } # line 5");
    assert_eq!(line("size "), "size = \"384x240\" # typed");
    assert_eq!(line("threads "), "threads = 2 # line 7");
    assert_eq!(line("flip_test "), "flip_test = true # line 8");
    assert_eq!(line("memory "), "memory = 30.0 # line 10");
    assert_eq!(line("hold "), "hold = 2.5 # default");
    assert_eq!(line("#model "), "#model = # default");
    // What it prints is a file that means the same.
    let again = stdout(&config("print", &said, &[]));
    let values = |text: &str| -> Vec<String> {
        text.lines()
            .skip(1)
            .map(|l| l.split(" # ").next().unwrap().trim().to_owned())
            .collect()
    };
    assert_eq!(values(&again), values(&said));
}

#[test]
fn an_address_of_the_network_is_no_path_below_the_settings() {
    let text = "[[camera]]\ninput = \"rtsp://10.0.0.5/stream\"\n";
    let said = program::stderr(&config("check", text, &[]));
    assert!(
        said.contains("ffmpeg -i 'rtsp://10.0.0.5/stream'"),
        "{said}"
    );
}

/// What a run ends with for good, a service that is not started again.
#[test]
fn what_no_run_would_start_with_is_not_right() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("lens.toml");
    std::fs::write(&other, "fov_degrees = 75.0\n").unwrap();
    let model = format!("[network]\nmodel = {other:?}\n");
    let record =
        "[[camera]]\nname = \"hall\"\ninput = \"camera\"\nrecord = \"/proc/nowhere/a.ecr\"\n";
    let both = "[network]\nsize = \"384x240\"\nquality = \"fast\"\n";
    let two = "[[camera]]\ninput = \"demo\"\nlive = true\n".repeat(2);
    let avatars = format!("{two}[bridges]\nvmc = \"127.0.0.1:39539\"\n");
    let films = "[[camera]]\ninput = \"demo\"\n".repeat(2);
    let pipes = "[[camera]]\ninput = \"-\"\n".repeat(2);
    let slowed = "[[camera]]\ninput = \"demo\"\nmax_fps = 5.0\n";
    let listening = |page: &str| {
        format!(
            "[[camera]]\n[metrics]\naddress = \"127.0.0.1:19744\"\n[bridges]\nview = \"{page}\"\n"
        )
    };
    let (same, any) = (listening("127.0.0.1:19744"), listening("0.0.0.0:19744"));
    let apart = config("check", &listening("127.0.0.1:19745"), &[]);
    assert!(apart.status.success(), "{}", program::stderr(&apart));
    let right = config("check", &two, &[]);
    assert!(right.status.success(), "{}", program::stderr(&right));
    let twice = "[[camera]]\njsonl = \"/tmp/a\"\nrecord = \"/tmp/a\"\n";
    let named = |name: &str| {
        format!("[[camera]]\nname = {name:?}\ninput = \"/dev/video97\"\nrecord = \"R\"\n")
    };
    let records = named("hall") + &named("all").replace("video97", "video96");
    let devices = named("hall") + &named("all").replace("\"R\"", "\"S\"");
    let stage2 = format!("[network]\nstage2 = {other:?}\n");
    for (text, code, place, words) in [
        (
            both,
            78,
            "3:1",
            "'quality' chooses the network's input: expected it or 'size'",
        ),
        (
            &avatars,
            78,
            "8:1",
            "'vmc' has a port for each person: expected one camera; 'edgecap bridge --vmc'",
        ),
        (&films, 78, "2:1", "input: demo: one of several cameras"),
        (&pipes, 78, "2:1", "input: -: one of several cameras"),
        (
            "[network]\nlooks = 9.0\nquality = \"fast\"\nsize = \"384x240\"\n",
            78,
            "3:1",
            "'quality' chooses",
        ),
        (
            "[network]\nquality = \"best\"\nlooks = 9.0\n",
            78,
            "3:1",
            "'looks' follows joints",
        ),
        (slowed, 78, "3:1", "'max_fps' leaves pictures"),
        (&same, 78, "5:1", "'view' 127.0.0.1:19744 and 'address' 127"),
        (&any, 78, "5:1", "'view' 0.0.0.0:19744 and 'address' 127"),
        (twice, 78, "2:1", "'jsonl' /tmp/a and 'record' /tmp/a"),
        (&records, 78, "8:1", "hall: 'record' R and all: 'record' R"),
        (
            &devices,
            78,
            "7:1",
            "input: hall and all: expected a device",
        ),
        (
            "[[camera]]\n[[camera]]\n",
            78,
            "2:1",
            "input: camera0 and camera1: expected a device",
        ),
        (
            "[[camera]]\ninput = \"-\"\nlive = true\n",
            78,
            "2:1",
            "'live' plays a film",
        ),
        (
            "[[camera]]\nfit = \"none.toml\"\n",
            78,
            "2:1",
            "fit: cannot read",
        ),
        (
            "[[camera]]\nevents = \"none.toml\"\n",
            78,
            "2:1",
            "events: cannot read",
        ),
        (&model, 65, "2:1", "lens.toml"),
        (&stage2, 65, "2:1", "lens.toml"),
        ("[[camera]]\nlens = \"none.toml\"\n", 78, "2:1", "none.toml"),
        ("[network]\nmodel = \"none.ecm\"\n", 78, "2:1", "none.ecm"),
        ("[network]\nstage2 = \"none.st\"\n", 78, "2:1", "none.st"),
        (record, 78, "4:1", "/proc/nowhere/a.ecr"),
    ] {
        // Root's words of /proc are not those of others.
        if text == record && !rustix::process::geteuid().is_root() {
            continue;
        }
        let out = config("check", text, &[]);
        let err = program::stderr(&out);
        assert_eq!(out.status.code(), Some(code), "{text}: {err}");
        assert_eq!(err.lines().count(), 1, "{text}: {err}");
        let at = format!("edgecap.toml:{place}: ");
        assert!(err.contains(&at) && err.contains(words), "{text}: {err}");
    }
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

#[test]
fn cameras_are_called_as_their_calibration_does() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let view = |name: &str, x: f64| {
        format!(
            "[{name}]\nname = \"{name}\"\nsize = [640.0, 480.0]\n\
             matrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
             distortions = [0.0, 0.0, 0.0, 0.0]\nrotation = [0.0, 0.0, 0.0]\n\
             translation = [{x:?}, 0.0, 1.0]\nfisheye = false\n"
        )
    };
    std::fs::write(at("Calib.toml"), view("left", 0.0) + &view("right", 1.0)).unwrap();
    let camera =
        |name: &str| format!("[[camera]]\nname = {name:?}\ninput = \"demo\"\nlive = true\n");
    let calibration = "[multiview]\ncalibration = \"Calib.toml\"\n";
    let file = at("edgecap.toml");
    let text = camera("left") + &camera("hall") + calibration;
    std::fs::write(&file, text).unwrap();
    for verb in [&["config", "check"][..], &["run"]] {
        let mut command = edgecap();
        let out = command.args(verb).arg("--config").arg(&file).output();
        let out = out.unwrap();
        let err = program::stderr(&out);
        assert_eq!(out.status.code(), Some(78), "{verb:?}: {err}");
        let expected = "edgecap.toml:6:1: name: expected one of the cameras left, right of ";
        assert!(err.contains(expected), "{verb:?}: {err}");
    }
}

#[test]
fn a_typed_size_or_quality_silences_the_other_one_of_the_file() {
    let line = |text: &str, more: &[&str], start: &str| {
        let said = stdout(&config("print", text, more));
        said.lines()
            .find(|l| l.starts_with(start))
            .map(str::to_owned)
    };
    let quality = "[network]\nquality = \"fast\"\n";
    let typed = ["--size", "384x240"];
    assert!(line(quality, &typed, "size = \"384x240\"").is_some());
    assert!(line(quality, &typed, "#quality =").is_some());
    let size = "[network]\nsize = \"384x240\"\n";
    let typed = ["--quality", "fast"];
    assert!(line(size, &typed, "quality = \"fast\"").is_some());
    assert!(line(size, &typed, "#size =").is_some());
    let looks = "[network]\nlooks = 10.0\n";
    assert!(line(looks, &["--quality", "best"], "#looks =").is_some());
    assert!(line(looks, &["--quality", "fast"], "looks = 10").is_some());
    let best = "[network]\nquality = \"best\"\n";
    assert!(line(best, &["--looks", "5"], "#quality =").is_some());
}

#[test]
fn the_users_file_is_found_and_another_is_named_with_a_flag() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("edgecap");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("edgecap.toml"), "[network]\nthreads = 3").unwrap();
    let print = |more: &[&str]| {
        let mut command = edgecap();
        command.env("XDG_CONFIG_HOME", home.path());
        stdout(
            &command
                .args(["config", "print"])
                .args(more)
                .output()
                .unwrap(),
        )
    };
    assert!(print(&[]).contains("threads = 3"));
    assert!(print(&["--config", "/dev/null"]).contains("#threads ="));
    let out = edgecap()
        .args(["run", "--config", "/nowhere.toml"])
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(78));
    let said = program::stderr(&out);
    assert!(said.contains("cannot read /nowhere.toml"), "{said}");
    assert!(
        said.contains("'edgecap config sample > /nowhere.toml'"),
        "{said}"
    );
}

/// Without it a kiosk would run by defaults after its settings have moved.
#[test]
fn settings_that_are_a_link_to_nowhere_are_no_lack_of_settings() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("edgecap");
    std::fs::create_dir(&folder).unwrap();
    std::os::unix::fs::symlink("/nowhere.toml", folder.join("edgecap.toml")).unwrap();
    for verb in [&["config", "check"][..], &["run"]] {
        let mut command = edgecap();
        command.args(verb).env("XDG_CONFIG_HOME", home.path());
        let out = command.output().unwrap();
        let said = program::stderr(&out);
        assert_eq!(out.status.code(), Some(78), "{verb:?}: {said}");
        assert!(
            said.contains("a link that leads nowhere"),
            "{verb:?}: {said}"
        );
    }
}

/// Whoever opens one waits for ever, deaf to signals.
#[test]
fn pipes_in_place_of_settings_and_of_what_they_name_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [file, pipe] = ["edgecap.toml", "pipe"].map(|name| folder.path().join(name));
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, 0o600.into()).unwrap();
    let refused = |settings: &Path, words: &str| {
        for verb in [&["config", "check"][..], &["run"]] {
            let mut command = edgecap();
            command.args(verb).arg("--config").arg(settings);
            let run = command
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn();
            let out = Running(run.unwrap()).wait(Duration::from_secs(60));
            let said = program::stderr(&out);
            assert_eq!(out.status.code(), Some(78), "{verb:?}: {said}");
            assert!(said.contains(words), "{verb:?}: {said}");
        }
    };
    refused(&pipe, "pipe: expected a file, found a pipe");
    for (section, key) in [
        ("[[camera]]", "lens"),
        ("[[camera]]", "fit"),
        ("[[camera]]", "events"),
        ("[network]", "model"),
        ("[network]", "stage2"),
    ] {
        std::fs::write(&file, format!("{section}\n{key} = \"pipe\"\n")).unwrap();
        refused(&file, &format!("edgecap.toml:2:1: {key}: cannot read "));
    }
    std::fs::write(&file, "[[camera]]\nlens = { fov_degrees = 81 }\n").unwrap();
    let typed = "\"$0\" config print --config <(cat \"$1\")";
    let mut shell = std::process::Command::new("bash");
    shell
        .args(["-c", typed, env!("CARGO_BIN_EXE_edgecap")])
        .arg(&file);
    let out = shell.output().unwrap();
    assert!(
        stdout(&out).contains("fov_degrees = 81"),
        "{}",
        program::stderr(&out)
    );
}

#[test]
fn a_run_takes_the_camera_that_is_named_and_a_film_takes_none() {
    let text =
        "[[camera]]\nname = \"hall\"\ninput = \"a.avi\"\n[[camera]]\nlens = { fov_degrees = 80 }\n";
    let cameras = |more: &[&str]| {
        stdout(&config("print", text, more))
            .matches("[[camera]]")
            .count()
    };
    assert_eq!(cameras(&[]), 2);
    let hall = stdout(&config("print", text, &["--name", "hall"]));
    assert!(
        hall.contains("/a.avi\""),
        "from the file's folder on: {hall}"
    );
    assert_eq!(cameras(&["--name", "hall"]), 1);
    let other = stdout(&config("print", text, &["--name", "camera1"]));
    assert!(other.contains("fov_degrees = 80"), "{other}");
    let film = stdout(&config("print", text, &["--input", "b.avi"]));
    assert!(film.contains("#lens ="), "another's lens: {film}");
    let out = config("print", text, &["--name", "yard"]);
    assert_eq!(out.status.code(), Some(64));
    assert!(program::stderr(&out).contains("one of hall, camera1"));
}

/// Its people are nobody in front of the cameras: a run hands them on nowhere that was not typed.
#[test]
fn bridges_of_the_settings_are_not_printed_for_another_film() {
    let text = "[bridges]\nosc = \"127.0.0.1:9000\"\ntoken = \"open-sesame\"\n\
        [[camera]]\ninput = \"hall.y4m\"\n";
    let printed = |more: &[&str]| stdout(&config("print", text, more));
    let film = printed(&["--input", "walk.y4m"]);
    assert!(film.contains("#osc ="), "{film}");
    let of_a_page = film.lines().find(|line| line.starts_with("token = "));
    assert!(of_a_page.unwrap().ends_with("# line 3"), "{film}");
    let told = printed(&["--input", "walk.y4m", "--osc", "127.0.0.1:9001"]);
    let typed = told.lines().find(|line| line.starts_with("osc = "));
    assert!(
        typed.is_some_and(|line| line.contains("9001") && line.ends_with("# typed")),
        "{told}"
    );
    for camera in [
        &[][..],
        &["--input", "walk.y4m", "--live"],
        &["--input", "/dev/video0"],
    ] {
        let said = printed(camera);
        assert!(said.contains("osc = \"127.0.0.1:9000\""), "{said}");
    }
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

/// The tasks of children hold paths as text.
#[test]
fn settings_in_a_folder_of_other_bytes_may_name_what_is_not_below_it() {
    use std::os::unix::ffi::OsStrExt;
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join(std::ffi::OsStr::from_bytes(b"x\xff"));
    std::fs::create_dir(&folder).unwrap();
    let check = |text: &str| {
        std::fs::write(folder.join("edgecap.toml"), text).unwrap();
        edgecap()
            .args(["config", "print", "--config"])
            .arg(folder.join("edgecap.toml"))
            .output()
            .unwrap()
    };
    let out = check("[[camera]]\ninput = \"/dev/video0\"\nlens = \"/lens.toml\"\n");
    assert!(out.status.success(), "{}", program::stderr(&out));
    for text in [
        "[[camera]]\ninput = \"hall.avi\"\n",
        "[[camera]]\nlens = \"lens.toml\"\n",
        "[network]\nmodel = \"own.ecm\"\n",
    ] {
        let out = check(text);
        let said = program::stderr(&out);
        assert_eq!(out.status.code(), Some(64), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        let words = "settings (--config): expected a path in UTF-8, found ";
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn a_film_of_the_file_is_known_by_every_path() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("hall.avi"), "").unwrap();
    std::os::unix::fs::symlink(at("hall.avi"), at("link.avi")).unwrap();
    let text = "[[camera]]\nname = \"lobby\"\ninput = \"hall.avi\"\nrotate = 90\n";
    std::fs::write(at("edgecap.toml"), text).unwrap();
    let print = |more: &[&str]| {
        let mut command = edgecap();
        command.args(["config", "print", "--config", "edgecap.toml"]);
        stdout(
            &command
                .args(more)
                .current_dir(folder.path())
                .output()
                .unwrap(),
        )
    };
    let value = |said: &str, key: &str| {
        let line = said.lines().find(|l| l.starts_with(key));
        let words: Vec<&str> = line.unwrap_or_default().split_whitespace().collect();
        words.join(" ")
    };
    let whole = at("hall.avi");
    for input in [
        "hall.avi",
        "./hall.avi",
        "link.avi",
        whole.to_str().unwrap(),
    ] {
        let said = print(&["--input", input]);
        assert_eq!(value(&said, "name"), "name = \"lobby\" # line 2", "{input}");
        assert_eq!(value(&said, "rotate"), "rotate = 90 # line 4", "{input}");
    }
    // Another name for its bodies is no other camera.
    let named = print(&["--input", "hall.avi", "--name", "foyer"]);
    assert_eq!(value(&named, "name"), "name = \"foyer\" # typed");
    assert_eq!(value(&named, "rotate"), "rotate = 90 # line 4");
    let other = print(&["--input", "other.avi"]);
    assert_eq!(value(&other, "#rotate"), "#rotate = # default");
    let upright = print(&["--input", "hall.avi", "--rotate", "0"]);
    assert_eq!(value(&upright, "rotate"), "rotate = 0 # typed");
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

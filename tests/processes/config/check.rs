//! What a check says of settings: each mistake in one line, with its place and what to write.

use super::config;
use crate::program::{self, edgecap};

/// Asserts that a check of this text says one line that names the place, with these words, and its exit code.
fn assert_refused(text: &str, code: i32, place: &str, words: &str) {
    let out = config("check", text, &[]);
    let err = program::stderr(&out);
    assert_eq!(out.status.code(), Some(code), "{text}: {err}");
    assert_eq!(err.lines().count(), 1, "{text}: {err}");
    let at = format!("edgecap.toml:{place}: ");
    assert!(err.contains(&at) && err.contains(words), "{text}:\n{err}");
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
        (
            "[[camera]]\nfps = \"fast\"",
            "2:7",
            "expected a number, found the text \"fast\"",
        ),
        (
            "[network]\nquality = 5",
            "2:11",
            "quality: expected one of fast, balanced, best, found 5",
        ),
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
        ("network = 3", "1:11", "expected a table, found an integer"),
        ("[network]\nsize = ", "2:8", ""),
        (
            "[network]\nthreads = 1\nthreads = 2",
            "3:1",
            "duplicate key",
        ),
    ] {
        assert_refused(text, 78, place, words);
    }
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
    let same = listening("127.0.0.1:19744");
    let [any, every] = ["0.0.0.0:19744", "[::]:19744"].map(listening);
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
        (&every, 78, "5:1", "'view' [::]:19744 and 'address' 127"),
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
        assert_refused(text, code, place, words);
    }
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

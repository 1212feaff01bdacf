//! `edgecap calibrate` from files to a file: places found by people, and what it says when it cannot.

use edgecap::body::skeleton::ANKLE_HEIGHT;
use edgecap::camera::View;
use edgecap::camera::calibration;
use edgecap::lab::multiview::own::own;
use edgecap::lab::synth::detector::Flaws;
use glam::DVec3;

use crate::many_views::files;
use crate::program::{assert_fails, output, stderr, stdout};

/// Distances between all cameras: the same in any axes.
fn distances(views: &[View]) -> Vec<f64> {
    let pairs = views.iter().enumerate();
    let apart = |a: DVec3, b: DVec3| a.distance(b);
    pairs
        .flat_map(|(k, a)| {
            views[..k]
                .iter()
                .map(move |b| apart(a.position, b.position))
        })
        .collect()
}

/// Eight seconds: feet must have been far enough apart both ways to tell the floor's slope.
const FRAMES: usize = 240;

#[test]
fn a_walk_gives_the_calibration_that_multiview_reads() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let truth = files(folder.path(), 3, FRAMES);
    let (lens, out, run) = (at("Calib.toml"), at("found.toml"), at("run"));
    let views = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let given = |verb: &'static str, more: &[&'static str]| -> Vec<String> {
        let views = views.iter().flat_map(|v| ["--view", v]);
        let all = std::iter::once(verb)
            .chain(views)
            .chain(more.iter().copied());
        all.map(ToOwned::to_owned).collect()
    };
    let mut args = given("calibrate", &["--distance", "0,120=7.274613"]);
    args.extend(["--lens", &lens, "--out", &out].map(ToOwned::to_owned));
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let done = output(&args);
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(stdout(&done).contains("held out px"), "{}", stdout(&done));
    let found = calibration::read(out.as_ref()).unwrap().views;
    for (found, truth) in distances(&found).iter().zip(distances(&truth)) {
        assert!((found - truth).abs() < 0.15, "{found} for {truth}");
    }
    // Who walks there stands where their legs end, which is not at the world's 0; their ankles are above it.
    let ankles = own(5, 3, FRAMES, Flaws::NONE).joints;
    let low = ankles.iter().flat_map(|j| [j[10].y, j[13].y]);
    let truth = 1.6 - (low.fold(f64::INFINITY, f64::min) - ANKLE_HEIGHT);
    for view in &found {
        let height = view.position.z;
        assert!(
            (height - truth).abs() < 0.3,
            "{}: {height}, not {truth} m",
            view.name
        );
    }
    let mut args = given("multiview", &[]);
    args.extend(["--calibration", &out, "--out", &run].map(ToOwned::to_owned));
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let done = output(&args);
    assert!(done.status.success(), "{}", stderr(&done));
}

#[test]
fn what_cannot_be_calibrated_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 2, 12);
    let (lens, first, second, out) = (
        at("Calib.toml"),
        at("0.jsonl"),
        at("120.jsonl"),
        at("found.toml"),
    );
    let refused = |more: &[&str], code: i32, words: &[&str]| {
        let args = [&["calibrate", "--view", &first, "--out", &out], more].concat();
        assert_fails(&args, code, words);
        assert!(!std::path::Path::new(&out).exists());
    };
    refused(&[], 64, &["at least two --view, found 1"]);
    let two = ["--view", &second, "--lens", &lens];
    refused(&two, 65, &["at least 20 frames", "found 12"]);
    // The other camera's lens is taken for the usual one.
    let of_first = format!("0={lens}");
    let one = ["--view", &second, "--lens", &of_first];
    refused(&one, 65, &["at least 20 frames", "found 12"]);
    refused(&["--view", &first], 64, &["every camera once", "0"]);
    let more = |extra: [&'static str; 2]| [&two[..], &extra].concat();
    refused(
        &more(["--distance", "0,7=3"]),
        64,
        &["--distance 0,7=3", "no --view is of 7", "two of 0, 120"],
    );
    refused(
        &more(["--lens", "north=x.toml"]),
        64,
        &["one of the cameras", "north"],
    );
    // OpenCV's calibration of a webcam by itself is a lens.
    let alone = at("webcam.yml");
    let text = "%YAML:1.0\n---\nimage_width: 1080\nimage_height: 1080\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
                cols: 3\n   dt: d\n   data: [ 1150., 0., 540., 0., 1150., 540., 0., 0., 1. ]\n";
    std::fs::write(&alone, text).unwrap();
    let of_one = format!("0={alone}");
    refused(
        &["--view", &second, "--lens", &lens, "--lens", &of_one],
        65,
        &["at least 20 frames"],
    );
    let nowhere = at("nowhere.toml");
    refused(
        &["--view", &second, "--lens", &nowhere],
        66,
        &["nowhere.toml"],
    );
}

/// Before films are looked at, which takes minutes: here there are none.
#[test]
fn what_can_be_known_of_the_command_is_said_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("file"), "").unwrap();
    let [north, south, out, blocked] = ["north.avi", "south.avi", "out", "file/out"].map(at);
    let refused = |verb: &[&str], out: &str, code: i32, words: &[&str]| {
        let views = ["--view", &north, "--view", &south, "--out", out];
        assert_fails(&[verb, &views].concat(), code, words);
    };
    let board = ["calibrate", "--board", "9x6", "--square", "0.03"];
    let calibration = ["multiview", "--calibration", &north];
    for verb in [&["calibrate"][..], &board, &calibration] {
        refused(verb, &blocked, 73, &["file/out"]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
    let distance = ["calibrate", "--distance", "north,west=3"];
    refused(&distance, &out, 64, &["no --view is of west"]);
}

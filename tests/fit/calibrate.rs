//! `edgecap calibrate` from files to a file: places found by people, and what it says when it cannot.

use std::path::Path;

use edgecap::body::skeleton::ANKLE_HEIGHT;
use edgecap::camera::calibration;
use edgecap::camera::{Brown, View};
use edgecap::lab::multiview::Trial;
use edgecap::lab::multiview::own::{RATE, Walker, own, ring, steady};
use edgecap::lab::synth::detector::Flaws;
use edgecap::lab::synth::noise::Dice;
use edgecap::message::{FLAG_FILE_TIME, Observation};
use edgecap::record::{Format, ObservationsRow, RecordWriter};
use glam::{DQuat, DVec3};

use crate::many_views::{files, seen_by};
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

/// As by a tape measure in feet, in inches or in centimetres; the cameras are 7.27 m apart.
#[test]
fn a_distance_that_makes_people_too_small_or_too_tall_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 3, 90);
    let [first, second, third, out] = ["0.jsonl", "120.jsonl", "240.jsonl", "found.toml"].map(at);
    let views = ["--view", &first, "--view", &second, "--view", &third];
    let by = |distance| {
        let verb = ["calibrate", "--out", &out, "--distance", distance];
        [&verb[..], &views].concat()
    };
    for distance in ["0,120=0.7274613", "0,120=72.74613"] {
        let words = ["--distance", "0.5 to 2.6 m tall", "in metres"];
        assert_fails(&by(distance), 65, &words);
        assert!(!Path::new(&out).exists());
    }
    for (distance, is_doubted) in [("0,120=4.4", true), ("0,120=7.274613", false)] {
        let done = output(&by(distance));
        let said = stderr(&done);
        assert!(done.status.success(), "{said}");
        assert_eq!(said.contains("by --distance"), is_doubted, "{said}");
        // Films are not the reason.
        assert!(!said.contains("far off:"), "{said}");
    }
}

/// Where films end of which one begins late.
#[derive(Clone, Copy, PartialEq)]
enum End {
    /// After as many frames as the late one has.
    Cut,
    /// At one time.
    Together,
}

/// Records of films of what views saw, frame by frame; that of the second camera begins so many frames late.
fn write_films(
    folder: &Path,
    views: &[View],
    seen: &[Vec<Vec<Observation>>],
    late: usize,
    end: End,
) {
    for (v, view) in views.iter().enumerate() {
        let path = folder.join(format!("{}.jsonl", view.name));
        let mut file = RecordWriter::<ObservationsRow>::create(&path, Format::Jsonl).unwrap();
        let skipped = if v == 1 { late } else { 0 };
        let most = match end {
            End::Cut => seen.len() - late,
            End::Together => seen.len(),
        };
        let frames = seen.iter().skip(skipped).take(most);
        for (k, frame) in frames.enumerate() {
            let mut message = seen_by(view, k, &frame[v]);
            message.flags = FLAG_FILE_TIME;
            file.write(&message, "").unwrap();
        }
        file.finish().unwrap();
    }
}

/// Cameras by films of which the second begins so many frames late, and what was said; they stand where they do.
fn found_by_films(late: usize, end: End) -> String {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let Trial { views, seen, .. } = own(5, 3, FRAMES, steady(5));
    write_films(folder.path(), &views, &seen, late, end);
    let out = at("found.toml");
    let given = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec!["calibrate", "--distance", "0,240=7.274613", "--out", &out];
    args.extend(given.iter().flat_map(|v| ["--view", v]));
    let done = output(&args);
    let said = stderr(&done);
    assert!(done.status.success(), "{said}");
    let found = calibration::read(out.as_ref()).unwrap().views;
    for (found, truth) in distances(&found).iter().zip(distances(&views)) {
        assert!((found - truth).abs() < 0.15, "{found} for {truth}");
    }
    said
}

#[test]
fn films_that_did_not_start_together_are_brought_to_one_time() {
    let said = found_by_films(5, End::Cut);
    assert!(said.contains("camera 120 started 0.1"), "{said}");
    assert!(said.contains("s after 0, as people move"), "{said}");
    // The lens is the records' own.
    assert!(!said.contains("60 degrees"), "{said}");
}

/// As by hand, one recorder after the other.
#[test]
fn films_that_end_together_need_not_start_together() {
    let said = found_by_films(20, End::Together);
    let wanted = "camera 120 started 0.667 s after 0, as people move";
    assert!(said.contains(wanted), "{said}");
}

/// The clock tells that they did not, and the times of one do not tell what was seen when.
#[test]
fn live_cameras_that_did_not_start_together_do_not_go_by_number() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 2, 60);
    let [first, second, out] = ["0.jsonl", "120.jsonl", "found.toml"].map(at);
    let text = std::fs::read_to_string(&second).unwrap();
    let later = text.lines().enumerate().map(|(k, line)| {
        let mut row: serde_json::Value = serde_json::from_str(line).unwrap();
        let back = if k % 6 == 5 { 40_000_000 } else { 0 };
        for key in ["time_ns", "publish_ns"] {
            row[key] = (row[key].as_u64().unwrap() + 400_000_000 - back).into();
        }
        format!("{row}\n")
    });
    let later: String = later.collect();
    std::fs::write(&second, later).unwrap();
    let args = ["calibrate", "--stature", "1.7", "--out", &out];
    let views = ["--view", &first, "--view", &second];
    let words = ["camera 120", "10 of 60", "0.4 s apart", "--fps"];
    assert_fails(&[&args[..], &views].concat(), 65, &words);
    assert!(!Path::new(&out).exists());
}

/// Whoever walks in a circle seems to walk the same circle some time later, seen by a camera that is turned: only
/// cameras that are found anew tell the time.
#[test]
fn films_of_a_walk_in_a_circle_are_brought_to_one_time() {
    const RADIUS: f64 = 1.3;
    const SPEED: f64 = 1.2;
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let target = DVec3::new(0.0, 1.0, 0.0);
    let views = ring(3).into_iter().map(|view| View {
        position: target + 6.0 / 4.2 * (view.position - target),
        distortion: Brown::default(),
        ..view
    });
    let views: Vec<View> = views.collect();
    let mut dice = Dice::new(4, 0);
    let on_the_spot = Walker::new(FRAMES, 5, DVec3::ZERO).joints;
    let frames = on_the_spot.iter().enumerate().map(|(k, joints)| {
        let turn = DQuat::from_rotation_y(SPEED / RADIUS * k as f64 / RATE);
        let of_view = |view: &View| {
            let mut seen = Observation::default();
            for (out, joint) in seen.joints2d.iter_mut().zip(joints) {
                let pixel = view.project(turn * (*joint + RADIUS * DVec3::X)).unwrap();
                let [u, v] = pixel.as_vec2().to_array();
                *out = [u + dice.normal(), v + dice.normal(), 0.9];
            }
            vec![seen]
        };
        views.iter().map(of_view).collect()
    });
    let seen: Vec<Vec<Vec<Observation>>> = frames.collect();
    write_films(folder.path(), &views, &seen, 5, End::Cut);
    let out = at("found.toml");
    let apart = format!("0,240={}", views[0].position.distance(views[2].position));
    let given = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec!["calibrate", "--distance", &apart, "--out", &out];
    args.extend(given.iter().flat_map(|v| ["--view", v]));
    let done = output(&args);
    let said = stderr(&done);
    assert!(done.status.success(), "{said}");
    assert!(
        said.contains("camera 120 started 0.167 s after 0"),
        "{said}"
    );
    let found = calibration::read(out.as_ref()).unwrap().views;
    for (found, truth) in distances(&found).iter().zip(distances(&views)) {
        assert!((found - truth).abs() < 0.15, "{found} for {truth}");
    }
}

#[test]
fn a_calibration_on_standard_output_is_alone_there() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    files(folder.path(), 3, 90);
    let given = ["0", "120", "240"].map(|v| at(&format!("{v}.jsonl")));
    let mut args = vec!["calibrate", "--stature", "1.7", "--out", "-"];
    args.extend(given.iter().flat_map(|v| ["--view", v]));
    let done = output(&args);
    assert!(done.status.success(), "{}", stderr(&done));
    let views = calibration::read_pose2sim(&stdout(&done), "stdout").unwrap();
    assert_eq!(views.len(), 3);
    assert!(stderr(&done).contains("held out px"), "{}", stderr(&done));
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
    // The other camera's lens is its record's own.
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
    // What is wrong with a lens is said, also where too little was seen.
    let folds = at("folds.toml");
    let text = "fx = 1150\ncx = 540\ncy = 540\nwidth = 1080\nheight = 1080\nk1 = -8\n";
    std::fs::write(&folds, text).unwrap();
    let views = ["--view", &first, "--view", &second, "--lens", &folds];
    let done = output(&[&["calibrate", "--out", &out], &views[..]].concat());
    let said = stderr(&done);
    assert_eq!(done.status.code(), Some(65), "{said}");
    assert!(said.contains("camera 0: its lens shows nothing"), "{said}");
    let fisheye = at("fisheye.toml");
    let text = std::fs::read_to_string(&lens).unwrap();
    std::fs::write(&fisheye, text.replace("fisheye = false", "fisheye = true")).unwrap();
    refused(
        &["--view", &second, "--lens", &fisheye],
        65,
        &["fisheye.toml", "camera 0 with a fisheye lens"],
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
    for verb in [&["calibrate"][..], &board] {
        let all = ["--lens", "a.toml", "--lens", "b.toml"];
        let words = ["one --lens for all", "a.toml and b.toml", "CAMERA=FILE"];
        refused(&[verb, &all].concat(), &out, 64, &words);
        let one = ["--lens", "north=a.toml", "--lens", "north=b.toml"];
        let words = ["one --lens for camera north", "a.toml and b.toml"];
        refused(&[verb, &one].concat(), &out, 64, &words);
    }
    let others = at("others.toml");
    std::fs::write(&others, calibration::write_pose2sim(&ring(2))).unwrap();
    for verb in [&["calibrate"][..], &board] {
        let words = ["others.toml", "expected camera north, found none"];
        refused(&[verb, &["--lens", &others]].concat(), &out, 65, &words);
    }
    std::fs::create_dir(at("photos")).unwrap();
    let photos = format!("west={}", at("photos"));
    let photos = ["calibrate", "--view", &photos];
    refused(&photos, &out, 64, &["camera west", "need --board"]);
    // A name that holds what stands between a camera and its file.
    let lens = at("lens=60.toml");
    std::fs::write(&lens, "fov_degrees = 60\n").unwrap();
    let replaced = ["calibrate", "--lens", &lens];
    refused(&replaced, &lens, 64, &["--lens", "--out"]);
    assert_eq!(
        std::fs::read_to_string(&lens).unwrap(),
        "fov_degrees = 60\n"
    );
}

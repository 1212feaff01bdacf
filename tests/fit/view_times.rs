//! When bodies were where they are: times of one view that are out of order, and whose clock results are of.

use std::fs;
use std::path::Path;

use edgecap::message::FLAG_FILE_TIME;
use edgecap::record::{Format, ObservationsRow, RecordWriter};
use serde_json::Value;

use crate::many_views;
use crate::program::{assert_fails, output, stderr};
use crate::scene::people;
use crate::scene::{Noise, Scene};

/// Frames a second.
const RATE: u64 = 30;

/// When a camera of the usual rate takes a frame, nanoseconds.
fn usual(frame: u64) -> u64 {
    1_000_000_000 * (frame + 1) / RATE
}

/// A live camera's record of somebody who walks, whose frames have these times, nanoseconds.
fn record(path: &Path, frames: u64, time: impl Fn(u64) -> u64) {
    let walker = people::everyday().swap_remove(0);
    let mut scene = Scene::new(vec![walker], Noise::NONE, RATE as f64, 4);
    let mut file = RecordWriter::<ObservationsRow>::create(path, Format::Jsonl).unwrap();
    for k in 0..frames {
        let (mut message, _) = scene.next();
        message.capture_ns = time(k);
        message.publish_ns = time(k) + 40_000_000;
        file.write(&message, "").unwrap();
    }
    file.finish().unwrap();
}

fn rows(run: &str) -> Vec<Value> {
    let lines = fs::read_to_string(Path::new(run).join("bodies.jsonl")).unwrap();
    let rows = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap());
    rows.collect()
}

/// Runs `multiview` without smoothing, and returns what it said.
fn run(args: &[&str]) -> String {
    let done = output(&[&["multiview", "--no-dct"], args].concat());
    assert!(done.status.success(), "{args:?}: {}", stderr(&done));
    stderr(&done)
}

#[test]
fn a_time_that_is_there_twice_does_not_take_those_of_one_view() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (view, out) = (at("cam.jsonl"), at("run"));
    record(view.as_ref(), 90, |k| match k {
        20 => usual(19),
        0..45 => usual(k),
        _ => usual(k) + 20_000_000_000,
    });
    let said = run(&["--view", &view, "--sync", "times", "--out", &out]);
    assert!(
        said.contains("camera cam: 1 frame is not later than those before; left out"),
        "{said}"
    );
    let rows = rows(&out);
    let time = |row: &Value| row["time_ns"].as_u64().unwrap();
    let span = time(&rows[rows.len() - 1]) - time(&rows[0]);
    assert!(span > 22_000_000_000, "{span} ns");
    assert!(rows.iter().all(|row| row["flags"] == 0));
}

#[test]
fn times_of_one_view_that_tell_nothing_are_said_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (view, out) = (at("cam.jsonl"), at("run"));
    record(view.as_ref(), 30, |k| usual(k - k % 3));
    for sync in ["times", "motion"] {
        let args = ["multiview", "--view", &view, "--sync", sync, "--out", &out];
        assert_fails(
            &args,
            65,
            &["tell when each frame was taken", "--sync none"],
        );
    }
    let said = run(&["--view", &view, "--out", &out]);
    assert!(
        said.contains("camera cam: its times do not tell when frames were taken"),
        "{said}"
    );
    let rows = rows(&out);
    assert_eq!(rows.len(), 30);
    assert!(rows.iter().all(|row| row["flags"] == FLAG_FILE_TIME));
}

/// A replay moves times of the machine's clock to now, and leaves those of films.
#[test]
fn results_tell_whose_clock_their_times_are_of() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let views = many_views::files(folder.path(), 3, 8);
    let files: Vec<String> = views
        .iter()
        .map(|v| at(&format!("{}.jsonl", v.name)))
        .collect();
    let calibration = at("Calib.toml");
    let flags = |name: &str, args: &[&str]| -> Vec<u64> {
        let out = at(name);
        run(&[args, &["--sync", "none", "--out", &out]].concat());
        let rows = rows(&out);
        assert!(
            rows.iter().all(|row| row["publish_ns"] == 0),
            "{name}: none was sent"
        );
        rows.iter()
            .map(|row| row["flags"].as_u64().unwrap())
            .collect()
    };
    let all = [
        "--calibration",
        &calibration,
        "--view",
        &files[0],
        "--view",
        &files[1],
        "--view",
        &files[2],
    ];
    let file = u64::from(FLAG_FILE_TIME);
    assert_eq!(flags("live", &all), [0; 8]);
    assert_eq!(
        flags("rate", &[&all[..], &["--fps", "30"]].concat()),
        [file; 8]
    );
    for path in &files {
        let lines = fs::read_to_string(path).unwrap();
        let of_film = lines.lines().map(|line| {
            let mut row: Value = serde_json::from_str(line).unwrap();
            row["flags"] = file.into();
            format!("{row}\n")
        });
        fs::write(path, of_film.collect::<String>()).unwrap();
    }
    assert_eq!(flags("films", &all), [file; 8]);
}

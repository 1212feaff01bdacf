//! Records whose times tell which frames belong together: of cameras on one machine's clock, and of films that lack
//! frames, against people whose truth is known.

use std::ops::Range;
use std::path::Path;

use edgecap::camera::calibration::{self, write_pose2sim};
use edgecap::joints::PELVIS;
use edgecap::message::FLAG_FILE_TIME;
use edgecap::record::{BodiesRow, Format, ObservationsRow, RecordWriter, RowReader};
use rand::SeedableRng;
use rand::rngs::SmallRng;

use crate::program::{assert_fails, output, stderr};
use crate::scene::people::{Activity, Person, walk};
use crate::scene::ring::{Spoil, error, observe, views};

/// When the machine's clock shows 0 s of the tests, nanoseconds.
const BEGIN: u64 = 5_000_000_000;

/// A camera that sees the people.
#[derive(Clone)]
struct Camera {
    rate: f64,
    /// Its first frame and its end, seconds.
    runs: Range<f64>,
    /// Seconds of which its record lacks the frames.
    lacks: Range<f64>,
    /// Seconds in which it looks once a second, as at an empty place.
    rests: Range<f64>,
}

fn camera(rate: f64, runs: Range<f64>) -> Camera {
    Camera {
        rate,
        runs,
        lacks: 0.0..0.0,
        rests: 0.0..0.0,
    }
}

/// What the times of a record are.
#[derive(Clone, Copy, PartialEq)]
enum Times {
    /// Those of the machine's clock.
    Machine,
    /// Those of a film, from 0.
    Film,
    /// Of another program, which tells nothing but when frames were taken, from 0.
    Bare,
}

/// Somebody who walks to and fro for a minute.
fn walker() -> Person {
    let round = [(-0.9, 3.4), (1.1, 4.4), (-0.8, 5.2), (0.6, 3.6)];
    let places: Vec<_> = round.into_iter().cycle().take(30).collect();
    Person::new(30, walk(0.0, 1.0, &places), Activity::Stand)
}

/// Writes a calibration and what each camera saw of `people` at a time, seconds; returns their files.
fn record(
    folder: &Path,
    cameras: &[Camera],
    times: Times,
    people: &dyn Fn(f64) -> Vec<Person>,
) -> Vec<String> {
    let views = views(cameras.len());
    std::fs::write(folder.join("Calib.toml"), write_pose2sim(&views)).unwrap();
    let each = views.iter().zip(cameras).map(|(view, camera)| {
        let path = folder.join(format!("{}.jsonl", view.name));
        let mut file = RecordWriter::<ObservationsRow>::create(&path, Format::Jsonl).unwrap();
        let mut rng = SmallRng::seed_from_u64(7);
        let count = ((camera.runs.end - camera.runs.start) * camera.rate) as usize;
        for k in 0..count {
            let own = k as f64 / camera.rate;
            let t = camera.runs.start + own;
            let is_glance = (t - 0.5 / camera.rate).floor() < (t + 0.5 / camera.rate).floor();
            if camera.lacks.contains(&t) || (camera.rests.contains(&t) && !is_glance) {
                continue;
            }
            let spoil = Spoil {
                pixels: 1.0,
                ..Spoil::default()
            };
            let mut frame = observe(view, &people(t), t, spoil, &mut rng);
            let ns = |seconds: f64| (seconds * 1e9).round() as u64;
            frame.sequence = k as u64;
            frame.capture_ns = ns(own);
            match times {
                Times::Machine => {
                    frame.capture_ns = BEGIN + ns(t);
                    frame.publish_ns = frame.capture_ns + 40_000_000;
                }
                Times::Film => {
                    frame.flags = FLAG_FILE_TIME;
                    frame.publish_ns = BEGIN + ns(t);
                }
                Times::Bare => {}
            }
            file.write(&frame, "").unwrap();
        }
        file.finish().unwrap();
        path.display().to_string()
    });
    each.collect()
}

/// Runs `multiview` and returns what it said; its results are in the folder `run`.
fn run(folder: &Path, files: &[String], more: &[&str]) -> String {
    let [calibration, out] = ["Calib.toml", "run"].map(|n| folder.join(n).display().to_string());
    let mut args = vec!["multiview", "--no-dct", "--out", &out];
    if files.len() > 1 {
        args.extend(["--calibration", &calibration]);
    }
    args.extend(files.iter().flat_map(|file| ["--view", file]));
    args.extend(more);
    let done = output(&args);
    assert!(done.status.success(), "{more:?}: {}", stderr(&done));
    stderr(&done)
}

fn rows(folder: &Path) -> Vec<BodiesRow> {
    let lines = std::fs::File::open(folder.join("run/bodies.jsonl")).unwrap();
    let mut rows = RowReader::new(std::io::BufReader::new(lines), "bodies");
    std::iter::from_fn(|| rows.read().unwrap()).collect()
}

/// Mean distance of the joints from the walker's, metres, from one second to another of the tests' clock; bodies' times
/// begin at `zero`.
fn off(rows: &[BodiesRow], zero: u64, span: Range<f64>) -> f64 {
    let walker = walker();
    let each: Vec<f64> = rows
        .iter()
        .map(|row| (row, (row.time_ns - zero) as f64 * 1e-9))
        .filter(|(_, t)| span.contains(t))
        .map(|(row, t)| {
            let body = row.people.first().expect("somebody in every frame");
            error(&body.joints3d, &walker, t)
        })
        .collect();
    assert!(each.len() > 20, "{} frames in {span:?}", each.len());
    each.iter().sum::<f64>() / each.len() as f64
}

/// Half a minute, in which a quarter of a second is missing: so little that its rate says nothing.
fn with_a_hole() -> Camera {
    Camera {
        lacks: 10.0..10.25,
        ..camera(30.0, 0.0..30.0)
    }
}

/// Bodies are as right at the end as in the beginning.
fn assert_right(cameras: &[Camera], times: Times, sync: &str) {
    let folder = tempfile::tempdir().unwrap();
    let end = cameras.iter().map(|c| c.runs.end).fold(f64::MAX, f64::min);
    let files = record(folder.path(), cameras, times, &|_| vec![walker()]);
    run(folder.path(), &files, &["--sync", sync]);
    let rows = rows(folder.path());
    let zero = if times == Times::Machine { BEGIN } else { 0 };
    let [first, last] = [1.0..2.0, end - 1.5..end - 0.2].map(|s| off(&rows, zero, s));
    println!("--sync {sync}: {first:.3} m, at the end {last:.3} m");
    assert!(first < 0.04 && last < 0.04, "{first} m, {last} m");
}

#[test]
fn cameras_that_start_one_after_the_other_go_by_their_clock() {
    let usual = camera(30.0, 0.0..8.0);
    let late = camera(30.0, 0.7..8.0);
    let other = camera(25.0, 0.7..8.7);
    assert_right(&[usual.clone(), late.clone()], Times::Machine, "auto");
    assert_right(&[late, usual.clone()], Times::Machine, "auto");
    assert_right(&[usual.clone(), other, usual], Times::Machine, "auto");
}

/// Gives rows of a record other times, nanoseconds, by their numbers and their own.
fn retime(file: &str, time: &dyn Fn(usize, u64) -> u64) {
    let text = std::fs::read_to_string(file).unwrap();
    let each = text.lines().enumerate().map(|(k, line)| {
        let mut row: serde_json::Value = serde_json::from_str(line).unwrap();
        row["time_ns"] = time(k, row["time_ns"].as_u64().unwrap()).into();
        format!("{row}\n")
    });
    let text: String = each.collect();
    std::fs::write(file, text).unwrap();
}

#[test]
fn a_time_that_is_there_twice_shifts_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [camera(30.0, 0.0..8.0), camera(30.0, 0.7..8.0)];
    let files = record(folder.path(), &cameras, Times::Machine, &|_| vec![walker()]);
    retime(&files[1], &|k, t| if k == 50 { t - 34_000_000 } else { t });
    let said = run(folder.path(), &files, &[]);
    assert!(
        said.contains("camera cam1: 1 frame is not later than those before; left out"),
        "{said}"
    );
    let rows = rows(folder.path());
    let [first, last] = [1.0..2.0, 6.5..7.8].map(|s| off(&rows, BEGIN, s));
    assert!(first < 0.04 && last < 0.04, "{first} m, {last} m");
}

#[test]
fn times_that_tell_nothing_are_named() {
    let third = |k: usize, t: u64| if k % 3 == 2 { t - 34_000_000 } else { t };
    let folder = tempfile::tempdir().unwrap();
    let apart = [camera(30.0, 0.0..3.0), camera(30.0, 0.7..3.0)];
    let files = record(folder.path(), &apart, Times::Machine, &|_| vec![walker()]);
    retime(&files[1], &third);
    let [calibration, out] = ["Calib.toml", "run"].map(|n| folder.path().join(n));
    let [calibration, out] = [calibration, out].map(|path| path.display().to_string());
    let args = ["multiview", "--calibration", &calibration, "--out", &out];
    let views = ["--view", &files[0], "--view", &files[1]];
    let words = ["camera cam1", "23 of 69", "0.7 s apart", "--sync none"];
    assert_fails(&[&args[..], &views].concat(), 65, &words);
    // Films may have started together.
    let folder = tempfile::tempdir().unwrap();
    let together = [camera(30.0, 0.0..3.0), camera(30.0, 0.0..3.0)];
    let files = record(folder.path(), &together, Times::Film, &|_| vec![walker()]);
    retime(&files[1], &|_, _| 7);
    let said = run(folder.path(), &files, &[]);
    assert!(
        said.contains("camera cam1: its times do not tell") && !said.contains("camera cam0: its"),
        "{said}"
    );
    assert_eq!(rows(folder.path()).len(), 90);
}

#[test]
fn what_a_camera_that_died_cuts_off_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [camera(30.0, 0.0..8.0), camera(25.0, 0.7..5.0)];
    let files = record(folder.path(), &cameras, Times::Machine, &|_| vec![walker()]);
    let said = run(folder.path(), &files, &[]);
    for wanted in [
        "camera cam1 begins 0.7 s after cam0",
        "camera cam1 ends 3.0 s before cam0",
    ] {
        assert!(said.contains(wanted), "{said}");
    }
    // So is what was copied by half.
    let whole = std::fs::read(&files[0]).unwrap();
    std::fs::write(&files[0], &whole[..whole.len() / 2 + 7]).unwrap();
    std::fs::remove_dir_all(folder.path().join("run")).unwrap();
    let said = run(folder.path(), &files, &[]);
    for wanted in [
        "the frames before it are used",
        "camera cam0 ends 1.0 s before cam1",
    ] {
        assert!(said.contains(wanted), "{said}");
    }
}

/// Each verb names options of its own.
#[test]
fn cameras_that_never_ran_together_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [camera(30.0, 0.0..3.0), camera(30.0, 6.0..9.0)];
    let files = record(folder.path(), &cameras, Times::Machine, &|_| vec![walker()]);
    let [calibration, run, found] =
        ["Calib.toml", "run", "found.toml"].map(|n| folder.path().join(n).display().to_string());
    let views = ["--view", &files[0], "--view", &files[1]];
    let fit = ["multiview", "--calibration", &calibration, "--out", &run];
    let fit = [&fit[..], &views].concat();
    assert_fails(&fit, 65, &["ran at one time", "--sync motion"]);
    let find = [&["calibrate", "--out", &found][..], &views].concat();
    assert_fails(&find, 65, &["ran at one time", "--fps"]);
    assert!(!stderr(&output(&find)).contains("--sync"));
}

/// A quarter of a second apart by the end, were they paired by number.
#[test]
fn rates_that_differ_by_little_do_not_drift_apart() {
    let cameras = [camera(30.0, 0.0..30.0), camera(29.75, 0.0..30.0)];
    assert_right(&cameras, Times::Machine, "auto");
}

#[test]
fn a_record_that_lacks_frames_goes_by_its_times() {
    let usual = camera(30.0, 0.0..30.0);
    assert_right(&[usual, with_a_hole()], Times::Machine, "auto");
}

#[test]
fn frames_that_the_first_record_lacks_shift_nothing() {
    let usual = camera(30.0, 0.0..30.0);
    assert_right(&[with_a_hole(), usual], Times::Machine, "auto");
}

#[test]
fn films_that_start_together_go_by_their_times() {
    let cameras = [camera(30.0, 0.0..30.0), with_a_hole()];
    assert_right(&cameras, Times::Film, "times");
}

#[test]
fn films_that_are_told_to_start_together_go_by_their_times() {
    let cameras = [camera(30.0, 0.0..30.0), with_a_hole()];
    assert_right(&cameras, Times::Film, "auto");
}

#[test]
fn films_that_end_one_after_the_other_are_cut() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [camera(30.0, 0.0..5.0), camera(30.0, 0.0..7.0)];
    let files = record(folder.path(), &cameras, Times::Film, &|_| vec![walker()]);
    let said = run(folder.path(), &files, &["--sync", "times"]);
    assert!(
        said.contains("camera cam0 has 60 frames less than cam1"),
        "{said}"
    );
    assert_eq!(rows(folder.path()).len(), 150);
    let out = folder.path().join("other").display().to_string();
    let calibration = folder.path().join("Calib.toml").display().to_string();
    let args = [
        "multiview",
        "--calibration",
        &calibration,
        "--out",
        &out,
        "--sync",
        "none",
    ];
    let views = ["--view", &files[0], "--view", &files[1]];
    assert_fails(
        &[&args[..], &views].concat(),
        65,
        &["one length", "210", "150"],
    );
}

/// Rows of other programs have no flags: they are no live camera's, whose starts would tell the time between them.
#[test]
fn records_without_flags_are_not_of_one_clock() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [camera(30.0, 2.0..8.0), camera(30.0, 0.6..8.0)];
    let files = record(folder.path(), &cameras, Times::Bare, &|_| vec![walker()]);
    let said = run(folder.path(), &files, &[]);
    assert!(
        said.contains("cam1 started 1.4") || said.contains("cam1 started 1.39"),
        "{said}"
    );
}

/// Somebody leaves, and somebody else comes 10 s later to where they were; nobody was looked for but once a second.
#[test]
fn pauses_are_as_long_as_they_were() {
    let rests = Camera {
        rests: 2.0..12.0,
        ..camera(30.0, 0.0..14.0)
    };
    // Both walk along one line at one speed.
    let line = |start: f64, seed: u64| {
        let legs = walk(start, 0.8, &[(-0.8, 4.2), (0.8, 4.2)]);
        Person::new(seed, legs, Activity::Stand)
    };
    let people = |t: f64| match t {
        t if t < 2.0 => vec![line(0.0, 30)],
        t if t < 12.0 => Vec::new(),
        _ => vec![line(12.0, 31)],
    };
    for count in [1, 2] {
        let folder = tempfile::tempdir().unwrap();
        let cameras = vec![rests.clone(); count];
        let files = record(folder.path(), &cameras, Times::Machine, &people);
        run(folder.path(), &files, &[]);
        let rows = rows(folder.path());
        let ids = |span: Range<f64>| -> Vec<u32> {
            let within = |row: &&BodiesRow| span.contains(&((row.time_ns - BEGIN) as f64 * 1e-9));
            let all = rows.iter().filter(within).flat_map(|row| &row.people);
            all.map(|body| body.id).collect()
        };
        let (before, after) = (ids(0.5..1.9), ids(12.5..13.9));
        assert!(
            before.len() > 30 && after.len() > 30,
            "{before:?}, {after:?}"
        );
        assert!(
            before.iter().all(|id| !after.contains(id)),
            "{count} views: {before:?}, {after:?}"
        );
        assert!(ids(3.0..11.9).is_empty(), "{count} views: nobody was there");
        // Velocities against where bodies were, by the rows' own times.
        let speeds: Vec<[f64; 2]> = rows
            .windows(3)
            .filter_map(|w| {
                let [a, now, b] = [&w[0], &w[1], &w[2]].map(|row| row.people.first());
                let (a, now, b) = (a?, now?, b?);
                let span = (w[2].time_ns - w[0].time_ns) as f64 * 1e-9;
                let way =
                    glam::Vec3::from(b.joints3d[PELVIS]) - glam::Vec3::from(a.joints3d[PELVIS]);
                let told = glam::Vec3::from(now.velocity);
                (a.id == b.id).then(|| [told.length().into(), f64::from(way.length()) / span])
            })
            .collect();
        let [told, went] = [0, 1].map(|k| speeds.iter().map(|s| s[k]).sum::<f64>());
        assert!(
            (told / went - 1.0).abs() < 0.1,
            "{count} views: {told}, {went}"
        );
    }
}

#[test]
fn a_view_whose_start_cannot_be_told_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = [
        camera(30.0, 2.0..7.0),
        camera(30.0, 0.6..6.0),
        camera(30.0, 2.3..7.0),
        camera(30.0, 2.0..7.0),
    ];
    let files = record(folder.path(), &cameras, Times::Film, &|_| vec![walker()]);
    // The last one's room is still.
    let text = std::fs::read_to_string(&files[3]).unwrap();
    let lines: Vec<serde_json::Value> = text
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    let still: String = lines
        .iter()
        .map(|line| {
            let mut line = line.clone();
            line["people"] = lines[0]["people"].clone();
            format!("{line}\n")
        })
        .collect();
    std::fs::write(&files[3], still).unwrap();
    let said = run(folder.path(), &files, &[]);
    assert!(
        said.contains("when camera cam3 started") && said.contains("left out"),
        "{said}"
    );
    let bodies = |run: &str| std::fs::read(folder.path().join(run).join("bodies.jsonl")).unwrap();
    let report = std::fs::read_to_string(folder.path().join("run/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["views"].as_array().unwrap().len(), 3, "{report}");
    std::fs::rename(folder.path().join("run"), folder.path().join("four")).unwrap();
    run(folder.path(), &files[..3], &[]);
    assert_eq!(bodies("run"), bodies("four"));
}

#[test]
fn live_cameras_are_calibrated_by_their_clock() {
    let truth = views(3);
    let far = |a: &[edgecap::camera::View]| {
        let at = |k: usize| a[k].position;
        [(0, 1), (0, 2), (1, 2)].map(|(i, j)| at(i).distance(at(j)))
    };
    let distance = format!("cam0,cam1={:.6}", far(&truth)[0]);
    let together = camera(30.0, 0.0..12.0);
    let apart = camera(25.0, 0.4..12.0);
    for second in [together.clone(), apart] {
        let folder = tempfile::tempdir().unwrap();
        let cameras = [together.clone(), second, together.clone()];
        let files = record(folder.path(), &cameras, Times::Machine, &|_| vec![walker()]);
        let at = |name: &str| folder.path().join(name).display().to_string();
        let (lens, out) = (at("Calib.toml"), at("found.toml"));
        let mut args = vec![
            "calibrate",
            "--lens",
            &lens,
            "--out",
            &out,
            "--distance",
            &distance,
        ];
        args.extend(files.iter().flat_map(|file| ["--view", file]));
        let done = output(&args);
        assert!(done.status.success(), "{}", stderr(&done));
        let found = calibration::read(out.as_ref()).unwrap().views;
        for (found, truth) in far(&found).into_iter().zip(far(&truth)) {
            println!("{found:.3} m for {truth:.3} m");
            assert!((found - truth).abs() < 0.15, "{found} m for {truth} m");
        }
    }
}

#[test]
fn a_film_may_be_called_as_people_call_films() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (hall, film, out) = (at("hall"), at("cam 1.ä.avi"), at("run"));
    let synth = [
        "synth", "--views", "1", "--frames", "6", "--fps", "10", "--width", "640", "--height",
        "400", "--seed", "2", "--out", &hall,
    ];
    let done = output(&synth);
    assert!(done.status.success(), "{}", stderr(&done));
    std::fs::rename(at("hall/cam01.avi"), &film).unwrap();
    let done = output(&["multiview", "--view", &film, "--out", &out]);
    // Whether somebody is found in six frames is not asked: without a look at them the code is another one.
    let said = stderr(&done);
    assert!(!said.contains("camera name"), "{said}");
    assert!(matches!(done.status.code(), Some(0 | 65)), "{said}");
}

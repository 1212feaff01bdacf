//! Clocks of views that were not started together, against offsets that were put in.

use std::path::Path;

use edgecap::camera::View;
use edgecap::camera::calibration::write_pose2sim;
use edgecap::message::{FLAG_FILE_TIME, ObservationFrame};
use edgecap::multiview::Sight;
use edgecap::multiview::time::{Offset, Watched, offsets};
use edgecap::record::{Format, ObservationsRow, RecordWriter};
use rand::SeedableRng;
use rand::rngs::SmallRng;

use crate::program::{assert_fails, output, stderr};
use crate::scene::people::{Activity, Person, walk};
use crate::scene::ring::{Spoil, observe, views};

const NOISY: Spoil = Spoil {
    pixels: 5.0,
    space: 0.05,
    unseen: 0.08,
    outliers: 0.03,
    exchanged: false,
    arms_exchanged: false,
    colourless: false,
};

/// A camera's clock: frames a second, and how many seconds it started before the first camera.
type Clock = (f64, f64);

fn walkers(count: usize) -> Vec<Person> {
    let ways = [
        [
            (-0.9, 3.4),
            (1.1, 4.4),
            (-0.8, 5.2),
            (0.6, 3.6),
            (-1.0, 4.6),
        ],
        [(1.3, 5.4), (-1.2, 5.0), (0.2, 5.9), (-1.3, 4.0), (1.0, 4.9)],
    ];
    (0..count)
        .map(|k| {
            let legs = walk(0.4 + k as f64, 1.0 + 0.2 * k as f64, &ways[k]);
            Person::new(30 + k as u64, legs, Activity::Stand)
        })
        .collect()
}

/// What a view with this clock saw in so many seconds; the first view's clock is the people's own, less two seconds.
fn record(
    view: &View,
    (rate, ahead): Clock,
    people: &[Person],
    seconds: f64,
    spoil: Spoil,
    frozen: bool,
) -> Vec<ObservationFrame> {
    let mut rng = SmallRng::seed_from_u64((1e3 * (rate + ahead + 10.0)) as u64);
    (0..(seconds * rate) as usize)
        .map(|k| {
            let own = k as f64 / rate;
            let t = if frozen { 3.0 } else { own - ahead + 2.0 };
            let mut frame = observe(view, people, t, spoil, &mut rng);
            (frame.sequence, frame.capture_ns) = (k as u64, (own * 1e9).round() as u64);
            frame.flags = FLAG_FILE_TIME;
            frame
        })
        .collect()
}

fn found(
    clocks: &[Clock],
    people: &[Person],
    seconds: f64,
    spoil: Spoil,
    frozen: bool,
) -> Vec<Offset> {
    let views = views(clocks.len());
    let records: Vec<Vec<ObservationFrame>> = views
        .iter()
        .zip(clocks)
        .map(|(view, clock)| record(view, *clock, people, seconds, spoil, frozen))
        .collect();
    told(&views, &records)
}

fn told(views: &[View], records: &[Vec<ObservationFrame>]) -> Vec<Offset> {
    let times: Vec<Vec<f64>> = records
        .iter()
        .map(|r| r.iter().map(|f| f.capture_ns as f64 * 1e-9).collect())
        .collect();
    let people: Vec<Vec<Vec<Sight>>> = records
        .iter()
        .zip(views)
        .map(|(r, view)| {
            let frame =
                |f: &ObservationFrame| f.people().iter().map(|o| Sight::new(view, o)).collect();
            r.iter().map(frame).collect()
        })
        .collect();
    let watched: Vec<Watched<'_>> = (0..views.len())
        .map(|k| Watched {
            view: &views[k],
            times: &times[k],
            people: &people[k],
        })
        .collect();
    offsets(&watched)
}

#[test]
fn offsets_of_up_to_two_seconds_are_found_within_half_a_frame() {
    for (clocks, count, spoil) in [
        (
            &[(30.0, 0.0), (30.0, 0.217), (30.0, -1.93)][..],
            1,
            Spoil::default(),
        ),
        (&[(30.0, 0.0), (30.0, 2.0), (30.0, -0.451)], 1, NOISY),
        (&[(30.0, 0.0), (30.0, -1.268)], 2, NOISY),
        // Of other rates.
        (
            &[(30.0, 0.0), (50.0, 0.731), (24.0, -2.0)],
            2,
            Spoil::default(),
        ),
        (&[(25.0, 0.0), (60.0, 1.105)], 1, NOISY),
    ] {
        let told = found(clocks, &walkers(count), 8.0, spoil, false);
        println!("{clocks:?}: {told:?}");
        assert_eq!(told[0], Offset::Told(0.0));
        for (told, (_, ahead)) in told.iter().zip(clocks) {
            let Offset::Told(seconds) = told else {
                panic!("{clocks:?}: {told:?}");
            };
            assert!((seconds - ahead).abs() < 0.5 / 30.0, "{clocks:?}: {told:?}");
        }
    }
}

#[test]
fn views_that_started_together_are_told_so_whatever_the_noise() {
    for count in [2, 3, 4] {
        let clocks = vec![(30.0, 0.0); count];
        let told = found(&clocks, &walkers(2), 8.0, NOISY, false);
        assert_eq!(told, vec![Offset::Told(0.0); count]);
    }
    // Two that did are so as well beside one that did not.
    let told = found(
        &[(30.0, 0.0), (30.0, 0.0), (30.0, 1.4)],
        &walkers(2),
        8.0,
        NOISY,
        false,
    );
    assert_eq!(told[..2], [Offset::Told(0.0); 2]);
    assert!((told[2].seconds() - 1.4).abs() < 0.5 / 30.0, "{told:?}");
}

#[test]
fn clocks_that_jump_by_years_are_told() {
    const YEARS: u64 = 1_000_000_000_000_000_000;
    let (views, people) = (views(2), walkers(1));
    let clocks = [(30.0, 0.0), (30.0, 0.217)];
    let record = |(view, clock): (&View, &Clock)| {
        let mut frames = record(view, *clock, &people, 8.0, Spoil::default(), false);
        for frame in &mut frames {
            if frame.capture_ns as f64 * 1e-9 - clock.1 >= 4.0 {
                frame.capture_ns += YEARS;
            }
        }
        frames
    };
    let records: Vec<_> = views.iter().zip(&clocks).map(record).collect();
    let Offset::Told(seconds) = told(&views, &records)[1] else {
        panic!("cannot tell");
    };
    assert!((seconds - 0.217).abs() < 0.5 / 30.0, "{seconds}");
}

#[test]
fn where_nobody_moves_it_cannot_be_told() {
    for (spoil, people, seconds) in [
        (Spoil::default(), 2, 5.0),
        (NOISY, 2, 5.0),
        (NOISY, 1, 5.0),
        (NOISY, 1, 1.5),
        (NOISY, 1, 0.8),
    ] {
        let clocks = [(30.0, 0.0), (30.0, 0.4), (25.0, -0.2)];
        let told = found(&clocks, &walkers(people), seconds, spoil, true);
        assert_eq!(
            told[1..],
            [Offset::CannotTell; 2],
            "{people} in {seconds} s"
        );
    }
    let nobody = found(&[(30.0, 0.0), (30.0, 0.9)], &[], 3.0, NOISY, false);
    assert_eq!(nobody[1], Offset::CannotTell);
    let moment = found(&[(30.0, 0.0), (30.0, 0.0)], &walkers(1), 0.1, NOISY, false);
    assert_eq!(moment[1], Offset::CannotTell, "of three frames");
}

fn write(folder: &Path, name: &str, frames: &[ObservationFrame]) -> String {
    let path = folder.join(format!("{name}.jsonl"));
    let mut writer = RecordWriter::<ObservationsRow>::create(&path, Format::Jsonl).unwrap();
    for frame in frames {
        writer.write(frame, "").unwrap();
    }
    writer.finish().unwrap();
    path.display().to_string()
}

#[test]
fn views_that_started_one_after_the_other_become_one_run() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(3);
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("Calib.toml"), write_pose2sim(&views)).unwrap();
    let people = walkers(1);
    let clocks = [(30.0, 0.0), (30.0, 1.4), (25.0, -0.6)];
    let mut args = vec![
        "multiview".to_owned(),
        "--calibration".into(),
        at("Calib.toml"),
    ];
    for (view, clock) in views.iter().zip(clocks) {
        let frames = record(
            view,
            clock,
            &people,
            4.5,
            Spoil {
                pixels: 2.0,
                ..Spoil::default()
            },
            false,
        );
        args.extend(["--view".into(), write(folder.path(), &view.name, &frames)]);
    }
    let run = |more: &[&str]| {
        let args: Vec<&str> = args
            .iter()
            .map(String::as_str)
            .chain(more.iter().copied())
            .collect();
        output(&args)
    };
    let out = run(&["--out", &at("run"), "--no-dct"]);
    let said = stderr(&out);
    assert!(out.status.success(), "{said}");
    assert!(
        said.contains("cam1 started 1.4") && said.contains("before cam0"),
        "{said}"
    );
    assert!(
        said.contains("cam2 started 0.6") || said.contains("cam2 started 0.59"),
        "{said}"
    );
    let report = std::fs::read_to_string(at("run/report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    for (line, (_, ahead)) in report["views"].as_array().unwrap().iter().zip(clocks) {
        let offset = line["offset_s"].as_f64().unwrap();
        assert!((offset - ahead).abs() < 0.5 / 30.0, "{line}");
        let off = line["median_percent"].as_f64().unwrap();
        assert!(off < 2.5, "views agree: {line}");
    }
    // The time that all three share: from cam2's first frame, 0.6 s after cam0's, to cam1's last, 3.1 s after.
    let frames = report["frames"].as_u64().unwrap();
    assert!((70..=78).contains(&frames), "{frames}");

    let refused = |more: &[&str], code: i32, words: &[&str]| {
        let all: Vec<&str> = args
            .iter()
            .map(String::as_str)
            .chain(more.iter().copied())
            .collect();
        assert_fails(&all, code, words);
    };
    refused(
        &["--out", &at("x"), "--sync", "none"],
        65,
        &["one rate", "30.00", "25.00"],
    );
    let still: Vec<String> = views
        .iter()
        .map(|view| {
            let frames = record(view, (30.0, 0.0), &people, 1.5, NOISY, true);
            write(folder.path(), &format!("still/{}", view.name), &frames)
        })
        .collect();
    let mut args = vec![
        "multiview",
        "--calibration",
        args[2].as_str(),
        "--sync",
        "motion",
    ];
    for file in &still {
        args.extend(["--view", file]);
    }
    let x = at("x");
    args.extend(["--out", &x]);
    assert_fails(&args, 65, &["cannot tell", "cam0 and cam1", "--sync times"]);
}

/// The report's views by name, and its frames.
fn reported(run: &str) -> (Vec<(String, serde_json::Value)>, u64) {
    let text = std::fs::read_to_string(Path::new(run).join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    let views = report["views"].as_array().unwrap().iter();
    let views = views.map(|v| (v["name"].as_str().unwrap().to_owned(), v.clone()));
    (views.collect(), report["frames"].as_u64().unwrap())
}

/// Two cameras that ran together for ten seconds, and one that was started three seconds later, in which nobody is seen
/// for long enough to tell.
#[test]
fn a_view_that_cannot_have_started_with_the_others_takes_nothing_from_them() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(3);
    let at = |name: &str| folder.path().join(name).display().to_string();
    let (calibration, run) = (at("Calib.toml"), at("run"));
    std::fs::write(&calibration, write_pose2sim(&views)).unwrap();
    let people = walkers(2);
    let mut args = vec![
        "multiview",
        "--calibration",
        &calibration,
        "--no-dct",
        "--out",
        &run,
    ];
    let files: Vec<String> = (views.iter().zip([0.0, 0.0, -3.0]))
        .map(|(view, ahead)| {
            let mut frames = record(view, (30.0, ahead), &people, 10.0 + ahead, NOISY, false);
            if ahead != 0.0 {
                frames[3..].iter_mut().for_each(|frame| frame.count = 0);
            }
            write(folder.path(), &view.name, &frames)
        })
        .collect();
    args.extend(files.iter().flat_map(|file| ["--view", file]));
    let out = output(&args);
    let said = stderr(&out);
    assert!(out.status.success(), "{said}");
    assert!(said.contains("cam1 started together with cam0"), "{said}");
    assert!(
        said.contains("cam2") && said.contains("not as long"),
        "{said}"
    );
    let (views, frames) = reported(&run);
    let names: Vec<&str> = views.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!((&names[..], frames), (&["cam0", "cam1"][..], 300));
}

/// The one that is held out is the fastest, and was started first.
#[test]
fn bodies_are_those_without_the_camera_that_is_held_out() {
    let folder = tempfile::tempdir().unwrap();
    let views = views(3);
    let at = |name: &str| folder.path().join(name).display().to_string();
    let calibration = at("Calib.toml");
    std::fs::write(&calibration, write_pose2sim(&views)).unwrap();
    let people = walkers(1);
    let clocks = [(60.0, 0.9), (30.0, 0.0), (25.0, 0.4)];
    let spoil = Spoil {
        pixels: 2.0,
        ..Spoil::default()
    };
    let files: Vec<String> = (views.iter().zip(clocks))
        .map(|(view, clock)| {
            let frames = record(view, clock, &people, 5.0, spoil, false);
            write(folder.path(), &view.name, &frames)
        })
        .collect();
    let run = |files: &[String], name: &str, more: &[&str]| {
        let to = at(name);
        let mut args = vec![
            "multiview",
            "--calibration",
            &calibration,
            "--no-dct",
            "--out",
            &to,
        ];
        args.extend(files.iter().flat_map(|file| ["--view", file]));
        args.extend(more);
        let out = output(&args);
        assert!(out.status.success(), "{}", stderr(&out));
        to
    };
    let held = run(&files, "held", &["--hold-out", "cam0"]);
    let without = run(&files[1..], "without", &[]);
    for file in ["bodies.npz", "bodies.jsonl"] {
        let [held, without] =
            [&held, &without].map(|run| std::fs::read(Path::new(run).join(file)).unwrap());
        assert!(held == without, "{file}");
    }
    // It is measured all the same, at its own time.
    let (views, _) = reported(&held);
    let (name, line) = &views[0];
    assert_eq!(
        (name.as_str(), line["weight"].as_f64()),
        ("cam0", Some(0.0))
    );
    let offset = line["offset_s"].as_f64().unwrap();
    assert!((offset - 0.9).abs() < 0.5 / 30.0, "{line}");
    assert!(line["median_percent"].as_f64().unwrap() < 5.0, "{line}");
}

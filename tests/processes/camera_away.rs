//! A camera that is not there yet, goes away, falls silent, comes back.

use std::io::{BufRead, BufReader};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use crate::program::stand_in::{StandIn, Watched};
use crate::program::{Running, assert_fails, edgecap, eventually, signal, stderr, stream};
use edgecap::camera::monotonic_ns;
use edgecap::capture::{AviReader, Frame, Source};
use edgecap::message::{BodyFrame, ObservationFrame};
use edgecap_client::Subscriber;

/// Waits for a body of a picture that is taken from now on.
fn fresh_body(bodies: &Subscriber<BodyFrame>) -> u64 {
    let from = monotonic_ns();
    eventually("a body of a new picture", || {
        let body = bodies.next(Duration::from_millis(100)).unwrap()?;
        (body.capture_ns >= from).then_some(body.sequence)
    })
}

#[test]
fn a_camera_that_is_absent_at_the_start_is_waited_for() {
    let camera = StandIn::absent(30.0);
    let mut watched = Watched::start("late", &camera, &[]);
    let bodies = watched.listen::<BodyFrame>();
    // It is plugged in when it is waited for, however long a busy machine takes to look for it.
    let stderr = watched.run.0.stderr.take().unwrap();
    let (send, lines) = channel();
    let reader = std::thread::spawn(move || {
        for line in BufReader::new(stderr).lines().map_while(Result::ok) {
            let _ = send.send(line);
        }
    });
    let mut said: Vec<String> = Vec::new();
    let waits = |line: &String| line.contains("waiting for the camera");
    while !said.last().is_some_and(waits) {
        let line = lines.recv_timeout(Duration::from_secs(60));
        said.push(line.expect("it says that it waits"));
    }
    assert!(!watched.run.has_ended());
    camera.plug_in();
    fresh_body(&bodies);
    drop(bodies);
    signal(watched.run.pid(), "TERM");
    eventually("the end", || watched.run.has_ended().then_some(()));
    assert!(watched.run.0.wait().unwrap().success());
    reader.join().unwrap();
    said.extend(lines);
    assert_eq!(said.iter().filter(|l| waits(l)).count(), 1, "{said:?}");
}

#[test]
fn with_no_wait_an_absent_camera_ends_the_run() {
    let camera = StandIn::absent(30.0);
    let name = stream("no-wait");
    let args = [
        "run",
        "--no-wait",
        "--input",
        &camera.input(),
        "--name",
        &name,
    ];
    assert_fails(&args, 69, &["no such file"]);
}

/// The clip that stands in for a camera would play without end.
#[test]
fn with_no_wait_nothing_stands_in_for_a_camera() {
    if edgecap::capture::list_cameras().is_ok() {
        eprintln!("skipped: this machine has a camera");
        return;
    }
    let args = ["run", "--no-wait", "--name", &stream("no-clip-no-wait")];
    assert_fails(&args, 69, &["--no-wait", "expected a camera"]);
}

#[test]
fn an_unplugged_camera_and_a_killed_infer_are_back_when_it_is_plugged_in() {
    let camera = StandIn::new(30.0);
    let watched = Watched::start("unplugged", &camera, &[]);
    let bodies = watched.listen::<BodyFrame>();
    fresh_body(&bodies);
    camera.unplug();
    let infer = eventually("infer", || watched.run.child("infer"));
    signal(infer, "KILL");
    eventually("another infer", || {
        watched.run.child("infer").filter(|p| *p != infer)
    });
    std::thread::sleep(Duration::from_millis(500));
    assert!(!watched.run.has_ended(), "it waits");
    camera.plug_in();
    fresh_body(&bodies);
    camera.fall_silent();
    std::thread::sleep(Duration::from_millis(1500));
    let infer = eventually("infer", || watched.run.child("infer"));
    camera.plug_in();
    fresh_body(&bodies);
    assert_eq!(
        watched.run.child("infer"),
        Some(infer),
        "a silent camera is no reason to replace infer"
    );
    drop(bodies);
    assert!(watched.stop().status.success());
}

#[test]
fn stopping_does_not_wait_for_the_camera() {
    let camera = StandIn::absent(30.0);
    let watched = Watched::start("stop-waiting", &camera, &[]);
    eventually("infer", || watched.run.child("infer"));
    let asked = Instant::now();
    assert!(watched.stop().status.success());
    assert!(asked.elapsed() < Duration::from_secs(20));
}

#[test]
fn infer_itself_stops_while_it_waits_for_the_camera() {
    let camera = StandIn::new(30.0);
    let name = stream("stop-infer");
    // `run` would kill one that does not.
    let infer = Running::start(&["infer", "--input", &camera.input(), "--name", &name]);
    let observations = Subscriber::<ObservationFrame>::open(&name).unwrap();
    eventually("an observation", || {
        observations.next(Duration::from_millis(100)).unwrap()
    });
    camera.unplug();
    // Within a second it has lost the camera, and looks for it.
    std::thread::sleep(Duration::from_secs(1));
    assert!(!infer.has_ended(), "it waits");
    drop(observations);
    signal(infer.pid(), "TERM");
    let out = infer.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
}

/// A camera as `edgecap status` has it.
fn told(name: &str) -> Option<serde_json::Value> {
    let out = edgecap().args(["status", "--json"]).output().unwrap();
    let runs: serde_json::Value = serde_json::from_slice(&out.stdout).ok()?;
    let mut cameras = runs
        .as_array()?
        .iter()
        .filter_map(|r| r["cameras"].as_array())
        .flatten();
    cameras.find(|c| c["name"] == name).cloned()
}

/// Frames, and how often the camera came back.
fn counted(name: &str) -> Option<(u64, u64)> {
    let camera = told(name)?;
    Some((camera["frames"].as_u64()?, camera["reconnects"].as_u64()?))
}

/// Waits until the status, which is renewed once a second, tells of so many frames more.
fn frames_more(name: &str, more: u64) -> u64 {
    let (from, _) = eventually("the status", || counted(name));
    let told = eventually("frames in the status", || {
        counted(name).filter(|(frames, _)| *frames >= from + more)
    });
    told.1
}

#[test]
fn only_a_camera_that_was_away_has_come_back() {
    // Its next picture is not due at most looks.
    let camera = StandIn::new(5.0);
    let watched = Watched::start("five-a-second", &camera, &["--no-idle"]);
    let bodies = watched.listen::<BodyFrame>();
    fresh_body(&bodies);
    assert_eq!(frames_more(&watched.name, 15), 0);
    camera.unplug();
    eventually("its absence in the status", || {
        (told(&watched.name)?["healthy"] == false).then_some(())
    });
    camera.plug_in();
    fresh_body(&bodies);
    assert_eq!(frames_more(&watched.name, 10), 1);
    drop(bodies);
    assert!(watched.stop().status.success());
}

#[test]
fn damaged_pictures_are_no_camera_that_is_away() {
    let folder = tempfile::tempdir().unwrap();
    let film = folder.path().join("damaged.avi");
    let mut bytes = std::fs::read("models/demo/demo.avi").unwrap();
    // Every third picture of the film begins as no JPEG does.
    let pictures: Vec<usize> = (0..bytes.len() - 10)
        .filter(|&at| {
            bytes[at..].starts_with(b"00dc") && bytes[at + 8..].starts_with(&[0xff, 0xd8])
        })
        .collect();
    assert!(pictures.len() > 30);
    for at in pictures.iter().step_by(3) {
        bytes[at + 8..at + 10].fill(0);
    }
    std::fs::write(&film, bytes).unwrap();
    let camera = StandIn::of(&film, 10.0);
    let watched = Watched::start("damaged", &camera, &["--no-idle"]);
    let bodies = watched.listen::<BodyFrame>();
    fresh_body(&bodies);
    assert_eq!(frames_more(&watched.name, 15), 0);
    drop(bodies);
    assert!(watched.stop().status.success());
}

/// `edgecap run` on a camera with a lens that is calibrated for its pictures.
fn with_lens(test: &str, camera: &StandIn) -> (Watched, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let lens = folder.path().join("lens.toml");
    let text = "fx = 90.0\ncx = 47.5\ncy = 31.5\nwidth = 96\nheight = 64\n";
    std::fs::write(&lens, text).unwrap();
    let lens = lens.to_str().unwrap();
    let watched = Watched::start(test, camera, &["--no-idle", "--camera", lens]);
    (watched, folder)
}

/// At the start it would end the run: the lens is a mistake then.
#[test]
fn a_camera_that_sends_another_shape_for_a_while_does_not_end_the_run() {
    let camera = StandIn::new(30.0);
    let (watched, _lens) = with_lens("shape", &camera);
    let bodies = watched.listen::<BodyFrame>();
    fresh_body(&bodies);
    let infer = eventually("infer", || watched.run.child("infer"));
    // The status is a moment late: it has to tell of each change, not of what was before.
    let told_of_bodies = || {
        eventually("bodies in the status", || {
            (told(&watched.name)?["healthy"] == true).then_some(())
        })
    };
    told_of_bodies();
    for _ in 0..2 {
        camera.changes_size((64, 64));
        eventually("no bodies in the status", || {
            (told(&watched.name)?["healthy"] == false).then_some(())
        });
        assert!(!watched.run.has_ended(), "it goes on");
        camera.plug_in();
        fresh_body(&bodies);
        told_of_bodies();
    }
    assert_eq!(watched.run.child("infer"), Some(infer));
    // What it sent was of no use, as if it were away.
    eventually("it came back twice in the status", || {
        counted(&watched.name).filter(|(_, reconnects)| *reconnects == 2)
    });
    drop(bodies);
    let out = watched.stop();
    assert!(out.status.success());
    let said = stderr(&out);
    assert_eq!(
        said.matches("another shape are left out").count(),
        1,
        "{said}"
    );
}

#[test]
fn an_infer_that_is_killed_while_its_camera_sends_another_shape_does_not_end_the_run() {
    let camera = StandIn::new(30.0);
    let (mut watched, _lens) = with_lens("shape-killed", &camera);
    let bodies = watched.listen::<BodyFrame>();
    fresh_body(&bodies);
    camera.changes_size((64, 64));
    watched.run.says("another shape are left out");
    let infer = eventually("infer", || watched.run.child("infer"));
    signal(infer, "KILL");
    let another = eventually("another infer", || {
        watched.run.child("infer").filter(|p| *p != infer)
    });
    watched.run.says("another shape are left out");
    camera.plug_in();
    fresh_body(&bodies);
    assert_eq!(watched.run.child("infer"), Some(another), "it waited");
    drop(bodies);
    assert!(watched.stop().status.success());
}

#[test]
fn a_camera_of_another_shape_than_its_lens_is_told_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let lens = folder.path().join("lens.toml");
    let text = "fx = 90.0\ncx = 31.5\ncy = 31.5\nwidth = 64\nheight = 64\n";
    std::fs::write(&lens, text).unwrap();
    let camera = StandIn::new(30.0);
    let (input, name, lens) = (camera.input(), stream("lens-shape"), lens.to_str().unwrap());
    let words = [
        "camera.toml",
        "calibrated for 64x64",
        "96x64",
        "--capture-size 64x64",
        "fov_degrees",
    ];
    for verb in ["infer", "run"] {
        let args = [verb, "--input", &input, "--name", &name, "--camera", lens];
        let small = ["--size", "64x64", "--threads", "1"];
        assert_fails(&[&args[..], &small].concat(), 78, &words);
    }
}

#[test]
fn a_film_of_a_camera_that_comes_back_with_another_size_goes_on_in_another_file() {
    let folder = tempfile::tempdir().unwrap();
    let film = folder.path().join("film.avi");
    let camera = StandIn::new(30.0);
    let (input, name) = (camera.input(), stream("film-of-camera"));
    let args = ["infer", "--input", &input, "--name", &name, "--overlay"];
    let small = ["--no-idle", "--size", "64x64", "--threads", "1"];
    let infer = Running::start(&[&args[..], &[film.to_str().unwrap()], &small].concat());
    let observations = Subscriber::<ObservationFrame>::open(&name).unwrap();
    let sees = |size: (u32, u32)| {
        eventually("a picture of this size", || {
            let seen = observations.next(Duration::from_millis(100)).unwrap()?;
            ((seen.width, seen.height) == size).then_some(())
        });
    };
    sees((96, 64));
    camera.changes_size((64, 64));
    sees((64, 64));
    drop(observations);
    signal(infer.pid(), "TERM");
    let out = infer.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
    for (part, size) in [("film.avi", (96, 64)), ("film-2.avi", (64, 64))] {
        let file = std::fs::File::open(folder.path().join(part)).unwrap();
        let mut film = AviReader::new(file, part).unwrap();
        let mut picture = Frame::default();
        assert!(film.next_into(&mut picture).unwrap());
        assert_eq!((picture.width, picture.height), size);
    }
}

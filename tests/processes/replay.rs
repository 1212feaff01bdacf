//! `edgecap record` and `edgecap replay`: what was published comes again, and a client cannot tell.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use edgecap::camera::monotonic_ns;
use edgecap::record::{
    BodiesRow, BodyReader, Format, ObservationsRow, RecordWriter, Row, RowReader,
};
use edgecap_client::message::{
    Body, BodyFrame, BodyState, FLAG_END_OF_STREAM, FLAG_FILE_TIME, HealthFrame, HealthPace,
    HealthState, Intrinsics, Observation, ObservationFrame,
};
use edgecap_client::{Publisher, Subscriber};

use crate::program::{self, Running, assert_fails, eventually, output, signal, stderr, stream};

const STEP: u64 = 20_000_000;

fn frame(number: u64) -> BodyFrame {
    let mut frame = BodyFrame {
        sequence: 40 + number,
        capture_ns: 7_000_000_000 + number * STEP,
        pose_ns: 7_000_000_000 + number * STEP,
        publish_ns: 7_015_000_000 + number * STEP,
        width: 640,
        height: 480,
        count: 2,
        ..BodyFrame::default()
    };
    for (n, body) in frame.bodies[..2].iter_mut().enumerate() {
        *body = Body {
            id: n as u32 + 1,
            state: BodyState::TRACKED,
            position: [n as f32, number as f32, 3.0],
            ..Body::default()
        };
    }
    frame
}

/// The end of a stream of such frames.
fn end_of(flags: u32) -> BodyFrame {
    BodyFrame {
        flags: flags | FLAG_END_OF_STREAM,
        count: 0,
        ..frame(99)
    }
}

fn record<T: Row>(folder: &Path, frames: impl IntoIterator<Item = T::Message>) -> PathBuf {
    let path = folder.join("take.record");
    let mut writer = RecordWriter::<T>::create(&path, Format::Binary).unwrap();
    for frame in frames {
        writer.write(&frame, "").unwrap();
    }
    writer.finish().unwrap();
    path
}

fn rows(path: &Path) -> Vec<BodyFrame> {
    let file = std::fs::File::open(path).unwrap();
    let mut reader = RowReader::<_, BodiesRow>::new(BufReader::new(file), "test");
    let mut all = Vec::new();
    while let Some(row) = reader.read().unwrap() {
        all.push(row.message());
    }
    all
}

fn wait_until_it_records(recorder: &mut Running) {
    let mut said = BufReader::new(recorder.0.stderr.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    assert!(line.contains("recording"), "{line}");
    recorder.0.stderr = Some(said.into_inner());
}

/// Everything but the times and the number.
fn content(frame: &BodyFrame) -> BodyFrame {
    BodyFrame {
        sequence: 0,
        capture_ns: 0,
        pose_ns: 0,
        publish_ns: 0,
        ..*frame
    }
}

#[test]
fn a_replay_is_what_was_published_with_its_latencies_in_its_own_time() {
    let folder = tempfile::tempdir().unwrap();
    // With the end no more than wait for a reader who is held up, so that none is lost.
    const FRAMES: u64 = 15;
    let path = record::<BodiesRow>(folder.path(), (0..FRAMES).map(frame));
    let name = stream("replay");
    let args = [
        "replay",
        path.to_str().unwrap(),
        "--name",
        &name,
        "--speed",
        "2",
    ];
    let replayed = || {
        let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
        let before = monotonic_ns();
        let run = Running::start(&args);
        let mut frames = Vec::new();
        let end = eventually("the end", || {
            let frame = bodies.next(Duration::from_secs(1)).unwrap()?;
            if frame.flags & FLAG_END_OF_STREAM != 0 {
                return Some(*frame);
            }
            frames.push(*frame);
            None
        });
        assert_eq!(end.count, 0);
        assert_eq!(frames.len() as u64, FRAMES);
        for (n, replayed) in frames.iter().enumerate() {
            let recorded = frame(n as u64);
            assert_eq!(content(replayed), content(&recorded));
            assert_eq!(replayed.sequence, recorded.sequence);
            // Stamped again as it is sent.
            let latency = replayed.publish_ns - replayed.capture_ns;
            assert!(latency >= 15_000_000, "{latency}");
            assert!(replayed.capture_ns + 15_000_000 >= before);
        }
        assert!(run.wait(Duration::from_secs(60)).status.success());
        frames[frames.len() - 1].publish_ns - frames[0].publish_ns
    };
    let least = (FRAMES - 1) * STEP / 2 - STEP;
    let mut took = replayed();
    // One that waited for the processor before its first frame has made up for it by the last.
    for _ in 0..4 {
        if took < least {
            took = replayed();
        }
    }
    assert!(took >= least, "twice as fast, not {took} ns");
}

/// All that a replay of this record says of its source.
fn told_by(path: &Path, name: &str) -> Vec<HealthFrame> {
    let health = Subscriber::<HealthFrame>::open(name).unwrap();
    let run = Running::start(&["replay", path.to_str().unwrap(), "--name", name]);
    let mut told = Vec::new();
    eventually("the end", || {
        let next = health.next(Duration::from_secs(1)).unwrap()?;
        told.push(*next);
        (next.flags & FLAG_END_OF_STREAM != 0).then_some(())
    });
    assert!(run.wait(Duration::from_secs(60)).status.success());
    told
}

#[test]
fn a_replay_says_how_the_source_of_its_record_did() {
    let folder = tempfile::tempdir().unwrap();
    // The camera stalled for two seconds, and dropped pictures; one body is extrapolated.
    let pause = 2_000_000_000;
    let later = |n| BodyFrame {
        capture_ns: frame(n).capture_ns + pause,
        pose_ns: frame(n).pose_ns + pause,
        publish_ns: frame(n).publish_ns + pause,
        ..frame(n)
    };
    let between = BodyFrame {
        sequence: frame(4).sequence,
        ..frame(5)
    };
    let live: Vec<_> = (0..5)
        .map(frame)
        .chain([between])
        .chain((9..12).map(later))
        .collect();
    let name = stream("replay-health");
    let told = told_by(&record::<BodiesRow>(folder.path(), live), &name);
    let states: Vec<_> = told.iter().map(|h| h.state).collect();
    assert_eq!(states[0], HealthState::STARTING);
    let mut changes = states.clone();
    changes.dedup();
    let (end, middle) = changes[1..].split_last().unwrap();
    assert_eq!(*end, HealthState::ENDED);
    assert!(middle.starts_with(&[HealthState::LIVE]) && middle.ends_with(&[HealthState::LIVE]));
    // On a busy machine frames may be late for more than a second, too.
    let comes_and_goes = [HealthState::LIVE, HealthState::STALLED];
    assert!(middle.contains(&HealthState::STALLED), "{changes:?}");
    assert!(
        middle.iter().all(|state| comes_and_goes.contains(state)),
        "{changes:?}"
    );
    assert!(
        told.iter()
            .all(|h| h.pace == HealthPace::UNKNOWN && h.cameras == 1)
    );
    let live = told.iter().rfind(|h| h.state == HealthState::LIVE).unwrap();
    assert!(live.latency_us >= 14_999 && live.people == 2, "{live:?}");
    let end = told.last().unwrap();
    assert_eq!(
        (end.flags, end.observed, end.left_out),
        (FLAG_END_OF_STREAM, 8, 4)
    );
    assert_eq!(end.sequence, frame(11).sequence);

    // Of a film nothing is late, and it has ended.
    let film = (0..5).map(|n| ObservationFrame {
        sequence: n,
        capture_ns: n * STEP,
        publish_ns: 7_000_000_000 + n,
        flags: FLAG_FILE_TIME,
        width: 640,
        height: 480,
        intrinsics: Intrinsics::from_horizontal_fov(640, 480, 60.0),
        ..ObservationFrame::default()
    });
    let told = told_by(&record::<ObservationsRow>(folder.path(), film), &name);
    assert!(
        told.iter()
            .all(|h| h.flags & FLAG_FILE_TIME != 0 && h.latency_us == 0)
    );
    let end = told.last().unwrap();
    assert_eq!(
        (end.state, end.observed, end.left_out),
        (HealthState::ENDED, 5, 0)
    );
}

/// Its bodies and its observations may be replayed side by side.
#[test]
fn a_replay_beside_another_of_the_same_camera_leaves_its_health_to_that() {
    let folder = tempfile::tempdir().unwrap();
    let path = record::<BodiesRow>(folder.path(), (0..5).map(frame));
    let name = stream("replay-beside");
    let _other = Publisher::<HealthFrame>::open(&name).unwrap();
    let out = output(&["replay", path.to_str().unwrap(), "--name", &name]);
    let said = stderr(&out);
    assert!(out.status.success(), "{said}");
    assert!(
        said.contains(&format!("edgecap/v1/{name}/health already")),
        "{said}"
    );
}

#[test]
fn a_record_that_was_cut_off_is_replayed_to_its_last_whole_frame_and_it_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = record::<BodiesRow>(folder.path(), (0..5).map(frame));
    let whole = std::fs::read(&path).unwrap();
    let name = stream("cut-replay");
    let args = ["replay", path.to_str().unwrap(), "--name", &name];
    std::fs::write(&path, &whole[..whole.len() - 10]).unwrap();
    let out = output(&args);
    let said = stderr(&out);
    assert!(out.status.success(), "{said}");
    assert!(said.contains("cut off inside a frame"), "{said}");
    assert!(program::stdout(&out).contains("4 frames"));
    std::fs::write(&path, &whole[..20]).unwrap();
    assert_fails(&args, 65, &["cut off inside its first frame"]);
}

#[test]
fn a_replay_is_as_fast_as_it_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = record::<BodiesRow>(folder.path(), (0..3000).map(frame));
    let name = stream("fast");
    let run = Running::start(&[
        "replay",
        path.to_str().unwrap(),
        "--name",
        &name,
        "--speed",
        "100",
    ]);
    // A minute of record.
    assert!(run.wait(Duration::from_secs(60)).status.success());
}

#[test]
fn a_replay_in_a_loop_goes_on_until_it_is_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let path = record::<BodiesRow>(folder.path(), (0..5).map(frame));
    let name = stream("loop");
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    // Slowly, so that a reader who is held up for half a second loses none.
    let args = ["replay", path.to_str().unwrap(), "--name", &name, "--loop"];
    let run = Running::start(&[&args[..], &["--speed", "0.25"]].concat());
    let mut numbers = Vec::new();
    eventually("three passes", || {
        let frame = bodies.next(Duration::from_secs(1)).unwrap()?;
        numbers.push(frame.sequence);
        (numbers.len() == 15).then_some(())
    });
    let first = numbers[0];
    assert_eq!(numbers, (first..first + 15).collect::<Vec<_>>());
    assert_fails(
        &["replay", path.to_str().unwrap(), "--name", &name],
        69,
        &["--name"],
    );
    signal(run.pid(), "INT");
    let out = run.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
}

/// As of a camera whose processes were started again while it was recorded.
#[test]
fn numbers_and_ids_of_a_record_that_begin_anew_go_on_in_every_pass() {
    let folder = tempfile::tempdir().unwrap();
    let numbered = [70, 71, 0, 1].iter().zip(0..);
    let frames = numbered.map(|(&sequence, n)| BodyFrame {
        sequence,
        ..frame(n)
    });
    let path = record::<BodiesRow>(folder.path(), frames);
    let name = stream("anew");
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let _run = Running::start(&["replay", path.to_str().unwrap(), "--name", &name, "--loop"]);
    let mut numbers = Vec::new();
    eventually("three passes", || {
        let frame = bodies.next(Duration::from_secs(1)).unwrap()?;
        numbers.push(frame.sequence);
        // Two people in each take, and two frames.
        let life = (frame.sequence - 70) as u32 / 2;
        let ids: Vec<u32> = frame.bodies().iter().map(|b| b.id).collect();
        assert_eq!(ids, [2 * life + 1, 2 * life + 2], "{}", frame.sequence);
        (numbers.len() == 12).then_some(())
    });
    assert!(numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
}

/// As of a run that ended after its first frame.
#[test]
fn after_the_end_of_a_publisher_the_same_number_is_another_frame_s() {
    let folder = tempfile::tempdir().unwrap();
    let first = |n| BodyFrame {
        sequence: 0,
        ..frame(n)
    };
    let path = record::<BodiesRow>(folder.path(), [first(0), end_of(0), first(1)]);
    let name = stream("same-number");
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let _run = Running::start(&["replay", path.to_str().unwrap(), "--name", &name]);
    let mut found = Vec::new();
    eventually("the end", || {
        let frame = bodies.next(Duration::from_secs(1)).unwrap()?;
        if frame.flags & FLAG_END_OF_STREAM != 0 {
            return Some(());
        }
        found.push((frame.sequence, frame.bodies()[0].id));
        None
    });
    assert_eq!(found, [(0, 1), (1, 3)]);
}

/// A pipe can be read once, and is waited for.
#[test]
fn a_pipe_is_not_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let take = record::<BodiesRow>(folder.path(), (0..5).map(frame));
    let pipe = folder.path().join("pipe");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, 0o600.into()).unwrap();
    // Both ends in one, so that nobody waits to open it.
    let mut ends = std::fs::File::options();
    let mut ends = ends.read(true).write(true).open(&pipe).unwrap();
    ends.write_all(&std::fs::read(take).unwrap()).unwrap();
    let args = ["replay", pipe.to_str().unwrap(), "--name", &stream("pipe")];
    let out = Running::start(&args).wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(64), "{}", stderr(&out));
    assert!(stderr(&out).contains("expected a file"), "{}", stderr(&out));
}

#[test]
fn observations_are_replayed_for_fit() {
    let folder = tempfile::tempdir().unwrap();
    let frames = (0..40).map(|n| {
        let mut frame = ObservationFrame {
            sequence: n,
            capture_ns: n * STEP,
            flags: FLAG_FILE_TIME,
            width: 64,
            height: 48,
            intrinsics: Intrinsics::from_horizontal_fov(64, 48, 60.0),
            count: 1,
            ..ObservationFrame::default()
        };
        frame.people[0] = Observation {
            score: 0.5,
            ..Observation::default()
        };
        frame
    });
    let path = record::<ObservationsRow>(folder.path(), frames);
    let zones = folder.path().join("zones.toml");
    std::fs::write(&zones, "confirm = 0.1\n").unwrap();
    let name = stream("replay-seen");
    assert_fails(
        &[
            "replay",
            path.to_str().unwrap(),
            "--name",
            &name,
            "--events",
            zones.to_str().unwrap(),
        ],
        64,
        &["take.record", "fit --events"],
    );
    let seen = Subscriber::<ObservationFrame>::open(&name).unwrap();
    let args = [
        "replay",
        path.to_str().unwrap(),
        "--name",
        &name,
        "--speed",
        "0.5",
    ];
    let run = Running::start(&args);
    for _ in 0..3 {
        let frame = eventually("a frame", || seen.next(Duration::from_secs(1)).unwrap());
        // A film's times are its own.
        assert_eq!(frame.capture_ns, frame.sequence * STEP);
        assert_eq!(frame.people().len(), 1);
    }
    assert!(run.wait(Duration::from_secs(60)).status.success());
}

/// The second camera's record begins later, and its observations take longer to come.
#[test]
fn records_of_several_cameras_keep_their_common_clock() {
    let folder = tempfile::tempdir().unwrap();
    let camera = |name: &str, begin: u64, latency: u64| {
        let folder = folder.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        record::<ObservationsRow>(
            &folder,
            (0..10).map(|n| ObservationFrame {
                sequence: n,
                capture_ns: begin + n * STEP,
                publish_ns: begin + n * STEP + latency,
                width: 64,
                height: 48,
                intrinsics: Intrinsics::from_horizontal_fov(64, 48, 60.0),
                ..ObservationFrame::default()
            }),
        )
    };
    let begins = [7_000_000_000, 9_000_000_000];
    let first = camera("first", begins[0], 15_000_000);
    let second = camera("second", begins[1], 90_000_000);
    let names = [stream("replay-left"), stream("replay-right")];
    let seen = names
        .each_ref()
        .map(|name| Subscriber::<ObservationFrame>::open(name).unwrap());
    let mut args = vec!["replay", first.to_str().unwrap(), second.to_str().unwrap()];
    args.extend(["--name", &names[0], "--name", &names[1]]);
    let run = Running::start(&args);
    let published = [0, 1].map(|k| {
        let frame = eventually("a frame", || seen[k].next(Duration::from_secs(1)).unwrap());
        assert_eq!(frame.flags & FLAG_FILE_TIME, FLAG_FILE_TIME);
        assert_eq!(frame.capture_ns, begins[k] + frame.sequence * STEP);
        frame.publish_ns - frame.sequence * STEP
    });
    // The first may come late, the second never early.
    let apart = published[1].saturating_sub(published[0]);
    assert!(apart > 500_000_000, "{apart}");
    assert!(run.wait(Duration::from_secs(60)).status.success());
}

#[test]
fn several_records_want_a_name_each() {
    let folder = tempfile::tempdir().unwrap();
    let take = record::<BodiesRow>(folder.path(), (0..5).map(frame));
    let take = take.to_str().unwrap();
    for (args, words) in [
        (&["replay", take, take, "--name", "a"][..], "found 1 name"),
        (
            &["replay", take, take, "--name", "a", "--name", "a"],
            "--name a: expected a name for each record, found it given twice",
        ),
        (
            // Nothing is read before.
            &["replay", "/nowhere", "/none", "--name", "a", "--name", "a"],
            "found it given twice",
        ),
        (
            &["replay", take, take, "--name", "a", "--name", "b", "--loop"],
            "--loop plays one record",
        ),
    ] {
        let out = Running::start(args).wait(Duration::from_secs(60));
        assert_eq!(out.status.code(), Some(64), "{}", stderr(&out));
        assert!(stderr(&out).contains(words), "{}", stderr(&out));
    }
}

#[test]
fn a_recorder_that_is_killed_leaves_every_whole_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.record");
    let name = stream("recorder");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let run = Running::start(&["record", path.to_str().unwrap(), "--camera", &name]);
    let mut sent = 0;
    let mut came: Option<u64> = None;
    eventually("frames in the file", || {
        let size = std::fs::metadata(&path).map_or(0, |m| m.len());
        if size > 0 {
            came = rows(&path).last().map(|f| f.sequence - 40);
        }
        // No more than wait for a recorder that is held up; before it has begun nobody knows how many those are.
        match came {
            Some(last) if sent - last > 8 => return None,
            Some(_) => {}
            None => std::thread::sleep(Duration::from_millis(100)),
        }
        publisher.publish(&frame(sent)).unwrap();
        sent += 1;
        (size > 50_000).then_some(())
    });
    signal(run.pid(), "KILL");
    drop(run);
    let recorded = rows(&path);
    assert!(recorded.len() > 10, "{} frames", recorded.len());
    let first = recorded[0].sequence - 40;
    for (n, found) in recorded.iter().enumerate() {
        assert_eq!(*found, frame(first + n as u64));
    }
    // As if the power had gone in the middle of a frame.
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 100]).unwrap();
    assert_eq!(rows(&path), recorded[..recorded.len() - 1]);
}

/// A program that starts with the machine is there before anybody logs in.
#[test]
fn a_recorder_finds_a_run_of_a_session_that_begins_later() {
    let folder = tempfile::tempdir().unwrap();
    let (session, to) = (folder.path().join("session"), folder.path().join("a.jsonl"));
    let take = record::<BodiesRow>(folder.path(), (0..200).map(frame));
    let name = stream("later-session");
    let start = |args: &[&str]| {
        let child = program::edgecap()
            .args(args)
            .args(["--name", &name])
            .env_remove("EDGECAP_RUNTIME_DIR")
            .env("XDG_RUNTIME_DIR", &session)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        Running(child.unwrap())
    };
    let mut recorder = start(&["record", to.to_str().unwrap()]);
    wait_until_it_records(&mut recorder);
    std::fs::create_dir(&session).unwrap();
    let _replay = start(&["replay", take.to_str().unwrap(), "--loop"]);
    eventually("frames", || {
        std::fs::metadata(&to).ok().filter(|m| m.len() > 0)
    });
    assert!(std::fs::read_dir(&session).unwrap().count() > 0);
    signal(recorder.pid(), "TERM");
    assert!(recorder.wait(Duration::from_secs(60)).status.success());
}

#[test]
fn a_recording_begins_with_what_comes_after_its_start() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("a.jsonl");
    let name = stream("before");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    publisher.publish(&frame(0)).unwrap();
    let mut run = Running::start(&["record", to.to_str().unwrap(), "--name", &name]);
    wait_until_it_records(&mut run);
    // It begins at once after that; on a busy machine somebody else may have the processor first.
    std::thread::sleep(Duration::from_millis(2000));
    publisher.publish(&frame(7)).unwrap();
    publisher.publish(&end_of(FLAG_FILE_TIME)).unwrap();
    assert!(run.wait(Duration::from_secs(60)).status.success());
    assert_eq!(rows(&to), [frame(7)]);
}

/// As where the service of a camera is started again. Numbers and times go on: the end alone tells that the people are
/// others.
#[test]
fn a_record_of_a_camera_that_ends_goes_on_when_it_is_back() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("a.jsonl");
    let name = stream("comes-back");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let mut run = Running::start(&["record", to.to_str().unwrap(), "--name", &name]);
    wait_until_it_records(&mut run);
    eventually("a line in the file", || {
        publisher.publish(&frame(0)).unwrap();
        std::fs::metadata(&to).ok().filter(|m| m.len() > 0)
    });
    publisher.publish(&end_of(0)).unwrap();
    let mut said = BufReader::new(run.0.stderr.take().unwrap());
    let mut line = String::new();
    said.read_line(&mut line).unwrap();
    assert!(line.contains("goes on when it is back"), "'{line}'");
    run.0.stderr = Some(said.into_inner());
    publisher.publish(&frame(7)).unwrap();
    publisher.publish(&end_of(FLAG_FILE_TIME)).unwrap();
    assert!(run.wait(Duration::from_secs(60)).status.success());
    let recorded = rows(&to);
    assert_eq!(recorded[0], frame(0));
    assert_eq!(recorded.last(), Some(&frame(7)));
    let mut bodies = BodyReader::new(BufReader::new(std::fs::File::open(&to).unwrap()), "test");
    let mut people = Vec::new();
    while let Some(frame) = bodies.read().unwrap() {
        people.push(frame.bodies().iter().map(|b| b.id).collect::<Vec<_>>());
    }
    people.dedup();
    assert_eq!(people, [[1, 2], [3, 4]]);

    // Replayed, the stream goes on there, and so do ids.
    let name = stream("comes-back-again");
    let bodies = Subscriber::<BodyFrame>::open(&name).unwrap();
    let replay = Running::start(&["replay", to.to_str().unwrap(), "--name", &name]);
    let mut people = Vec::new();
    eventually("the end", || {
        let frame = bodies.next(Duration::from_secs(1)).unwrap()?;
        people.extend(frame.bodies().iter().map(|b| b.id));
        (frame.flags & FLAG_END_OF_STREAM != 0).then_some(())
    });
    people.sort_unstable();
    people.dedup();
    assert_eq!(people, [1, 2, 3, 4]);
    let out = replay.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
}

/// A limit on the size of files stands in for a full disk.
#[test]
fn a_record_whose_first_frame_finds_no_room_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let name = stream("no-room");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    for (file, code) in [("new/take.jsonl", 74), ("new/take.record", 74)] {
        let path = folder.path().join(file);
        let mut sh = std::process::Command::new("sh");
        sh.args(["-c", "trap '' XFSZ; ulimit -f 0; exec \"$@\"", "sh"]);
        sh.arg(env!("CARGO_BIN_EXE_edgecap")).arg("record");
        sh.arg(&path).args(["--camera", &name]);
        sh.env("XDG_CONFIG_HOME", "/nonexistent");
        let run = Running(
            sh.stderr(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()
                .unwrap(),
        );
        let mut sent = 0;
        eventually("the end", || {
            publisher.publish(&frame(sent)).unwrap();
            sent += 1;
            run.has_ended().then_some(())
        });
        let out = run.wait(Duration::from_secs(60));
        assert_eq!(out.status.code(), Some(code), "{}", stderr(&out));
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 0, "{file}");
    }
}

#[test]
fn a_record_that_is_removed_begins_anew_and_one_that_is_gone_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("take.jsonl");
    let name = stream("removed");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let run = Running::start(&["record", path.to_str().unwrap(), "--camera", &name]);
    let mut sent = 0;
    for take in ["the first record", "the second"] {
        eventually(take, || {
            publisher.publish(&frame(sent)).unwrap();
            sent += 1;
            std::fs::metadata(&path).ok().filter(|m| m.len() > 0)
        });
        // Nothing is on the way any more that would begin a third.
        eventually("the last frame", || {
            // A line may be half written.
            let text = std::fs::read_to_string(&path).ok()?;
            let line = text.strip_suffix('\n')?.lines().next_back()?;
            let row: serde_json::Value = serde_json::from_str(line).unwrap();
            (row["frame"] == frame(sent - 1).sequence).then_some(())
        });
        std::fs::remove_file(&path).unwrap();
    }
    signal(run.pid(), "INT");
    let out = run.wait(Duration::from_secs(60));
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(74), "{said}");
    let [anew, gone] = ["it begins anew", "writing stopped (somebody removed"].map(|line| {
        let lines = said.lines().filter(|l| l.contains(line));
        lines.count()
    });
    assert_eq!((anew, gone), (1, 1), "{said}");
    assert!(!path.exists());
}

#[test]
fn a_recording_ends_with_its_input_and_what_cannot_be_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).display().to_string();
    let name = stream("recording");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let (to, from) = (file("a.jsonl"), file("take.record"));
    let run = Running::start(&["record", &to, "--name", &name]);
    eventually("a line in the file", || {
        publisher.publish(&frame(0)).unwrap();
        std::fs::metadata(&to).ok().filter(|m| m.len() > 0)
    });
    publisher.publish(&end_of(FLAG_FILE_TIME)).unwrap();
    let out = run.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));
    let recorded = rows(to.as_ref());
    assert!(!recorded.is_empty() && recorded.iter().all(|f| f.count == 2));

    assert_fails(
        &["record", &to, "--name", &name],
        73,
        &["a.jsonl", "there is a file"],
    );
    assert_fails(
        &["record", "/proc/x.record", "--name", &name],
        73,
        &["/proc/x.record"],
    );
    assert_fails(&["record", &file("b"), "--name", "a/b"], 64, &["a/b"]);
    for stdout in ["-", "/dev/stdout"] {
        let args = ["record", stdout, "--name", &name, "--seconds", "1"];
        assert_fails(&args, 64, &["found standard output"]);
    }
    assert_fails(
        &["replay", &file("absent"), "--name", &name],
        66,
        &["absent"],
    );
    let mut other = std::fs::File::create(&from).unwrap();
    other.write_all(b"{\"x\": 1}\n").unwrap();
    assert_fails(
        &["replay", &from, "--name", &stream("other")],
        65,
        &["expected a record"],
    );
    let out = output(&["replay", &from, "--speed", "0"]);
    assert_eq!(out.status.code(), Some(64), "{}", stderr(&out));
}

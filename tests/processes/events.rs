//! Events: a scene with a script, in which what happens is known to the moment.

use std::io::{BufRead, BufReader};
use std::os::fd::OwnedFd;
use std::path::Path;
use std::process::Stdio;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use edgecap::body::skeleton::{Pose, Posed, Skeleton};
use edgecap::joints::{BODY_JOINTS, JOINT_NAMES};
use edgecap::message::{
    Body, BodyFrame, BodyState, EventFrame, EventKind, FLAG_END_OF_STREAM, FLAG_FILE_TIME,
    JointState, MAX_PEOPLE, World, WorldState,
};
use edgecap::record::{BodiesRow, Format, RecordWriter};
use edgecap_client::place::runtime_dir;
use edgecap_client::{Publisher, Subscriber};
use glam::DVec3;
use serde_json::{Value, json};

use crate::program::place::messages_written;
use crate::program::{self, Running, assert_fails, eventually, output, signal, stderr, stream};

const FPS: f64 = 30.0;
const SETTINGS: &str = "\
    [[zone]]\nname = \"door\"\ncorners = [[-0.5, -3.0], [0.5, -3.0], [0.5, -5.0], [-0.5, -5.0]]\n\
    [[zone]]\nname = \"till\"\ncorners = [[0.9, -1.0], [3.0, -1.0], [3.0, -3.0], [0.9, -3.0]]\ndwell = 2.0\n";

fn joint(name: &str) -> usize {
    JOINT_NAMES.iter().position(|n| *n == name).unwrap()
}

/// Somebody who stands on the floor and faces a level camera 1.8 m above it.
fn standing(id: u32, x: f64, away: f64) -> Body {
    let skeleton = Skeleton::builtin();
    let mut pose = Pose::facing_camera(away);
    pose.position = DVec3::new(x, 0.9, away);
    let mut posed = Posed::default();
    skeleton.pose(&pose, skeleton.lengths(), &mut posed);
    Body {
        id,
        state: BodyState::TRACKED,
        position: pose.position.as_vec3().to_array(),
        joints3d: posed.joints.map(|p| p.as_vec3().to_array()),
        confidence: [0.9; BODY_JOINTS],
        joint_states: [JointState::OBSERVED; BODY_JOINTS],
        ..Body::default()
    }
}

/// Puts a wrist beside and above the elbow, metres.
fn hand(body: &mut Body, side: &str, beside: f64, above: f64) {
    let elbow = body.joints3d[joint(&format!("{side}_elbow"))];
    let wrist = &mut body.joints3d[joint(&format!("{side}_wrist"))];
    *wrist = [elbow[0] + beside as f32, elbow[1] - above as f32, elbow[2]];
}

/// Who is where at a time.
fn scene(t: f64) -> Vec<Body> {
    let mut bodies = Vec::new();
    // Walks through the door, leaves, comes back. Lost for three frames on the way, which is nothing.
    if t < 6.0 && !(2.9..3.0).contains(&t) || (9.0..14.0).contains(&t) {
        let x = if t < 6.0 { -2.0 + 0.7 * t } else { -2.0 };
        bodies.push(standing(1, x, 4.0));
    }
    // Stands at the till, nearer to the camera; raises a hand, waves with the other.
    if (9.5..14.0).contains(&t) {
        let mut body = standing(2, 1.2, 2.0);
        if (10.5..11.5).contains(&t) {
            hand(&mut body, "r", 0.0, 1.0);
        }
        if (12.0..13.5).contains(&t) {
            let swing = 0.2 * (std::f64::consts::TAU * 1.5 * (t - 12.0)).sin();
            hand(&mut body, "l", swing, 0.45);
        }
        bodies.push(body);
    }
    // Somebody for two frames: nobody.
    if (4.0..4.06).contains(&t) {
        bodies.push(standing(9, 0.0, 1.0));
    }
    bodies
}

fn record(folder: &Path) -> String {
    record_of(folder, 0.0, 16.0)
}

/// The scene from one time to another, seconds.
fn record_of(folder: &Path, from: f64, to: f64) -> String {
    record_as(Format::Binary, folder, from, to)
}

fn record_as(format: Format, folder: &Path, from: f64, to: f64) -> String {
    let moments = (from * FPS) as u64..(to * FPS) as u64;
    record_at(format, folder, moments.map(|n| (n, n as f64 / FPS, 1.0)))
}

/// Frames by number, moment of the scene in seconds, and how many times as long it lasts.
fn record_at(
    format: Format,
    folder: &Path,
    moments: impl Iterator<Item = (u64, f64, f64)>,
) -> String {
    let path = folder.join("scene.record");
    let mut writer = RecordWriter::<BodiesRow>::create(&path, format).unwrap();
    for (n, moment, times) in moments {
        let bodies = scene(moment);
        let mut frame = BodyFrame {
            sequence: n,
            pose_ns: (moment * times * 1e9) as u64,
            // The script's time, however late a replay is.
            flags: FLAG_FILE_TIME,
            count: bodies.len() as u32,
            world: World {
                rotation: [1.0, 0.0, 0.0, 0.0],
                translation: [0.0, 1.8, 0.0],
                state: WorldState::GIVEN,
            },
            ..BodyFrame::default()
        };
        frame.bodies[..bodies.len()].copy_from_slice(&bodies);
        writer.write(&frame, "hall").unwrap();
    }
    writer.finish().unwrap();
    path.display().to_string()
}

fn events(record: &str, settings: &str) -> Vec<Value> {
    let out = output(&["events", "--input", record, "--settings", settings]);
    assert!(out.status.success(), "{}", stderr(&out));
    let lines = String::from_utf8(out.stdout).unwrap();
    lines
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect()
}

#[test]
fn a_scene_tells_what_happens_once_each_and_in_time() {
    let folder = tempfile::tempdir().unwrap();
    let settings = folder.path().join("zones.toml");
    std::fs::write(&settings, SETTINGS).unwrap();
    let found = events(&record(folder.path()), settings.to_str().unwrap());
    // When it began, and what is told within the time that it must hold.
    let script = [
        (0.0, json!({"person": 1, "event": "entered"})),
        (0.3, json!({"person": 1, "event": "main_person"})),
        (
            2.14,
            json!({"person": 1, "event": "zone_entered", "zone": "door"}),
        ),
        (
            3.57,
            json!({"person": 1, "event": "zone_left", "zone": "door"}),
        ),
        (6.7, json!({"person": 1, "event": "left"})),
        (7.0, json!({"person": null, "event": "main_person"})),
        (9.0, json!({"person": 1, "event": "came_back"})),
        (9.3, json!({"person": 1, "event": "main_person"})),
        (9.5, json!({"person": 2, "event": "entered"})),
        (
            9.8,
            json!({"person": 2, "event": "zone_entered", "zone": "till"}),
        ),
        (9.8, json!({"person": 2, "event": "main_person"})),
        (
            10.5,
            json!({"person": 2, "event": "hand_raised", "hand": "right"}),
        ),
        (11.7, json!({"person": 2, "event": "dwelt", "zone": "till"})),
        (
            11.5,
            json!({"person": 2, "event": "hand_lowered", "hand": "right"}),
        ),
        (12.6, json!({"person": 2, "event": "waved", "hand": "left"})),
        (14.7, json!({"person": 1, "event": "left"})),
        (
            14.7,
            json!({"person": 2, "event": "zone_left", "zone": "till"}),
        ),
        (14.7, json!({"person": 2, "event": "left"})),
        (15.0, json!({"person": null, "event": "main_person"})),
    ];
    let named: Vec<Value> = found
        .iter()
        .map(|e| {
            let mut named = e.clone();
            let fields = named.as_object_mut().unwrap();
            for other in ["camera", "frame", "time_ns", "seconds"] {
                fields.remove(other);
            }
            named
        })
        .collect();
    let wanted: Vec<Value> = script.iter().map(|(_, e)| e.clone()).collect();
    assert_eq!(named, wanted);
    for ((began, wanted), event) in script.iter().zip(&found) {
        let told = event["time_ns"].as_f64().unwrap() * 1e-9;
        assert!(
            (-0.1..0.75).contains(&(told - began)),
            "{wanted} at {told} s"
        );
        assert_eq!(event["camera"], "hall");
    }
    let seconds = |n: usize| found[n]["seconds"].as_f64().unwrap();
    assert!((seconds(3) - 1.43).abs() < 0.1, "in the door");
    assert!((seconds(4) - 6.0).abs() < 0.1, "there");
    assert!((seconds(6) - 3.0).abs() < 0.1, "away");
}

/// The scene in slow motion, six frames of its every second and five seconds between them.
#[test]
fn at_a_slow_pace_who_comes_and_goes_is_told_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let settings = folder.path().join("zones.toml");
    std::fs::write(&settings, SETTINGS).unwrap();
    let moments = (0..96).map(|n| (n, n as f64 / 6.0, 30.0));
    let record = record_at(Format::Binary, folder.path(), moments);
    let found = events(&record, settings.to_str().unwrap());
    let presence = ["entered", "left", "came_back"];
    let told: Vec<(u64, &str)> = found
        .iter()
        .filter_map(|e| Some((e["person"].as_u64()?, e["event"].as_str()?)))
        .filter(|(_, event)| presence.contains(event))
        .collect();
    let script = [
        (1, "entered"),
        (1, "left"),
        (1, "came_back"),
        (2, "entered"),
        (1, "left"),
        (2, "left"),
    ];
    assert_eq!(told, script, "{found:?}");
}

#[test]
fn what_happens_is_published_beside_the_bodies() {
    let folder = tempfile::tempdir().unwrap();
    let settings = folder.path().join("zones.toml");
    std::fs::write(&settings, SETTINGS).unwrap();
    let record = record_of(folder.path(), 9.4, 12.4);
    let camera = stream("events");
    let stream = Subscriber::<EventFrame>::open(&camera).unwrap();
    let settings = settings.to_str().unwrap();
    let args = ["replay", &record, "--name", &camera, "--events", settings];
    let replay = Running::start(&args);
    let (mut told, mut lasts) = (Vec::new(), Vec::new());
    let mut has_ended = false;
    while !has_ended {
        let frame = stream.next(Duration::from_secs(60)).unwrap();
        let frame = frame.expect("an event, or the end of the record");
        has_ended = frame.flags & FLAG_END_OF_STREAM != 0;
        assert_eq!(frame.first as usize, told.len(), "none is lost");
        told.extend(frame.events().iter().map(ToString::to_string));
        lasts.push((frame.present, frame.main_person));
    }
    let script = [
        "#1 entered",
        "#2 entered",
        "#2 zone_entered till",
        "#2 main_person",
        "#2 hand_raised right",
        "#2 dwelt till, 2.0 s",
        "#2 hand_lowered right",
    ];
    assert_eq!(told, script);
    assert_eq!(lasts[lasts.len() - 2], (2, 2));
    assert_eq!(lasts.last(), Some(&(0, 0)), "at the end nobody is there");
    assert!(replay.wait(Duration::from_secs(60)).status.success());
}

/// Takes of one second in one file, and files that are played in a loop, whose passes may follow each other by number
/// and time: published numbers and times go on all the same, and so do ids.
#[test]
fn where_a_record_that_is_replayed_begins_anew_everybody_leaves() {
    const FRAMES: u64 = 30;
    let folder = tempfile::tempdir().unwrap();
    for (case, takes, more, seen) in [
        ("two", &[0, 0][..], &[][..], 2),
        ("loop", &[0], &["--loop"], 2),
        ("forwards", &[70, 0], &["--loop"], 3),
    ] {
        let path = folder.path().join(format!("{case}.record"));
        let mut writer = RecordWriter::<BodiesRow>::create(&path, Format::Binary).unwrap();
        for sequence in takes.iter().flat_map(|first| *first..first + FRAMES) {
            let pose_ns = 7_000_000_000 + sequence * 33_000_000;
            let mut frame = BodyFrame {
                sequence,
                pose_ns,
                publish_ns: pose_ns + 30_000_000,
                count: 1,
                ..BodyFrame::default()
            };
            frame.bodies[0] = standing(1, 0.0, 4.0);
            writer.write(&frame, "").unwrap();
        }
        writer.finish().unwrap();
        let camera = stream(&format!("takes-{case}"));
        let stream = Subscriber::<EventFrame>::open(&camera).unwrap();
        let args = ["replay", path.to_str().unwrap(), "--name", &camera];
        let replay = Running::start(&[&args[..], more].concat());
        let come = |id| [(EventKind::ENTERED, id), (EventKind::MAIN_PERSON, id)];
        let gone = |id| [(EventKind::LEFT, id), (EventKind::MAIN_PERSON, 0)];
        let script = (1..=seen).flat_map(|id| [come(id), gone(id)]);
        let script = script.take(2 * seen as usize - 1);
        let script: Vec<_> = script.flatten().collect();
        let (mut told, mut stamps, mut left) = (Vec::new(), Vec::new(), Vec::new());
        while told.len() < script.len() {
            let frame = stream.next(Duration::from_secs(60)).unwrap();
            let frame = frame.unwrap_or_else(|| {
                let (read, ended) = (stamps.len(), replay.has_ended());
                // Who has ended has taken its stream along.
                let written = (!ended).then(|| messages_written(&runtime_dir(), &camera, "events"));
                panic!("{case}: no event; read {read}, written {written:?}, ended {ended}");
            });
            assert_eq!(frame.flags & FLAG_END_OF_STREAM, 0, "{told:?}");
            told.extend(frame.events().iter().map(|e| (e.kind, e.person)));
            stamps.push((frame.sequence, frame.time_ns));
            let leaves = frame.events().iter().any(|e| e.kind == EventKind::LEFT);
            left.extend(leaves.then_some(frame.sequence));
        }
        assert_eq!(told, script, "{case}");
        let seams: Vec<u64> = (1..u64::from(seen))
            .map(|n| takes[0] + n * FRAMES)
            .collect();
        assert_eq!(left, seams, "{case}");
        let rises = |a: &(u64, u64), b: &(u64, u64)| a.0 < b.0 && a.1 < b.1;
        assert!(stamps.is_sorted_by(rises), "{stamps:?}");
    }
}

/// As of a camera whose service was started again: who comes then is somebody else, whatever their id.
#[test]
fn a_record_of_three_people_twice_tells_of_six() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("twice.record");
    let mut writer = RecordWriter::<BodiesRow>::create(&path, Format::Binary).unwrap();
    for sequence in (0..30).chain(0..30) {
        let mut frame = BodyFrame {
            sequence,
            pose_ns: 7_000_000_000 + sequence * 33_000_000,
            count: 3,
            ..BodyFrame::default()
        };
        for (body, id) in frame.bodies.iter_mut().zip(1..=3) {
            *body = standing(id, f64::from(id) - 2.0, 4.0);
        }
        writer.write(&frame, "").unwrap();
    }
    writer.finish().unwrap();
    let settings = folder.path().join("none.toml");
    std::fs::write(&settings, "").unwrap();
    let told = events(path.to_str().unwrap(), settings.to_str().unwrap());
    let of = |event: &str| -> Vec<u64> {
        let those = told.iter().filter(|line| line["event"] == event);
        those.map(|line| line["person"].as_u64().unwrap()).collect()
    };
    assert_eq!(of("entered"), [1, 2, 3, 4, 5, 6]);
    assert_eq!(of("left"), [1, 2, 3]);
}

/// What a run says on standard output, line by line.
fn lines_of(run: &mut Running) -> Receiver<String> {
    let lines = BufReader::new(run.0.stdout.take().unwrap()).lines();
    let (send, said) = channel();
    std::thread::spawn(move || lines.for_each(|line| send.send(line.unwrap()).unwrap_or(())));
    said
}

/// Ids begin anew with every run, whatever number its first frame has that is read.
#[test]
fn who_was_there_at_the_end_of_a_run_has_left_in_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let settings = folder.path().join("zones.toml");
    std::fs::write(&settings, "confirm = 0.0\n").unwrap();
    let camera = stream("event-runs");
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let args = ["events", "--camera", &camera, "--settings"];
    let mut run = Running::start(&[&args[..], &[settings.to_str().unwrap()]].concat());
    let said = lines_of(&mut run);
    let mut frame = BodyFrame {
        sequence: 7,
        pose_ns: 1_000_000_000,
        count: 1,
        ..BodyFrame::default()
    };
    frame.bodies[0] = standing(1, 0.0, 4.0);
    let mut told = Vec::new();
    let mut enters = || {
        let line = said.recv_timeout(Duration::from_millis(100)).ok()?;
        let line: Value = serde_json::from_str(&line).unwrap();
        let event = line["event"].as_str().unwrap();
        told.extend((event != "main_person").then(|| event.to_owned()));
        (event == "entered").then(|| line["frame"].as_u64().unwrap())
    };
    let first = eventually("somebody", || {
        publisher.publish(&frame).unwrap();
        enters()
    });
    assert_eq!(first, 7);
    let second = eventually("somebody of the next run", || {
        let end = BodyFrame {
            flags: FLAG_END_OF_STREAM,
            count: 0,
            ..frame
        };
        publisher.publish(&end).unwrap();
        (frame.sequence, frame.pose_ns) = (frame.sequence + 1, frame.pose_ns + 33_000_000);
        publisher.publish(&frame).unwrap();
        enters()
    });
    assert!(second > 7);
    assert_eq!(told, ["entered", "left", "entered"]);
}

#[test]
fn events_of_a_run_are_lines_of_json() {
    let camera = stream("event-lines");
    let mut publisher = Publisher::<EventFrame>::open(&camera).unwrap();
    let mut run = Running::start(&["events", "--camera", &camera]);
    let said = lines_of(&mut run);
    let mut frame = EventFrame {
        sequence: 5,
        time_ns: 7,
        count: 2,
        ..EventFrame::default()
    };
    (frame.events[0].kind, frame.events[0].person) = (EventKind::CAME_BACK, 3);
    frame.events[0].seconds = 2.5;
    frame.events[1].kind = EventKind::from(4711);
    let line = eventually("a line", || {
        publisher.publish(&frame).unwrap();
        said.recv_timeout(Duration::from_millis(100)).ok()
    });
    let line: Value = serde_json::from_str(&line).unwrap();
    let wanted = json!({"camera": camera, "frame": 5, "time_ns": 7, "person": 3, "event": "came_back", "seconds": 2.5});
    assert_eq!(line, wanted, "and nothing of what a later version knows");
}

/// A run of its own, with the zones that its settings name.
#[test]
fn a_run_publishes_what_its_people_do() {
    let folder = tempfile::tempdir().unwrap();
    let zones = folder.path().join("zones.toml");
    std::fs::write(
        &zones,
        "confirm = 0.0\n[[zone]]\nname = \"here\"\ncorners = [[-50, 50], [50, 50], [0, -50]]\n",
    )
    .unwrap();
    let config = folder.path().join("edgecap.toml");
    let name = stream("run-events");
    std::fs::write(
        &config,
        format!(
            "[network]\nsize = \"256x160\"\n\
             [[camera]]\nname = \"{name}\"\ninput = \"demo\"\nlive = true\nevents = \"zones.toml\"\n\
             floor = {{ normal = [0.0, -1.0, 0.0], offset = 1.5 }}\n"
        ),
    )
    .unwrap();
    let stream = Subscriber::<EventFrame>::open(&name).unwrap();
    let run = Running::start(&["run", "--config", config.to_str().unwrap()]);
    let mut kinds = Vec::new();
    eventually("somebody in the zone", || {
        let frame = stream.next(Duration::from_millis(200)).unwrap()?;
        kinds.extend(frame.events().iter().map(|e| e.kind));
        frame.events().iter().find(|e| e.zone() == "here").copied()
    });
    assert!(kinds.contains(&EventKind::ENTERED), "{kinds:?}");
    signal(run.pid(), "INT");
    let out = run.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", stderr(&out));

    // A mistake in them is the settings', with its place.
    std::fs::write(
        &config,
        "[[camera]]\nevents = { zone = [{ name = \"\", corners = [] }] }\n",
    )
    .unwrap();
    let args = ["config", "check", "--config", config.to_str().unwrap()];
    assert_fails(&args, 78, &["edgecap.toml:2", "events", "1 to 63 bytes"]);
}

#[test]
fn what_cannot_be_a_zone_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path());
    let settings = folder.path().join("zones.toml");
    for (text, word) in [
        (
            "[[zone]]\nname = \"a\"\ncorners = [[0, 0], [1, 1]]\n",
            "3 or more corners",
        ),
        (
            "[[zone]]\nname = \"12345678901234567890123456789012345678901234567890123456789012345\"\ncorners = []\n",
            "1 to 63 bytes, found 65",
        ),
        ("confirm = -1.0\n", "confirm"),
        ("zones = 1\n", "zones"),
    ] {
        std::fs::write(&settings, text).unwrap();
        let args = [
            "events",
            "--input",
            &record,
            "--settings",
            settings.to_str().unwrap(),
        ];
        assert_fails(&args, 78, &[word]);
    }
    assert_fails(&["events", "--input", "/absent"], 66, &["/absent"]);
}

#[test]
fn a_record_that_was_cut_off_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let whole = std::fs::read(record_of(folder.path(), 0.0, 3.0)).unwrap();
    let path = folder.path().join("cut.record");
    let args = ["events", "--input", path.to_str().unwrap()];
    std::fs::write(&path, &whole[..whole.len() - 10]).unwrap();
    let out = output(&args);
    let said = stderr(&out);
    assert!(out.status.success() && !out.stdout.is_empty(), "{said}");
    assert!(said.contains("cut off inside a frame"), "{said}");
    std::fs::write(&path, &whole[..20]).unwrap();
    assert_fails(&args, 65, &["cut off inside its first frame"]);
}

/// Who does something at each event reads slowly.
#[test]
fn a_slow_reader_has_every_event_or_is_told_how_many_are_lost() {
    const EVENTS: u64 = 5000;
    let camera = stream("slow-events");
    let mut publisher = Publisher::<EventFrame>::open(&camera).unwrap();
    let mut told = 0;
    let mut publish = || {
        let frame = EventFrame {
            sequence: told,
            first: told,
            count: 1,
            ..EventFrame::default()
        };
        publisher.publish(&frame).unwrap();
        told += 1;
        told
    };
    let mut run = Running::start(&["events", "--camera", &camera]);
    let mut lines = BufReader::new(run.0.stdout.take().unwrap());
    let (send, said) = std::sync::mpsc::channel();
    let reader = std::thread::spawn(move || {
        let mut line = String::new();
        lines.read_line(&mut line).unwrap();
        send.send(line).unwrap();
        lines
    });
    let first = eventually("a line", || {
        publish();
        said.recv_timeout(Duration::from_millis(100)).ok()
    });
    let mut lines = reader.join().unwrap();
    // The pipe does not hold them.
    while publish() < EVENTS {}
    let number = |line: &str| {
        let line: Value = serde_json::from_str(line).unwrap();
        line["frame"].as_u64().unwrap()
    };
    let (first, mut read) = (number(&first), 1);
    for line in (&mut lines).lines() {
        read += 1;
        if number(&line.unwrap()) == EVENTS - 1 {
            break;
        }
    }
    run.0.stdout = Some(lines.into_inner());
    signal(run.pid(), "INT");
    let said = stderr(&run.wait(Duration::from_secs(60)));
    let lost = said.lines().filter_map(|l| l.split_once(" lost: "));
    let lost = lost.map(|(counted, _)| {
        let number = counted.split_whitespace().rev().nth(1);
        number.unwrap().parse::<u64>().unwrap()
    });
    let known = read + lost.sum::<u64>();
    assert!(known >= EVENTS - first, "{known} of {EVENTS} from {first}");
}

/// A stream of events that go on, and a reader that has gone.
#[test]
fn who_reads_no_more_ends_it() {
    let camera = stream("event-reader");
    let mut publisher = Publisher::<EventFrame>::open(&camera).unwrap();
    let mut run = Running::start(&["events", "--camera", &camera]);
    let mut lines = BufReader::new(run.0.stdout.take().unwrap());
    let (send, said) = std::sync::mpsc::channel();
    let reader = std::thread::spawn(move || {
        let mut line = String::new();
        lines.read_line(&mut line).unwrap();
        send.send(()).unwrap();
    });
    let mut frame = EventFrame {
        count: 1,
        ..EventFrame::default()
    };
    frame.events[0].kind = EventKind::ENTERED;
    eventually("a line", || {
        publisher.publish(&frame).unwrap();
        said.recv_timeout(Duration::from_millis(100)).ok()
    });
    reader.join().unwrap();
    let closed = std::time::Instant::now();
    eventually("its end", || {
        publisher.publish(&frame).unwrap();
        run.has_ended().then_some(())
    });
    assert!(closed.elapsed() < Duration::from_secs(10));
    assert_eq!(run.0.wait().unwrap().code(), Some(0));
}

/// A frame with more lines than the smallest pipe holds: whatever is printed of it, the rest is held up.
#[test]
fn a_reader_that_stands_still_does_not_keep_it_from_ending() {
    const ZONES: usize = 64;
    const SHORTEST_LINE: usize = 100;
    let folder = tempfile::tempdir().unwrap();
    let settings = folder.path().join("zones.toml");
    let zone = |n| {
        let corners = "[[-50, 50], [50, 50], [0, -50]]";
        format!("[[zone]]\nname = \"{n:060}\"\ncorners = {corners}\n")
    };
    let zones: String = (0..ZONES).map(zone).collect();
    std::fs::write(&settings, format!("confirm = 0.0\n{zones}")).unwrap();
    let mut frame = BodyFrame {
        pose_ns: 1_000_000_000,
        count: MAX_PEOPLE as u32,
        world: World {
            rotation: [1.0, 0.0, 0.0, 0.0],
            translation: [0.0, 1.8, 0.0],
            state: WorldState::GIVEN,
        },
        ..BodyFrame::default()
    };
    for (body, id) in frame.bodies.iter_mut().zip(1..) {
        *body = standing(id, 0.0, 4.0);
    }
    let record = folder.path().join("crowd.record");
    let mut writer = RecordWriter::<BodiesRow>::create(&record, Format::Binary).unwrap();
    writer.write(&frame, "hall").unwrap();
    writer.finish().unwrap();
    let camera = stream("event-standstill");
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let settings = settings.to_str().unwrap();
    for from in [["--camera", &camera], ["--input", record.to_str().unwrap()]] {
        let (pipe, end) = std::io::pipe().unwrap();
        // The kernel rounds it up to a page.
        let size = rustix::pipe::fcntl_setpipe_size(&pipe, 1).unwrap();
        assert!(size < ZONES * MAX_PEOPLE * SHORTEST_LINE, "{size}");
        let child = program::edgecap()
            .args(["events", "--settings", settings])
            .args(from)
            .stdout(end)
            .stderr(Stdio::piped())
            .spawn();
        let mut run = Running(child.unwrap());
        let pipe = run.0.stdout.insert(OwnedFd::from(pipe).into());
        eventually("a line in the pipe", || {
            publisher.publish(&frame).unwrap();
            (rustix::io::ioctl_fionread(&*pipe).unwrap() > 0).then_some(())
        });
        signal(run.pid(), "TERM");
        let out = run.wait(Duration::from_secs(60));
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(74), "{from:?}: {said}");
        assert!(said.contains("nobody has taken"), "{from:?}: {said}");
    }
}

#[test]
fn a_full_disk_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let record = record(folder.path());
    let full = std::fs::File::create("/dev/full").unwrap();
    let out = program::edgecap()
        .args(["events", "--input", &record])
        .stdout(full)
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(74), "{}", stderr(&out));
    assert!(stderr(&out).contains("standard output"), "{}", stderr(&out));
}

/// A record that does not end stops by a signal, and says that there is more.
#[test]
fn a_record_that_goes_on_is_stopped_by_a_signal() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = std::fs::read(record_as(Format::Jsonl, folder.path(), 0.0, 1.0)).unwrap();
    for (verb, flag, code) in [("events", "--input", 130), ("view", "--record", 0)] {
        let pipe = folder.path().join(verb);
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        let mut args = vec![verb, flag, pipe.to_str().unwrap()];
        if verb == "view" {
            args.extend(["--listen", "127.0.0.1:0"]);
        }
        let run = Running::start(&args);
        let pid = run.pid();
        let (path, bytes) = (pipe.clone(), bytes.clone());
        let writer = std::thread::spawn(move || {
            use std::io::Write;
            let mut pipe = std::fs::File::options().write(true).open(path).unwrap();
            // Slowly and for long, until nobody reads.
            let lines = bytes.split_inclusive(|b| *b == b'\n');
            for (n, piece) in lines.cycle().enumerate().take(1 << 12) {
                if n == 50 {
                    signal(pid, "INT");
                }
                if pipe.write_all(piece).is_err() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        let out = run.wait(Duration::from_secs(60));
        assert_eq!(out.status.code(), Some(code), "{verb}: {}", stderr(&out));
        writer.join().unwrap();
    }
}

/// A name that is mistyped is waited for, and that is said where it disturbs no lines.
#[test]
fn a_camera_that_nobody_publishes_is_named_with_those_that_there_are() {
    let there = stream("is-there");
    let _events = Publisher::<EventFrame>::open(&there).unwrap();
    let _bodies = Publisher::<BodyFrame>::open(&there).unwrap();
    for (verb, more) in [
        ("events", &[][..]),
        ("bridge", &["--osc", "127.0.0.1:9"]),
        ("view", &["--listen", "127.0.0.1:0"]),
    ] {
        let name = stream(&format!("nobody-{verb}"));
        // On a busy machine the publishers' signs of life may come late; it is said once of each silence.
        eventually("the camera that there is", || {
            let mut run = Running::start(&[&[verb, "--camera", &name], more].concat());
            let line = run.says(&format!("nobody publishes {name} yet"));
            signal(run.pid(), "INT");
            let out = run.wait(Duration::from_secs(60));
            assert!(out.status.success(), "{verb}: {}", stderr(&out));
            assert_eq!(out.stdout.is_empty(), verb == "events", "{verb}");
            line.contains(&there).then_some(())
        });
    }
}

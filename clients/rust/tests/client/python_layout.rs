//! The Python client's structures must lie in memory as ours do, and its world be ours; README's Python works as
//! printed.

use std::fmt::Debug;
use std::io::{BufRead, BufReader};
use std::mem::{offset_of, size_of};
use std::process::{Command, Stdio};
use std::str::FromStr;
use std::sync::mpsc;
use std::time::{Duration, Instant};

use edgecap_client::Publisher;
use edgecap_client::message::{
    Body, BodyFrame, BodyState, Event, EventFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, HealthFrame,
    HealthState, Observation, ObservationFrame, World, WorldState,
};

/// The numbers that a Python script prints; `None` without Python.
fn python<T: FromStr<Err: Debug>>(script: &str) -> Option<Vec<T>> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../python");
    if !crate::tools::has("python3") {
        return None;
    }
    let run = Command::new("python3")
        .args(["-B", "-c", script])
        .env("PYTHONPATH", folder)
        .output();
    let output = run.unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = String::from_utf8(output.stdout).unwrap();
    Some(
        text.split_whitespace()
            .map(|n| n.parse().unwrap())
            .collect(),
    )
}

#[test]
fn python_structures_have_the_same_layout() {
    let script = "import edgecap as e, ctypes\n\
        for t in (e.Observation, e.ObservationFrame, e.Body, e.World, e.BodyFrame, e.Event, e.EventFrame): print(ctypes.sizeof(t))\n\
        print(e.ObservationFrame.flags.offset, e.ObservationFrame._people.offset)\n\
        print(*(getattr(e.Event, f).offset for f, _ in e.Event._fields_), *(getattr(e.EventFrame, f).offset for f, _ in e.EventFrame._fields_))\n\
        print(e.Body.joints3d.offset, e.Body._joint_states.offset, e.BodyFrame.fit_us.offset, e.BodyFrame.world.offset, e.World._state.offset, e.BodyFrame._bodies.offset)";
    let Some(found) = python::<usize>(script) else {
        return;
    };
    let expected = [
        size_of::<Observation>(),
        size_of::<ObservationFrame>(),
        size_of::<Body>(),
        size_of::<World>(),
        size_of::<BodyFrame>(),
        size_of::<Event>(),
        size_of::<EventFrame>(),
        offset_of!(ObservationFrame, flags),
        offset_of!(ObservationFrame, people),
        offset_of!(Event, kind),
        offset_of!(Event, person),
        offset_of!(Event, seconds),
        offset_of!(Event, hand),
        offset_of!(Event, zone),
        offset_of!(EventFrame, sequence),
        offset_of!(EventFrame, time_ns),
        offset_of!(EventFrame, publish_ns),
        offset_of!(EventFrame, first),
        offset_of!(EventFrame, flags),
        offset_of!(EventFrame, count),
        offset_of!(EventFrame, present),
        offset_of!(EventFrame, main_person),
        offset_of!(EventFrame, events),
        offset_of!(Body, joints3d),
        offset_of!(Body, joint_states),
        offset_of!(BodyFrame, fit_us),
        offset_of!(BodyFrame, world),
        offset_of!(World, state),
        offset_of!(BodyFrame, bodies),
    ];
    assert_eq!(found, expected);
}

macro_rules! places {
    ($($field:ident)*) => { [size_of::<HealthFrame>(), $(offset_of!(HealthFrame, $field)),*] };
}

#[test]
fn what_is_said_of_health_lies_in_memory_as_ours_does() {
    let script = "import edgecap as e, ctypes\n\
        h = e.HealthFrame\n\
        print(ctypes.sizeof(h), *(getattr(h, f).offset for f, _ in h._fields_))";
    let Some(found) = python::<usize>(script) else {
        return;
    };
    let expected = places!(publish_ns started_ns since_ns sequence capture_ns observed left_out
        state flags source_hz observed_hz look_hz latency_us pace people input_width input_height
        reconnects restarts cameras cameras_live);
    assert_eq!(found, expected);
}

#[test]
fn the_python_of_the_page_on_health_works_as_printed() {
    if !crate::tools::has("python3") {
        return;
    }
    let page = include_str!("../../../../docs/clients.md");
    let code = page.split("## Health").nth(1).unwrap();
    let code = code.split("```python\n").nth(1).unwrap();
    let code = code.split("```").next().unwrap();
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("edgecap");
    // It goes on until it is killed, or nobody reads what it prints.
    let mut python = Command::new("python3")
        .args(["-B", "-u", "-c", code])
        .env(
            "PYTHONPATH",
            concat!(env!("CARGO_MANIFEST_DIR"), "/../python"),
        )
        .env("EDGECAP_RUNTIME_DIR", &folder)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(python.stdout.take().unwrap()).lines();
    let mut before = String::new();
    let mut says = |words: &str| {
        // On a busy machine it may have time to say the same again.
        let line = lines.find(|line| line.as_ref().is_ok_and(|l| *l != before));
        before = line.expect("it goes on").unwrap();
        assert_eq!(before, words);
    };
    says("nobody publishes camera0");
    let mut publisher = Publisher::<HealthFrame>::open_at(&folder, "camera0").unwrap();
    // The line that the page prints as an example.
    let health = HealthFrame {
        publish_ns: 12_000_000_000,
        since_ns: 0,
        state: HealthState::LIVE,
        source_hz: 30.0,
        observed_hz: 29.9,
        latency_us: 42_000,
        people: 2,
        ..HealthFrame::default()
    };
    assert!(code.contains(&format!("# {health}")), "{code}");
    publisher.publish(&health).unwrap();
    says(&health.to_string());
    says("it hangs; run starts it again");
    drop(publisher);
    says("nobody publishes camera0");
    python.kill().unwrap();
    python.wait().unwrap();
}

#[test]
fn python_takes_bodies_to_the_same_world() {
    let mut frame = BodyFrame {
        count: 1,
        world: World {
            rotation: [0.98, 0.05, -0.03, 0.19],
            translation: [0.0, 1.6, 0.0],
            state: WorldState::ESTIMATED,
        },
        ..BodyFrame::default()
    };
    let body = Body {
        position: [0.4, 0.9, 3.5],
        orientation: [0.9, 0.1, 0.2, 0.3],
        velocity: [0.3, -0.2, 0.7],
        ..Body::default()
    };
    frame.bodies[0] = body;
    let script = "import edgecap as e\n\
        f = e.BodyFrame(count=1)\n\
        b = f._bodies[0]\n\
        b.position[:] = (0.4, 0.9, 3.5); b.orientation[:] = (0.9, 0.1, 0.2, 0.3); b.velocity[:] = (0.3, -0.2, 0.7)\n\
        b.joints3d[20][:] = (1.0, 2.0, 3.0)\n\
        assert f.in_world(b) is None and f.world.state == 'none'\n\
        f.world.rotation[:] = (0.98, 0.05, -0.03, 0.19); f.world.translation[:] = (0.0, 1.6, 0.0); f.world._state = 1\n\
        w = f.in_world(f.people()[0])\n\
        print(*w.position, *w.orientation, *w.velocity, *w.joints3d[20], *w.joint('l_foot_tip'))";
    frame.bodies[0].joints3d[20] = [1.0, 2.0, 3.0];
    let Some(found) = python::<f32>(script) else {
        return;
    };
    let there = frame.in_world(&frame.bodies[0]).unwrap();
    let tip = there.joints3d[20];
    let expected = [
        &there.position[..],
        &there.orientation,
        &there.velocity,
        &tip,
        &tip,
    ]
    .concat();
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(&expected) {
        assert!((a - b).abs() < 1e-5, "{found:?} is not {expected:?}");
    }
}

#[test]
fn the_python_of_the_readme_works_as_printed() {
    if !crate::tools::has("python3") {
        return;
    }
    let readme = include_str!("../../../../README.md");
    assert!(readme.contains("`export PYTHONPATH=$PWD/clients/python`"));
    let code = readme.split("```python\n").nth(1).unwrap();
    let code = code.split("```").next().unwrap();
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("edgecap");
    let mut python = Command::new("python3")
        .args(["-B", "-u", "-c", code])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .env("PYTHONPATH", "clients/python")
        .env("EDGECAP_RUNTIME_DIR", &folder)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let output = BufReader::new(python.stdout.take().unwrap());
    let (send, lines) = mpsc::channel();
    std::thread::spawn(move || {
        for line in output.lines() {
            let _ = send.send(line.unwrap());
        }
    });
    // It was started first and waits.
    let mut publisher = Publisher::<BodyFrame>::open_at(&folder, "camera0").unwrap();
    let mut frame = BodyFrame {
        count: 1,
        ..BodyFrame::default()
    };
    frame.bodies[0] = Body {
        id: 3,
        state: BodyState::TRACKED,
        position: [0.5, 1.0, 4.0],
        ..Body::default()
    };
    frame.bodies[0].joints3d[4] = [0.25, 0.5, 3.5];
    let start = Instant::now();
    let first = loop {
        publisher.publish(&frame).unwrap();
        if let Ok(line) = lines.recv_timeout(Duration::from_millis(50)) {
            break line;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "it says nothing");
    };
    frame.count = 0;
    frame.flags = FLAG_END_OF_STREAM | FLAG_FILE_TIME;
    publisher.publish(&frame).unwrap();
    let said: Vec<String> = std::iter::once(first).chain(lines).collect();
    assert!(python.wait().unwrap().success());
    assert_eq!(said[0], "#3: 4.00 m away, right wrist at [0.25, 0.5, 3.5]");
}

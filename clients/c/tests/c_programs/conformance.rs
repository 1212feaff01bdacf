//! One run, read in Rust, Python, C and C++ at once: everybody finds the same in every field of bodies, observations,
//! events and health.
//!
//! Each reader names every field through its own interface and prints it, floats as their bits. Lines that begin with
//! `~` hold what readers work out themselves, which may differ in its last digits.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use edgecap_client::joints::BODY_JOINTS;
use edgecap_client::message::{
    BodyFrame, EventFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, HealthFrame, MAX_EVENTS, MAX_PEOPLE,
    ObservationFrame,
};
use edgecap_client::{Message, Publisher, Subscriber};

use crate::compile::{C, CPP, HERE, program};
use crate::numbers::{Numbers, some_bodies, some_events, some_health, some_observations};
use crate::printed::Print;
use crate::tools;

fn assert_same(reader: &str, found: &str, expected: &str) {
    assert_eq!(found.lines().count(), expected.lines().count(), "{reader}");
    for (found, expected) in found.lines().zip(expected.lines()) {
        if !expected.starts_with('~') {
            assert_eq!(found, expected, "{reader}");
            continue;
        }
        let numbers = |line: &str| -> Vec<f64> {
            let words = line.split_whitespace().skip(1);
            words.map(|w| w.parse().unwrap()).collect()
        };
        let (f, e) = (numbers(found), numbers(expected));
        assert_eq!(f.len(), 10 + 3 * BODY_JOINTS, "{reader}");
        // Rotations here are no unit quaternions: numbers reach hundreds.
        let near = |(f, e): (&f64, &f64)| (f - e).abs() < 1e-4 * (1.0 + e.abs().max(100.0));
        assert!(
            f.len() == e.len() && f.iter().zip(&e).all(near),
            "{reader}: {found}, not {expected}"
        );
    }
}

/// A reader in a process of its own, which has said that it is there.
struct Reader {
    name: &'static str,
    child: Child,
    output: BufReader<std::process::ChildStdout>,
}

impl Reader {
    fn start(name: &'static str, mut command: Command) -> Self {
        let spawned = command.stdout(Stdio::piped()).spawn();
        let mut child = spawned.unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        output.read_line(&mut line).unwrap();
        assert_eq!(line, "ready\n", "{name}");
        Self {
            name,
            child,
            output,
        }
    }

    fn ends_with(mut self, expected: &str) {
        let mut found = String::new();
        self.output.read_to_string(&mut found).unwrap();
        assert!(self.child.wait().unwrap().success(), "{}", self.name);
        assert_same(self.name, &found, expected);
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn commands(folder: &Path) -> Vec<(&'static str, Command)> {
    let sources = [
        ("C", "print.c", C, include_str!("print.c")),
        ("C++", "print.cpp", CPP, include_str!("print.cpp")),
    ];
    let compiled = sources.into_iter().filter_map(|(name, file, how, text)| {
        Some((name, Command::new(program(folder, file, how, text)?)))
    });
    let mut commands: Vec<_> = compiled.collect();
    if tools::has("python3") {
        let mut python = Command::new("python3");
        python.args(["-B", "-c", include_str!("print.py")]);
        python.env("PYTHONPATH", format!("{HERE}/../python"));
        commands.push(("Python", python));
    }
    commands
}

/// Publishes a message of each count; the last one ends the stream.
fn publish<M: Message>(
    to: &mut Publisher<M>,
    counts: &[usize],
    mut make: impl FnMut(usize, u32) -> M,
) {
    for (i, count) in counts.iter().enumerate() {
        let is_last = i + 1 == counts.len();
        let flags = FLAG_FILE_TIME | if is_last { FLAG_END_OF_STREAM } else { 0 };
        to.publish(&make(*count, flags)).unwrap();
    }
}

#[test]
fn readers_in_four_languages_find_the_same_in_every_field() {
    let folder = tempfile::tempdir().unwrap();
    let camera = format!("test-conformance-{}", std::process::id());
    let mut bodies = Publisher::<BodyFrame>::open(&camera).unwrap();
    let mut observations = Publisher::<ObservationFrame>::open(&camera).unwrap();
    let mut events = Publisher::<EventFrame>::open(&camera).unwrap();
    let mut health = Publisher::<HealthFrame>::open(&camera).unwrap();
    let rust = (
        Subscriber::<BodyFrame>::open(&camera).unwrap(),
        Subscriber::<ObservationFrame>::open(&camera).unwrap(),
        Subscriber::<EventFrame>::open(&camera).unwrap(),
        Subscriber::<HealthFrame>::open(&camera).unwrap(),
    );
    let mut readers = Vec::new();
    for (name, mut command) in commands(folder.path()) {
        command.arg(&camera);
        readers.push(Reader::start(name, command));
    }
    let (mut numbers, mut expected) = (Numbers(25), Print::default());
    expected.names();
    // Each state of the floor, nobody, everybody; no more than wait for a slow reader.
    let counts = [2, 0, 1, 3, MAX_PEOPLE, 4];
    publish(&mut bodies, &counts, |count, flags| {
        let frame = some_bodies(&mut numbers, count, flags);
        expected.bodies(&frame);
        frame
    });
    publish(&mut observations, &[3, 0, MAX_PEOPLE, 1], |count, flags| {
        let frame = some_observations(&mut numbers, count, flags);
        expected.observations(&frame);
        frame
    });
    publish(&mut events, &[1, MAX_EVENTS, 0, 7], |count, flags| {
        let frame = some_events(&mut numbers, count, flags);
        expected.events(&frame);
        frame
    });
    // Each state.
    publish(&mut health, &[0, 1, 2, 3, 4, 5], |state, flags| {
        let frame = some_health(&mut numbers, state, flags);
        expected.health(&frame);
        frame
    });
    let mut found = Print::default();
    found.names();
    for frame in rust.0.messages() {
        found.bodies(&frame.unwrap());
    }
    for frame in rust.1.messages() {
        found.observations(&frame.unwrap());
    }
    for frame in rust.2.messages() {
        found.events(&frame.unwrap());
    }
    for frame in rust.3.messages() {
        found.health(&frame.unwrap());
    }
    assert_same("Rust", &found.0, &expected.0);
    for reader in readers {
        reader.ends_with(&expected.0);
    }
}

//! One run, read in Rust, Python, C and C++ at once: everybody finds the same in every field.
//!
//! Each reader names every field through its own interface and prints it, floats as their bits. Lines that begin with `~` hold
//! what readers work out themselves, which may differ in its last digits.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use edgecap_client::joints::{
    ANGLE_NAMES, BODY_JOINTS, HUMANOID_BONES, HUMANOID_PARENTS, JOINT_NAMES, PARENTS,
};
use edgecap_client::message::{
    Body, BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, Intrinsics, MAX_PEOPLE, StageTimes, World,
};
use edgecap_client::{Publisher, Subscriber};

use crate::compile::{C, CPP, HERE, program};
use crate::tools;

/// Numbers without a pattern, the same every time.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 32) as u32
    }

    fn long(&mut self) -> u64 {
        (u64::from(self.next()) << 32) | u64::from(self.next())
    }

    fn float(&mut self) -> f32 {
        self.next() as f32 / 2f32.powi(29) - 4.0
    }

    fn floats<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| self.float())
    }

    fn table<const N: usize, const M: usize>(&mut self) -> [[f32; N]; M] {
        std::array::from_fn(|_| self.floats())
    }
}

fn some_body(n: &mut Numbers) -> Body {
    Body {
        id: n.next(),
        state: (n.next() % 3).into(),
        score: n.float(),
        position: n.floats(),
        orientation: n.floats(),
        velocity: n.floats(),
        angles: n.floats(),
        joints3d: n.table(),
        joints2d: n.table(),
        confidence: n.floats(),
        height: n.float(),
        bone_lengths: n.floats(),
        bone_rotations: n.table(),
        joint_states: std::array::from_fn(|_| ((n.next() % 3) as u8).into()),
        reserved: [0; 3],
    }
}

fn some_frame(n: &mut Numbers, count: usize, flags: u32) -> BodyFrame {
    BodyFrame {
        sequence: n.long(),
        capture_ns: n.long(),
        pose_ns: n.long(),
        publish_ns: n.long(),
        width: n.next(),
        height: n.next(),
        intrinsics: Intrinsics {
            fx: n.float(),
            fy: n.float(),
            cx: n.float(),
            cy: n.float(),
        },
        stage_times: StageTimes {
            preprocess_us: n.next(),
            stage1_us: n.next(),
            association_us: n.next(),
            stage2_us: n.next(),
        },
        fit_us: n.next(),
        flags,
        count: count as u32,
        frame_total: n.next(),
        world: World {
            rotation: n.floats(),
            translation: n.floats(),
            state: (count as u32 % 3).into(),
        },
        // Those beyond the count must not be read.
        bodies: std::array::from_fn(|_| some_body(n)),
    }
}

/// What every reader prints.
#[derive(Default)]
struct Print(String);

impl Print {
    fn line<T: std::fmt::Display>(&mut self, label: &str, values: impl IntoIterator<Item = T>) {
        self.0 += label;
        for v in values {
            write!(self.0, " {v}").unwrap();
        }
        self.0.push('\n');
    }

    fn bits<'a>(&mut self, label: &str, values: impl IntoIterator<Item = &'a f32>) {
        let bits = values.into_iter().map(|v| format!("{:08x}", v.to_bits()));
        self.line(label, bits);
    }

    fn names(&mut self) {
        self.line("joints", JOINT_NAMES);
        self.line("parents", PARENTS);
        self.line("angles", ANGLE_NAMES);
        self.line("bones", HUMANOID_BONES);
        self.line("carriers", HUMANOID_PARENTS);
    }

    fn frame(&mut self, frame: &BodyFrame) {
        // Without `..`: a field that is new wants a line here and in the other readers.
        let BodyFrame {
            sequence,
            capture_ns,
            pose_ns,
            publish_ns,
            width,
            height,
            intrinsics,
            stage_times,
            fit_us,
            flags,
            count,
            frame_total,
            world,
            bodies: _,
        } = frame;
        self.line("sequence", [sequence]);
        self.line("times", [capture_ns, pose_ns, publish_ns]);
        self.line("size", [width, height]);
        let Intrinsics { fx, fy, cx, cy } = intrinsics;
        self.bits("intrinsics", [fx, fy, cx, cy]);
        let t = stage_times;
        self.line(
            "stages",
            [
                t.preprocess_us,
                t.stage1_us,
                t.association_us,
                t.stage2_us,
                *fit_us,
            ],
        );
        self.line("flags", [flags]);
        self.line("count", [count, frame_total]);
        let World {
            rotation,
            translation,
            state,
        } = world;
        self.bits("world", rotation.iter().chain(translation));
        self.line("floor", state.name());
        for body in frame.bodies() {
            self.body(frame, body);
        }
    }

    fn body(&mut self, frame: &BodyFrame, body: &Body) {
        let Body {
            id,
            state,
            score,
            position,
            orientation,
            velocity,
            angles,
            joints3d,
            joints2d,
            confidence,
            height,
            bone_lengths,
            bone_rotations,
            joint_states,
            reserved: _,
        } = body;
        self.line("id", [id]);
        self.line("state", state.name());
        self.bits("score", [score]);
        self.bits("position", position);
        self.bits("orientation", orientation);
        self.bits("velocity", velocity);
        self.bits("angles", angles);
        self.bits("joints3d", joints3d.iter().flatten());
        self.bits("joints2d", joints2d.iter().flatten());
        self.bits("confidence", confidence);
        self.bits("height", [height]);
        self.bits("bone_lengths", bone_lengths);
        self.bits("bone_rotations", bone_rotations.iter().flatten());
        self.line("joint_states", joint_states.map(|s| s.name().unwrap()));
        if let Some(there) = frame.in_world(body) {
            let numbers = there.position.into_iter().chain(there.orientation);
            let numbers = numbers.chain(there.velocity);
            self.line(
                "~there",
                numbers.chain(there.joints3d.into_iter().flatten()),
            );
        }
    }
}

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

#[test]
fn readers_in_four_languages_find_the_same_in_every_field() {
    let folder = tempfile::tempdir().unwrap();
    let camera = format!("test-conformance-{}", std::process::id());
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let rust = Subscriber::<BodyFrame>::open(&camera).unwrap();
    let mut readers = Vec::new();
    for (name, mut command) in commands(folder.path()) {
        command.arg(&camera);
        readers.push(Reader::start(name, command));
    }
    let (mut numbers, mut expected) = (Numbers(25), Print::default());
    expected.names();
    // Each state of the floor, nobody, everybody; no more than wait for a slow reader.
    let counts = [2, 0, 1, 3, MAX_PEOPLE, 4];
    for (i, count) in counts.into_iter().enumerate() {
        let is_last = i + 1 == counts.len();
        let flags = FLAG_FILE_TIME | if is_last { FLAG_END_OF_STREAM } else { 0 };
        let frame = some_frame(&mut numbers, count, flags);
        expected.frame(&frame);
        publisher.publish(&frame).unwrap();
    }
    let mut found = Print::default();
    found.names();
    for frame in rust.messages() {
        found.frame(&frame.unwrap());
    }
    assert_same("Rust", &found.0, &expected.0);
    for reader in readers {
        reader.ends_with(&expected.0);
    }
}

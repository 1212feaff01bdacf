//! `edgecap doctor`: what of this machine works, and what to do about the rest.

use std::fmt;
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use edgecap_client::message::BodyFrame;
use edgecap_client::place;
use edgecap_client::{LinkError, Publisher, Subscriber};

use super::exit::{self, Failure};
use super::input::DEFAULT_NAME;
use super::pipeline::{Pipeline, PipelineOptions};
use super::say;
use crate::capture::demo;
use crate::capture::{self, CameraInfo, CaptureError, Frame, InputSpec, OpenOptions, list_cameras};
use crate::engine::Isa;
use crate::machine::Machine;

/// Pictures of the bundled clip that speed is measured with.
const FRAMES: usize = 20;
/// Below this many pictures a second movement looks broken.
const FLUENT: f64 = 12.0;
/// How long a camera may take for its first picture.
const FIRST_PICTURE: Duration = Duration::from_secs(5);

/// Options of `edgecap doctor`.
#[derive(Debug, clap::Args)]
pub struct DoctorArgs {
    /// Threads for the network; all cores when not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
    /// Clear what earlier runs left in shared memory, if nobody alive uses it
    #[arg(long)]
    repair: bool,
}

/// How one thing is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// As it should be.
    Fine,
    /// Works, or is not needed by everybody.
    Note,
    /// Has to be mended; the exit code.
    Broken(u8),
}

/// One line of the report.
#[derive(Debug)]
struct Finding {
    what: &'static str,
    state: State,
    text: String,
}

impl Finding {
    fn new(what: &'static str, state: State, text: impl Into<String>) -> Self {
        let text = text.into();
        Self { what, state, text }
    }

    fn failed(what: &'static str, error: impl Into<anyhow::Error>) -> Self {
        let error = error.into();
        let state = State::Broken(exit::code(&error));
        Self::new(what, state, format!("{error:#}"))
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = match self.state {
            State::Fine => "ok",
            State::Note => "note",
            State::Broken(_) => "BROKEN",
        };
        write!(f, "{state:7} {:14} {}", self.what, self.text)
    }
}

/// Looks at everything that a run needs; prints each finding as soon as it is known.
///
/// # Errors
/// The exit code of the first thing that is broken.
pub fn doctor(args: DoctorArgs) -> anyhow::Result<()> {
    if args.repair {
        return repair();
    }
    let threads = args.threads.map_or_else(
        || std::thread::available_parallelism().map_or(1, usize::from),
        usize::from,
    );
    let checks: [&dyn Fn() -> Finding; 7] = [
        &build,
        &processor,
        &|| speed(threads),
        &shared_memory,
        &camera,
        &films,
        &running,
    ];
    let mut broken = None;
    for check in checks {
        let finding = check();
        writeln!(std::io::stdout(), "{finding}")?;
        if let State::Broken(code) = finding.state {
            broken = broken.or(Some(code));
        }
    }
    match broken {
        Some(code) => Err(Failure::silent(code).into()),
        None => Ok(()),
    }
}

/// Clears what the dead left of this user's shared memory.
fn repair() -> anyhow::Result<()> {
    let folder = place::runtime_dir();
    let alive = place::clear()?;
    if alive.is_empty() {
        say::out(&format!("{}: cleared; start again", folder.display()));
        return Ok(());
    }
    Err(Failure::unavailable(format!(
        "{}: what the dead left is cleared; {} in use and stayed: stop who publishes there first",
        folder.display(),
        alive.join(", ")
    ))
    .into())
}

fn build() -> Finding {
    Finding::new("build", State::Fine, crate::BUILD)
}

fn processor() -> Finding {
    match Isa::detect() {
        Ok(isa) => processor_with(isa),
        Err(e) => Finding::new(PROCESSOR, State::Broken(exit::USAGE), e.to_string()),
    }
}

const PROCESSOR: &str = "processor";

fn processor_with(isa: Isa) -> Finding {
    let machine = Machine::here(isa);
    let mut text = format!("{}, {} cores, {}", machine.cpu, machine.cores, machine.isa);
    let mut state = State::Fine;
    if isa == Isa::Scalar {
        text += &format!("; {}", super::pipeline::SCALAR_ONLY);
        state = State::Note;
    }
    if machine.governor.as_deref() == Some("powersave") {
        text += "; governor 'powersave' may slow it down: 'performance' is steadier";
        state = State::Note;
    }
    if let Some(load) = machine.load.filter(|_| machine.is_disturbed()) {
        text += &format!("; {load:.1} other processes run, which takes speed");
        state = State::Note;
    }
    Finding::new(PROCESSOR, state, text)
}

/// The bundled clip through every stage of `infer`.
fn speed(threads: usize) -> Finding {
    const WHAT: &str = "speed";
    let measured = || -> anyhow::Result<(f64, f64)> {
        let (width, height) = super::infer::DEFAULT_SIZE;
        let mut pipeline = Pipeline::new(&PipelineOptions {
            model: None,
            stage2: None,
            width,
            height,
            threads,
            flip_test: false,
        })?;
        let camera = demo::camera();
        let mut clip = capture::open_bytes("demo", demo::CLIP)?;
        let mut frame = Frame::default();
        let mut times = Vec::with_capacity(FRAMES);
        let mut people = 0;
        while times.len() < FRAMES && clip.next_into(&mut frame)? {
            let lens = camera.for_frame(frame.width, frame.height);
            let lens = lens.map_err(anyhow::Error::msg)?;
            let start = Instant::now();
            let seen = pipeline.process(&frame, &lens)?;
            people += seen.people.len();
            times.push(start.elapsed().as_secs_f64());
        }
        times.sort_by(f64::total_cmp);
        let median = times.get(times.len() / 2).copied().unwrap_or(f64::NAN);
        Ok((median, people as f64 / times.len() as f64))
    };
    match measured() {
        Ok((seconds, people)) => {
            let rate = 1.0 / seconds;
            let mut text = format!(
                "{:.0} ms a picture of {people:.1} people on {threads} of the cores: up to {rate:.*} a second",
                1e3 * seconds,
                usize::from(rate < 10.0)
            );
            let mut state = State::Fine;
            if rate < FLUENT {
                text += "; --size 384x240 takes less, for people who stand near";
                state = State::Note;
            }
            Finding::new(WHAT, state, text)
        }
        Err(e) => Finding::failed(WHAT, e),
    }
}

/// A message goes round through a stream of its own.
fn shared_memory() -> Finding {
    const WHAT: &str = "shared memory";
    let name = format!("doctor-{}", std::process::id());
    let round = || -> Result<Option<Duration>, LinkError> {
        let reader = Subscriber::<BodyFrame>::open(&name)?;
        let mut writer = Publisher::<BodyFrame>::open(&name)?;
        let sent = BodyFrame {
            sequence: 1,
            ..BodyFrame::default()
        };
        let start = Instant::now();
        writer.publish(&sent)?;
        let received = reader.next(Duration::from_secs(1))?;
        Ok(received.filter(|r| **r == sent).map(|_| start.elapsed()))
    };
    match round() {
        Ok(Some(time)) => {
            let text = format!(
                "a message takes {:.0} µs; in {}",
                1e6 * time.as_secs_f64(),
                place::runtime_dir().display()
            );
            Finding::new(WHAT, State::Fine, text)
        }
        Ok(None) => {
            let text = "a message did not arrive within a second: is the machine overloaded?";
            Finding::new(WHAT, State::Broken(exit::IO), text)
        }
        Err(e) => Finding::failed(WHAT, e),
    }
}

fn camera() -> Finding {
    const WHAT: &str = "camera";
    let failed = |e: CaptureError| match e {
        CaptureError::Unavailable { .. } | CaptureError::Busy { .. } => {
            Finding::new(WHAT, State::Note, e.to_string())
        }
        _ => Finding::failed(WHAT, e),
    };
    let cameras = match list_cameras() {
        Ok(cameras) => cameras,
        Err(e) => return failed(e),
    };
    let named = |c: &CameraInfo| format!("{} ({})", c.path.display(), c.name);
    let all = cameras.iter().map(named).collect::<Vec<_>>().join(", ");
    match first_picture() {
        Ok(Some((frame, time))) => {
            let text = format!(
                "{all}; the first picture, {}×{}, after {:.1} s",
                frame.width,
                frame.height,
                time.as_secs_f64()
            );
            Finding::new(WHAT, State::Fine, text)
        }
        Ok(None) => {
            let text = format!(
                "{all}; expected a picture within {} s, got none: plug it in again, or into another socket",
                FIRST_PICTURE.as_secs()
            );
            Finding::new(WHAT, State::Broken(exit::UNAVAILABLE), text)
        }
        Err(e) => failed(e),
    }
}

/// A picture of the camera that a run without arguments would take.
fn first_picture() -> Result<Option<(Frame, Duration)>, CaptureError> {
    let start = Instant::now();
    let mut source = capture::open(&InputSpec::FirstCamera, &OpenOptions::default())?;
    let mut frame = Frame::default();
    while start.elapsed() < FIRST_PICTURE {
        match source.next_into(&mut frame) {
            Ok(true) => return Ok(Some((frame, start.elapsed()))),
            Ok(false) => break,
            Err(e) if e.is_skippable() => {}
            Err(e) => return Err(e),
        }
    }
    Ok(None)
}

fn films() -> Finding {
    const WHAT: &str = "films";
    let runs = |program: &str| {
        let mut command = Command::new(program);
        command.arg("-version").stdin(Stdio::null());
        let quiet = command.stdout(Stdio::null()).stderr(Stdio::null());
        quiet.status().is_ok_and(|s| s.success())
    };
    if runs("ffmpeg") && runs("ffprobe") {
        return Finding::new(WHAT, State::Fine, "ffmpeg plays whatever it can read");
    }
    let text = "Motion-JPEG AVI and y4m only: install ffmpeg for mp4 and others";
    Finding::new(WHAT, State::Note, text)
}

fn running() -> Finding {
    const WHAT: &str = "running";
    match Subscriber::<BodyFrame>::open(DEFAULT_NAME) {
        Ok(bodies) if bodies.publisher_count() > 0 => {
            let text = format!("{DEFAULT_NAME} publishes: 'edgecap watch' shows it");
            Finding::new(WHAT, State::Fine, text)
        }
        Ok(_) => {
            let text = format!("nobody publishes {DEFAULT_NAME}: 'edgecap' starts it");
            Finding::new(WHAT, State::Note, text)
        }
        Err(e) => Finding::failed(WHAT, e),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_processor_with_scalar_kernels_only_is_told() {
        let scalar = processor_with(Isa::Scalar);
        assert!(scalar.text.contains("only scalar kernels are left"));
        assert!(!matches!(scalar.state, State::Fine));
        for isa in Isa::available().filter(|isa| *isa != Isa::Scalar) {
            assert!(!processor_with(isa).text.contains("scalar kernels"));
        }
    }
}

//! `edgecap infer`: pictures in, observations out. The only process that sees pictures.

mod engine_args;
mod pipelines;
mod zoom;

use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use edgecap_client::Publisher;
use edgecap_client::message::{
    FLAG_END_OF_STREAM, FLAG_FILE_TIME, MAX_PEOPLE, Observation, ObservationFrame,
};
use serde::Serialize;

use super::exit::Failure;
use super::input::{self, InputArgs};
use super::stop::{self, Stop};
use crate::capture::{CaptureError, Frame};
use crate::output::AtomicFile;
use crate::overlay;
pub(super) use engine_args::{EngineArgs, InputSize, parse_size};
use pipelines::Pipelines;

/// Network input for pictures that lie, pixels, where it does not follow the people in view.
pub(super) const DEFAULT_SIZE: (usize, usize) = zoom::INPUTS[0];

/// How long to wait for a reader before the first frame of a file, and for it to leave after the last.
const READER_PATIENCE: Duration = Duration::from_secs(5);
/// How often leftovers of killed processes are looked for.
const CLEAN_UP_EVERY: Duration = Duration::from_secs(10);

/// Options of `edgecap infer`.
#[derive(Debug, clap::Args)]
pub struct InferArgs {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    engine: EngineArgs,
    /// Write one line per frame to this file; then nothing is published unless --name is given
    #[arg(long, value_name = "FILE")]
    jsonl: Option<PathBuf>,
    /// Write pictures with the detected skeletons drawn to this folder
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
    /// Do not start before somebody reads the observations
    #[arg(long, hide = true)]
    wait_for_reader: bool,
    /// End with this process
    #[arg(long, hide = true, value_name = "PID")]
    supervisor: Option<i32>,
}

#[derive(Serialize)]
struct Line<'a> {
    frame: u64,
    time_ns: u64,
    source: &'a str,
    width: u32,
    height: u32,
    intrinsics: Camera,
    people: Vec<Person<'a>>,
}

#[derive(Serialize)]
struct Camera {
    fx: f32,
    fy: f32,
    cx: f32,
    cy: f32,
}

#[derive(Serialize)]
struct Person<'a> {
    score: f32,
    joints2d: &'a [[f32; 3]],
    joints3d: &'a [[f32; 3]],
    appearance: Appearance<'a>,
}

#[derive(Serialize)]
struct Appearance<'a> {
    hue: &'a [f32],
    saturation: &'a [f32],
}

impl<'a> Person<'a> {
    fn new(o: &'a Observation) -> Self {
        Self {
            score: o.score,
            joints2d: &o.joints2d,
            joints3d: &o.joints3d,
            appearance: Appearance {
                hue: &o.hue,
                saturation: &o.saturation,
            },
        }
    }
}

/// Runs Stage I, association and Stage II on every frame of the input.
///
/// # Errors
/// Input, model, output and shared-memory errors, each with its exit code.
pub fn infer(args: InferArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    if let Some(pid) = args.supervisor {
        stop::with_supervisor(pid)?;
    }
    let chosen = input::choose(&args.input);
    let film = !chosen.is_stills() || args.input.fps.is_some();
    if args.engine.size == Some(InputSize::Auto) && !film {
        return Err(Failure::usage(
            "--size auto follows people from picture to picture: expected a film, a camera or a folder of its frames with --fps, found photos: give --size WxH",
        )
        .into());
    }
    let camera = input::camera_file(&args.input, &chosen)?;
    let mut source = chosen.open(&args.input)?;
    let label = chosen.spec.to_string();
    let mut jsonl = match &args.jsonl {
        Some(path) => Some((
            AtomicFile::create(path).map_err(|e| Failure::output(path, &e))?,
            path,
        )),
        None => None,
    };
    if let Some(folder) = &args.overlay {
        std::fs::create_dir_all(folder).map_err(|e| Failure::output(folder, &e))?;
    }
    let publishes = args.input.name.is_some() || (args.jsonl.is_none() && args.overlay.is_none());
    let publisher = if publishes {
        Some(Publisher::<ObservationFrame>::open(&chosen.name)?)
    } else {
        None
    };
    let mut pipelines = Pipelines::new(&args.engine, film)?;
    tracing::info!(source = %label, name = %chosen.name, "infer starts");

    if let (Some(p), true) = (&publisher, args.wait_for_reader) {
        wait_until(&stop, || p.subscriber_count() > 0);
    }
    let mut frame = Frame::default();
    let mut message = Box::new(ObservationFrame::default());
    let mut cleaned = Instant::now();
    let mut last_sequence = 0;
    while !stop.requested() {
        match source.next_into(&mut frame) {
            Ok(true) => {}
            Ok(false) => break,
            // The source has logged what is wrong and looks for the camera again.
            Err(CaptureError::NoPictureYet { .. }) => continue,
            // One bad picture among many does not end the work.
            Err(e) if e.is_skippable() && source.frame_count() != Some(1) => {
                tracing::warn!("{e}; skipped");
                continue;
            }
            Err(e) => return Err(e.into()),
        }
        let intrinsics = camera
            .for_frame(frame.width, frame.height)
            .map_err(Failure::config)?;
        let seen = pipelines.process(&frame, &intrinsics)?;
        if let Some((file, path)) = &mut jsonl {
            let line = Line {
                frame: frame.sequence,
                time_ns: frame.time_ns,
                source: &source.picture(),
                width: frame.width,
                height: frame.height,
                intrinsics: Camera {
                    fx: intrinsics.fx,
                    fy: intrinsics.fy,
                    cx: intrinsics.cx,
                    cy: intrinsics.cy,
                },
                people: seen.people.iter().map(Person::new).collect(),
            };
            serde_json::to_writer(&mut *file, &line)
                .map_err(std::io::Error::from)
                .map_err(|e| Failure::output(path, &e))?;
            file.write_all(b"\n")
                .map_err(|e| Failure::output(path, &e))?;
        }
        if let Some(p) = &publisher {
            message.sequence = frame.sequence;
            message.capture_ns = frame.time_ns;
            message.width = frame.width;
            message.height = frame.height;
            message.intrinsics = intrinsics;
            message.stage_times = seen.times;
            message.flags = if source.is_live() { 0 } else { FLAG_FILE_TIME };
            message.without_neck = seen.without_neck;
            message.frame_total = source
                .frame_count()
                .map_or(0, |n| u32::try_from(n).unwrap_or(u32::MAX));
            message.count = seen.people.len().min(MAX_PEOPLE) as u32;
            for (slot, o) in message.people.iter_mut().zip(seen.people) {
                *slot = *o;
            }
            message.publish_ns = crate::camera::monotonic_ns();
            p.publish(&message)?;
            if cleaned.elapsed() > CLEAN_UP_EVERY {
                p.clean_up();
                cleaned = Instant::now();
            }
        }
        if let Some(folder) = &args.overlay {
            let path = folder.join(format!("{:06}.png", frame.sequence));
            overlay::draw(&mut frame, seen.people);
            overlay::write_png(&frame, &path)?;
        }
        last_sequence = frame.sequence;
    }
    if let Some((file, path)) = jsonl {
        file.finish().map_err(|e| Failure::output(path, &e))?;
    }
    if let Some(p) = &publisher {
        message.sequence = last_sequence;
        message.flags |= FLAG_END_OF_STREAM;
        message.count = 0;
        message.publish_ns = crate::camera::monotonic_ns();
        p.publish(&message)?;
        // Messages still in a reader's buffer live in this process's memory.
        wait_until(&stop, || p.subscriber_count() == 0);
    }
    Ok(())
}

fn wait_until(stop: &Stop, done: impl Fn() -> bool) {
    let start = Instant::now();
    while !done() && !stop.requested() && start.elapsed() < READER_PATIENCE {
        std::thread::sleep(Duration::from_millis(5));
    }
}

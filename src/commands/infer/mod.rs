//! `edgecap infer`: pictures in, observations out. Beside `run` on a file, the only process that sees pictures.

mod crops;
mod engine_args;
mod feed;
mod looks;
mod observer;
mod pace_args;
mod pipelines;
mod shapes;
mod turned;

use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use edgecap_client::message::ObservationFrame;
use serde::{Deserialize, Serialize};

use super::apart::Apart;
use super::exit::{self, Failure};
use super::health::HealthStream;
use super::input::{self, InputArgs, NamedInput};
use super::job::{self, Supervised};
use super::log;
use super::outputs::{RecordArgs, finish};
use super::progress;
use super::result;
use super::say;
use super::stop::Stop;
use super::taken::{What, expect_free};
use crate::capture::{InputSpec, Source, camera, list_cameras};
use crate::counted::counted;
use crate::metrics::{About, Health};
use crate::record::ObservationsRow;
use crate::sink::{OverlaySink, Packet, PictureSink, SharedMemorySink, Sinks, Streams};
use crate::supervise::{Beat, Heartbeat, restarts};
pub(super) use engine_args::EngineArgs;
pub(super) use observer::{Observer, Step};
pub(super) use pace_args::PaceArgs;
pub(super) use pipelines::Pipelines;

/// How often the supervisor hears that a film is being opened.
const OPENING: Duration = Duration::from_millis(250);
/// How long that goes on: a disk that has gone away never answers.
const LONGEST_OPENING: Duration = Duration::from_secs(600);

/// Options of `edgecap infer`. Without a place for a file's observations they go to
/// edgecap-out/<name>.observations.jsonl.
#[derive(Debug, clap::Args)]
pub struct InferArgs {
    #[command(flatten)]
    task: InferTask,
    #[command(flatten)]
    record: RecordArgs,
    /// Write pictures with the detected skeletons drawn to this folder, or a film where it ends in .avi
    #[arg(long, value_name = "DIR|FILM.avi")]
    overlay: Option<PathBuf>,
    /// Another verb has a film looked at, and says itself what has come of it
    #[arg(long, hide = true)]
    asked: bool,
    /// Say what can be set on the camera by --control, and end
    #[arg(long)]
    list_controls: bool,
    /// What a supervisor wants done, in place of all other options
    #[arg(long, hide = true, value_parser = job::parse::<InferTask>)]
    job: Option<job::Parsed<InferTask>>,
}

/// What is observed, and how.
#[derive(Debug, Clone, clap::Args, Serialize, Deserialize)]
pub struct InferTask {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub pace: PaceArgs,
    /// Publish what the camera sees, made small, for 'edgecap view --show-picture': otherwise no picture leaves this
    /// process
    #[arg(long)]
    #[serde(default)]
    pub show_picture: bool,
    /// Whether a camera may come later.
    #[arg(skip)]
    #[serde(default)]
    pub waits: bool,
    /// Cameras that share this machine's cores.
    #[arg(skip)]
    #[serde(default)]
    pub cameras: Option<usize>,
}

/// Runs Stage I, association and Stage II on every frame of the input.
///
/// # Errors
/// Input, model, output and shared-memory errors, each with its exit code; what was observed before is complete.
pub fn infer(mut args: InferArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let is_supervised = args.job.is_some();
    let Supervised { mut task, heart } = job::supervised(args.job, args.task)?;
    task.engine.cameras = task.cameras;
    let chosen = input::choose(&task.input)?;
    if args.list_controls {
        return list_controls(&chosen.spec);
    }
    if !is_supervised {
        task.input.expect_use(&chosen)?;
    }
    let limits = task.pace.limits(&chosen, args.overlay.is_some())?;
    log::name(format!("infer {}", chosen.name));
    let has_place = !args.record.is_empty() || args.overlay.is_some();
    let is_published = task.input.name.is_some() || !has_place;
    // Of a stream, readers know. Nobody waits for that of a file which was given no name.
    if !has_place && !is_supervised && task.input.name.is_none() && !chosen.is_live() {
        args.record.jsonl = Some(result::place(&task.input, &chosen, "observations"));
    }
    Apart::default()
        .reads_input(&task.input)
        .may_read("--model", task.engine.model.as_deref())
        .may_read("--stage2", task.engine.stage2.as_deref())
        .writes_records(&args.record)
        .may_write("--overlay", args.overlay.as_deref())
        .check()?;
    let streams = match chosen.is_live() {
        true => Streams::of_camera(&chosen.name),
        false => Streams::of_file(&chosen.name, task.input.name.is_some()),
    };
    // A supervisor has looked, and one that it has just ended may take its time.
    if is_published && !is_supervised {
        let what = [What::Observations, What::Health];
        streams.expect(expect_free(&chosen.name, &what))?;
    }
    let source = open(&task, &chosen, &heart)?;
    let lens = input::camera_file(&task.input, &chosen)?;
    let mut sinks = Sinks::default();
    let has_end = chosen.has_end();
    args.record.add_to::<ObservationsRow>(has_end, &mut sinks)?;
    if let Some(path) = &args.overlay {
        sinks.push(OverlaySink::create(
            path,
            source.rate().at_most(task.pace.max_fps),
            source.is_stills(),
        )?);
    }
    if is_published {
        streams.add_to(&mut sinks, SharedMemorySink::<ObservationFrame>::open)?;
    }
    let about = About {
        interval: task.pace.interval(),
        is_file: !source.is_live(),
        is_sequence: !source.is_stills(),
        restarts: restarts(),
        ..About::default()
    };
    let mut health = HealthStream::open(about, is_published.then_some(&streams))?;
    health.look(|_, _| ())?;
    if task.show_picture {
        streams.add_to(&mut sinks, PictureSink::open)?;
    }
    let mut observer = Observer::new(source, lens, &task.engine, limits, task.input.mounting())?;
    tracing::info!(source = %chosen.spec, name = %chosen.name, "infer starts");

    let mut message = Box::new(ObservationFrame::default());
    let (mut observed, mut inhabited, mut has_ended) = (0, 0, false);
    let mut bar = None;
    let mut is_silent = false;
    let mut observe = || -> anyhow::Result<()> {
        while !stop.requested() {
            let step = observer.step(&mut message)?;
            health.look(|health, now| without_picture(step, health, now))?;
            let was_silent = std::mem::replace(&mut is_silent, step == Step::Silent);
            match step {
                Step::Nothing => {
                    heart.beat(Beat::Waiting);
                    continue;
                }
                Step::Away => {
                    sinks.quiet();
                    heart.beat(Beat::Away);
                    continue;
                }
                Step::Idle => {
                    heart.beat(Beat::Idle);
                    continue;
                }
                // A source that does not answer is no progress. The next picture of a film may take a while, as of one
                // that begins anew or lies on a disk that wakes up: said once, since one that hangs is to be noticed.
                Step::Silent => {
                    if task.input.live && !was_silent {
                        heart.beat(Beat::Waiting);
                    }
                    continue;
                }
                Step::Ended => {
                    has_ended = true;
                    break;
                }
                Step::Observed => {}
            }
            observed += 1;
            inhabited += u64::from(message.count > 0);
            sinks.take(&Packet {
                message: &message,
                source: observer.picture_name(),
                picture: observer.picture(),
            })?;
            heart.beat(Beat::Step);
            health.look(|health, now| {
                health.looks_at(observer.input());
                health.observed(now, &(&*message).into(), observer.is_idle());
            })?;
            // Only an input with an end has a total.
            if message.frame_total > 0 && !is_supervised {
                bar.get_or_insert_with(|| progress::bar(message.frame_total.into(), "frames"))
                    .set_position(message.sequence + 1);
            }
        }
        Ok(())
    };
    let mut outcome = observe();
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    // The supervisor has not asked for the end of the stream: it knows why this process ends, or starts another one.
    if is_supervised && (outcome.is_err() || stop.requested()) {
        // No picture stays that stands for what nobody sees any more.
        sinks.quiet();
        health.end();
        outcome?;
        return Err(Failure::silent(exit::INTERRUPTED).into());
    }
    if outcome.is_ok() && !has_ended && has_end {
        // Whoever waits for the whole film must not take this for it.
        outcome = Err(Failure::stopped(observed).into());
    }
    let (outcome, left_out) = exit::without_left_out(outcome, observed);
    // Readers of both hear it before one of them waits for its own.
    health.end();
    let (words, ended) = finish(sinks, observed, outcome);
    health.finish();
    // Whoever names a stream and nothing else reads it.
    let is_read = task.input.name.is_some() && !has_place;
    let is_quiet = is_supervised || args.asked || is_read;
    let has_news = ended.is_ok() || !words.is_empty();
    if has_news && !is_quiet {
        let frames = counted(observed, "frame", "frames");
        let done = format!("{frames}, {inhabited} with people");
        say::err(&say::concluded(&done, &words));
    }
    ended?;
    left_out
}

/// What a step without a picture says of the source.
fn without_picture(step: Step, health: &mut Health, now: u64) {
    match step {
        Step::Nothing | Step::Silent => health.waits(now),
        Step::Away => health.is_away(now),
        Step::Idle => health.not_due(now),
        Step::Observed | Step::Ended => {}
    }
}

/// Opens the input. All packets of a film are listed before its first picture, which takes minutes for a large one: the
/// supervisor hears for a while that there is no picture yet. Opening a camera says nothing, and one that does not
/// answer is noticed.
///
/// # Errors
/// As [`NamedInput::open`], and if no thread can be started.
fn open(
    task: &InferTask,
    chosen: &NamedInput,
    heart: &Heartbeat,
) -> anyhow::Result<Box<dyn Source>> {
    if !task.input.live {
        return match task.waits {
            true => chosen.open_when_there(&task.input),
            false => chosen.open(&task.input),
        };
    }
    std::thread::scope(|threads| {
        let (tell, opened) = channel();
        let work = move || {
            // Who waits for it stays until it has come.
            let _ = tell.send(chosen.open(&task.input));
        };
        std::thread::Builder::new()
            .name("open".into())
            .spawn_scoped(threads, work)?;
        let began = Instant::now();
        loop {
            match opened.recv_timeout(OPENING) {
                Ok(opened) => return opened,
                Err(RecvTimeoutError::Timeout) if began.elapsed() < LONGEST_OPENING => {
                    heart.beat(Beat::Waiting);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    anyhow::bail!("the thread that opens the film ended unexpectedly")
                }
            }
        }
    })
}

/// Says what can be set on a camera.
fn list_controls(spec: &InputSpec) -> anyhow::Result<()> {
    let path = match spec {
        InputSpec::Path(path) => path.clone(),
        InputSpec::FirstCamera => list_cameras()?.remove(0).path,
        InputSpec::Stdin | InputSpec::Demo | InputSpec::StandIn(_) => {
            return Err(Failure::usage(
                "--list-controls asks a camera: expected --input /dev/video0 or 'camera'",
            )
            .into());
        }
    };
    for line in camera::list_controls(&path)? {
        say::out(&line);
    }
    Ok(())
}

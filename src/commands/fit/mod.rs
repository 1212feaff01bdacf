//! `edgecap fit`: observations in, bodies out. Sees no pictures; live from shared memory, of one camera or of several
//! that are calibrated, or from a recorded file.

mod cameras;
mod lines;
pub mod numbers;
mod pace;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use edgecap_client::message::{
    BodyFrame, EventFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, ObservationFrame,
};
use edgecap_client::{Priority, Subscriber};
use serde::{Deserialize, Serialize};

use super::apart::Apart;
use super::event_settings;
use super::exit::Failure;
use super::fit_settings::{config, fitter};
use super::input::{DEFAULT_NAME, lens};
use super::job::{self, Supervised};
use super::log;
use super::outputs::{RecordArgs, finish};
use super::say;
use super::settings::parse_rate;
use super::stop::Stop;
use super::views;
use lines::Lines;
use numbers::{Before, Numbers, Succession};
use pace::{Fresh, Pace};

use crate::camera::{DEFAULT_FOV, Sleep, monotonic_ns};
use crate::config::Setting;
use crate::counted::counted;
use crate::events::EventConfig;
use crate::fit::{FitConfig, Fitter};
use crate::multiview::live::{LiveFit, without_meaning};
use crate::record::{BodiesRow, CameraSource, ObservationReader};
use crate::sink::{EventSink, Packet, SharedMemorySink, SinkError, Sinks};
use crate::supervise::{Beat, Heartbeat};

/// Longest wait for an observation: signals and the supervisor want to be heard.
const STEP: Duration = Duration::from_millis(200);
/// Name of the bodies that several cameras see, when the user gives none.
pub const ROOM: &str = "room";

/// Options of `edgecap fit`.
#[derive(Debug, clap::Args)]
pub struct FitArgs {
    /// Fit recorded observations (of `infer --jsonl` or `infer --record`) instead of live ones; '-' for standard input
    #[arg(long, value_name = "FILE", conflicts_with = "cameras")]
    input: Option<PathBuf>,
    #[command(flatten)]
    record: RecordArgs,
    /// The lens behind --input (TOML), whatever its lines say: fov_degrees across, or a calibration's fx, fy, cx, cy,
    /// width, height
    #[arg(
        long,
        value_name = "FILE",
        requires = "input",
        conflicts_with = "cameras"
    )]
    camera: Option<PathBuf>,
    #[command(flatten)]
    task: FitTask,
    /// What a supervisor wants done, in place of all other options
    #[arg(long, hide = true, value_parser = job::parse::<FitTask>)]
    job: Option<job::Parsed<FitTask>>,
}

/// Whose observations are fitted, and how.
#[derive(Debug, Clone, clap::Args, Serialize, Deserialize)]
pub struct FitTask {
    /// Name under which observations are read and bodies published; of several cameras, bodies [default: camera0, of
    /// several cameras room]
    #[arg(long, conflicts_with = "input")]
    pub name: Option<String>,
    /// Fit what several calibrated cameras see of the same people: the names under which each one's observations are
    /// published, as the calibration calls the cameras, or CAMERA=NAME
    #[arg(
        long,
        value_name = "[CAMERA=]NAME,…",
        value_delimiter = ',',
        requires = "calibration"
    )]
    #[serde(default)]
    pub cameras: Vec<String>,
    /// Their calibration: Pose2Sim's or Anipose's Calib.toml, QTM's .qca.txt, or a folder of EasyMocap, COLMAP or one
    /// OpenCV file a camera
    #[arg(long, value_name = "FILE", requires = "cameras")]
    #[serde(default)]
    pub calibration: Option<PathBuf>,
    /// Settings of identity, filters and fit (TOML)
    #[arg(long = "fit-config", visible_alias = "config", value_name = "FILE")]
    pub config: Option<Setting<FitConfig>>,
    /// What counts as an event, and zones of the floor (TOML); events are published with the bodies
    #[arg(long, value_name = "FILE", conflicts_with = "input")]
    #[serde(default)]
    pub events: Option<Setting<EventConfig>>,
    /// Every frame is a picture of its own: no motion between frames
    #[arg(long, conflicts_with = "cameras")]
    pub stills: bool,
    /// Publish at this rate, extrapolating between camera frames, Hz
    #[arg(long, value_name = "HZ", value_parser = parse_rate, conflicts_with = "input")]
    pub rate: Option<u16>,
    /// What was published before, which a supervisor knows
    #[arg(skip)]
    #[serde(default)]
    pub before: Before,
}

/// Runs Stage III.
///
/// # Errors
/// Configuration, input, output and shared-memory errors, each with its exit code; what was fitted before is complete.
pub fn fit(args: FitArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let Supervised { task, heart } = job::supervised(args.job, args.task)?;
    log::name(format!("fit {}", task.name()));
    Apart::default()
        .may_read("--input", args.input.as_deref())
        .may_read("--camera", args.camera.as_deref())
        .reads_setting("--fit-config", task.config.as_ref())
        .reads_setting("--events", task.events.as_ref())
        .reads_calibration(task.calibration.as_deref())
        .writes_records(&args.record)
        .check()?;
    let mut sinks = Sinks::default();
    if let Some(calibration) = &task.calibration {
        let chosen = views::choose(&task.cameras, calibration)?;
        let config = config(task.config.as_ref())?;
        let idle = without_meaning(&config);
        if !idle.is_empty() {
            let idle = idle.join(", ");
            tracing::warn!("settings of the fit that mean nothing with several cameras: {idle}");
        }
        let fit = LiveFit::new(chosen.views.clone(), config);
        let fit = fit.map_err(|e| Failure::config(e.to_string()))?;
        args.record.add_to::<BodiesRow>(false, &mut sinks)?;
        publish(&task, &mut sinks)?;
        return cameras::live(fit, &chosen.names, &task, sinks, &stop, &heart);
    }
    let mut fitter = fitter(task.config.as_ref(), task.stills)?;
    let Some(input) = &args.input else {
        args.record.add_to::<BodiesRow>(false, &mut sinks)?;
        publish(&task, &mut sinks)?;
        return live(&mut fitter, &task, sinks, &stop, &heart);
    };
    if args.record.is_empty() {
        return Err(Failure::usage(
            "fit --input: expected a place for the bodies: give --jsonl FILE or --record FILE",
        )
        .into());
    }
    let lines = Lines::open(input, &stop)?;
    args.record.add_to::<BodiesRow>(lines.has_end, &mut sinks)?;
    recorded(
        &mut fitter,
        lines,
        input,
        args.camera.as_deref(),
        sinks,
        &stop,
    )
}

/// Bodies, and what happens with them, into shared memory.
fn publish(task: &FitTask, sinks: &mut Sinks<BodyFrame>) -> anyhow::Result<()> {
    let config = event_settings::config(task.events.as_ref())?;
    sinks.push(SharedMemorySink::<BodyFrame>::open(task.name())?);
    let mut to = Sinks::default();
    to.push(SharedMemorySink::<EventFrame>::open(task.name())?);
    sinks.push(EventSink::new(config, to));
    Ok(())
}

impl FitTask {
    /// Name under which bodies are published.
    pub fn name(&self) -> &str {
        let usual = match self.cameras.is_empty() {
            true => DEFAULT_NAME,
            false => ROOM,
        };
        self.name.as_deref().unwrap_or(usual)
    }
}

fn live(
    fitter: &mut Fitter,
    task: &FitTask,
    mut sinks: Sinks<BodyFrame>,
    stop: &Stop,
    heart: &Heartbeat,
) -> anyhow::Result<()> {
    let observations = Subscriber::<ObservationFrame>::open_with(task.name(), Priority::Reserved)?;
    let mut pace = Pace::new(task.rate);
    let mut out = Box::new(BodyFrame::default());
    let mut fit_us = 0;
    let mut frames = 0;
    let (mut fresh, mut succession) = (Fresh::default(), Succession::after(task.before));
    let mut sleep = Sleep::default();
    let mut fit = || -> anyhow::Result<()> {
        let mut take = |out: &mut BodyFrame| {
            frames += 1;
            succession.go_on(out);
            out.publish_ns = monotonic_ns();
            sinks.take(&Packet {
                message: out,
                source: "",
                picture: None,
            })?;
            heart.beat(Beat::Step);
            Ok::<_, SinkError>(())
        };
        heart.beat(Beat::Idle);
        while !stop.requested() {
            match observations.next(pace.patience(STEP, Instant::now()))? {
                // The sinks say so to whoever reads; nothing may follow.
                Some(frame) if frame.flags & FLAG_END_OF_STREAM != 0 => break,
                Some(frame) if fresh.is_news(&frame) => {
                    let start = Instant::now();
                    let slept = sleep.seconds();
                    if frame.flags & FLAG_FILE_TIME == 0 {
                        fitter.slept(slept);
                    }
                    fitter.update(&frame, &mut out);
                    fit_us = start.elapsed().as_micros() as u32;
                    out.fit_us = fit_us;
                    if pace.fitted(&out, Instant::now()) {
                        take(&mut out)?;
                    }
                }
                Some(_) | None => heart.beat(Beat::Idle),
            }
            if pace.is_due(Instant::now()) {
                fitter.predict(monotonic_ns(), &mut out);
                out.fit_us = fit_us;
                take(&mut out)?;
            }
        }
        Ok(())
    };
    let outcome = fit();
    finish(sinks, frames, outcome).1
}

fn recorded(
    fitter: &mut Fitter,
    lines: Lines,
    input: &Path,
    camera: Option<&Path>,
    mut sinks: Sinks<BodyFrame>,
    stop: &Stop,
) -> anyhow::Result<()> {
    let given = camera.map(lens).transpose()?;
    let for_frame = |width, height| given.unwrap_or_default().for_frame(width, height);
    let camera = match &given {
        Some(_) => CameraSource::Given(&for_frame),
        None => CameraSource::Recorded {
            fov_degrees: DEFAULT_FOV,
        },
    };
    let Lines { from, has_end } = lines;
    let mut reader = ObservationReader::new(from, input.display().to_string(), camera);
    let mut frame = Box::new(ObservationFrame::default());
    let mut out = Box::new(BodyFrame::default());
    let (mut frames, mut told, mut numbers) = (0, false, Numbers::default());
    let mut fit = || -> anyhow::Result<()> {
        loop {
            let is_frame = reader.read(&mut frame);
            if stop.requested() {
                // What was being read then ends wherever it was.
                return match has_end {
                    true => Err(Failure::stopped(frames).into()),
                    false => Ok(()),
                };
            }
            if !is_frame? {
                break;
            }
            let start = Instant::now();
            fitter.update(&frame, &mut out);
            out.fit_us = start.elapsed().as_micros() as u32;
            out.sequence = numbers.go_on(out.sequence);
            frames += 1;
            if fitter.counters().stale_frames > 0 && !told {
                told = true;
                tracing::warn!(
                    "{}: expected times that rise, found frame {} no later than the one before; such frames repeat its bodies; --stills takes every frame by itself",
                    input.display(),
                    reader.line()
                );
            }
            sinks.take(&Packet {
                message: &*out,
                source: reader.source(),
                picture: None,
            })?;
        }
        let name = input.display();
        match (frames, reader.was_cut()) {
            (0, was_cut) => {
                let name = name.to_string();
                Err(Failure::no_whole_frame(&name, "observations", was_cut).into())
            }
            (_, true) => {
                tracing::warn!(
                    "{name}: cut off inside frame {}; the frames before it were fitted",
                    reader.line() + 1
                );
                Ok(())
            }
            (_, false) => Ok(()),
        }
    };
    let outcome = fit();
    let (words, ended) = finish(sinks, frames, outcome);
    if ended.is_ok() || !words.is_empty() {
        say::err(&say::concluded(&counted(frames, "frame", "frames"), &words));
    }
    ended
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::BufReader;

    use super::*;
    use crate::message::Intrinsics;
    use crate::record::{Format, ObservationsRow, Row, RowReader};
    use crate::sink::RecordSink;

    /// Two recordings after each other; the second one's clock goes on.
    fn observations() -> Vec<u8> {
        let mut lines = Vec::new();
        for (sequence, time) in [(0, 1), (1, 2), (2, 3), (0, 4), (2, 5)] {
            let frame = ObservationFrame {
                sequence,
                capture_ns: time * 40_000_000,
                width: 640,
                height: 480,
                intrinsics: Intrinsics::from_horizontal_fov(640, 480, DEFAULT_FOV),
                ..ObservationFrame::default()
            };
            serde_json::to_writer(&mut lines, &ObservationsRow::new(&frame, "")).unwrap();
            lines.push(b'\n');
        }
        lines
    }

    #[test]
    fn bodies_of_several_records_are_counted_as_those_of_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bodies.jsonl");
        let mut sinks = Sinks::default();
        sinks.push(RecordSink::<BodiesRow>::create(&path, Format::Jsonl).unwrap());
        let lines = Lines {
            from: Box::new(std::io::Cursor::new(observations())),
            has_end: false,
        };
        let mut fitter = Fitter::new(FitConfig::default()).unwrap();
        let input = Path::new("-");
        recorded(&mut fitter, lines, input, None, sinks, &Stop::never()).unwrap();
        let file = BufReader::new(File::open(&path).unwrap());
        let mut rows = RowReader::<_, BodiesRow>::new(file, "bodies");
        let numbers = std::iter::from_fn(|| rows.read().unwrap()).map(|row| row.frame);
        assert_eq!(numbers.collect::<Vec<_>>(), [0, 1, 2, 3, 5]);
    }
}

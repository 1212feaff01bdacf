//! `edgecap fit`: observations in, bodies out. Sees no pictures; live from shared memory, or from a recorded file.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, ObservationFrame};
use edgecap_client::{Publisher, Subscriber};

use super::exit::Failure;
use super::input::DEFAULT_NAME;
use super::stop::{self, Stop};
use crate::camera::{CameraFile, DEFAULT_FOV, monotonic_ns};
use crate::fit::bodies_line::write_bodies;
use crate::fit::offline::{CameraSource, ObservationReader};
use crate::fit::{FitConfig, Fitter};
use crate::output::AtomicFile;

const READER_PATIENCE: Duration = Duration::from_millis(1500);
const CLEAN_UP_EVERY: Duration = Duration::from_secs(10);

/// Options of `edgecap fit`.
#[derive(Debug, clap::Args)]
pub struct FitArgs {
    /// Fit a recorded observation file (the format of `infer --jsonl`) instead of live observations
    #[arg(long, value_name = "FILE", requires = "jsonl")]
    input: Option<PathBuf>,
    /// Where the bodies of --input go, one line per frame
    #[arg(long, value_name = "FILE", requires = "input")]
    jsonl: Option<PathBuf>,
    /// The lens behind --input (TOML), whatever its lines say: fov_degrees across, or a calibration's fx, fy, cx, cy, width, height
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Name under which observations are read and bodies published
    #[arg(long, default_value = DEFAULT_NAME)]
    name: String,
    /// Settings of identity, filters and fit (TOML)
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Every frame is a picture of its own: no motion between frames
    #[arg(long)]
    stills: bool,
    /// Publish at this rate, extrapolating between camera frames, Hz
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u16).range(1..=240))]
    rate: Option<u16>,
    /// End with this process
    #[arg(long, hide = true, value_name = "PID")]
    supervisor: Option<i32>,
}

/// Runs Stage III.
///
/// # Errors
/// Configuration, input, output and shared-memory errors, each with its exit code.
pub fn fit(args: FitArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    if let Some(pid) = args.supervisor {
        stop::with_supervisor(pid)?;
    }
    let mut config = read_config(args.config.as_deref())?;
    config.stills |= args.stills;
    let mut fitter = Fitter::new(config).map_err(|e| Failure::config(e.to_string()))?;
    match (&args.input, &args.jsonl) {
        (Some(input), Some(output)) => {
            recorded(&mut fitter, input, output, args.camera.as_deref(), &stop)
        }
        _ => live(&mut fitter, &args.name, args.rate, &stop),
    }
}

fn read_config(path: Option<&Path>) -> anyhow::Result<FitConfig> {
    let Some(path) = path else {
        return Ok(FitConfig::default());
    };
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::config(format!("cannot read {}: {e}", path.display())))?;
    Ok(toml::from_str(&text).map_err(|e| {
        Failure::config(format!("{}: {}", path.display(), e.to_string().trim_end()))
    })?)
}

fn live(fitter: &mut Fitter, name: &str, rate: Option<u16>, stop: &Stop) -> anyhow::Result<()> {
    let bodies = Publisher::<BodyFrame>::open(name)?;
    let observations = Subscriber::<ObservationFrame>::open(name)?;
    let period = rate.map(|hz| Duration::from_secs(1) / u32::from(hz));
    let mut out = Box::new(BodyFrame::default());
    let mut cleaned = Instant::now();
    let mut next_tick = Instant::now();
    let mut fit_us = 0;
    while !stop.requested() {
        let patience = match period {
            Some(_) => next_tick.saturating_duration_since(Instant::now()),
            None => Duration::from_millis(200),
        };
        let mut ended = false;
        if let Some(frame) = observations.next(patience)? {
            ended = frame.flags & FLAG_END_OF_STREAM != 0;
            let start = Instant::now();
            if !ended {
                fitter.update(&frame, &mut out);
            }
            out.flags = frame.flags;
            fit_us = start.elapsed().as_micros() as u32;
            out.fit_us = fit_us;
            // A file's clock is not ours to extrapolate on.
            if period.is_none() || ended || frame.flags & FLAG_FILE_TIME != 0 {
                publish(&bodies, &mut out)?;
            }
        }
        if let Some(period) = period
            && Instant::now() >= next_tick
        {
            if out.width > 0 && out.flags & FLAG_FILE_TIME == 0 {
                fitter.predict(monotonic_ns(), &mut out);
                out.fit_us = fit_us;
                publish(&bodies, &mut out)?;
            }
            next_tick = (next_tick + period).max(Instant::now());
        }
        if ended {
            let start = Instant::now();
            while bodies.subscriber_count() > 0
                && start.elapsed() < READER_PATIENCE
                && !stop.requested()
            {
                std::thread::sleep(Duration::from_millis(5));
            }
            break;
        }
        if cleaned.elapsed() > CLEAN_UP_EVERY {
            observations.clean_up();
            cleaned = Instant::now();
        }
    }
    Ok(())
}

fn publish(bodies: &Publisher<BodyFrame>, out: &mut BodyFrame) -> anyhow::Result<()> {
    out.publish_ns = monotonic_ns();
    Ok(bodies.publish(out)?)
}

fn recorded(
    fitter: &mut Fitter,
    input: &Path,
    output: &Path,
    camera: Option<&Path>,
    stop: &Stop,
) -> anyhow::Result<()> {
    let file = File::open(input).map_err(|e| Failure::no_input(input, &e))?;
    let mut lines = AtomicFile::create(output).map_err(|e| Failure::output(output, &e))?;
    let given = camera.map(CameraFile::read).transpose()?;
    let for_frame = |width, height| given.unwrap_or_default().for_frame(width, height);
    let camera = match &given {
        Some(_) => CameraSource::Given(&for_frame),
        None => CameraSource::Recorded {
            fov_degrees: DEFAULT_FOV,
        },
    };
    let mut reader =
        ObservationReader::new(BufReader::new(file), input.display().to_string(), camera);
    let mut frame = Box::new(ObservationFrame::default());
    let mut out = Box::new(BodyFrame::default());
    while reader.read(&mut frame)? {
        if stop.requested() {
            return Err(Failure::stopped().into());
        }
        fitter.update(&frame, &mut out);
        write_bodies(&mut lines, &out).map_err(|e| Failure::output(output, &e))?;
    }
    lines.finish().map_err(|e| Failure::output(output, &e))?;
    Ok(())
}

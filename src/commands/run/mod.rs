//! `edgecap run`: starts and supervises `infer` and `fit`, and shows what they publish.

mod children;
mod overlay;

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM};
use edgecap_client::{Subscriber, service_name};

use super::exit::{self, Failure};
use super::infer::EngineArgs;
use super::input::{self, Chosen, InputArgs};
use super::stop::Stop;
use super::table::{Table, TableArgs};
use super::tally::Tally;
use crate::fit::bodies_line::write_bodies;
use crate::output::AtomicFile;
use children::{Supervised, describe, stop_all};
use overlay::OverlayWriter;

/// Where the results of a file go when the user names no place.
const OUT: &str = "edgecap-out";
/// How long the last bodies may take after `infer` has ended.
const LAST_BODIES: Duration = Duration::from_secs(3);
const CLEAN_UP_EVERY: Duration = Duration::from_secs(10);

/// Options of `edgecap run`.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    engine: EngineArgs,
    /// Write the bodies of every frame to this file [default for files: edgecap-out/<name>.bodies.jsonl]
    #[arg(long, value_name = "FILE")]
    jsonl: Option<PathBuf>,
    /// Write pictures with the fitted skeletons drawn to this folder (files only)
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
    /// Publish bodies at this rate, extrapolating between camera frames, Hz
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u16).range(1..=240))]
    rate: Option<u16>,
    /// Settings of identity, filters and fit (TOML)
    #[arg(long, value_name = "FILE")]
    fit_config: Option<PathBuf>,
    #[command(flatten)]
    table: TableArgs,
}

impl RunArgs {
    fn infer_args(&self, chosen: &Chosen) -> Vec<OsString> {
        let mut args = self.input.to_args(chosen);
        args.push("--wait-for-reader".into());
        args.extend(self.engine.to_args());
        args
    }

    fn fit_args(&self, chosen: &Chosen) -> Vec<OsString> {
        let mut args: Vec<OsString> = vec!["--name".into(), chosen.name.clone().into()];
        if chosen.is_stills() && self.input.fps.is_none() {
            args.push("--stills".into());
        }
        if let Some(rate) = self.rate {
            args.extend(["--rate".into(), rate.to_string().into()]);
        }
        if let Some(config) = &self.fit_config {
            args.extend(["--config".into(), config.into()]);
        }
        args
    }
}

/// Runs the whole system on one input.
///
/// # Errors
/// The failure of either process with its own exit code; output and shared-memory errors.
pub fn run(args: RunArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let chosen = input::choose(&args.input);
    let jsonl_path = match &args.jsonl {
        Some(path) => Some(path.clone()),
        None if chosen.is_file() => {
            Some(PathBuf::from(OUT).join(format!("{}.bodies.jsonl", chosen.name)))
        }
        None => None,
    };
    let mut jsonl = match &jsonl_path {
        Some(path) => Some((
            AtomicFile::create(path).map_err(|e| Failure::output(path, &e))?,
            path.clone(),
        )),
        None => None,
    };
    let overlay = match &args.overlay {
        Some(_) if !chosen.can_reopen() => {
            let message = "--overlay reads the input a second time: give a file, or use 'edgecap infer --overlay' for a camera or pipe";
            return Err(Failure::usage(message).into());
        }
        Some(folder) => Some(OverlayWriter::start(
            chosen.open(&args.input)?,
            folder.clone(),
        )?),
        None => None,
    };
    let bodies = Subscriber::<BodyFrame>::open(&chosen.name)?;
    let mut table = Table::new(args.table);
    table.say(&format!(
        "{} → shared memory {} (Ctrl-C stops)",
        chosen.spec,
        service_name::<BodyFrame>(&chosen.name)
    ));

    let mut fit = Supervised::start("fit", args.fit_args(&chosen))?;
    let mut infer = match Supervised::start("infer", args.infer_args(&chosen)) {
        Ok(child) => child,
        Err(e) => {
            stop_all(&mut [&mut fit]);
            return Err(e.into());
        }
    };
    let mut tally = Tally::default();
    let outcome = watch(
        &bodies,
        &stop,
        &mut infer,
        &mut fit,
        chosen.is_file(),
        &mut |frame: &BodyFrame| {
            tally.count(frame);
            table.update(frame, tally.lost);
            if let Some((file, path)) = &mut jsonl {
                write_bodies(file, frame).map_err(|e| Failure::output(path, &e))?;
            }
            if let Some(o) = &overlay {
                o.push(frame);
            }
            Ok(())
        },
    );
    stop_all(&mut [&mut infer, &mut fit]);
    table.finish();
    outcome?;

    let pictures = overlay.map(OverlayWriter::finish).transpose()?;
    if let Some((file, path)) = jsonl {
        file.finish().map_err(|e| Failure::output(&path, &e))?;
        println!(
            "{} frames, {} people → {}",
            tally.frames,
            tally.ids.len(),
            path.display()
        );
    } else {
        println!("{} frames, {} people", tally.frames, tally.ids.len());
    }
    if let (Some(n), Some(folder)) = (pictures, &args.overlay) {
        println!("{n} pictures → {}", folder.display());
    }
    if tally.lost > 0 {
        println!(
            "{} frames were lost on the way (a process was restarted or too slow)",
            tally.lost
        );
    }
    Ok(())
}

/// Hands every message to `take` until the input ends, the user stops, or a process fails for good.
fn watch(
    bodies: &Subscriber<BodyFrame>,
    stop: &Stop,
    infer: &mut Supervised,
    fit: &mut Supervised,
    is_file: bool,
    take: &mut dyn FnMut(&BodyFrame) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut infer_done: Option<Instant> = None;
    let mut cleaned = Instant::now();
    while !stop.requested() {
        while let Some(frame) = bodies.next(Duration::from_millis(50))? {
            if frame.flags & FLAG_END_OF_STREAM != 0 {
                return Ok(());
            }
            take(&frame)?;
            if stop.requested() {
                return Ok(());
            }
        }
        if let Some(status) = fit.ended()? {
            let permanent = status
                .code()
                .filter(|&c| matches!(c as u8, exit::CONFIG | exit::USAGE | exit::UNAVAILABLE));
            if let Some(code) = permanent {
                return Err(Failure::silent(code as u8).into());
            }
            if infer_done.is_none() {
                tracing::warn!("fit ended with {}; starting it again", describe(status));
                fit.restart_later();
            }
        }
        if let Some(status) = infer.ended()? {
            match status.code() {
                Some(0) => infer_done = Some(Instant::now()),
                Some(code) if is_file || code as u8 != exit::SOFTWARE => {
                    return Err(Failure::silent(code as u8).into());
                }
                _ if is_file => {
                    let message =
                        format!("infer ended with {}; nothing was written", describe(status));
                    return Err(Failure::child(exit::SOFTWARE, message).into());
                }
                _ => {
                    tracing::warn!("infer ended with {}; starting it again", describe(status));
                    infer.restart_later();
                }
            }
        }
        fit.revive()?;
        infer.revive()?;
        if infer_done.is_some_and(|t| t.elapsed() > LAST_BODIES) {
            return Ok(());
        }
        if cleaned.elapsed() > CLEAN_UP_EVERY {
            bodies.clean_up();
            cleaned = Instant::now();
        }
    }
    Ok(())
}

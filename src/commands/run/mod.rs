//! `edgecap run`: the whole system on one input. A file goes through one process at its own pace, and no frame of it is lost; a
//! camera has one process that sees pictures and one that fits, under supervision, and its newest frame wins.

mod file;
mod flow;
mod live;

use std::path::PathBuf;

use super::exit::Failure;
use super::infer::{EngineArgs, InferTask, PaceArgs};
use super::input::{self, Chosen, InputArgs};
use super::outputs::RecordArgs;
use super::say;
use super::stop::Stop;
use super::table::TableArgs;
use super::tally::Tally;

/// Where the results of a file go when the user names no place.
const OUT: &str = "edgecap-out";

/// Options of `edgecap run`. Without a place for a file's bodies they go to edgecap-out/<name>.bodies.jsonl.
#[derive(Debug, clap::Args)]
pub struct RunArgs {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    engine: EngineArgs,
    #[command(flatten)]
    pace: PaceArgs,
    #[command(flatten)]
    record: RecordArgs,
    /// Write pictures with the fitted skeletons drawn to this folder (files only)
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
    /// End where the camera is missing or in use at the start, instead of waiting for it
    #[arg(long)]
    no_wait: bool,
    /// Publish a camera's bodies at this rate, extrapolating between its frames, Hz
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u16).range(1..=240))]
    rate: Option<u16>,
    /// Settings of identity, filters and fit (TOML)
    #[arg(long, value_name = "FILE")]
    fit_config: Option<PathBuf>,
    #[command(flatten)]
    table: TableArgs,
}

/// Runs the whole system on one input.
///
/// # Errors
/// The failure of any stage with its own exit code; output and shared-memory errors. What was computed before is complete.
pub fn run(mut args: RunArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let chosen = input::choose(&args.input)?;
    // What is wrong with it the user is told here, not by a child.
    args.pace.limits(&chosen, false)?;
    if chosen.is_live() {
        if args.overlay.is_some() {
            return Err(Failure::usage(
                "--overlay keeps pictures of people: expected a file; for a camera 'edgecap infer --overlay' does",
            )
            .into());
        }
        return live::run(&args, &chosen, &stop);
    }
    if args.record.is_empty() {
        let path = PathBuf::from(OUT).join(format!("{}.bodies.jsonl", chosen.name));
        args.record.jsonl = Some(path);
    }
    file::run(&args, &chosen, &stop)
}

impl RunArgs {
    fn infer_task(&self, chosen: &Chosen) -> InferTask {
        InferTask {
            input: self.input.resolved(chosen),
            engine: self.engine.clone(),
            waits: !self.no_wait,
            pace: self.pace.clone(),
        }
    }

    /// Says what there is now.
    fn conclude(&self, tally: &Tally, words: &[String]) {
        let line = format!(
            "{} frames, {} people {}",
            tally.frames,
            tally.ids.len(),
            words.join("; ")
        );
        let say = if self.record.takes_stdout() {
            say::err
        } else {
            say::out
        };
        say(line.trim_end());
    }
}

//! `edgecap run`: the whole system on one input. A file goes through one process at its own pace, and no frame of it is lost; a
//! camera has one process that sees pictures and one that fits, under supervision, and its newest frame wins. Several cameras have
//! a pair of their own each, and one supervisor; where they see the same people, one process that fits for all of them.

mod cameras;
mod file;
mod flow;
mod hints;
mod infers;
mod live;
mod mend;
mod pulse;
mod room;

use std::path::PathBuf;

use super::bridges::BridgeArgs;
use super::infer::{EngineArgs, InferTask, PaceArgs};
use super::input::{self, InputArgs, NamedInput};
use super::outputs::RecordArgs;
use super::say;
use super::settings::{self, ConfigArgs, FittingArgs, MetricsArgs, MultiviewArgs, Settings};
use super::stop::Stop;
use super::table::TableArgs;
use super::tally::Tally;

/// Where the results of a file go when the user names no place.
const OUT: &str = "edgecap-out";

/// Options of `edgecap run`. Without a place for a file's bodies they go to edgecap-out/<name>.bodies.jsonl.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct RunArgs {
    #[command(flatten)]
    pub settings: ConfigArgs,
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub pace: PaceArgs,
    #[command(flatten)]
    pub fitting: FittingArgs,
    #[command(flatten)]
    pub record: RecordArgs,
    /// Write pictures with the fitted skeletons drawn to this folder, or a film where it ends in .avi (files only)
    #[arg(long, value_name = "DIR|FILM.avi")]
    pub overlay: Option<PathBuf>,
    /// Write the bodies as a file of another program, too, as 'edgecap export' does: .bvh, .glb, .trc, .csv, .npz or .svg (files
    /// only); may be given several times
    #[arg(long, value_name = "FILE")]
    pub export: Vec<PathBuf>,
    /// End where the camera is missing or in use at the start, instead of waiting for it
    #[arg(long)]
    pub no_wait: bool,
    /// Publish what the camera sees, made small, and show it on the page (--view, 'edgecap view --show-picture'). Otherwise no
    /// picture leaves the process that sees it
    #[arg(long)]
    pub show_picture: bool,
    #[command(flatten)]
    pub metrics: MetricsArgs,
    #[command(flatten)]
    pub bridges: BridgeArgs,
    #[command(flatten)]
    pub multiview: MultiviewArgs,
    #[command(flatten)]
    pub table: TableArgs,
}

/// Runs the whole system: on the input that the user named, else on every camera of the settings, else on the first camera.
///
/// # Errors
/// Mistakes in settings. The failure of any stage with its own exit code; output and shared-memory errors. What was computed
/// before is complete.
pub fn run(args: RunArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let settings = Settings::load(&args.settings)?;
    let effective = settings::effective(&args, &settings)?;
    let mut runs = effective.runs()?;
    if let Some(calibration) = effective.calibration()? {
        return room::run(&runs, calibration, &stop);
    }
    match runs.pop() {
        Some(one) if runs.is_empty() => run_one(one, &stop),
        last => {
            runs.extend(last);
            cameras::run(&runs, &stop)
        }
    }
}

fn run_one(mut args: RunArgs, stop: &Stop) -> anyhow::Result<()> {
    let chosen = input::choose(&args.input)?;
    // What is wrong with it the user is told here, not by a child.
    args.pace.limits(&chosen, false)?;
    if chosen.is_live() {
        return cameras::run(&[args], stop);
    }
    if args.record.is_empty() {
        let path = PathBuf::from(OUT).join(format!("{}.bodies.jsonl", chosen.name));
        args.record.jsonl = Some(path);
    }
    file::run(&args, &chosen, stop)
}

impl RunArgs {
    /// Nothing but settings.
    pub fn of_settings(settings: ConfigArgs) -> Self {
        Self {
            settings,
            ..Self::default()
        }
    }

    fn infer_task(&self, chosen: &NamedInput) -> InferTask {
        InferTask {
            input: self.input.resolved(chosen),
            engine: self.engine.clone(),
            waits: !self.no_wait,
            show_picture: self.show_picture,
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

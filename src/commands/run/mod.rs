//! `edgecap run`: the whole system on one input. A file goes through one process at its own pace, and no frame of it is
//! lost; a camera has one process that sees pictures and one that fits, under supervision, and its newest frame wins.
//! Several cameras have a pair of their own each, and one supervisor; where they see the same people, one process that
//! fits for all of them.

mod again;
pub mod args;
mod cameras;
mod file;
mod flow;
mod hints;
mod infers;
mod live;
mod mend;
mod own;
mod pulse;
mod room;
mod taken;

use super::input;
use super::result;
use super::settings::{self, Effective, Settings};
use super::stop::Stop;
pub use args::RunArgs;
pub use cameras::{checked as expect_camera, expect_one_for_vmc};
pub use own::{Devices, expect_addresses};

/// Runs the whole system: on the input that the user named, else on every camera of the settings, else on the first
/// camera.
///
/// # Errors
/// Mistakes in settings. The failure of any stage with its own exit code; output and shared-memory errors. What was
/// computed before is complete.
pub fn run(args: RunArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let settings = Settings::load(&args.settings)?;
    let effective = settings::effective(&args, &settings)?;
    effective.apart()?;
    run_all(&effective, &stop).map_err(|e| effective.blamed(e))
}

fn run_all(effective: &Effective, stop: &Stop) -> anyhow::Result<()> {
    let mut runs = effective.runs()?;
    let calibration = effective.calibration()?;
    if let Some(calibration) = calibration {
        let fitting = effective.fitting_of_room()?;
        return room::run(&runs, fitting, calibration, stop);
    }
    match runs.pop() {
        Some(one) if runs.is_empty() => run_one(one, stop),
        last => {
            runs.extend(last);
            cameras::run(&runs, stop)
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
        args.record.jsonl = Some(result::place(&args.input, &chosen, "bodies"));
    }
    file::run(&args, &chosen, stop)
}

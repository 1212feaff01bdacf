//! `edgecap run`: the whole system on one input. A file goes through one process at its own pace, and no frame of it is
//! lost; a camera has one process that sees pictures and one that fits, under supervision, and its newest frame wins.
//! Several cameras have a pair of their own each, and one supervisor; where they see the same people, one process that
//! fits for all of them.

mod again;
mod args;
mod cameras;
mod file;
mod flow;
mod hints;
mod infers;
mod live;
mod mend;
mod pulse;
mod room;

use super::exit::Failure;
use super::input::{self, NamedInput};
use super::result;
use super::settings::{self, Effective, RunArgs, Settings};
use super::stop::Stop;

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
    run_all(&args, &effective, &stop).map_err(|e| effective.blamed(e))
}

fn run_all(typed: &RunArgs, effective: &Effective, stop: &Stop) -> anyhow::Result<()> {
    let mut runs = effective.runs()?;
    let calibration = effective.calibration()?;
    if let Some(calibration) = calibration {
        let fitting = effective.fitting_of_room()?;
        return room::run(&runs, fitting, calibration, stop);
    }
    match runs.pop() {
        Some(one) if runs.is_empty() => run_one(one, typed, stop),
        last => {
            runs.extend(last);
            cameras::run(&runs, stop)
        }
    }
}

fn run_one(mut args: RunArgs, typed: &RunArgs, stop: &Stop) -> anyhow::Result<()> {
    let chosen = input::choose(&args.input)?;
    // What is wrong with it the user is told here, not by a child.
    args.pace.limits(&chosen, false)?;
    expect_use(typed, &chosen)?;
    typed.input.expect_use(&chosen)?;
    if chosen.is_live() {
        return cameras::run(&[args], stop);
    }
    if args.record.is_empty() {
        args.record.jsonl = Some(result::place(&args.input, &chosen, "bodies"));
    }
    file::run(&args, &chosen, stop)
}

/// Refuses what was typed and means nothing for this input. Settings are of all inputs that a user has.
///
/// # Errors
/// Exit code 64; 69 where a camera is wanted and there is none.
fn expect_use(typed: &RunArgs, chosen: &NamedInput) -> Result<(), Failure> {
    if typed.no_wait && chosen.stands_in {
        return Err(Failure::unavailable(
            "--no-wait: expected a camera, found none on this machine; plug one in, or leave --no-wait out for the bundled clip",
        ));
    }
    let is_file = !chosen.is_live();
    if typed.metrics.address.is_some() && is_file {
        return Err(Failure::usage(
            "--metrics serves figures of cameras: expected a camera or --live, found a film, photos or a pipe, which have none; leave it out",
        ));
    }
    if typed.fitting.rate.is_some() && is_file {
        return Err(Failure::usage(
            "--rate publishes bodies between the frames of a camera: expected a camera or --live, found a film, photos or a pipe, whose own frames are published; leave it out",
        ));
    }
    Ok(())
}

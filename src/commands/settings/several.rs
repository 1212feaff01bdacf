//! What cameras of one run must be, and what only one of them can have: an address to listen at, a device.

use std::net::SocketAddr;
use std::path::PathBuf;

use super::RunArgs;
use crate::capture::InputSpec;
use crate::commands::exit::Failure;
use crate::commands::input::{self, NamedInput};

/// What a run that is one of a camera opens.
///
/// # Errors
/// Names that cannot be; exit code 64 for a file, and for what only a file can have.
pub fn expect_camera(args: &RunArgs) -> anyhow::Result<NamedInput> {
    let chosen = input::choose(&args.input)?;
    if !chosen.is_live() {
        return Err(Failure::usage(format!(
            "{}: one of several cameras: expected a camera, or a film with live = true; a file is run alone",
            chosen.spec
        ))
        .into());
    }
    if args.overlay.is_some() {
        return Err(Failure::usage(
            "--overlay keeps pictures of people: expected a file; for a camera 'edgecap infer --overlay' does",
        )
        .into());
    }
    if !args.export.is_empty() {
        return Err(Failure::usage(
            "--export writes a whole take: expected a file; of a camera 'edgecap record' makes a take, and 'edgecap export' exports it",
        )
        .into());
    }
    Ok(chosen)
}

/// Refuses VMC of several cameras that are no room: each numbers its people for itself.
///
/// # Errors
/// Exit code 64.
pub fn expect_one_for_vmc(runs: &[RunArgs]) -> Result<(), Failure> {
    match runs {
        [first, _, ..] if first.bridges.vmc.is_some() => Err(Failure::usage(
            "--vmc has a port for each person: expected one camera; 'edgecap bridge --vmc' takes one of several",
        )),
        _ => Ok(()),
    }
}

/// Refuses cameras one of which could only wait for what another one of them has. Where names of devices lead is not
/// looked at: that changes when a camera is plugged in, and the name of one that is away may lead to another's.
///
/// # Errors
/// Exit code 64.
pub fn expect_each_its_own(runs: &[RunArgs], chosen: &[NamedInput]) -> Result<(), Failure> {
    let mut devices = Devices::default();
    for (run, chosen) in runs.iter().zip(chosen) {
        expect_addresses(run)?;
        devices.take(run, chosen, |path| path)?;
    }
    Ok(())
}

/// Refuses one address for figures and the page: whichever begins to listen later could not.
///
/// # Errors
/// Exit code 64.
pub fn expect_addresses(run: &RunArgs) -> Result<(), Failure> {
    match (run.metrics.address, run.bridges.view) {
        (Some(figures), Some(page)) if collide(figures.0, page) => Err(Failure::usage(format!(
            "--view {page} and --metrics {figures}: expected an address for each, found that only one can listen; choose another port for one"
        ))),
        _ => Ok(()),
    }
}

/// Whether only one can listen at these addresses.
fn collide(one: SocketAddr, other: SocketAddr) -> bool {
    let is_any = |a: SocketAddr| a.ip().is_unspecified();
    let is_same_machine = one.is_ipv4() == other.is_ipv4() && (is_any(one) || is_any(other));
    // At port 0 each gets one of its own.
    one.port() != 0 && one.port() == other.port() && (one.ip() == other.ip() || is_same_machine)
}

/// The devices of the cameras of a run, and who has them.
#[derive(Debug, Default)]
pub struct Devices(Vec<(PathBuf, String)>);

impl Devices {
    /// Gives a camera its device, which `follow` finds by the name that it has in the run. A film is played for each.
    ///
    /// # Errors
    /// Exit code 64 where another camera has it.
    pub fn take(
        &mut self,
        run: &RunArgs,
        chosen: &NamedInput,
        follow: impl FnOnce(PathBuf) -> PathBuf,
    ) -> Result<(), Failure> {
        let path = match &chosen.spec {
            _ if run.input.live => return Ok(()),
            InputSpec::Path(path) | InputSpec::StandIn(path) => path.clone(),
            InputSpec::FirstCamera => "camera".into(),
            InputSpec::Stdin | InputSpec::Demo => return Ok(()),
        };
        let device = follow(path);
        if let Some((_, other)) = self.0.iter().find(|(taken, _)| *taken == device) {
            return Err(Failure::usage(format!(
                "{other} and {}: expected a device for each, found {} for both; 'ls /dev/v4l/by-id /dev/v4l/by-path' names each camera",
                chosen.name,
                device.display()
            )));
        }
        self.0.push((device, chosen.name.clone()));
        Ok(())
    }
}

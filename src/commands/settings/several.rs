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
    // At port 0 each gets one of its own.
    let is_same_port = one.port() != 0 && one.port() == other.port();
    is_same_port && (one.ip() == other.ip() || takes_all(one, other) || takes_all(other, one))
}

/// Whether who listens at `one` has the port of `other`, too: `0.0.0.0` is every address of IPv4, and `[::]` every one
/// of both, unless the system has it otherwise (`net.ipv6.bindv6only`).
fn takes_all(one: SocketAddr, other: SocketAddr) -> bool {
    one.ip().is_unspecified() && (one.is_ipv6() || other.is_ipv4())
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

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    /// The system is asked for the addresses of this machine itself; it need not have IPv6.
    #[test]
    fn addresses_collide_where_only_one_can_listen() {
        let address =
            |ip: &str, port: u16| -> SocketAddr { format!("{ip}:{port}").parse().unwrap() };
        for (one, other, expected) in [
            ("127.0.0.1", "127.0.0.1", true),
            ("0.0.0.0", "127.0.0.1", true),
            ("[::]", "127.0.0.1", true),
            ("[::]", "0.0.0.0", true),
            ("[::]", "[::1]", true),
            ("127.0.0.1", "127.0.0.2", false),
            ("0.0.0.0", "[::1]", false),
            ("127.0.0.1", "[::1]", false),
        ] {
            for (one, other) in [(one, other), (other, one)] {
                let are_one = |a, b| collide(address(one, a), address(other, b));
                assert_eq!(are_one(9733, 9733), expected, "{one} {other}");
                assert!(!are_one(9733, 9734) && !are_one(0, 0), "{one} {other}");
            }
            let is_v6_alone = std::fs::read_to_string("/proc/sys/net/ipv6/bindv6only");
            if is_v6_alone.is_ok_and(|only| only.trim() == "0")
                && let Ok(listens) = TcpListener::bind(address(one, 0))
            {
                let port = listens.local_addr().unwrap().port();
                let second = TcpListener::bind(address(other, port));
                assert!(!(expected && second.is_ok()), "{one} {other}");
            }
        }
    }
}

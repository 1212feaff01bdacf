//! Cameras whose settings are right each and with which a run cannot start, alone or together.

use std::net::SocketAddr;
use std::path::PathBuf;

use edgecap_client::message::BodyFrame;
use edgecap_client::{LinkError, Subscriber};

use super::effective::Effective;
use super::multiview_args::MultiviewArgs;
use crate::capture::InputSpec;
use crate::commands::apart::Apart;
use crate::commands::exit::Failure;
use crate::commands::input;
use crate::commands::outputs::RecordArgs;
use crate::commands::run::{RunArgs, expect_camera, expect_one_for_vmc};

/// Looks at what the runs would find wrong when they start. A camera may be plugged in later.
///
/// # Errors
/// The first mistake; exit code 78 where it is one of the file.
pub fn check(effective: &Effective, runs: &[RunArgs]) -> anyhow::Result<()> {
    let first = &effective.cameras[0];
    let MultiviewArgs { calibration, room } = &effective.multiview.0;
    if let Some(path) = calibration.as_ref().filter(|path| !path.exists()) {
        let what = format!(
            "expected a file or folder, found no {}; 'edgecap calibrate' makes one",
            path.display()
        );
        return Err(effective.blame(first, &["calibration"], Failure::config(what)));
    }
    if let Some(room) = room {
        expect_name(room, "--room").map_err(|e| effective.blame(first, &["room"], e))?;
    }
    let mut devices: Vec<(PathBuf, String)> = Vec::new();
    for (camera, run) in effective.cameras.iter().zip(runs) {
        let blame = |keys: &[&str], e: anyhow::Error| effective.blame(camera, keys, e);
        let chosen = input::choose(&run.input).map_err(|e| blame(&["input", "live"], e))?;
        expect_name(&chosen.name, "--name").map_err(|e| blame(&["name"], e.into()))?;
        if let InputSpec::Path(path) = &chosen.spec
            && !path.starts_with("/dev")
            && !path.exists()
        {
            let what = format!(
                "expected a camera or a film, found no {}; check the path",
                path.display()
            );
            return Err(blame(&["input"], Failure::config(what).into()));
        }
        let limits = run.pace.limits(&chosen, false);
        limits.map_err(|e| blame(&["max_fps"], e))?;
        if chosen.is_live() {
            expect_addresses(run).map_err(|e| blame(&["view"], e.into()))?;
        }
        if runs.len() == 1 {
            continue;
        }
        expect_camera(run).map_err(|e| blame(&["input"], e))?;
        let path = match &chosen.spec {
            // A film is played for each.
            _ if run.input.live => continue,
            InputSpec::Path(path) | InputSpec::StandIn(path) => path.clone(),
            InputSpec::FirstCamera => "camera".into(),
            InputSpec::Stdin | InputSpec::Demo => continue,
        };
        let device = path.canonicalize().unwrap_or(path);
        if let Some((_, other)) = devices.iter().find(|(d, _)| *d == device) {
            let what = format!(
                "{other} and {}: expected a device for each, found {} for both; 'ls /dev/v4l/by-id /dev/v4l/by-path' names each camera",
                chosen.name,
                device.display()
            );
            return Err(blame(&["input"], Failure::config(what).into()));
        }
        devices.push((device, chosen.name));
    }
    // Of a room there is one stream of bodies.
    if calibration.is_none() {
        expect_one_for_vmc(runs).map_err(|e| effective.blame(first, &["vmc"], e))?;
    }
    Ok(())
}

/// Looks whether the records that are wanted could be made.
///
/// # Errors
/// The first that could not, whoever runs it.
pub fn expect_places(effective: &Effective) -> anyhow::Result<()> {
    for camera in &effective.cameras {
        let name = camera.args.input.name.as_deref().unwrap_or_default();
        let RecordArgs { jsonl, record } = camera.args.record.clone();
        let none = RecordArgs::default;
        let jsonl = RecordArgs { jsonl, ..none() };
        let record = RecordArgs { record, ..none() };
        for (key, one) in [("jsonl", jsonl), ("record", record)] {
            let place = one.expect_place(name);
            place.map_err(|e| effective.blame(camera, &[key], e))?;
        }
    }
    Ok(())
}

/// Refuses one address for figures and the page: whichever begins to listen later could not.
fn expect_addresses(run: &RunArgs) -> Result<(), Failure> {
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

/// Whether a stream can have this name, which the flag gives.
fn expect_name(name: &str, flag: &str) -> Result<(), Failure> {
    // Opening a stream to read makes nothing.
    let opened = Subscriber::<BodyFrame>::open(name).map(drop);
    opened.map_err(|e| match e {
        LinkError::Name(_) => Failure::usage(e.to_string().replace("--name", flag)),
        e => Failure::config(e.to_string()),
    })
}

/// Holds apart what the runs read and write. Of cameras that see the same people, the first record is all that there
/// is.
///
/// # Errors
/// As [`Apart::check`]; exit code 78 where it is a mistake of the file.
pub fn apart(effective: &Effective, same_people: bool) -> anyhow::Result<()> {
    let mut all = Apart::default();
    let mut recorded = false;
    for camera in &effective.cameras {
        let blame = |e| effective.blame(camera, &[], e);
        // The runs as they start no longer know from which files their settings came.
        let mut run = RunArgs {
            multiview: effective.multiview.0.clone(),
            ..camera.args.clone()
        };
        if same_people && recorded {
            run.record = RecordArgs::default();
        }
        recorded |= !run.record.is_empty();
        run.apart().check().map_err(blame)?;
        let name = run.input.name.clone().unwrap_or_default();
        all = all.and(run.apart(), &name);
        all.check().map_err(blame)?;
    }
    Ok(())
}

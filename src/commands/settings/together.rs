//! Cameras whose settings are right each and with which a run cannot start, alone or together.

use std::path::{Path, PathBuf};

use edgecap_client::Subscriber;
use edgecap_client::message::BodyFrame;

use crate::capture::InputSpec;
use crate::commands::apart::Apart;
use crate::commands::exit::Failure;
use crate::commands::input;
use crate::commands::run::{RunArgs, expect_camera, expect_one_for_vmc};

/// Looks at what the runs would find wrong when they start. A camera may be plugged in later.
///
/// # Errors
/// The first mistake; exit code 78.
pub fn check(
    runs: &[RunArgs],
    calibration: Option<&Path>,
    room: Option<&str>,
) -> anyhow::Result<()> {
    if let Some(path) = calibration.filter(|path| !path.exists()) {
        return Err(Failure::config(format!(
            "[multiview] calibration: expected a file or folder, found no {}; 'edgecap calibrate' makes one",
            path.display()
        ))
        .into());
    }
    room.into_iter().try_for_each(expect_name)?;
    let mut devices: Vec<(PathBuf, String)> = Vec::new();
    for run in runs {
        let chosen = input::choose(&run.input)?;
        expect_name(&chosen.name)?;
        run.record.expect_place(&chosen.name)?;
        let path = match &chosen.spec {
            InputSpec::Path(path) | InputSpec::StandIn(path) => path.clone(),
            InputSpec::FirstCamera => "camera".into(),
            InputSpec::Stdin | InputSpec::Demo => continue,
        };
        let may_come = !matches!(chosen.spec, InputSpec::Path(_)) || path.starts_with("/dev");
        if !may_come && !path.exists() {
            return Err(Failure::config(format!(
                "[[camera]] {}: input: expected a camera or a film, found no {}; check the path",
                chosen.name,
                path.display()
            ))
            .into());
        }
        if runs.len() == 1 {
            continue;
        }
        expect_camera(run)?;
        // A film is played for each.
        if run.input.live {
            continue;
        }
        let device = path.canonicalize().unwrap_or(path);
        if let Some((_, other)) = devices.iter().find(|(d, _)| *d == device) {
            return Err(Failure::config(format!(
                "[[camera]] {other} and {}: expected a device for each, found {} for both; 'ls /dev/v4l/by-id /dev/v4l/by-path' names each camera",
                chosen.name,
                device.display()
            ))
            .into());
        }
        devices.push((device, chosen.name));
    }
    // Of a room there is one stream of bodies.
    if calibration.is_none() {
        expect_one_for_vmc(runs)?;
    }
    Ok(())
}

fn expect_name(name: &str) -> anyhow::Result<()> {
    // Opening a stream to read makes nothing.
    let opened = Subscriber::<BodyFrame>::open(name).map(drop);
    opened.map_err(|e| Failure::config(e.to_string()).into())
}

/// Holds apart what the runs read and write. Of cameras that see the same people, the first record is all that there
/// is.
///
/// # Errors
/// As [`Apart::check`].
pub fn apart(runs: &[RunArgs], same_people: bool) -> anyhow::Result<()> {
    let mut all = Apart::default();
    let mut recorded = false;
    for run in runs {
        let mut run = run.clone();
        if same_people && recorded {
            run.record = Default::default();
        }
        recorded |= !run.record.is_empty();
        run.apart().check()?;
        let name = run.input.name.clone().unwrap_or_default();
        all = all.and(run.apart(), &name);
    }
    all.check()
}

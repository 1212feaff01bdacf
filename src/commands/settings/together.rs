//! Cameras whose settings are right each and with which a run cannot start, alone or together.

use std::path::PathBuf;

use edgecap_client::message::BodyFrame;
use edgecap_client::{LinkError, Subscriber};

use super::blame::Fault;
use super::effective::{Camera, Effective};
use super::several::{Devices, expect_addresses, expect_camera, expect_one_for_vmc};
use super::{MultiviewArgs, RunArgs};
use crate::capture::{self, InputSpec};
use crate::commands::apart::Apart;
use crate::commands::exit::Failure;
use crate::commands::infer::EngineArgs;
use crate::commands::input;
use crate::commands::outputs::RecordArgs;
use crate::commands::views::choose;

impl Effective {
    /// Looks at the files that the settings name, too.
    ///
    /// # Errors
    /// The first that is wrong or cannot be read.
    pub fn check(&self) -> anyhow::Result<()> {
        self.apart()?;
        self.expect_none(self.unreadable())?;
        self.expect_none(self.doubled_inputs(&self.runs()?))?;
        if let Some(calibration) = self.calibration()? {
            let chosen = choose(&self.names(), calibration);
            chosen.map_err(|e| self.blame(&self.cameras[0], &["calibration"], e))?;
        }
        Ok(())
    }

    /// Holds apart what the runs read and write.
    ///
    /// # Errors
    /// The first two files that are the same; exit code 78 where the settings name them, 64 where one was typed.
    pub fn apart(&self) -> anyhow::Result<()> {
        apart(self, self.calibration()?.is_some())
    }

    /// Whether a run would start with these settings, cameras aside that may be plugged in later.
    ///
    /// # Errors
    /// The first mistake.
    pub fn expect_start(&self) -> anyhow::Result<()> {
        self.expect_none(faults(self, &self.runs()?))?;
        expect_places(self)?;
        // One for all cameras, and slow to read.
        let camera = &self.cameras[0];
        let engine = &camera.args.engine;
        engine.expect_model().map_err(|e| {
            let model = EngineArgs {
                stage2: None,
                ..engine.clone()
            };
            let key = match model.expect_model() {
                Ok(()) => "stage2",
                Err(_) => "model",
            };
            self.blame(camera, &[key], e)
        })
    }

    fn names(&self) -> Vec<String> {
        let names = self.cameras.iter().map(|c| c.args.input.name.clone());
        names.flatten().collect()
    }
}

/// What the runs would find wrong when they start. A camera may be plugged in later.
pub fn faults<'a>(effective: &'a Effective, runs: &[RunArgs]) -> Vec<Fault<'a>> {
    let first = &effective.cameras[0];
    let mut found = Vec::new();
    let MultiviewArgs { calibration, room } = &effective.multiview.0;
    if let Some(path) = calibration.as_ref().filter(|path| !path.exists()) {
        let error = Failure::config(format!(
            "expected a file or folder, found no {}; 'edgecap calibrate' makes one",
            path.display()
        ));
        found.push(Fault::new(first, &["calibration"], error));
    }
    if let Some(room) = room {
        found.extend(fault_of_name(first, &["room"], room, "--room"));
    }
    // As they are named, and where that leads now.
    let (mut named, mut real) = (Devices::default(), Devices::default());
    for (camera, run) in effective.cameras.iter().zip(runs) {
        let chosen = match input::choose(&run.input) {
            Ok(chosen) => chosen,
            Err(e) => {
                found.push(Fault::new(camera, &["input", "live"], e));
                continue;
            }
        };
        found.extend(fault_of_name(camera, &["name"], &chosen.name, "--name"));
        if let InputSpec::Path(path) = &chosen.spec
            && !capture::is_camera_place(path)
            && !path.exists()
        {
            let error = Failure::config(format!(
                "expected a camera or a film, found no {}; check the path",
                path.display()
            ));
            found.push(Fault::new(camera, &["input"], error));
        }
        let limits = run.pace.limits(&chosen, false).err();
        found.extend(limits.map(|e| Fault::new(camera, &["max_fps"], e)));
        if chosen.is_live() {
            let addresses = expect_addresses(run).err();
            found.extend(addresses.map(|e| Fault::new(camera, &["view"], e)));
        }
        if runs.len() == 1 {
            continue;
        }
        let several = expect_camera(run).err();
        found.extend(several.map(|e| Fault::new(camera, &["input"], e)));
        let follow = |path: PathBuf| path.canonicalize().unwrap_or(path);
        let own = named.take(run, &chosen, |path| path);
        let own = own.and_then(|()| real.take(run, &chosen, follow)).err();
        found.extend(own.map(|e| Fault::new(camera, &["input"], e)));
    }
    // Of a room there is one stream of bodies.
    if calibration.is_none() {
        let vmc = expect_one_for_vmc(runs).err();
        found.extend(vmc.map(|e| Fault::new(first, &["vmc"], e)));
    }
    found
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

/// Why no stream can have this name, which the flag gives. Where streams cannot be at all no other name would do.
fn fault_of_name<'a>(
    camera: &'a Camera,
    keys: &'static [&'static str],
    name: &str,
    flag: &str,
) -> Option<Fault<'a>> {
    // Opening a stream to read makes nothing.
    match Subscriber::<BodyFrame>::open(name).err()? {
        e @ LinkError::Name(_) => {
            let error = Failure::usage(e.to_string().replace("--name", flag));
            Some(Fault::new(camera, keys, error).about(name))
        }
        e => Some(Fault::new(camera, &[], e)),
    }
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

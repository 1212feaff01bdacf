//! What holds: flags over the file over the defaults, for each camera of a run.

use std::collections::BTreeMap;
use std::path::Path;

use super::{
    CameraSettings, ConfigArgs, FittingArgs, MetricsArgs, MultiviewArgs, Placed, Settings, together,
};
use crate::capture::InputSpec;
use crate::commands::bridges::BridgeArgs;
use crate::commands::events;
use crate::commands::exit::Failure;
use crate::commands::fit::choose_cameras;
use crate::commands::fit::settings::read_config;
use crate::commands::infer::EngineArgs;
use crate::commands::run::args::RunArgs;
use crate::config::{Origin, Setting, merge};
use crate::events::EventConfig;
use crate::fit::FitConfig;

/// Where the values of a section came from, by key.
pub type Origins = BTreeMap<String, Origin>;

/// What holds for one run.
#[derive(Debug, Clone)]
pub struct Effective {
    /// One for each camera; a file is one, too.
    pub cameras: Vec<Camera>,
    /// Where the network's options came from.
    pub network: Origins,
    /// The fit of cameras that have none of their own.
    pub fit: Placed<FitConfig>,
    /// Figures for whoever watches.
    pub metrics: (MetricsArgs, Origins),
    /// Where bodies go besides shared memory.
    pub bridges: (BridgeArgs, Origins),
    /// Whether all cameras see the same people.
    pub multiview: (MultiviewArgs, Origins),
}

impl Effective {
    /// Looks at the files that the settings name, too.
    ///
    /// # Errors
    /// The first that is wrong or cannot be read.
    pub fn check(&self) -> anyhow::Result<()> {
        self.apart()?;
        self.expect_readable()?;
        for run in self.runs()? {
            let inputs = run.engine.inputs(true);
            inputs.map_err(|e| Failure::config(format!("[network]: {e}")))?;
        }
        if let Some(calibration) = self.calibration()? {
            choose_cameras(&self.names(), calibration)?;
        }
        Ok(())
    }

    /// Holds apart what the runs read and write.
    ///
    /// # Errors
    /// Exit code 64 with the first two files that are the same.
    pub fn apart(&self) -> anyhow::Result<()> {
        // The runs as they start no longer know from which files their settings came.
        let named = self.cameras.iter().map(|camera| RunArgs {
            multiview: self.multiview.0.clone(),
            ..camera.args.clone()
        });
        let named: Vec<RunArgs> = named.collect();
        together::apart(&named, self.calibration()?.is_some())
    }

    /// Whether a run would start with these settings, cameras aside that may be plugged in later.
    ///
    /// # Errors
    /// The first mistake.
    pub fn expect_start(&self) -> anyhow::Result<()> {
        let MultiviewArgs { calibration, room } = &self.multiview.0;
        let runs = self.runs()?;
        together::check(&runs, calibration.as_deref(), room.as_deref())?;
        // One for all cameras, and slow to read.
        runs.first().map_or(Ok(()), |run| run.engine.expect_model())
    }

    /// The calibration of all cameras of this run, where they see the same people. One that the file names says nothing
    /// of a camera that runs alone.
    ///
    /// # Errors
    /// One that was typed for a single camera.
    pub fn calibration(&self) -> anyhow::Result<Option<&Path>> {
        let (args, origins) = &self.multiview;
        let given = args.calibration.as_deref();
        if self.cameras.len() > 1 {
            return Ok(given);
        }
        match given {
            Some(_) if origins.get("calibration") == Some(&Origin::Flag) => Err(Failure::usage(
                "--calibration: expected several [[camera]] in edgecap.toml that see the same people, found one camera",
            )
            .into()),
            _ => Ok(None),
        }
    }

    fn names(&self) -> Vec<String> {
        let names = self.cameras.iter().map(|c| c.args.input.name.clone());
        names.flatten().collect()
    }

    /// The runs, with the fit of each.
    ///
    /// # Errors
    /// Files of the fit that are wrong.
    pub fn runs(&self) -> anyhow::Result<Vec<RunArgs>> {
        self.cameras
            .iter()
            .map(|camera| {
                let typed = camera.origins.get("fit") == Some(&Origin::Flag);
                let fitting = resolved(camera.args.fitting.clone(), &self.fit.value, typed)?;
                Ok(RunArgs {
                    fitting,
                    metrics: self.metrics.0.clone(),
                    bridges: self.bridges.0.clone(),
                    multiview: self.multiview.0.clone(),
                    engine: EngineArgs {
                        cameras: Some(self.cameras.len()),
                        ..camera.args.engine.clone()
                    },
                    ..camera.args.clone()
                })
            })
            .collect()
    }

    /// The fit of cameras that see the same people: of each key what the first camera says that says anything.
    ///
    /// # Errors
    /// As [`runs`](Self::runs).
    pub fn fitting_of_room(&self) -> anyhow::Result<FittingArgs> {
        let each = || self.cameras.iter().map(|c| &c.args.fitting);
        let fitting = FittingArgs {
            rate: each().find_map(|f| f.rate),
            fit: each().find_map(|f| f.fit.clone()),
            events: each().find_map(|f| f.events.clone()),
            height: each().find_map(|f| f.height),
            // In the axes of its camera; the room's floor is the calibration's.
            floor: None,
        };
        let is_typed = |c: &Camera| c.origins.get("fit") == Some(&Origin::Flag);
        resolved(fitting, &self.fit.value, self.cameras.iter().any(is_typed))
    }
}

/// What holds for one camera.
#[derive(Debug, Clone)]
pub struct Camera {
    /// As if all of it had been typed.
    pub args: RunArgs,
    /// Where the keys of `[[camera]]` came from.
    pub origins: Origins,
}

/// What `typed` and the file mean together.
///
/// # Errors
/// Names that no camera of the file has.
pub fn effective(typed: &RunArgs, settings: &Settings) -> anyhow::Result<Effective> {
    let (mut engine, mut network) = merge(
        &typed.engine,
        &settings.network.value,
        &settings.network.places,
    )?;
    only_typed(&mut engine, &mut network);
    let metrics = merge(
        &typed.metrics,
        &settings.metrics.value,
        &settings.metrics.places,
    )?;
    let bridges = merge(
        &typed.bridges,
        &settings.bridges.value,
        &settings.bridges.places,
    )?;
    let multiview = merge(
        &typed.multiview,
        &settings.multiview.value,
        &settings.multiview.places,
    )?;
    let cameras = chosen(typed, settings)?
        .into_iter()
        .map(|camera| {
            let (input, mut origins) = merge(&typed.input, &camera.input, &camera.places)?;
            let (pace, more) = merge(&typed.pace, &camera.pace, &camera.places)?;
            origins.extend(more);
            let (record, more) = merge(&typed.record, &camera.record, &camera.places)?;
            origins.extend(more);
            let (fitting, more) = merge(&typed.fitting, &camera.fitting, &camera.places)?;
            origins.extend(more);
            let args = RunArgs {
                input,
                pace,
                record,
                fitting,
                engine: engine.clone(),
                settings: ConfigArgs {
                    config: settings.file.clone(),
                },
                ..typed.clone()
            };
            Ok(Camera { args, origins })
        })
        .collect::<anyhow::Result<_>>()?;
    Ok(Effective {
        cameras,
        network,
        fit: settings.fit.clone(),
        metrics,
        bridges,
        multiview,
    })
}

/// A size and a quality exclude each other: the one that was typed has the other of the file say nothing.
fn only_typed(engine: &mut EngineArgs, origins: &mut Origins) {
    let typed = |key: &str| origins.get(key) == Some(&Origin::Flag);
    let silent = match (typed("size"), typed("quality")) {
        (true, false) => {
            engine.quality = None;
            "quality"
        }
        (false, true) => {
            engine.size = None;
            "size"
        }
        _ => return,
    };
    origins.insert(silent.to_owned(), Origin::Default);
}

/// The cameras of the file that a run is about. One that was typed and is not in the file has nothing from there: its
/// lens and its floor would be another's.
fn chosen(typed: &RunArgs, settings: &Settings) -> anyhow::Result<Vec<CameraSettings>> {
    let cameras = &settings.cameras;
    let (input, name) = (&typed.input.input, &typed.input.name);
    if let Some(input) = input {
        let same = cameras.iter().find(|c| {
            c.input.input.as_ref().is_some_and(|i| is_same(i, input))
                && name
                    .as_ref()
                    .is_none_or(|n| c.input.name.as_ref() == Some(n))
        });
        return Ok(vec![same.cloned().unwrap_or_default()]);
    }
    if let Some(name) = name {
        let named = cameras.iter().find(|c| c.input.name.as_ref() == Some(name));
        return match (named, &cameras[..]) {
            (Some(named), _) => Ok(vec![named.clone()]),
            (None, [] | [_]) => Ok(vec![cameras.first().cloned().unwrap_or_default()]),
            (None, all) => {
                let names: Vec<&str> = all.iter().filter_map(|c| c.input.name.as_deref()).collect();
                Err(Failure::usage(format!(
                    "--name {name}: expected a camera of the settings: one of {}",
                    names.join(", ")
                ))
                .into())
            }
        };
    }
    match &cameras[..] {
        [] => Ok(vec![CameraSettings::default()]),
        all => Ok(all.to_vec()),
    }
}

/// Whether both name the same input: a file or device is the same by every path and link.
fn is_same(one: &str, other: &str) -> bool {
    let (Ok(one), Ok(other)) = (one.parse::<InputSpec>(), other.parse::<InputSpec>());
    let real = |path: &Path| {
        path.canonicalize()
            .or_else(|_| std::path::absolute(path))
            .ok()
    };
    match (&one, &other) {
        (InputSpec::Path(a), InputSpec::Path(b)) => {
            a == b || real(a).is_some_and(|a| real(b) == Some(a))
        }
        _ => one == other,
    }
}

/// A camera's own fit, else that of the file, with what is known of the place unless a file of the fit was `typed`.
fn resolved(fitting: FittingArgs, of_all: &FitConfig, typed: bool) -> anyhow::Result<FittingArgs> {
    let mut config = match fitting.fit {
        Some(Setting::Given(config)) => config,
        Some(Setting::File(path)) => read_config(&path)?,
        None => of_all.clone(),
    };
    if !typed {
        config.height = fitting.height.or(config.height);
        config.ground = fitting.floor.or(config.ground);
    }
    let fit = (config != FitConfig::default()).then_some(Setting::Given(config));
    let events = events::config(fitting.events.as_ref())?;
    let events = (events != EventConfig::default()).then_some(Setting::Given(events));
    Ok(FittingArgs {
        fit,
        events,
        ..fitting
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fit of a room with this file.
    fn room(text: &str) -> (Option<u16>, FitConfig) {
        let settings = Settings::parse("edgecap.toml", text).unwrap();
        let effective = effective(&RunArgs::default(), &settings).unwrap();
        let fitting = effective.fitting_of_room().unwrap();
        let config = match fitting.fit {
            Some(Setting::Given(config)) => config,
            other => panic!("expected what was read, found {other:?}"),
        };
        (fitting.rate, config)
    }

    #[test]
    fn a_room_is_fitted_as_the_first_camera_says_that_says_anything() {
        let text = "[fit]\nprediction.max = 0.05\n\
            [[camera]]\nname = \"a\"\n\
            [[camera]]\nname = \"b\"\nrate = 60\nheight = 1.8\n\
            [[camera]]\nname = \"c\"\nrate = 90\nheight = 1.6\n";
        let (rate, config) = room(text);
        assert_eq!((rate, config.height), (Some(60), Some(1.8)));
        assert_eq!(config.prediction.max, 0.05);
        let (_, config) = room(&format!(
            "{text}fit = {{ prediction = {{ max = 0.07 }} }}\n"
        ));
        assert_eq!((config.prediction.max, config.height), (0.07, Some(1.8)));
    }

    #[test]
    fn an_input_is_the_same_by_every_path() {
        let folder = tempfile::tempdir().unwrap();
        let [film, link, other] =
            ["film.avi", "link.avi", "other.avi"].map(|n| folder.path().join(n));
        std::fs::write(&film, "").unwrap();
        std::fs::write(&other, "").unwrap();
        std::os::unix::fs::symlink(&film, &link).unwrap();
        let text = |path: &Path| path.display().to_string();
        assert!(is_same(&text(&film), &text(&link)));
        assert!(is_same(
            &text(&folder.path().join("./film.avi")),
            &text(&film)
        ));
        assert!(!is_same(&text(&film), &text(&other)));
        // One that is not there yet has its name alone.
        let here = text(&std::env::current_dir().unwrap().join("away.avi"));
        assert!(is_same("away.avi", &here) && !is_same("away.avi", "gone.avi"));
        assert!(is_same("camera", "camera") && !is_same("camera", "demo"));
    }
}

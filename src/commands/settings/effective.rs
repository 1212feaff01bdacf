//! What holds: flags over the file over the defaults, for each camera of a run.

use std::collections::BTreeMap;
use std::path::Path;

use super::{
    CameraSettings, ConfigArgs, FittingArgs, MetricsArgs, MultiviewArgs, Placed, RunArgs, Settings,
};
use crate::capture::{InputSpec, holds_stills};
use crate::commands::bridges::BridgeArgs;
use crate::commands::event_settings;
use crate::commands::exit::Failure;
use crate::commands::fit_settings::read_config;
use crate::commands::infer::EngineArgs;
use crate::commands::input::{self, InputArgs};
use crate::config::{Origin, Place, Setting, merge};
use crate::events::EventConfig;
use crate::fit::FitConfig;
use crate::schedule::inputs::Quality;

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

    /// The runs, with the fit of each.
    ///
    /// # Errors
    /// Files of the fit that are wrong.
    pub fn runs(&self) -> anyhow::Result<Vec<RunArgs>> {
        self.cameras
            .iter()
            .map(|camera| {
                let typed = camera.origins.get("fit") == Some(&Origin::Flag);
                let (fit, events) = self.read(camera)?;
                let fit = fit.unwrap_or_else(|| self.fit.value.clone());
                let events = events.unwrap_or_default();
                Ok(RunArgs {
                    fitting: resolved(&camera.args.fitting, fit, events, typed),
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
        let (mut fit, mut events) = (None, None);
        for camera in &self.cameras {
            let (own_fit, own_events) = self.read(camera)?;
            fit = fit.or(own_fit);
            events = events.or(own_events);
        }
        let each = || self.cameras.iter().map(|c| &c.args.fitting);
        let known = FittingArgs {
            rate: each().find_map(|f| f.rate),
            height: each().find_map(|f| f.height),
            // Of its floor none: that is in the axes of its camera, the room's is the calibration's.
            ..FittingArgs::default()
        };
        let is_typed = |c: &Camera| c.origins.get("fit") == Some(&Origin::Flag);
        let fit = fit.unwrap_or_else(|| self.fit.value.clone());
        let typed = self.cameras.iter().any(is_typed);
        Ok(resolved(&known, fit, events.unwrap_or_default(), typed))
    }

    /// A camera's own fit and events, where it has some.
    ///
    /// # Errors
    /// Files of them that cannot be read, and mistakes in those.
    fn read(&self, camera: &Camera) -> anyhow::Result<(Option<FitConfig>, Option<EventConfig>)> {
        let FittingArgs { fit, events, .. } = &camera.args.fitting;
        let fit = fit.as_ref().map(|fit| match fit {
            Setting::Given(config) => Ok(config.clone()),
            Setting::File(path) => read_config(path),
        });
        let fit = fit.transpose();
        let fit = fit.map_err(|e| self.blame(camera, &["fit"], e))?;
        let events = events.as_ref().map(|e| event_settings::config(Some(e)));
        let events = events.transpose();
        let events = events.map_err(|e| self.blame(camera, &["events"], e))?;
        Ok((fit, events))
    }
}

/// What holds for one camera.
#[derive(Debug, Clone)]
pub struct Camera {
    /// As if all of it had been typed.
    pub args: RunArgs,
    /// Where the keys of `[[camera]]` came from.
    pub origins: Origins,
    /// Where it begins in the file; `None` of one that is not there.
    pub head: Option<Place>,
}

/// What `typed` and the file mean together.
///
/// # Errors
/// Names that no camera of the file has, a typed token without a page, and pipes in place of files that are named.
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
    let mut bridges = merge(
        &typed.bridges,
        &settings.bridges.value,
        &settings.bridges.places,
    )?;
    let multiview = merge(
        &typed.multiview,
        &settings.multiview.value,
        &settings.multiview.places,
    )?;
    let mut cameras: Vec<Camera> = chosen(typed, settings)?
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
            Ok(Camera {
                args,
                origins,
                head: camera.head,
            })
        })
        .collect::<anyhow::Result<_>>()?;
    if cameras.iter().all(|c| are_stills(&c.args.input)) {
        only_of_stills(&mut cameras, &mut network);
    }
    if cameras.iter().all(|c| c.head.is_none()) && is_file(&typed.input) {
        only_where_typed(&typed.bridges, &mut bridges);
    }
    if bridges.1.get("token") == Some(&Origin::Flag) {
        bridges.0.expect_page()?;
    }
    let effective = Effective {
        cameras,
        network,
        fit: settings.fit.clone(),
        metrics,
        bridges,
        multiview,
    };
    effective.expect_no_pipes()?;
    Ok(effective)
}

/// A size and a quality exclude each other, and so do the best quality and fewer looks: what was typed has the other of
/// the file say nothing.
fn only_typed(engine: &mut EngineArgs, origins: &mut Origins) {
    let [size, quality, looks] =
        ["size", "quality", "looks"].map(|key| origins.get(key) == Some(&Origin::Flag));
    let mut silence = |key: &str| origins.insert(key.to_owned(), Origin::Default);
    let is_best = engine.quality == Some(Quality::Best);
    if quality && !size {
        engine.size = None;
        silence("size");
    }
    if quality && is_best && !looks {
        engine.looks = None;
        silence("looks");
    }
    if !quality && (size || looks && is_best) {
        engine.quality = None;
        silence("quality");
    }
}

/// Nothing follows people from one photo to the next: what the file says of that is of films and cameras. What was
/// typed stays, and is refused.
fn only_of_stills(cameras: &mut [Camera], origins: &mut Origins) {
    let auto = "auto".parse().ok();
    for key in ["looks", "size"] {
        if origins.get(key) == Some(&Origin::Flag) {
            continue;
        }
        for engine in cameras.iter_mut().map(|c| &mut c.args.engine) {
            match key {
                "looks" => engine.looks = None,
                _ if engine.size == auto => engine.size = None,
                _ => continue,
            }
            origins.insert(key.to_owned(), Origin::Default);
        }
    }
}

/// The people of a file that no `[[camera]]` has are nobody in front of the cameras for which the settings say where
/// bodies go, and those may run and have the addresses: what was typed holds alone, with the token of its page.
fn only_where_typed(typed: &BridgeArgs, (bridges, origins): &mut (BridgeArgs, Origins)) {
    *bridges = BridgeArgs {
        token: bridges.token.take(),
        ..typed.clone()
    };
    for (key, origin) in origins {
        if *origin != Origin::Flag && key != "token" {
            *origin = Origin::Default;
        }
    }
}

/// Whether what was typed is a film, photos or a pipe, and not played like a camera.
fn is_file(typed: &InputArgs) -> bool {
    typed.input.is_some() && input::choose(typed).is_ok_and(|chosen| !chosen.is_live())
}

/// Whether an input is photos that have nothing to do with each other in time.
fn are_stills(input: &InputArgs) -> bool {
    let spec = input.input.as_ref().and_then(|input| input.parse().ok());
    let at = |path: &Path| !input.live && holds_stills(path, input.fps);
    matches!(spec, Some(InputSpec::Path(path)) if at(&path))
}

/// The cameras of the file that a run is about. One that was typed and is not in the file has nothing from there: its
/// lens and its floor would be another's.
fn chosen(typed: &RunArgs, settings: &Settings) -> anyhow::Result<Vec<CameraSettings>> {
    let cameras = &settings.cameras;
    let (input, name) = (&typed.input.input, &typed.input.name);
    if let Some(input) = input {
        let has_input =
            |c: &&CameraSettings| c.input.input.as_ref().is_some_and(|i| is_same(i, input));
        let same: Vec<&CameraSettings> = cameras.iter().filter(has_input).collect();
        let named = same
            .iter()
            .find(|c| name.is_none() || c.input.name == *name);
        let one = match (named, &same[..]) {
            (Some(named), _) => Some(*named),
            // Its bodies may have another name.
            (None, [only]) => Some(*only),
            // Of several which have this input nobody has told which is meant.
            (None, _) => None,
        };
        return Ok(vec![one.cloned().unwrap_or_default()]);
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
        (InputSpec::Path(a), InputSpec::Path(b))
        | (InputSpec::StandIn(a), InputSpec::StandIn(b)) => {
            a == b || real(a).is_some_and(|a| real(b) == Some(a))
        }
        _ => one == other,
    }
}

/// What holds of a fit and events, with what is known of the place unless a file of the fit was `typed`.
fn resolved(
    known: &FittingArgs,
    mut fit: FitConfig,
    events: EventConfig,
    typed: bool,
) -> FittingArgs {
    if !typed {
        fit.height = known.height.or(fit.height);
        fit.ground = known.floor.or(fit.ground);
    }
    FittingArgs {
        fit: (fit != FitConfig::default()).then_some(Setting::Given(fit)),
        events: (events != EventConfig::default()).then_some(Setting::Given(events)),
        ..known.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::exit;

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
    fn what_follows_people_from_picture_to_picture_says_nothing_of_photos_unless_it_is_typed() {
        let folder = tempfile::tempdir().unwrap();
        let photo = folder.path().join("photo.png");
        std::fs::write(&photo, b"\x89PNG\r\n\x1A\n").unwrap();
        let text = "[network]\nthreads = 2\n";
        let read = |keys: &str, typed: &RunArgs| {
            let settings = Settings::parse("edgecap.toml", &format!("{text}{keys}")).unwrap();
            let effective = effective(typed, &settings).unwrap();
            let engine = effective.runs().unwrap().remove(0).engine;
            assert_eq!(engine.threads, Some(2));
            (engine, effective.network)
        };
        let of = |path: &Path| {
            let mut typed = RunArgs::default();
            typed.input.input = Some(path.display().to_string());
            typed
        };
        for (key, line, value) in [
            ("looks", "looks = 15.0\n", "15"),
            ("size", "size = \"auto\"\n", "auto"),
        ] {
            for path in [&photo, folder.path()] {
                let (engine, origins) = read(line, &of(path));
                assert!(engine.inputs(false).is_ok(), "{key}");
                assert_eq!(origins[key], Origin::Default);
                let (mut live, mut film) = (of(path), of(path));
                (live.input.live, film.input.fps) = (true, Some(30.0));
                for of_film in [live, film] {
                    let (engine, _) = read(line, &of_film);
                    assert!(engine.inputs(false).is_err(), "{key} stays");
                }
                let mut typed = of(path);
                match key {
                    "looks" => typed.engine.looks = value.parse().ok(),
                    _ => typed.engine.size = value.parse().ok(),
                }
                let (engine, origins) = read(line, &typed);
                let refused = engine.inputs(false).err().unwrap().into();
                assert_eq!(exit::code(&refused), exit::USAGE, "{key}");
                assert_eq!(origins[key], Origin::Flag);
            }
        }
        let (engine, _) = read("size = \"512x320\"\n", &of(&photo));
        assert_eq!(engine.size, "512x320".parse().ok());
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
        let stand_in = |path: &Path| format!("stand-in:{}", path.display());
        assert!(is_same(&stand_in(&link), &stand_in(&film)));
        assert!(!is_same(&stand_in(&film), &text(&film)));
    }
}

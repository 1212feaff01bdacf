//! What `edgecap.toml` may hold: the options of the verbs under the names of their fields, by section; and which of it
//! holds for a run. A new option of a section is a key of the file without anybody typing it again.

mod blame;
mod check;
mod effective;
mod metrics_args;
mod multiview_args;
mod named;
mod rate;
mod run_args;
mod several;
mod together;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::bridges::BridgeArgs;
use super::exit::Failure;
use super::infer::{EngineArgs, PaceArgs};
use super::input::{InputArgs, is_network, other_bytes};
use super::outputs::RecordArgs;
use crate::bounded;
use crate::capture::InputSpec;
use crate::config::{self, Mistake, Place, Setting, Table};
use crate::events::EventConfig;
use crate::fit::{FitConfig, GroundConfig};

pub use effective::{Effective, Origins, effective};
pub use metrics_args::{Loopback, MetricsArgs};
pub use multiview_args::MultiviewArgs;
pub use rate::parse_rate;
pub use run_args::RunArgs;
pub use several::{expect_camera, expect_each_its_own, expect_one_for_vmc};

/// A commented file that holds every key.
pub const SAMPLE: &str = include_str!("../../../deploy/edgecap.toml");

/// Where a verb finds its settings.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ConfigArgs {
    /// Settings (TOML); flags override them [default: edgecap/edgecap.toml in $XDG_CONFIG_HOME or ~/.config, else in
    /// /etc]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

/// How a camera's observations become bodies.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FittingArgs {
    /// Publish a camera's bodies at this rate, extrapolating between its frames, Hz (cameras only)
    #[arg(long, value_name = "HZ", value_parser = parse_rate)]
    #[serde(deserialize_with = "rate::rate")]
    pub rate: Option<u16>,
    /// Settings of identity, filters and fit (TOML)
    #[arg(long = "fit-config", value_name = "FILE")]
    pub fit: Option<Setting<FitConfig>>,
    /// What counts as an event, and zones of the floor (TOML)
    #[arg(long, value_name = "FILE")]
    pub events: Option<Setting<EventConfig>>,
    /// Stature of everybody in view, metres, where it is known
    #[arg(skip)]
    pub height: Option<f64>,
    /// The floor, where it is known
    #[arg(skip)]
    pub floor: Option<GroundConfig>,
}

/// A section, and where its keys stand.
#[derive(Debug, Clone, Default)]
pub struct Placed<T> {
    /// What the file says, defaults included.
    pub value: T,
    /// Of the keys that it names, dotted below the section.
    pub places: BTreeMap<String, Place>,
}

/// One `[[camera]]`.
#[derive(Debug, Clone, Default)]
pub struct CameraSettings {
    /// What is seen.
    pub input: InputArgs,
    /// How fast.
    pub pace: PaceArgs,
    /// What is made of it.
    pub fitting: FittingArgs,
    /// What is recorded.
    pub record: RecordArgs,
    /// Where the keys of all of them stand.
    pub places: BTreeMap<String, Place>,
    /// Where it begins; `None` of one that is not in the file.
    pub head: Option<Place>,
}

/// A whole file.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// The file; `None` where there is none.
    pub file: Option<PathBuf>,
    /// Every camera, named.
    pub cameras: Vec<CameraSettings>,
    /// Which network at which size.
    pub network: Placed<EngineArgs>,
    /// The fit of cameras that have none of their own.
    pub fit: Placed<FitConfig>,
    /// Figures for whoever watches.
    pub metrics: Placed<MetricsArgs>,
    /// Where bodies go besides shared memory.
    pub bridges: Placed<BridgeArgs>,
    /// Whether all cameras see the same people.
    pub multiview: Placed<MultiviewArgs>,
}

impl Settings {
    /// The file that the arguments name, else the one that is found; defaults where there is none.
    ///
    /// # Errors
    /// Files that cannot be read, and mistakes in them.
    pub fn load(args: &ConfigArgs) -> anyhow::Result<Self> {
        let Some(path) = args.config.clone().or_else(config::find) else {
            return Ok(Self::default());
        };
        named::expect_no_pipe(&path)?;
        let text = bounded::read_text(&path, bounded::SETTINGS).map_err(|e| {
            let name = path.display();
            let advice = match e.kind() {
                ErrorKind::NotFound if path.is_symlink() => {
                    "it is a link that leads nowhere: mend it".to_owned()
                }
                ErrorKind::NotFound => format!("'edgecap config sample > {name}' makes one"),
                _ => "make it readable".to_owned(),
            };
            Failure::config(format!(
                "cannot read {name}: {e}; {advice}, or name another with --config"
            ))
        })?;
        let mut settings = Self::parse(&path.display().to_string(), &text)?;
        // Whoever wrote the file does not know where it is read.
        let absolute = std::path::absolute(&path).unwrap_or_else(|_| path.clone());
        settings.resolve(absolute.parent().unwrap_or(Path::new("/")))?;
        settings.file = Some(path);
        Ok(settings)
    }

    /// Reads a file's text.
    ///
    /// # Errors
    /// The first mistake.
    pub fn parse(file: &str, text: &str) -> Result<Self, Mistake> {
        let mut root = Table::parse(file, text)?;
        let mut cameras: Vec<CameraSettings> = Vec::new();
        for (index, mut table) in root.take_tables("camera")?.into_iter().enumerate() {
            let (head, places) = (Some(table.head()), table.places());
            let mut input: InputArgs = check::take(&mut table)?;
            check::ranges(&table, &places, &input)?;
            let pace: PaceArgs = check::take(&mut table)?;
            check::ranges(&table, &places, &pace)?;
            let fitting: FittingArgs = check::take(&mut table)?;
            check::ranges(&table, &places, &fitting)?;
            check::fitting(&table, &places, &fitting)?;
            let record: RecordArgs = check::take(&mut table)?;
            let given = [
                ("input", input.input.as_ref().map(OsStr::new)),
                ("jsonl", record.jsonl.as_ref().map(|p| p.as_os_str())),
                ("record", record.record.as_ref().map(|p| p.as_os_str())),
            ];
            check::names(&table, &places, given)?;
            let name = input.name.get_or_insert_with(|| format!("camera{index}"));
            if cameras.iter().any(|c| c.input.name.as_ref() == Some(name)) {
                let what = format!("another camera is called '{name}': give each its own name");
                return Err(table.mistake(places.get("name").copied(), what));
            }
            table.finish()?;
            // Whoever describes a camera wants no clip in its place while it is away.
            let first = || InputSpec::FirstCamera.to_string();
            input.input.get_or_insert_with(first);
            cameras.push(CameraSettings {
                input,
                pace,
                fitting,
                record,
                places,
                head,
            });
        }
        let mut table = root.take_table("network")?;
        let places = table.places();
        let value: EngineArgs = check::take(&mut table)?;
        check::ranges(&table, &places, &value)?;
        table.finish()?;
        let network = Placed { value, places };

        let mut table = root.take_table("fit")?;
        let places = table.places();
        let value: FitConfig = table.take()?;
        check::fit(&table, &places, "", &value)?;
        table.finish()?;
        let fit = Placed { value, places };

        let mut table = root.take_table("metrics")?;
        let places = table.places();
        let value = table.take()?;
        table.finish()?;
        let metrics = Placed { value, places };

        let mut table = root.take_table("bridges")?;
        let places = table.places();
        let value: BridgeArgs = check::take(&mut table)?;
        check::ranges(&table, &places, &value)?;
        table.finish()?;
        let bridges = Placed { value, places };

        let mut table = root.take_table("multiview")?;
        let places = table.places();
        let value: MultiviewArgs = check::take(&mut table)?;
        check::ranges(&table, &places, &value)?;
        table.finish()?;
        let multiview = Placed { value, places };
        root.finish()?;
        Ok(Self {
            file: None,
            cameras,
            network,
            fit,
            metrics,
            bridges,
            multiview,
        })
    }

    /// Takes relative paths of what is read from `folder` on; results go where the process works.
    ///
    /// # Errors
    /// Where that makes a path that is not UTF-8: the tasks of children hold paths as text.
    fn resolve(&mut self, folder: &Path) -> Result<(), Failure> {
        let below = |path: &mut PathBuf| {
            *path = folder.join(&path);
            match path.to_str() {
                Some(_) => Ok(()),
                None => {
                    let told = other_bytes("settings (--config)", "a path", path.as_os_str());
                    Err(Failure::usage(told))
                }
            }
        };
        for camera in &mut self.cameras {
            if let Some(input) = camera.input.input.as_mut().filter(|i| !is_network(i))
                && let Ok(mut spec) = input.parse::<InputSpec>()
            {
                match &mut spec {
                    InputSpec::Path(path) | InputSpec::StandIn(path) => below(path)?,
                    InputSpec::FirstCamera | InputSpec::Stdin | InputSpec::Demo => {}
                }
                *input = spec.to_string();
            }
            if let Some(Setting::File(path)) = &mut camera.input.lens {
                below(path)?;
            }
            if let Some(Setting::File(path)) = &mut camera.fitting.fit {
                below(path)?;
            }
            if let Some(Setting::File(path)) = &mut camera.fitting.events {
                below(path)?;
            }
        }
        let named = [
            &mut self.network.value.model,
            &mut self.network.value.stage2,
            &mut self.multiview.value.calibration,
        ];
        let is_stdout = |path: &PathBuf| path.as_os_str() == crate::output::STDOUT;
        let mut named = named.into_iter().flatten().filter(|path| !is_stdout(path));
        named.try_for_each(below)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The options of a section that have a value when nobody types one.
    fn with_defaults<T: config::Section + clap::Args>() -> Vec<String> {
        let command = T::augment_args(clap::Command::new("edgecap"));
        let has_default = |a: &&clap::Arg| !a.get_default_values().is_empty();
        let of = command.get_arguments().filter(has_default);
        of.map(|a| a.get_id().to_string()).collect()
    }

    /// A default of the command line would pass for nothing typed when it is typed, and the file would win.
    #[test]
    fn what_is_typed_can_be_told_from_what_is_not() {
        let all = [
            with_defaults::<InputArgs>(),
            with_defaults::<PaceArgs>(),
            with_defaults::<FittingArgs>(),
            with_defaults::<RecordArgs>(),
            with_defaults::<EngineArgs>(),
            with_defaults::<MetricsArgs>(),
            with_defaults::<BridgeArgs>(),
            with_defaults::<MultiviewArgs>(),
        ];
        assert_eq!(all.concat(), Vec::<String>::new());
    }

    #[test]
    fn what_is_read_lies_beside_the_file() {
        let text = ["stand-in:hall.toml", "hall.avi", "/films/hall.avi", "demo"]
            .map(|input| format!("[[camera]]\ninput = {input:?}\n"))
            .concat();
        let mut settings = Settings::parse("edgecap.toml", &text).unwrap();
        settings.resolve(Path::new("/etc/edgecap")).unwrap();
        let inputs = settings.cameras.into_iter().map(|c| c.input.input);
        let inputs: Vec<String> = inputs.flatten().collect();
        let expected = [
            "stand-in:/etc/edgecap/hall.toml",
            "/etc/edgecap/hall.avi",
            "/films/hall.avi",
            "demo",
        ];
        assert_eq!(inputs, expected);
    }

    #[test]
    fn a_camera_without_an_input_is_the_first_that_there_is() {
        let text = "[[camera]]\nheight = 1.8\n[[camera]]\ninput = \"hall.avi\"\n";
        let settings = Settings::parse("edgecap.toml", text).unwrap();
        let inputs = settings.cameras.into_iter().map(|c| c.input.input);
        let inputs: Vec<String> = inputs.flatten().collect();
        assert_eq!(inputs, ["camera", "hall.avi"]);
    }
}

//! `edgecap events`: what happens in front of a camera, a line of JSON an event.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use edgecap_client::Subscriber;
use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM};
use serde::Serialize;

use super::exit::Failure;
use super::input::DEFAULT_NAME;
use super::say;
use super::stop::Stop;
use crate::bounded;
use crate::config::Mistake;
use crate::events::{Detector, Event, EventConfig};
use crate::record::{BodiesRow, RowReader};

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
const CLEAN_UP_EVERY: Duration = Duration::from_secs(10);

/// Options of `edgecap events`.
#[derive(Debug, clap::Args)]
pub struct EventsArgs {
    /// The camera: the --name of the run that publishes
    #[arg(long = "camera", visible_alias = "name", value_name = "NAME", default_value = DEFAULT_NAME)]
    camera: String,
    /// Events of a record of bodies instead
    #[arg(long, value_name = "FILE", conflicts_with = "camera")]
    input: Option<PathBuf>,
    /// Zones of the floor and thresholds (TOML)
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
}

/// An event, and whose it is.
#[derive(Serialize)]
struct Line<'a> {
    camera: &'a str,
    #[serde(flatten)]
    event: &'a Event,
}

/// Prints events until the user stops it, or the record ends.
///
/// # Errors
/// Mistakes in the settings, names that cannot be, records that cannot be read, and shared memory that fails.
pub fn events(args: EventsArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let config = match &args.settings {
        Some(path) => read(path)?,
        None => EventConfig::default(),
    };
    let mut detector = Detector::new(config);
    let mut tell = |camera: &str, frame: &BodyFrame| -> anyhow::Result<()> {
        for event in &detector.look(frame) {
            say::out(&serde_json::to_string(&Line { camera, event })?);
        }
        Ok(())
    };
    if let Some(path) = &args.input {
        let name = path.display().to_string();
        let file = File::open(path).map_err(|e| Failure::no_input(path, &e))?;
        let mut rows = RowReader::<_, BodiesRow>::new(BufReader::new(file), &name);
        while let Some(row) = rows.read()? {
            tell(&row.source, &row.message())?;
        }
        return Ok(());
    }
    let bodies = Subscriber::<BodyFrame>::open(&args.camera)?;
    let mut cleaned = Instant::now();
    while !stop.requested() {
        if let Some(frame) = bodies.next(LOOK_UP)?
            && frame.flags & FLAG_END_OF_STREAM == 0
        {
            tell(&args.camera, &frame)?;
        }
        if cleaned.elapsed() > CLEAN_UP_EVERY {
            bodies.clean_up();
            cleaned = Instant::now();
        }
    }
    Ok(())
}

fn read(path: &Path) -> anyhow::Result<EventConfig> {
    let name = path.display().to_string();
    let text = bounded::read_text(path, bounded::SETTINGS)
        .map_err(|e| Failure::config(format!("cannot read {name}: {e}")))?;
    let config: EventConfig =
        toml::from_str(&text).map_err(|e| Mistake::refused(&name, &text, &e))?;
    match config.mistake() {
        Some(mistake) => Err(Failure::config(format!("{name}: {mistake}")).into()),
        None => Ok(config),
    }
}

//! `edgecap events`: what happens in front of a camera, a line of JSON an event.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

use edgecap_client::message::{BodyFrame, EventFrame, FLAG_END_OF_STREAM};
use edgecap_client::{Message, Subscriber};

use super::exit::Failure;
use super::input::DEFAULT_NAME;
use super::say;
use super::stop::Stop;
use crate::bounded;
use crate::config::{Mistake, Setting};
use crate::events::{EventConfig, Line};
use crate::record::{BodiesRow, RowReader};
use crate::sink::{EventSink, Sinks};

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);

/// Options of `edgecap events`.
#[derive(Debug, clap::Args)]
pub struct EventsArgs {
    /// The camera: the --name of the run that publishes
    #[arg(long = "camera", visible_alias = "name", value_name = "NAME", default_value = DEFAULT_NAME)]
    camera: String,
    /// Events of a record of bodies instead
    #[arg(long, value_name = "FILE", conflicts_with = "camera")]
    input: Option<PathBuf>,
    /// Find them anew, with these zones of the floor and thresholds (TOML), instead of those of the run
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
}

/// Prints events until the user stops it, nobody reads them any more, or the record ends.
///
/// # Errors
/// Mistakes in the settings, names that cannot be, records that cannot be read or were not read to their end, events
/// that cannot be written, and shared memory that fails.
pub fn events(args: EventsArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let config = args.settings.as_deref().map(read).transpose()?;
    if config.is_none() && args.input.is_none() {
        return follow(&args.camera, &stop, |frame: &EventFrame| {
            tell(&args.camera, frame)
        });
    }
    let mut found = EventSink::new(config.unwrap_or_default(), Sinks::default());
    let mut look = |camera: &str, frame: &BodyFrame| -> anyhow::Result<bool> {
        for message in &found.look(frame) {
            if !tell(camera, message)? {
                return Ok(false);
            }
        }
        Ok(true)
    };
    let Some(path) = &args.input else {
        return follow(&args.camera, &stop, |frame: &BodyFrame| {
            look(&args.camera, frame)
        });
    };
    let name = path.display().to_string();
    let file = File::open(path).map_err(|e| Failure::no_input(path, &e))?;
    let mut rows = RowReader::<_, BodiesRow>::new(BufReader::new(file), &name);
    let mut frames = 0_u64;
    while let Some(row) = rows.read()? {
        if !look(&row.source, &row.message())? {
            return Ok(());
        }
        frames += 1;
        if stop.requested() {
            return Err(Failure::stopped(frames).into());
        }
    }
    match frames {
        0 => Err(Failure::no_frames(&name, "bodies").into()),
        _ => Ok(()),
    }
}

/// Whether somebody still reads.
fn tell(camera: &str, frame: &EventFrame) -> anyhow::Result<bool> {
    for line in Line::all(camera, frame) {
        if !say::result(&line.json())? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Every message of a stream until `take` wants no more or the user stops it; the publisher may come and go.
fn follow<M: Message>(
    camera: &str,
    stop: &Stop,
    mut take: impl FnMut(&M) -> anyhow::Result<bool>,
) -> anyhow::Result<()> {
    let stream = Subscriber::<M>::open(camera)?;
    // What happened before is not told as if it happened now.
    stream.next(Duration::ZERO)?;
    while !stop.requested() {
        if let Some(message) = stream.next(LOOK_UP)?
            && message.flags() & FLAG_END_OF_STREAM == 0
            && !take(&message)?
        {
            return Ok(());
        }
    }
    Ok(())
}

/// These settings, or those of a file, or the usual ones.
///
/// # Errors
/// If the file cannot be read, or what is wrong with them.
pub fn config(setting: Option<&Setting<EventConfig>>) -> anyhow::Result<EventConfig> {
    match setting {
        None => Ok(EventConfig::default()),
        Some(Setting::Given(config)) => match config.mistake() {
            Some(mistake) => Err(Failure::config(format!("events: {mistake}")).into()),
            None => Ok(config.clone()),
        },
        Some(Setting::File(path)) => read(path),
    }
}

/// Reads a file of settings.
///
/// # Errors
/// If it cannot be read, or what is wrong with it.
pub fn read(path: &Path) -> anyhow::Result<EventConfig> {
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

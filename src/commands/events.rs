//! `edgecap events`: what happens in front of a camera, a line of JSON an event.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use edgecap_client::message::{BodyFrame, EventFrame, FLAG_END_OF_STREAM};
use edgecap_client::{Message, Subscriber};

use super::exit::Failure;
use super::input::{DEFAULT_NAME, stream_name};
use super::say;
use super::stop::Stop;
use crate::bounded;
use crate::config::{Mistake, Setting};
use crate::counted::counted;
use crate::events::{EventConfig, Line};
use crate::record::{BodiesRow, RowReader};
use crate::sink::{EventSink, Sinks};

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
/// Messages that wait for who reads the lines. A stream itself keeps the newest few.
const MOST_WAITING: usize = 1 << 16;

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
            vec![Told::new(&args.camera, frame)]
        });
    }
    let mut found = EventSink::new(config.unwrap_or_default(), Sinks::default());
    let Some(path) = &args.input else {
        return follow(&args.camera, &stop, |frame: &BodyFrame| {
            let messages = found.look(frame);
            let told = messages.iter().map(|m| Told::new(&args.camera, m));
            told.collect()
        });
    };
    let name = path.display().to_string();
    let file = File::open(path).map_err(|e| Failure::no_input(path, &e))?;
    let mut rows = RowReader::<_, BodiesRow>::new(BufReader::new(file), &name);
    let mut frames = 0_u64;
    while let Some(row) = rows.read()? {
        let camera = camera_of(&row.source, path);
        for message in &found.look(&row.message()) {
            if !Told::new(&camera, message).print()? {
                return Ok(());
            }
        }
        frames += 1;
        if stop.requested() {
            return Err(Failure::stopped(frames).into());
        }
    }
    if frames == 0 {
        return Err(Failure::no_whole_frame(&name, "bodies", rows.was_cut()).into());
    }
    if rows.was_cut() {
        tracing::warn!("{name}: cut off inside a frame; the frames before it are used");
    }
    Ok(())
}

/// Whose bodies a row of a record holds. Those of films and devices say where these lie, some nothing at all.
fn camera_of(source: &str, record: &Path) -> String {
    let path = Path::new(source);
    match path.file_stem() {
        None => stream_name(record),
        Some(stem) if stem == path => source.to_owned(),
        Some(_) => stream_name(path),
    }
}

/// The events of a message.
#[derive(Debug)]
struct Told {
    /// How many came before them from the same publisher.
    first: u64,
    count: u64,
    lines: Vec<String>,
}

impl Told {
    fn new(camera: &str, frame: &EventFrame) -> Self {
        Self {
            first: frame.first,
            count: frame.events().len() as u64,
            lines: Line::all(camera, frame).map(|line| line.json()).collect(),
        }
    }

    /// Whether somebody still reads.
    fn print(&self) -> anyhow::Result<bool> {
        for line in &self.lines {
            if !say::result(line)? {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Prints what `find` makes of every message of a stream, until nobody reads it any more or the user stops it; the
/// publisher may come and go.
fn follow<M: Message>(
    camera: &str,
    stop: &Stop,
    mut find: impl FnMut(&M) -> Vec<Told>,
) -> anyhow::Result<()> {
    std::thread::scope(|threads| {
        let (send, waiting) = sync_channel(MOST_WAITING);
        let printing = threads.spawn(move || print_all(&waiting));
        let mut read = || -> anyhow::Result<()> {
            let stream = Subscriber::<M>::open(camera)?;
            // What happened before is not told as if it happened now.
            stream.next(Duration::ZERO)?;
            while !stop.requested() && !printing.is_finished() {
                if let Some(message) = stream.next(LOOK_UP)?
                    && message.flags() & FLAG_END_OF_STREAM == 0
                {
                    for told in find(&message) {
                        // By the one after it the gap shows.
                        let _ = send.try_send(told);
                    }
                }
            }
            Ok(())
        };
        let outcome = read();
        drop(send);
        let printed = printing.join();
        outcome?;
        printed.unwrap_or_else(|_| Err(anyhow::anyhow!("printing ended unexpectedly")))
    })
}

/// Prints what comes, and says what is missing in between.
fn print_all(waiting: &Receiver<Told>) -> anyhow::Result<()> {
    let mut had = None;
    for told in waiting {
        let lost = lost_before(had, told.first);
        if lost > 0 {
            tracing::warn!(
                "{} lost: nobody read them in time",
                counted(lost, "event", "events")
            );
        }
        had = Some(told.first.saturating_add(told.count));
        if !told.print()? {
            break;
        }
    }
    Ok(())
}

/// How many events nobody was told of who has had so many of a publisher, or came when there were some already. One
/// that has told fewer is another publisher.
fn lost_before(had: Option<u64>, first: u64) -> u64 {
    had.map_or(0, |had| first.checked_sub(had).unwrap_or(first))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_of_a_record_are_those_of_the_stream_that_its_run_had() {
        let record = Path::new("takes/tuesday.record");
        for (source, camera) in [
            ("hall", "hall"),
            ("", "tuesday"),
            ("films/my hall.mp4", "my_hall"),
            ("hall.mp4", "hall"),
            ("/dev/video0", "video0"),
        ] {
            assert_eq!(camera_of(source, record), camera);
        }
    }

    #[test]
    fn a_gap_is_what_was_lost_and_another_publisher_begins_anew() {
        assert_eq!(lost_before(None, 812), 0, "of before");
        assert_eq!(lost_before(Some(12), 12), 0);
        assert_eq!(lost_before(Some(12), 15), 3);
        assert_eq!(lost_before(Some(12), 0), 0);
        assert_eq!(lost_before(Some(12), 4), 4);
    }
}

//! `edgecap events`: what happens in front of a camera, a line of JSON an event.

use std::io::{self, BufReader, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{
    Receiver, RecvTimeoutError, SyncSender, TrySendError, channel, sync_channel,
};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, EventFrame, FLAG_END_OF_STREAM};
use edgecap_client::{Message, Subscriber};

use super::event_settings::read as read_settings;
use super::exit::Failure;
use super::input::{DEFAULT_NAME, stream_name};
use super::say;
use super::stop::Stop;
use super::watch::Absence;
use crate::capture::STDIN;
use crate::counted::counted;
use crate::events::Line;
use crate::record::{self, BodyReader};
use crate::sink::{EventSink, Sinks};

/// How pictures of a folder end.
const PICTURES: [&str; 3] = ["jpg", "jpeg", "png"];
/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
/// Messages that wait for who reads the lines. A stream itself keeps the newest few.
const MOST_WAITING: usize = 1 << 16;
/// How long to wait for room among them before looking again.
const ROOM: Duration = Duration::from_millis(5);
/// How long who reads the lines may take for the last ones.
const LAST_LINES: Duration = Duration::from_secs(5);

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
    let config = args.settings.as_deref().map(read_settings).transpose()?;
    if config.is_none() && args.input.is_none() {
        return follow(&args.camera, &stop, |frame: &EventFrame| {
            match is_end(frame.flags) {
                true => Vec::new(),
                false => vec![Told::new(&args.camera, frame)],
            }
        });
    }
    let mut found = EventSink::new(config.unwrap_or_default(), Sinks::default());
    let Some(path) = &args.input else {
        return follow(&args.camera, &stop, |frame: &BodyFrame| {
            if is_end(frame.flags) {
                // The next run has other people under the same ids.
                found.begin_anew();
                return Vec::new();
            }
            let messages = found.look(frame);
            let told = messages.iter().map(|m| Told::new(&args.camera, m));
            told.collect()
        });
    };
    of_record(path, &mut found, &stop)
}

fn is_end(flags: u32) -> bool {
    flags & FLAG_END_OF_STREAM != 0
}

/// Whose bodies a row of a record holds: the name of the stream that its run had where nobody gave one. Rows of films
/// and devices say where these lie, those of a folder's pictures where each picture does, some nothing at all.
pub(super) fn camera_of(source: &str, record: &Path) -> String {
    if source == STDIN {
        return DEFAULT_NAME.to_owned();
    }
    let path = match source {
        "" => record,
        _ => Path::new(source),
    };
    let ending = path.extension().unwrap_or_default();
    // In one picture alone nothing happens.
    match PICTURES.iter().any(|p| ending.eq_ignore_ascii_case(p)) {
        true => stream_name(path.parent().unwrap_or(path)),
        false => stream_name(path),
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

/// Prints what `find` makes of every message of a stream, its end included, until nobody reads it any more or the user
/// stops it; the publisher may come and go, which is said.
///
/// # Errors
/// Shared memory's, what standard output failed of, and lines that nobody takes at the end.
fn follow<M: Message>(
    camera: &str,
    stop: &Stop,
    mut find: impl FnMut(&M) -> Vec<Told>,
) -> anyhow::Result<()> {
    let lines = Lines::start()?;
    let mut read = || -> anyhow::Result<()> {
        let stream = Subscriber::<M>::open(camera)?;
        // What happened before is not told as if it happened now.
        stream.next(Duration::ZERO)?;
        let mut absence = Absence::since(Instant::now());
        while !stop.requested() && !lines.have_ended() {
            if let Some(message) = stream.next(LOOK_UP)? {
                absence.hear(message.flags(), Instant::now());
                for told in find(&message) {
                    lines.offer(told);
                }
            } else if let Some(line) = absence.look(camera, &stream, Instant::now()) {
                say::err(&line);
            }
        }
        Ok(())
    };
    let outcome = read();
    let printed = lines.finish(|| true);
    outcome?;
    printed
}

/// Prints what `found` finds in a record of bodies, until its end, until nobody reads it any more or the user stops it.
///
/// # Errors
/// The record's, what standard output failed of, lines that nobody takes once the user has stopped it, and that there
/// is more where they have.
fn of_record(path: &Path, found: &mut EventSink, stop: &Stop) -> anyhow::Result<()> {
    let name = path.display().to_string();
    let file = record::open(path).map_err(|e| Failure::no_input(path, &e))?;
    let mut bodies = BodyReader::new(BufReader::new(file), &name);
    let lines = Lines::start()?;
    let mut read = || -> anyhow::Result<()> {
        let mut frames = 0_u64;
        while let Some(frame) = bodies.read()? {
            let camera = camera_of(bodies.source(), path);
            if bodies.begins_anew() {
                found.begin_anew();
            }
            for message in &found.look(&frame) {
                lines.hand(Told::new(&camera, message), stop);
            }
            frames += 1;
            if lines.have_ended() {
                return Ok(());
            }
            if stop.requested() {
                return Err(Failure::stopped(frames).into());
            }
        }
        if frames == 0 {
            return Err(Failure::no_whole_frame(&name, "bodies", bodies.was_cut()).into());
        }
        if bodies.was_cut() {
            tracing::warn!("{name}: cut off inside a frame; the frames before it are used");
        }
        Ok(())
    };
    let outcome = read();
    // That lines are missing matters more than that the user stopped it.
    lines.finish(|| stop.requested())?;
    outcome
}

/// Lines on their way to whoever reads them, in a thread of their own: a reader that stands still holds nothing up.
struct Lines {
    send: SyncSender<Told>,
    /// How it went.
    ended: Receiver<anyhow::Result<()>>,
    printing: JoinHandle<()>,
}

impl Lines {
    /// Prints what is handed over, in its order.
    ///
    /// # Errors
    /// If the operating system refuses a thread.
    fn start() -> io::Result<Self> {
        let (send, waiting) = sync_channel(MOST_WAITING);
        let (end, ended) = channel();
        // Not waited for where it is held up in a line that nobody takes.
        let printing = thread::Builder::new().name("lines".to_owned());
        let printing = printing.spawn(move || {
            // Nobody may wait for it any more.
            let _ = end.send(print_all(&waiting));
        })?;
        Ok(Self {
            send,
            ended,
            printing,
        })
    }

    /// Whether nobody reads any more, or they cannot be written.
    fn have_ended(&self) -> bool {
        self.printing.is_finished()
    }

    /// Hands over events that go on without waiting for anybody; where there is no room for them they are lost.
    fn offer(&self, told: Told) {
        // By the one after it the gap shows.
        let _ = self.send.try_send(told);
    }

    /// Hands over events that wait for room, until the user stops it or nobody reads any more.
    fn hand(&self, mut told: Told, stop: &Stop) {
        while let Err(TrySendError::Full(back)) = self.send.try_send(told) {
            if stop.requested() {
                return;
            }
            told = back;
            thread::sleep(ROOM);
        }
    }

    /// Waits for the last lines: for [`LAST_LINES`] once it `must_end`, until then for as long as they take.
    ///
    /// # Errors
    /// What standard output failed of, and lines that nobody takes in time.
    fn finish(self, must_end: impl Fn() -> bool) -> anyhow::Result<()> {
        let Self { send, ended, .. } = self;
        drop(send);
        loop {
            let is_last = must_end();
            let patience = if is_last { LAST_LINES } else { LOOK_UP };
            return match ended.recv_timeout(patience) {
                Ok(printed) => printed,
                Err(RecvTimeoutError::Timeout) if !is_last => continue,
                Err(RecvTimeoutError::Timeout) => Err(untaken().into()),
                Err(RecvTimeoutError::Disconnected) => {
                    Err(anyhow::anyhow!("printing ended unexpectedly"))
                }
            };
        }
    }
}

/// Why the last lines are not all there.
fn untaken() -> io::Error {
    let why = format!(
        "standard output: expected the last lines to be read within {} s, found some that nobody has taken; \
         let their reader go on, or end it",
        LAST_LINES.as_secs()
    );
    io::Error::new(ErrorKind::TimedOut, why)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_of_a_record_are_those_of_the_stream_that_its_run_had() {
        let record = Path::new("takes/tuesday.record");
        for (source, camera) in [
            ("hall", "hall"),
            ("", "tuesday"),
            ("my film", "my_film"),
            ("standard input", "camera0"),
            ("photos/my walk/000004.JPG", "my_walk"),
            ("photos/my walk/000008.png", "my_walk"),
            ("000004.jpeg", "camera0"),
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

//! `edgecap replay`: publishes a record as if its camera ran again, at the times at which it was published. Several are
//! played on one clock: what their cameras saw at one instant has one time again.

use std::fs::{self, File};
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, EventFrame, ObservationFrame};
use edgecap_client::{LinkError, service_name};

use super::events;
use super::exit::Failure;
use super::fit::numbers::Numbers;
use super::input::DEFAULT_NAME;
use super::say;
use super::stop::Stop;
use crate::camera::{DEFAULT_FOV, monotonic_ns};
use crate::config::Setting;
use crate::counted::counted;
use crate::events::EventConfig;
use crate::export::{self, Lives, RATE, Stamp, usual_step};
use crate::record::{self, BodiesRow, CameraSource, Kind, ObservationReader, RowReader, Times};
use crate::sink::{EventSink, Packet, SharedMemorySink, Sink, SinkError, Sinks, Streamed};

/// How long a signal may take to be heard.
const LOOK_UP: Duration = Duration::from_millis(100);
/// Between frames whose times say nothing, nanoseconds.
const STILL_NS: u64 = (1e9 / RATE) as u64;
/// So many frames at a record's beginning tell whether its times say anything.
const HEAD: usize = 1000;

/// Options of `edgecap replay`.
#[derive(Debug, clap::Args)]
pub struct ReplayArgs {
    /// A record of bodies or observations, of 'record', 'run --record' or '--jsonl'; or several, of the cameras of one
    /// room: their times of capture stay
    #[arg(value_name = "FILE", required = true)]
    records: Vec<PathBuf>,
    /// Name under which it is published; of several records one each, in their order
    #[arg(long = "name", visible_alias = "camera", value_name = "NAME", default_value = DEFAULT_NAME)]
    names: Vec<String>,
    /// So many times as fast
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_speed)]
    speed: f64,
    /// What counts as an event, and zones of the floor (TOML); of a record of bodies
    #[arg(long, value_name = "FILE")]
    events: Option<Setting<EventConfig>>,
    /// Over and over, until stopped; one record alone
    #[arg(long = "loop")]
    again: bool,
}

fn parse_speed(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(speed) if (0.01..=100.0).contains(&speed) => Ok(speed),
        _ => Err(format!("'{text}': expected a factor from 0.01 to 100")),
    }
}

/// Publishes the records until their ends, or until the user stops it.
///
/// # Errors
/// Records that cannot be read or hold nothing, names that are taken, and shared memory that fails.
pub fn replay(args: ReplayArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let (records, names) = (args.records.len(), args.names.len());
    if records != names {
        return Err(Failure::usage(format!(
            "expected a --name for each of {}, found {}; give as many",
            counted(records as u64, "record", "records"),
            counted(names as u64, "name", "names"),
        ))
        .into());
    }
    let is_again = |(k, name): &(usize, &String)| args.names[..*k].contains(name);
    if let Some((_, name)) = args.names.iter().enumerate().find(is_again) {
        return Err(Failure::usage(format!(
            "--name {name}: expected a name for each record, found it given twice; only one record can have it",
        ))
        .into());
    }
    if records > 1 && args.again {
        return Err(Failure::usage("--loop plays one record: give one, or leave it out").into());
    }
    for record in &args.records {
        let no_input = |e: io::Error| Failure::no_input(record, &e);
        let found = fs::metadata(record).map_err(no_input)?;
        record::expect_no_folder(&found).map_err(no_input)?;
        if !found.is_file() {
            return Err(Failure::usage(format!(
                "{}: expected a file, which is read from its start more than once, found something else; \
                 write what a pipe brings to a file first",
                record.display()
            ))
            .into());
        }
    }
    let are_together = records > 1;
    let heads = args.records.iter().map(|r| Head::read(r, are_together));
    let heads: Vec<Head> = heads.collect::<Result<_, _>>()?;
    let seen = args.records.iter().zip(&heads);
    let mut seen = seen.filter(|(_, head)| head.kind == Some(Kind::Observations));
    if let (Some(_), Some((record, _))) = (&args.events, seen.next()) {
        return Err(Failure::usage(format!(
            "{}: --events looks at bodies, found observations; give the zones to 'edgecap fit --events', which makes \
             bodies of them",
            record.display()
        ))
        .into());
    }
    let firsts = heads.iter().filter_map(|head| head.first);
    let together = firsts.min().filter(|_| are_together);
    if are_together {
        let ends =
            |n: usize, time: u64| heads[n].ends_before(&args.records[n], time, || stop.requested());
        for (record, seconds) in detached(&heads, ends) {
            tracing::warn!(
                "{}: begins {seconds:.0} s after the first record, when those before it have ended; where that is of \
                 another clock, replay it alone",
                args.records[record].display()
            );
        }
    }
    let (began, has_failed) = (Instant::now(), AtomicBool::new(false));
    let takes = args.records.iter().zip(&args.names).zip(heads);
    let takes = takes.map(|((record, name), head)| Take {
        args: &args,
        record,
        name,
        step: head.step,
        stop: &stop,
        has_failed: &has_failed,
        began,
        together,
    });
    thread::scope(|scope| {
        let playing = takes.map(|take| {
            let play = move || {
                let played = take.publish();
                // Of a room that lacks a camera the others are no replay.
                take.has_failed.fetch_or(played.is_err(), Ordering::Relaxed);
                played
            };
            let started = thread::Builder::new()
                .name("take".into())
                .spawn_scoped(scope, play);
            // Nor of one for which the system has no thread.
            has_failed.fetch_or(started.is_err(), Ordering::Relaxed);
            started
        });
        let playing: Vec<_> = playing.collect();
        let ends = playing.into_iter().map(|started| -> anyhow::Result<()> {
            let thread = started.map_err(|e| Failure::no_thread("for each record", &e))?;
            thread
                .join()
                .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        let ends: Vec<_> = ends.collect();
        ends.into_iter().collect()
    })
}

/// The records that begin when all that began before have ended, as those of two machines' clocks do, and how long
/// after the first of all, seconds. `ends_before` says whether a record has no frame from that time on.
fn detached(heads: &[Head], ends_before: impl Fn(usize, u64) -> bool) -> Vec<(usize, f64)> {
    let firsts = heads.iter().enumerate();
    let mut firsts: Vec<(u64, usize)> = firsts
        .filter_map(|(n, head)| Some((head.first?, n)))
        .collect();
    firsts.sort_unstable();
    let mut found = Vec::new();
    for (k, &(first, record)) in firsts.iter().enumerate().skip(1) {
        if firsts[..k].iter().all(|&(_, n)| ends_before(n, first)) {
            found.push((record, (first - firsts[0].0) as f64 / 1e9));
        }
    }
    found
}

/// What a record's first frames tell of its times.
#[derive(Debug)]
struct Head {
    /// `None` of what is no record.
    kind: Option<Kind>,
    /// When the first is due; `None` where there is none.
    first: Option<u64>,
    /// Usually between two, nanoseconds; `None` where times do not rise.
    step: Option<u64>,
}

impl Head {
    /// `keeps_times`: frames are due by their times of capture.
    fn read(record: &Path, keeps_times: bool) -> anyhow::Result<Self> {
        let mut stamps = Vec::new();
        let kind = Kind::of(&mut open(record)?);
        let read = match kind {
            Some(Kind::Bodies) => bodies(record, &mut |frame| {
                Ok(Self::takes(&mut stamps, frame, keeps_times))
            }),
            Some(Kind::Observations) => observations(record, &mut |frame| {
                Ok(Self::takes(&mut stamps, frame, keeps_times))
            }),
            None => Ok(false),
        };
        // What is wrong after frames is said where these have been played.
        if stamps.is_empty() {
            read?;
        }
        Ok(Self {
            kind,
            first: stamps.first().map(|(_, due)| *due),
            step: usual_step(&stamps),
        })
    }

    /// Whether the record, of which times of capture are kept, has no frame that is due at `time` or later; `false`
    /// where the user stops the look.
    fn ends_before(&self, record: &Path, time: u64, is_stopped: impl Fn() -> bool) -> bool {
        let mut clock = Clock::new(1.0, Instant::now(), self.step, None);
        let mut goes_on = false;
        let mut look = |due| {
            goes_on = clock.look(due) >= time || is_stopped();
            Ok(!goes_on)
        };
        let read = match self.kind {
            Some(Kind::Bodies) => bodies(record, &mut |frame| look(kept_ns(frame))),
            Some(Kind::Observations) => observations(record, &mut |frame| look(kept_ns(frame))),
            None => Ok(false),
        };
        // What is wrong after frames is said where these have been played.
        read.is_ok() && !goes_on
    }

    /// Takes another frame's stamp; whether more are wanted.
    fn takes<M: Times + Copy>(stamps: &mut Vec<Stamp>, frame: &M, keeps_times: bool) -> bool {
        let due = match keeps_times {
            true => kept_ns(frame),
            false => frame.due_ns(),
        };
        stamps.push((frame.number(), due));
        stamps.len() < HEAD
    }
}

/// When a frame is due whose times of capture are kept.
fn kept_ns<M: Times + Copy>(frame: &M) -> u64 {
    let mut frame = Box::new(*frame);
    frame.keep_times();
    frame.due_ns()
}

/// Calls `take` with every frame of a record of bodies until that says `false`; whether the record ends inside a frame.
fn bodies(
    record: &Path,
    take: &mut dyn FnMut(&BodyFrame) -> anyhow::Result<bool>,
) -> anyhow::Result<bool> {
    let name = record.display().to_string();
    let mut rows = RowReader::<_, BodiesRow>::new(open(record)?, &name);
    while let Some(row) = rows.read()? {
        if !take(&row.message())? {
            break;
        }
    }
    Ok(rows.was_cut())
}

/// The same of a record of observations.
fn observations(
    record: &Path,
    take: &mut dyn FnMut(&ObservationFrame) -> anyhow::Result<bool>,
) -> anyhow::Result<bool> {
    let camera = CameraSource::Recorded {
        fov_degrees: DEFAULT_FOV,
    };
    let name = record.display().to_string();
    let mut rows = ObservationReader::new(open(record)?, &name, camera);
    let mut frame = Box::new(ObservationFrame::default());
    while rows.read(&mut frame)? {
        if !take(&frame)? {
            break;
        }
    }
    Ok(rows.was_cut())
}

fn open(path: &Path) -> anyhow::Result<BufReader<File>> {
    let file = record::open(path).map_err(|e| Failure::no_input(path, &e))?;
    Ok(BufReader::new(file))
}

/// Calls its argument with every frame of the record until that says `false`; whether the record ends inside a frame.
type Rows<'a, M> =
    &'a mut dyn FnMut(&mut dyn FnMut(&M) -> anyhow::Result<bool>) -> anyhow::Result<bool>;

/// One record, and what it is published as.
#[derive(Clone, Copy)]
struct Take<'a> {
    args: &'a ReplayArgs,
    record: &'a Path,
    name: &'a str,
    /// Usually between two of its frames, nanoseconds; `None` where times do not rise.
    step: Option<u64>,
    stop: &'a Stop,
    /// Whether one of several could not be played.
    has_failed: &'a AtomicBool,
    began: Instant,
    /// Of several records, when the first frame of all was taken.
    together: Option<u64>,
}

impl Take<'_> {
    fn must_end(&self) -> bool {
        self.stop.requested() || self.has_failed.load(Ordering::Relaxed)
    }

    fn publish(&self) -> anyhow::Result<()> {
        match Kind::of(&mut open(self.record)?) {
            Some(Kind::Bodies) => {
                let config = events::config(self.args.events.as_ref())?;
                let to = BodyStreams::open(self.name, config)?;
                self.play("bodies", to, &mut |take| bodies(self.record, take))
            }
            Some(Kind::Observations) => {
                let to = SharedMemorySink::<ObservationFrame>::open(self.name)?;
                self.play("observations", to, &mut |take| {
                    observations(self.record, take)
                })
            }
            None => Err(Failure::data(format!(
                "{}: expected a record of bodies or observations, found something else; 'edgecap record' makes one",
                self.record.display()
            ))
            .into()),
        }
    }

    fn play<M: Streamed + Times>(
        &self,
        what: &str,
        mut to: impl Target<M>,
        rows: Rows<'_, M>,
    ) -> anyhow::Result<()> {
        let name = self.record.display().to_string();
        say::err(&format!(
            "{name} → shared memory {} (Ctrl-C stops)",
            service_name::<M>(self.name)
        ));
        let mut frames = 0_u64;
        let mut numbers = Numbers::default();
        let began = match self.together {
            Some(_) => self.began,
            None => Instant::now(),
        };
        let mut clock = Clock::new(self.args.speed, began, self.step, self.together);
        let outcome = loop {
            let before = frames;
            let played = rows(&mut |recorded| {
                let mut recorded = Box::new(*recorded);
                to.count_on(&mut recorded);
                let mut message = recorded.clone();
                if self.together.is_some() {
                    message.keep_times();
                }
                clock.wait(&*message, || self.must_end());
                if self.must_end() {
                    return Ok(false);
                }
                message.renumber(numbers.go_on(recorded.number()));
                message.publish_at(monotonic_ns());
                to.take(&message, &recorded)?;
                frames += 1;
                Ok(true)
            });
            let was_cut = match played {
                Ok(was_cut) => was_cut,
                Err(e) => break Err(e),
            };
            if self.must_end() {
                break Ok(());
            }
            if frames == before {
                break Err(Failure::no_whole_frame(&name, what, was_cut).into());
            }
            // Of further passes nobody has to be told again.
            if was_cut && before == 0 {
                tracing::warn!("{name}: cut off inside a frame; the frames before it are replayed");
            }
            if !self.args.again {
                break Ok(());
            }
            numbers.begin_anew();
            to.begin_anew();
            clock = clock.next_pass(Instant::now());
        };
        let finished = to.finish();
        outcome?;
        finished?;
        say::out(&counted(frames, "frame", "frames"));
        Ok(())
    }
}

/// Where the frames of a record go.
trait Target<M> {
    /// Counts what the record counts anew for people on from those before.
    fn count_on(&mut self, _recorded: &mut M) {}

    /// Publishes a frame as it is `replayed`, which was `recorded` with other times and another number.
    ///
    /// # Errors
    /// Shared memory's.
    fn take(&mut self, replayed: &M, recorded: &M) -> Result<(), SinkError>;

    /// Says that the next frame is the first of another pass.
    fn begin_anew(&mut self) {}

    /// Tells readers that nothing follows.
    ///
    /// # Errors
    /// Shared memory's.
    fn finish(self) -> Result<(), SinkError>;
}

impl<M: Streamed> Target<M> for SharedMemorySink<M> {
    fn take(&mut self, replayed: &M, _: &M) -> Result<(), SinkError> {
        <Self as Sink<M>>::take(self, &packet(replayed))
    }

    fn finish(self) -> Result<(), SinkError> {
        <Self as Sink<M>>::finish(Box::new(self)).map(drop)
    }
}

/// Bodies, and what happens with them.
struct BodyStreams {
    lives: Lives,
    bodies: Sinks<BodyFrame>,
    events: Box<EventSink>,
}

impl BodyStreams {
    fn open(name: &str, config: EventConfig) -> Result<Self, LinkError> {
        let (mut bodies, mut events) = (Sinks::default(), Sinks::default());
        bodies.push(SharedMemorySink::<BodyFrame>::open(name)?);
        events.push(SharedMemorySink::<EventFrame>::open(name)?);
        let events = Box::new(EventSink::new(config, events));
        Ok(Self {
            lives: Lives::default(),
            bodies,
            events,
        })
    }
}

impl Target<BodyFrame> for BodyStreams {
    fn count_on(&mut self, recorded: &mut BodyFrame) {
        self.lives.count_on(recorded);
    }

    fn take(&mut self, replayed: &BodyFrame, recorded: &BodyFrame) -> Result<(), SinkError> {
        let packet = packet(replayed);
        self.bodies.take(&packet)?;
        // By the record's own times and numbers, which say where it begins anew.
        self.events.take_as(&packet, recorded)
    }

    fn begin_anew(&mut self) {
        self.lives.begin_anew();
        self.events.begin_anew();
    }

    fn finish(mut self) -> Result<(), SinkError> {
        // Readers of both hear it before one of them waits for its own.
        let ended = self.bodies.end().and(self.events.end());
        let events = self.events.finish().map(drop);
        let bodies = self.bodies.finish().1;
        ended.and(events).and(bodies)
    }
}

fn packet<M>(message: &M) -> Packet<'_, M> {
    Packet {
        message,
        source: "",
        picture: None,
    }
}

/// When a record's frames are due.
struct Clock {
    speed: f64,
    began: Instant,
    times: export::Clock,
    /// Usually between two frames, nanoseconds; `None` where times do not rise: then frames are evenly spaced.
    step: Option<u64>,
    /// What of the record was due when it began: its first frame, or of several records the first one of all.
    zero: Option<u64>,
    /// On the clock of the record's beginning.
    newest: Option<u64>,
}

impl Clock {
    fn new(speed: f64, began: Instant, step: Option<u64>, zero: Option<u64>) -> Self {
        Self {
            speed,
            began,
            times: export::Clock::default(),
            step,
            zero,
            newest: None,
        }
    }

    /// How long after the beginning a frame of this time is due.
    fn due(&mut self, time: u64) -> Duration {
        let now = self.look(time);
        self.after_zero(now)
    }

    /// When a frame of this time is due on the clock of the record's beginning. One that is no later than those before,
    /// as of bodies that are held, is due with the newest.
    fn look(&mut self, time: u64) -> u64 {
        let now = match (self.newest, self.step) {
            (Some(newest), None) => newest.saturating_add(STILL_NS),
            (newest, step) => {
                let later = self.times.look(time, step.unwrap_or_default());
                later.or(newest).unwrap_or(time)
            }
        };
        self.newest = Some(now);
        now
    }

    /// How long after the beginning this is due on the clock of the record's beginning; what is due first is its zero.
    fn after_zero(&mut self, now: u64) -> Duration {
        let zero = *self.zero.get_or_insert(now);
        Duration::from_nanos(now.saturating_sub(zero)).div_f64(self.speed)
    }

    /// The clock of the same record played again: it begins a usual step after the last frame was due, or `now` where
    /// that is later, so that who was held up makes up for nothing.
    fn next_pass(mut self, now: Instant) -> Self {
        let step = self.step.unwrap_or(STILL_NS);
        let end = self.newest.unwrap_or_default().saturating_add(step);
        let began = self.began + self.after_zero(end);
        Self::new(self.speed, began.max(now), self.step, None)
    }

    /// Waits until a frame is due, or must not be waited for any more.
    fn wait(&mut self, frame: &impl Times, must_end: impl Fn() -> bool) {
        let due = self.began + self.due(frame.due_ns());
        while !must_end() {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            thread::sleep(left.min(LOOK_UP));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Format, RecordWriter};

    #[test]
    fn records_of_one_room_have_one_zero() {
        const MS: u64 = 1_000_000;
        let due = |zero: Option<u64>, times: &[u64]| -> Vec<u128> {
            let stamps: Vec<Stamp> = (0..).zip(times.iter().map(|t| t * MS)).collect();
            let mut clock = Clock::new(0.5, Instant::now(), usual_step(&stamps), zero);
            let due = stamps.iter().map(|(_, time)| clock.due(*time));
            due.map(|after| after.as_millis()).collect()
        };
        // At half the speed; alone it begins at once.
        assert_eq!(due(None, &[500, 540, 600]), [0, 80, 200]);
        assert_eq!(due(Some(300 * MS), &[300, 340]), [0, 80]);
        assert_eq!(due(Some(300 * MS), &[500, 540, 600]), [400, 480, 600]);
        // Bodies that are held are due at once, and nothing that follows is later for it.
        assert_eq!(due(None, &[500, 500, 540]), [0, 0, 80]);
        let held = [0, 20, 20, 20, 40];
        assert_eq!(due(Some(0), &held), held.map(|ms| 2 * u128::from(ms)));
        // One that was overtaken; another recording, which follows by as much as is usual.
        assert_eq!(due(None, &[0, 40, 20, 80]), [0, 80, 80, 160]);
        assert_eq!(
            due(None, &[9000, 9040, 0, 40]),
            [0, 80, 160, 240],
            "another recording"
        );
        // Photos have no times.
        assert_eq!(due(None, &[7, 7, 7, 7]), [0, 66, 133, 199]);
    }

    #[test]
    fn a_record_that_begins_when_those_before_have_ended_is_of_another_clock() {
        const SECOND: u64 = 1_000_000_000;
        let detached = |takes: &[(u64, u64)]| {
            let head = |&(first, _): &(u64, u64)| Head {
                kind: Some(Kind::Bodies),
                first: Some(first * SECOND),
                step: None,
            };
            let heads: Vec<Head> = takes.iter().map(head).collect();
            super::detached(&heads, |n, time| takes[n].1 * SECOND < time)
        };
        assert!(detached(&[(500, 600), (520, 580), (590, 700)]).is_empty());
        let days = 864_000;
        assert_eq!(
            detached(&[(days + 7, days + 90), (7, 90)]),
            [(0, days as f64)]
        );
        let pair = (days, days + 60);
        assert_eq!(
            detached(&[(0, 60), pair, pair]),
            [(1, days as f64)],
            "the third begins with the second"
        );
    }

    #[test]
    fn how_long_a_record_lasts_is_looked_for_up_to_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.record");
        let mut writer = RecordWriter::<BodiesRow>::create(&path, Format::Binary).unwrap();
        // Published an hour after it was captured; another recording follows.
        for (sequence, pose_ns) in [(0, 900), (1, 940), (0, 0), (1, 40)] {
            let frame = BodyFrame {
                sequence,
                pose_ns: pose_ns * 1_000_000,
                publish_ns: 3_600_000_000_000,
                ..BodyFrame::default()
            };
            writer.write(&frame, "").unwrap();
        }
        writer.finish().unwrap();
        let head = Head::read(&path, true).unwrap();
        let lasts = [1_020, 1_021].map(|ms| !head.ends_before(&path, ms * 1_000_000, || false));
        assert_eq!(lasts, [true, false]);
    }

    #[test]
    fn a_next_pass_begins_a_step_after_the_last_frame_and_makes_up_for_nothing() {
        const MS: u64 = 1_000_000;
        let start = Instant::now();
        // Between the beginnings of two passes at half the speed; `late`: after the first began, milliseconds.
        let apart = |times: &[u64], late: u64| {
            let stamps: Vec<Stamp> = (0..).zip(times.iter().map(|t| t * MS)).collect();
            let mut clock = Clock::new(0.5, start, usual_step(&stamps), None);
            for (_, time) in &stamps {
                clock.due(*time);
            }
            let next = clock.next_pass(start + Duration::from_millis(late));
            (next.began - start).as_millis()
        };
        assert_eq!(apart(&[7], 0), 66, "one frame");
        assert_eq!(apart(&[7, 7, 7], 0), 199, "photos");
        assert_eq!(apart(&[500, 540, 580], 0), 240);
        assert_eq!(apart(&[9000, 9040, 0, 40], 0), 320, "two takes");
        assert_eq!(apart(&[500, 540, 580], 5000), 5000);
    }
}

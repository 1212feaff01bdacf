//! `edgecap replay`: publishes a record as if its camera ran again, at the times at which it was published.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, EventFrame, ObservationFrame};
use edgecap_client::service_name;

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
use crate::record::{BodiesRow, CameraSource, Kind, ObservationReader, RowReader, Times};
use crate::sink::{EventSink, Packet, SharedMemorySink, Sinks, Streamed};

/// How long a signal may take to be heard.
const LOOK_UP: Duration = Duration::from_millis(100);
/// Frames a second where the record's times say nothing.
const RATE: f64 = 30.0;

/// Options of `edgecap replay`.
#[derive(Debug, clap::Args)]
pub struct ReplayArgs {
    /// A record of bodies or observations, of 'record', 'run --record' or '--jsonl'
    #[arg(value_name = "FILE")]
    record: PathBuf,
    /// Name under which it is published
    #[arg(long = "name", visible_alias = "camera", value_name = "NAME", default_value = DEFAULT_NAME)]
    name: String,
    /// So many times as fast
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = parse_speed)]
    speed: f64,
    /// What counts as an event, and zones of the floor (TOML); of a record of bodies
    #[arg(long, value_name = "FILE")]
    events: Option<Setting<EventConfig>>,
    /// Over and over, until stopped
    #[arg(long = "loop")]
    again: bool,
}

fn parse_speed(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(speed) if (0.01..=100.0).contains(&speed) => Ok(speed),
        _ => Err(format!("'{text}': expected a factor from 0.01 to 100")),
    }
}

/// Publishes the record until its end, or until the user stops it.
///
/// # Errors
/// Records that cannot be read or hold nothing, names that are taken, and shared memory that fails.
pub fn replay(args: ReplayArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let name = args.record.display().to_string();
    let found = fs::metadata(&args.record).map_err(|e| Failure::no_input(&args.record, &e))?;
    if !found.is_file() {
        return Err(Failure::usage(format!(
            "{name}: expected a file, which is read from its start more than once, found something else; \
             write what a pipe brings to a file first"
        ))
        .into());
    }
    match Kind::of(&mut open(&args.record)?) {
        Some(Kind::Bodies) => {
            let mut rows = |take: &mut dyn FnMut(&BodyFrame) -> anyhow::Result<bool>| {
                let mut rows = RowReader::<_, BodiesRow>::new(open(&args.record)?, &name);
                while let Some(row) = rows.read()? {
                    if !take(&row.message())? {
                        break;
                    }
                }
                Ok(rows.was_cut())
            };
            let config = events::config(args.events.as_ref())?;
            let mut sinks = Sinks::default();
            sinks.push(SharedMemorySink::<BodyFrame>::open(&args.name)?);
            let mut happened = Sinks::default();
            happened.push(SharedMemorySink::<EventFrame>::open(&args.name)?);
            sinks.push(EventSink::new(config, happened));
            play(&args, &stop, "bodies", sinks, &mut rows)
        }
        Some(Kind::Observations) => {
            let mut rows = |take: &mut dyn FnMut(&ObservationFrame) -> anyhow::Result<bool>| {
                let camera = CameraSource::Recorded {
                    fov_degrees: DEFAULT_FOV,
                };
                let mut rows = ObservationReader::new(open(&args.record)?, &name, camera);
                let mut frame = Box::new(ObservationFrame::default());
                while rows.read(&mut frame)? {
                    if !take(&frame)? {
                        break;
                    }
                }
                Ok(rows.was_cut())
            };
            let mut sinks = Sinks::default();
            sinks.push(SharedMemorySink::<ObservationFrame>::open(&args.name)?);
            play(&args, &stop, "observations", sinks, &mut rows)
        }
        None => Err(Failure::data(format!(
            "{name}: expected a record of bodies or observations, found something else; 'edgecap record' makes one"
        ))
        .into()),
    }
}

fn open(path: &Path) -> anyhow::Result<BufReader<File>> {
    let file = File::open(path).map_err(|e| Failure::no_input(path, &e))?;
    Ok(BufReader::new(file))
}

/// Calls its argument with every frame of the record until that says `false`; whether the record ends inside a frame.
type Rows<'a, M> =
    &'a mut dyn FnMut(&mut dyn FnMut(&M) -> anyhow::Result<bool>) -> anyhow::Result<bool>;

fn play<M: Streamed + Times>(
    args: &ReplayArgs,
    stop: &Stop,
    what: &str,
    mut sinks: Sinks<M>,
    rows: Rows<'_, M>,
) -> anyhow::Result<()> {
    let name = args.record.display().to_string();
    say::err(&format!(
        "{name} → shared memory {} (Ctrl-C stops)",
        service_name::<M>(&args.name)
    ));
    let mut frames = 0_u64;
    let mut numbers = Numbers::default();
    let outcome = loop {
        let mut clock = Clock::new(args.speed);
        let before = frames;
        let played = rows(&mut |recorded| {
            clock.wait(recorded, stop);
            if stop.requested() {
                return Ok(false);
            }
            let mut message = Box::new(*recorded);
            message.renumber(numbers.go_on(recorded.number()));
            message.publish_at(monotonic_ns());
            sinks.take(&Packet {
                message: &*message,
                source: "",
                picture: None,
            })?;
            frames += 1;
            Ok(true)
        });
        let was_cut = match played {
            Ok(was_cut) => was_cut,
            Err(e) => break Err(e),
        };
        if stop.requested() {
            break Ok(());
        }
        if frames == before {
            break Err(Failure::no_whole_frame(&name, what, was_cut).into());
        }
        // Of further passes nobody has to be told again.
        if was_cut && before == 0 {
            tracing::warn!("{name}: cut off inside a frame; the frames before it are replayed");
        }
        if !args.again {
            break Ok(());
        }
        numbers.begin_anew();
    };
    let finished = sinks.finish().1;
    outcome?;
    finished?;
    say::out(&counted(frames, "frame", "frames"));
    Ok(())
}

/// When a record's frames are due.
struct Clock {
    speed: f64,
    began: Instant,
    first: Option<u64>,
    last: u64,
    /// Of the record, seconds.
    now: f64,
}

impl Clock {
    fn new(speed: f64) -> Self {
        Self {
            speed,
            began: Instant::now(),
            first: None,
            last: 0,
            now: 0.0,
        }
    }

    /// Waits until a frame is due, or the user stops it.
    fn wait(&mut self, frame: &impl Times, stop: &Stop) {
        let time = frame.due_ns();
        if self.first.is_none() {
            self.first = Some(time);
        } else if time > self.last {
            self.now += (time - self.last) as f64 * 1e-9;
        } else {
            self.now += 1.0 / RATE;
        }
        self.last = time;
        let due = self.began + Duration::from_secs_f64(self.now / self.speed);
        while !stop.requested() {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            std::thread::sleep(left.min(LOOK_UP));
        }
    }
}

//! `edgecap view`: shows what running cameras publish on a page, and hands it on over WebSocket.

use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use edgecap_client::message::{BodyFrame, FLAG_FILE_TIME};
use edgecap_client::{Subscriber, cameras};

use super::events::camera_of;
use super::exit::Failure;
use super::followed::Followed;
use super::say;
use super::serve::{PageArgs, PageServer, Past};
use super::stop::Stop;
use super::watch::{QUIET, nobody_yet};
use super::{closed, doctor};
use crate::bridge::websocket::APART;
use crate::events::EventConfig;
use crate::record::clock::Clock;
use crate::record::{self, BodyReader, Times};
use crate::sink::{EventSink, Sinks};

/// How long to wait before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
/// How often new cameras are looked for.
const DISCOVER_EVERY: Duration = Duration::from_millis(500);
/// How long nobody may publish a camera before it is let go of.
const PATIENCE: Duration = Duration::from_secs(30);

/// Options of `edgecap view`.
#[derive(Debug, clap::Args)]
pub struct ViewArgs {
    /// Show this camera only, the --name of a run; may be given several times [default: every camera that runs]
    #[arg(long = "camera", visible_alias = "name", value_name = "NAME")]
    cameras: Vec<String>,
    /// Show a record of bodies instead, to go through from its first frame to its last
    #[arg(long, value_name = "RECORD", conflicts_with_all = ["cameras", "show_picture"])]
    record: Option<PathBuf>,
    /// Show what the cameras see, too, of runs with --show-picture
    #[arg(long)]
    show_picture: bool,
    #[command(flatten)]
    page: PageArgs,
}

/// Serves the page until the user stops it. Cameras may come and go meanwhile.
///
/// # Errors
/// Names that cannot be, an address that is taken, and records that cannot be read.
pub fn view(args: ViewArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    for name in &args.cameras {
        Subscriber::<BodyFrame>::open(name)?;
    }
    if let Some(path) = &args.record {
        return recorded(path, &args.page, &stop);
    }
    let past = Past::LastMinute;
    let server = PageServer::start("--listen", &args.page, past, args.show_picture)?;
    say::out(&format!("{} (Ctrl-C stops)", server.url_for_log()));
    // Those that the user names are waited for, however long.
    let patience = args.cameras.is_empty().then_some(PATIENCE);
    let mut followed = Followed::new(server.hub(), &stop, patience);
    let (began, mut awaited) = (Instant::now(), args.cameras.clone());
    let mut told = false;
    while !stop.requested() {
        let names = if args.cameras.is_empty() {
            let mut names = cameras::<BodyFrame>();
            names.retain(|name| !doctor::is_check(name));
            names
        } else {
            args.cameras.clone()
        };
        if names.is_empty() && !told {
            say::err(&match closed::advice() {
                Some(advice) => format!("nobody publishes that this user may see; {advice}"),
                None => {
                    "nobody publishes yet: start 'edgecap'; 'edgecap doctor' says where this looks"
                        .to_owned()
                }
            });
            told = true;
        }
        // They may start together with this.
        if began.elapsed() > QUIET {
            for name in awaited.drain(..) {
                let stream = Subscriber::<BodyFrame>::open(&name);
                if stream.is_ok_and(|stream| stream.publisher_count() == 0) {
                    say::err(&nobody_yet::<BodyFrame>(&name));
                }
            }
        }
        followed.look(&names);
        std::thread::sleep(DISCOVER_EVERY);
    }
    followed.end();
    Ok(())
}

/// Shows a record until the user stops it.
fn recorded(path: &Path, page: &PageArgs, stop: &Stop) -> anyhow::Result<()> {
    let name = path.display().to_string();
    let file = record::open(path).map_err(|e| Failure::no_input(path, &e))?;
    let mut bodies = BodyReader::new(BufReader::new(file), &name);
    let server = PageServer::start("--listen", page, Past::Record, false)?;
    let mut found = EventSink::new(EventConfig::default(), Sinks::default());
    let (mut frames, mut timeline) = (0_u64, Timeline::default());
    while let Some(mut frame) = bodies.read()? {
        let camera = camera_of(bodies.source(), path);
        if bodies.begins_anew() {
            found.begin_anew();
        }
        // By the record's own times: those of a film go back where it begins anew.
        let happened = found.look(&frame);
        timeline.put(&mut frame);
        server.hub().publish(&camera, &frame);
        for mut event in happened {
            (event.time_ns, event.publish_ns) = (frame.pose_ns, frame.publish_ns);
            server.hub().tell(&camera, &event);
        }
        frames += 1;
        if stop.requested() {
            return Ok(());
        }
    }
    if frames == 0 {
        return Err(Failure::no_whole_frame(&name, "bodies", bodies.was_cut()).into());
    }
    if bodies.was_cut() {
        tracing::warn!("{name}: cut off inside a frame; the frames before it are shown");
    }
    server.hub().loaded();
    let every = server.hub().kept_every();
    if every > 1 {
        say::err(&format!(
            "{name}: more than the page can hold; one frame of {every} is shown, from the first of {frames} to the last"
        ));
    }
    say::out(&format!("{} (Ctrl-C stops)", server.url_for_log()));
    while !stop.requested() {
        std::thread::sleep(LOOK_UP);
    }
    Ok(())
}

/// How long a frame of photos is shown, whose times say nothing, nanoseconds.
const STILL: u64 = 1_000_000_000;

/// When frames of a record are published for the page, which goes by that: one after the other, though the record's own
/// times may say nothing, or begin again. All in nanoseconds.
#[derive(Debug, Default)]
struct Timeline {
    clock: Clock,
    /// What the record's times told last.
    told: Option<u64>,
    /// The last step that they tell.
    step: u64,
    /// By how much frames are later than their times tell.
    shift: u64,
    /// When the last frame is published.
    last: u64,
}

impl Timeline {
    /// Moves a frame to where it follows the one before.
    fn put(&mut self, frame: &mut BodyFrame) {
        let least = self.last.saturating_add(APART);
        let now = match self.clock.look(frame.due_ns(), self.step) {
            Some(told) => {
                if let Some(before) = self.told.replace(told) {
                    self.step = told - before;
                }
                if told.saturating_add(self.shift) < least {
                    // All that follow are later, too: else those up to the last one would be shown at once.
                    let next = self.last.saturating_add(self.step).max(least);
                    self.shift = next.saturating_sub(told);
                }
                told.saturating_add(self.shift)
            }
            None if self.step == 0 => self.last.saturating_add(STILL),
            None => least,
        };
        frame.publish_at(now);
        if frame.flags & FLAG_FILE_TIME != 0 {
            // Of a second pass what happens is told after what happened in the first.
            frame.pose_ns = now;
        }
        self.last = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: u64 = 40_000_000;

    fn live(k: u64) -> BodyFrame {
        let now = 7_000_000_000 + k * STEP;
        BodyFrame {
            capture_ns: now - 30_000_000,
            pose_ns: now - 30_000_000,
            publish_ns: now,
            ..BodyFrame::default()
        }
    }

    fn of_film(k: u64) -> BodyFrame {
        BodyFrame {
            flags: FLAG_FILE_TIME,
            pose_ns: k * STEP,
            publish_ns: 7_000_000_000 + k,
            ..BodyFrame::default()
        }
    }

    fn put(frames: impl Iterator<Item = BodyFrame>) -> Vec<BodyFrame> {
        let mut timeline = Timeline::default();
        let put = frames.map(|mut frame| {
            timeline.put(&mut frame);
            frame
        });
        put.collect()
    }

    #[test]
    fn two_passes_last_twice_as_long_and_every_step_is_the_record_s() {
        for frame in [live, of_film] {
            let put = put((1..=50).chain(1..=50).map(frame));
            let times: Vec<u64> = put.iter().map(|f| f.publish_ns).collect();
            assert_eq!(times[0], frame(1).due_ns());
            let steps: Vec<u64> = times.windows(2).map(|w| w[1] - w[0]).collect();
            assert_eq!(steps, [STEP; 99]);
            assert!(put.is_sorted_by(|a, b| a.pose_ns < b.pose_ns));
        }
    }

    #[test]
    fn frames_of_a_later_pass_are_as_old_as_they_were() {
        for frame in put((0..20).chain(0..20).map(live)) {
            assert_eq!(frame.publish_ns - frame.capture_ns, 30_000_000);
        }
    }

    #[test]
    fn frames_whose_times_say_nothing_come_one_after_the_other() {
        let photos = put((0..5).map(|_| of_film(0)));
        let times: Vec<u64> = photos.iter().map(|f| f.publish_ns).collect();
        assert_eq!(times, [0, 1, 2, 3, 4].map(|k| APART + k * STILL));
    }

    #[test]
    fn two_frames_of_one_time_at_the_start_change_no_step_that_follows() {
        let put = put([1, 1, 2, 3, 3, 4].into_iter().map(of_film));
        let times: Vec<u64> = put.iter().map(|f| f.publish_ns).collect();
        let steps: Vec<u64> = times.windows(2).map(|w| w[1] - w[0]).collect();
        assert_eq!(steps, [STILL, STEP, STEP, APART, STEP - APART]);
    }

    #[test]
    fn frames_have_times_of_their_own_however_late_they_are() {
        // In half a year.
        let late = |k: u64| BodyFrame {
            flags: FLAG_FILE_TIME,
            pose_ns: 15_768_000_000_000_001 + k * STEP,
            ..BodyFrame::default()
        };
        let frames = [0, 1, 1, 1, 2].into_iter().map(late);
        // Numbers as the page has them.
        let times: Vec<f64> = put(frames).iter().map(|f| f.publish_ns as f64).collect();
        assert!(times.is_sorted_by(|a, b| a < b), "{times:?}");
    }
}

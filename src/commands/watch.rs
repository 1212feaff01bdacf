//! `edgecap watch`: shows what a camera's processes publish, without touching them.

use std::time::{Duration, Instant};

use edgecap_client::message::{
    BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, HealthFrame, HealthState,
};
use edgecap_client::{Message, Subscriber, service_name};

use super::health::health_of;
use super::input::DEFAULT_NAME;
use super::stop::Stop;
use super::table::{Table, TableArgs};
use super::tally::Tally;
use super::{closed, doctor, say, status};
use crate::sink::Rhythm;

/// How long to wait for a message before looking at the signals again.
const LOOK_UP: Duration = Duration::from_millis(200);
/// How long nothing may come before the user is told, where the camera is not slower.
pub const QUIET: Duration = Duration::from_secs(3);

/// Options of `edgecap watch`.
#[derive(Debug, clap::Args)]
pub struct WatchArgs {
    /// The camera: the --name of the run that publishes
    #[arg(long, visible_alias = "camera", value_name = "NAME", default_value = DEFAULT_NAME)]
    name: String,
    #[command(flatten)]
    table: TableArgs,
}

/// Shows bodies until the user stops it or a file ends; waits where nobody publishes yet, or no more.
///
/// # Errors
/// Names that cannot be, and shared memory that fails.
pub fn watch(args: WatchArgs) -> anyhow::Result<()> {
    let stop = Stop::on_signals()?;
    let bodies = Subscriber::<BodyFrame>::open(&args.name)?;
    let mut table = Table::new(args.table);
    table.say(&format!(
        "watching shared memory {} (Ctrl-C stops)",
        service_name::<BodyFrame>(&args.name)
    ));
    let mut quiet = Quiet::since(Instant::now());
    let mut tally = Tally::default();
    let mut heard = Heard::Nothing;
    while !stop.requested() {
        if let Some(frame) = bodies.next(LOOK_UP)? {
            if frame.flags & FLAG_END_OF_STREAM != 0 {
                if frame.flags & FLAG_FILE_TIME != 0 {
                    table.finish();
                    say::out("the input has ended");
                    return Ok(());
                }
                // A camera's process that is started again ends its stream, too: whether that was all, silence tells.
                heard = Heard::End;
                quiet.hear(Instant::now());
                continue;
            }
            heard = Heard::Frames;
            tally.count(&frame);
            table.update(&frame, tally.left_out);
            quiet.hear(Instant::now());
        } else if quiet.begins(Instant::now()) {
            match bodies.publisher_count() {
                0 => table.say(&heard.then_nobody::<BodyFrame>(&args.name)),
                _ => table.say(&format!(
                    "connected, but no frames come: {}",
                    why_none_come(&args.name)
                )),
            }
        }
    }
    table.finish();
    Ok(())
}

/// Why no bodies come of a camera whose bodies somebody publishes.
fn why_none_come(camera: &str) -> String {
    match health_of(camera) {
        Some(health) => why(&health),
        None => "is the camera there?".to_owned(),
    }
}

/// The same, as the camera, or the room of several, says of itself.
fn why(health: &HealthFrame) -> String {
    let seconds = health.state_seconds();
    match health.state {
        _ if health.cameras > 1 => {
            format!("{} of {} cameras send", health.cameras_live, health.cameras)
        }
        HealthState::AWAY => format!("the camera has been away for {seconds:.0} s"),
        HealthState::STALLED => format!("the camera has sent no picture for {seconds:.0} s"),
        HealthState::STARTING => "the camera has sent no picture yet".to_owned(),
        _ => format!("of the camera is said: {health}"),
    }
}

/// What came last.
#[derive(Debug, Clone, Copy)]
enum Heard {
    Nothing,
    Frames,
    /// The run said that it ends.
    End,
}

impl Heard {
    /// What to say where nobody publishes a camera's messages after that.
    fn then_nobody<M: Message>(self, camera: &str) -> String {
        let why = match self {
            Self::Nothing => return nobody_yet::<M>(camera),
            Self::Frames => {
                "its run was killed, or is being started again; this goes on with the next"
            }
            Self::End => "its run has ended; this goes on with the next (Ctrl-C stops)",
        };
        format!("nobody publishes {camera} any more: {why}")
    }
}

/// What to say of a camera that is waited for and of which nobody publishes such messages: perhaps another is meant.
pub fn nobody_yet<M: Message>(camera: &str) -> String {
    let mut others = status::published::<M>();
    others.retain(|name| name != camera && !doctor::is_check(name));
    if others.is_empty()
        && let Some(advice) = closed::advice()
    {
        return format!("nobody publishes {camera} that this user may see; {advice}");
    }
    let others = match others.is_empty() {
        true => "'edgecap doctor' says where it looks".to_owned(),
        false => format!("or name one that there is: {}", others.join(", ")),
    };
    format!("nobody publishes {camera} yet: start 'edgecap run --name {camera}'; {others}")
}

/// Whether the user is to be told that nobody publishes what a verb waits for: once of each silence. A publisher that
/// has nothing to tell is there all the same.
pub struct Absence {
    quiet: Quiet,
    heard: Heard,
}

impl Absence {
    /// Of a verb that waits from now on.
    pub fn since(began: Instant) -> Self {
        Self {
            quiet: Quiet::since(began),
            heard: Heard::Nothing,
        }
    }

    /// A message with these flags came.
    pub fn hear(&mut self, flags: u32, now: Instant) {
        self.heard = match flags & FLAG_END_OF_STREAM {
            0 => Heard::Frames,
            _ => Heard::End,
        };
        self.quiet.hear(now);
    }

    /// What to say where no message came.
    pub fn look<M: Message>(
        &mut self,
        camera: &str,
        stream: &Subscriber<M>,
        now: Instant,
    ) -> Option<String> {
        if stream.publisher_count() > 0 {
            if matches!(self.heard, Heard::Nothing) {
                self.heard = Heard::Frames;
            }
            self.quiet.hear(now);
            return None;
        }
        let is_news = self.quiet.begins(now);
        is_news.then(|| self.heard.then_nobody::<M>(camera))
    }
}

/// Whether the user is to be told that nothing comes: once of each silence.
struct Quiet {
    began: Instant,
    rhythm: Rhythm,
    told: bool,
}

impl Quiet {
    fn since(began: Instant) -> Self {
        Self {
            began,
            rhythm: Rhythm::default(),
            told: false,
        }
    }

    /// A frame came, or the stream's end.
    fn hear(&mut self, now: Instant) {
        self.rhythm.hear(now);
        self.told = false;
    }

    fn begins(&mut self, now: Instant) -> bool {
        let is_silent = self.rhythm.is_silent(QUIET, now);
        let is_silent = is_silent.unwrap_or_else(|| now - self.began > QUIET);
        let is_news = is_silent && !self.told;
        self.told |= is_news;
        is_news
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_says_what_has_become_of_it_and_a_room_how_many_send() {
        let mut health = HealthFrame {
            publish_ns: 15_000_000_000,
            since_ns: 3_000_000_000,
            state: HealthState::AWAY,
            cameras: 1,
            ..HealthFrame::default()
        };
        assert_eq!(why(&health), "the camera has been away for 12 s");
        health.state = HealthState::STALLED;
        assert_eq!(why(&health), "the camera has sent no picture for 12 s");
        (health.cameras, health.cameras_live) = (3, 1);
        assert_eq!(why(&health), "1 of 3 cameras send");
    }

    #[test]
    fn a_slow_camera_is_not_silent_between_its_frames() {
        let began = Instant::now();
        let mut quiet = Quiet::since(began);
        let mut told = Vec::new();
        for second in 0..100 {
            let now = began + Duration::from_secs(second);
            if (10..=50).contains(&second) && second % 5 == 0 {
                quiet.hear(now);
            }
            if quiet.begins(now) {
                told.push(second);
            }
        }
        // Before the first frame, after it, since it may be the last, and once after the last.
        assert_eq!(told, [4, 14, 61]);
    }
}

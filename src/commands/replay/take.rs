//! One record, played.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use edgecap_client::message::ObservationFrame;
use edgecap_client::{LinkError, service_name};

use super::ReplayArgs;
use super::clock::Clock;
use super::records::{bodies, no_record, observations, open};
use super::target::{BodyStreams, Target};
use crate::camera::monotonic_ns;
use crate::commands::exit::Failure;
use crate::commands::fit::numbers::Numbers;
use crate::commands::health::HealthStream;
use crate::commands::stop::Stop;
use crate::commands::{event_settings, say};
use crate::counted::counted;
use crate::metrics::{About, Seen};
use crate::record::{Kind, Times};
use crate::sink::{SharedMemorySink, Streamed, Streams};

/// Calls its argument with every frame of the record until that says `false`; whether the record ends inside a frame.
type Rows<'a, M> =
    &'a mut dyn FnMut(&mut dyn FnMut(&M) -> anyhow::Result<bool>) -> anyhow::Result<bool>;

/// One record, and what it is published as.
#[derive(Clone, Copy)]
pub struct Take<'a> {
    /// What the user wants.
    pub args: &'a ReplayArgs,
    /// Where it lies.
    pub record: &'a Path,
    /// Under which it is published.
    pub name: &'a str,
    /// Usually between two of its frames, nanoseconds; `None` where times do not rise.
    pub step: Option<u64>,
    /// What there is to say of its source.
    pub about: About,
    /// When the user has enough.
    pub stop: &'a Stop,
    /// Whether one of several could not be played.
    pub has_failed: &'a AtomicBool,
    /// When the first frame of several records is due.
    pub began: Instant,
    /// Of several records, when the first frame of all was taken.
    pub together: Option<u64>,
}

impl Take<'_> {
    fn must_end(&self) -> bool {
        self.stop.requested() || self.has_failed.load(Ordering::Relaxed)
    }

    /// Plays it until its end, or until it must end before.
    ///
    /// # Errors
    /// A record that cannot be read or holds nothing, a name that is taken, and shared memory that fails.
    pub fn publish(&self) -> anyhow::Result<()> {
        match Kind::of(&mut open(self.record)?) {
            Some(Kind::Bodies) => {
                let config = event_settings::config(self.args.events.as_ref())?;
                let to = BodyStreams::open(self.name, config)?;
                self.play("bodies", to, &mut |take| bodies(self.record, take))
            }
            Some(Kind::Observations) => {
                let to = SharedMemorySink::<ObservationFrame>::open(self.name)?;
                self.play("observations", to, &mut |take| {
                    observations(self.record, take)
                })
            }
            None => Err(no_record(self.record).into()),
        }
    }

    /// What is said of the record's source under its name; nothing where another process does, as one that replays the
    /// same camera's bodies beside its observations.
    fn health(&self) -> Result<HealthStream, LinkError> {
        let streams = Streams::of_camera(self.name);
        match HealthStream::open(self.about, Some(&streams)) {
            Err(LinkError::Busy { service }) => {
                tracing::warn!(
                    "another process publishes {service} already: this replay does without"
                );
                HealthStream::open(self.about, None)
            }
            opened => opened,
        }
    }

    fn play<M: Streamed + Times>(
        &self,
        what: &str,
        mut to: impl Target<M>,
        rows: Rows<'_, M>,
    ) -> anyhow::Result<()>
    where
        Seen: for<'m> From<&'m M>,
    {
        let mut health = self.health()?;
        health.look(|_, _| ())?;
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
        let mut newest = None;
        let outcome = loop {
            let before = frames;
            let played = rows(&mut |recorded| {
                if recorded.is_end() {
                    // Of those who read along none must end by it: more follows.
                    numbers.begin_anew();
                    to.publisher_ended();
                    return Ok(true);
                }
                let mut recorded = Box::new(*recorded);
                to.count_on(&mut recorded);
                let mut message = recorded.clone();
                if self.together.is_some() {
                    message.keep_times();
                }
                let mut told = Ok(());
                clock.wait(&*message, || {
                    told = health.look(|health, now| health.waits(now));
                    told.is_err() || self.must_end()
                });
                told?;
                if self.must_end() {
                    return Ok(false);
                }
                message.renumber(numbers.go_on(recorded.number()));
                message.publish_at(monotonic_ns());
                to.take(&message, &recorded)?;
                // Bodies that are extrapolated, or held, are of no picture of their own.
                if newest.replace(message.number()) != Some(message.number()) {
                    health.look(|health, now| health.observed(now, &(&*message).into(), false))?;
                }
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
        // Readers of all streams hear it before one of them waits for its own.
        health.end();
        let finished = to.finish();
        health.finish();
        outcome?;
        finished?;
        say::out(&counted(frames, "frame", "frames"));
        Ok(())
    }
}

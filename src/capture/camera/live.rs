//! A camera that may go away and come back: openings and pictures go in, steps come out. No device here, so that every
//! way of failing can be tested.
//!
//! ```text
//! Streaming ──error, or silence──▶ Reconnecting ──opened again──▶ Streaming
//!                                   │    ▲ waits 0.25 s, then twice as long each time, at most 2 s
//!                                   └────┘ opening failed
//! ```
//!
//! Silence is 3 s without a picture, of a slow camera 2.5 of its intervals. A camera is back with its first picture:
//! one that opens and sends nothing waits as one that does not open. One that sends for as long nothing that can be
//! decoded is as good as silent, and back with its first picture that can be.

use std::io;
use std::time::{Duration, Instant};

use crate::camera::Clock;
use crate::capture::error::CaptureError;
use crate::capture::raw::RawPicture;

/// Longest that one step takes while no picture comes: callers look at their stop signal that often.
pub const STEP_LIMIT: Duration = Duration::from_millis(250);
/// A camera that sends nothing for so long is closed and opened again, …
const SILENCE_LIMIT: Duration = Duration::from_secs(3);
/// … or for so many times the interval that it promised, where that is longer.
const SILENT_INTERVALS: f64 = 2.5;
/// Fewer pictures that cannot be decoded tell nothing of the next ones, however seldom they are asked for.
const LEAST_UNDECODABLE: u32 = 3;
/// First wait before opening again; doubles with every failure.
const FIRST_DELAY: Duration = Duration::from_millis(250);
/// Longest wait before opening again.
const LAST_DELAY: Duration = Duration::from_secs(2);
/// Steps by which sequence numbers may jump; more is a camera that counts anew.
const MAX_JUMP: u32 = 1 << 16;

/// Where a camera is plugged in.
pub trait CameraPort: Send {
    /// Opens the camera and starts it.
    ///
    /// # Errors
    /// Why not: absent, busy, not permitted, not usable.
    fn open(&mut self) -> Result<Box<dyn CameraStream>, CaptureError>;

    /// The camera's name, for messages.
    fn name(&self) -> &str;
}

/// A camera that is open and runs.
pub trait CameraStream: Send {
    /// Waits for a picture and overwrites `raw` with the newest one: bytes, layout, and CLOCK_MONOTONIC time of
    /// capture. Returns the camera's own count of it; `None` when none came within `timeout`.
    ///
    /// # Errors
    /// The camera is gone or refuses: it has to be opened again.
    fn newest(&mut self, timeout: Duration, raw: &mut RawPicture) -> io::Result<Option<u32>>;

    /// Pictures per second that the camera promised, if it did.
    fn fps(&self) -> Option<f64>;
}

/// What a step brought.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// A new picture.
    Picture,
    /// Nothing yet; why.
    Waiting(String),
}

/// The state machine.
pub struct Live<P, C> {
    port: P,
    clock: C,
    state: State,
    /// Count of the last picture in our terms.
    sequence: Option<u64>,
    /// Count of the last picture in the camera's terms, since it was opened.
    counter: Option<u32>,
    /// Why it could not be opened again, the last time, since it went away.
    refusal: Option<String>,
    /// Since when none of its pictures could be decoded, and how many.
    undecodable: Option<(Instant, u32)>,
    /// It was closed because of that: only one that can be decoded shows that it is back.
    is_doubted: bool,
}

enum State {
    Streaming {
        stream: Box<dyn CameraStream>,
        /// How long it was waited for the next picture: while nobody asks, none is missed.
        silent: Duration,
        /// Of one that was opened again and has sent nothing yet: how long it was waited for last.
        awaited: Option<Duration>,
    },
    Reconnecting {
        reason: String,
        next_try: Instant,
        delay: Duration,
    },
}

impl<P: CameraPort, C: Clock> Live<P, C> {
    /// Opens the camera for the first time. What fails now fails for good: a user who names a wrong camera wants to
    /// know.
    ///
    /// # Errors
    /// Those of [`CameraPort::open`].
    pub fn new(mut port: P, clock: C) -> Result<Self, CaptureError> {
        let stream = port.open()?;
        Ok(Self {
            port,
            clock,
            state: State::Streaming {
                stream,
                silent: Duration::ZERO,
                awaited: None,
            },
            sequence: None,
            counter: None,
            refusal: None,
            undecodable: None,
            is_doubted: false,
        })
    }

    /// Takes at most about a quarter of a second, reopening aside. After [`Step::Waiting`] `raw` holds nothing useful.
    pub fn step(&mut self, raw: &mut RawPicture) -> Step {
        match &mut self.state {
            State::Streaming { stream, silent, .. } => {
                let asked = self.clock.now();
                match stream.newest(STEP_LIMIT, raw) {
                    Ok(Some(counter)) => {
                        *silent = Duration::ZERO;
                        if !self.is_doubted {
                            self.came_back();
                        }
                        raw.sequence = self.count(counter);
                        Step::Picture
                    }
                    Ok(None) => {
                        *silent += self.clock.now().duration_since(asked);
                        if *silent < silence_limit(stream.fps()) {
                            return Step::Waiting("no picture yet".into());
                        }
                        let reason = format!("no picture for {} s", silent.as_secs());
                        self.lose(reason)
                    }
                    Err(e) => self.lose(describe(&e)),
                }
            }
            State::Reconnecting {
                reason,
                next_try,
                delay,
            } => {
                let now = self.clock.now();
                if now < *next_try {
                    self.clock.sleep((*next_try - now).min(STEP_LIMIT));
                    return Step::Waiting(reason.clone());
                }
                match self.port.open() {
                    Ok(stream) => {
                        self.counter = None;
                        self.state = State::Streaming {
                            stream,
                            silent: Duration::ZERO,
                            awaited: Some(*delay),
                        };
                        Step::Waiting("the camera is there, no picture yet".into())
                    }
                    Err(e) => {
                        *delay = (*delay * 2).min(LAST_DELAY);
                        *next_try = self.clock.now() + *delay;
                        let reason = reason.clone();
                        self.refused(&e);
                        Step::Waiting(reason)
                    }
                }
            }
        }
    }

    /// Hears whether the last picture could be decoded, or why not. A camera that sends nothing else is opened again.
    pub fn judged(&mut self, failure: Option<&str>) {
        let Some(why) = failure else {
            self.undecodable = None;
            self.is_doubted = false;
            self.came_back();
            return;
        };
        let now = self.clock.now();
        let (since, count) = self.undecodable.get_or_insert((now, 0));
        *count += 1;
        let are_enough = *count >= LEAST_UNDECODABLE;
        let lasted = now - *since;
        if self.is_streaming() && are_enough && lasted >= silence_limit(self.fps()) {
            self.is_doubted = true;
            // What follows says what to do about a file.
            let what = why.split("; ").next().unwrap_or(why);
            self.lose(format!("sends pictures that cannot be decoded ({what})"));
        }
    }

    /// It has shown that it is there.
    fn came_back(&mut self) {
        if let State::Streaming { awaited, .. } = &mut self.state
            && awaited.take().is_some()
        {
            self.refusal = None;
            tracing::info!("{}: camera is back", self.port.name());
        }
    }

    /// Says why it cannot be opened again, once: that it is away was said when it went.
    fn refused(&mut self, error: &CaptureError) {
        let why = error.to_string();
        let is_news = match &self.refusal {
            None => !error.may_pass(),
            Some(before) => *before != why,
        };
        if is_news {
            tracing::warn!("the camera cannot be opened again, and is tried on: {why}");
        } else {
            tracing::debug!("{why}");
        }
        self.refusal = Some(why);
    }

    /// Whether the camera is open, as far as is known.
    pub fn is_streaming(&self) -> bool {
        matches!(self.state, State::Streaming { .. })
    }

    /// Whether it went away and has sent no picture since.
    pub fn is_away(&self) -> bool {
        match &self.state {
            State::Streaming { awaited, .. } => awaited.is_some(),
            State::Reconnecting { .. } => true,
        }
    }

    /// The camera's name.
    pub fn name(&self) -> &str {
        self.port.name()
    }

    /// Pictures per second that the camera promised.
    pub fn fps(&self) -> Option<f64> {
        match &self.state {
            State::Streaming { stream, .. } => stream.fps(),
            State::Reconnecting { .. } => None,
        }
    }

    /// Closes the camera, to be opened again: soon, or, where that has brought nothing, less and less often.
    fn lose(&mut self, reason: String) -> Step {
        let awaited = match &self.state {
            State::Streaming { awaited, .. } => *awaited,
            State::Reconnecting { .. } => None,
        };
        let delay = match awaited {
            None => {
                tracing::warn!("{}: {reason}; reconnecting", self.port.name());
                FIRST_DELAY
            }
            // Said when it went away; a line every few seconds would fill the log.
            Some(delay) => {
                tracing::debug!("{}: {reason}; reconnecting", self.port.name());
                (delay * 2).min(LAST_DELAY)
            }
        };
        self.undecodable = None;
        self.state = State::Reconnecting {
            reason: reason.clone(),
            next_try: self.clock.now() + delay,
            delay,
        };
        Step::Waiting(reason)
    }

    /// From the camera's 32-bit count, which wraps and starts anew, to one that only grows: gaps are dropped pictures.
    fn count(&mut self, counter: u32) -> u64 {
        let step = match self.counter.replace(counter) {
            Some(last) => match counter.wrapping_sub(last) {
                step @ 1..MAX_JUMP => step,
                _ => 1,
            },
            // What was missed while the camera was away nobody knows: it counts as one.
            None => 1 + u32::from(self.sequence.is_some()),
        };
        let sequence = self.sequence.map_or(0, |s| s + u64::from(step));
        self.sequence = Some(sequence);
        sequence
    }
}

/// How long a camera of so many pictures a second may be silent.
fn silence_limit(fps: Option<f64>) -> Duration {
    let interval = fps.map_or(0.0, |fps| SILENT_INTERVALS / fps);
    // A rate of 0 is none.
    Duration::try_from_secs_f64(interval).map_or(SILENCE_LIMIT, |slow| slow.max(SILENCE_LIMIT))
}

/// The system's words, with the one that users meet explained.
fn describe(error: &io::Error) -> String {
    match error.raw_os_error() {
        Some(libc::ENODEV) => "the camera was unplugged".into(),
        _ => format!("the camera failed ({error})"),
    }
}

//! A source that need not be there yet: it is opened as soon as it is.

use std::time::{Duration, Instant};

use super::error::CaptureError;
use super::frame::Frame;
use super::raw::RawPicture;
use super::source::Source;
use crate::camera::Clock;

/// Longest that one step takes while nothing is there.
const STEP: Duration = Duration::from_millis(250);
/// How often opening is tried.
const TRY_EVERY: Duration = Duration::from_millis(500);

/// A camera that is opened when it comes. Once it was there it is the source's own to find it again.
pub struct AwaitedSource<O, C> {
    open: O,
    name: String,
    clock: C,
    source: Option<Box<dyn Source>>,
    next_try: Instant,
    /// What it is asked for has suited it.
    has_suited: bool,
    /// What was said of its absence.
    said: Option<String>,
}

impl<O, C> AwaitedSource<O, C>
where
    O: FnMut() -> Result<Box<dyn Source>, CaptureError>,
    C: Clock,
{
    /// What `open` opens, from the first call of [`Source::next_into`] on; `name` is what the user calls it.
    pub fn new(name: impl Into<String>, open: O, clock: C) -> Self {
        Self {
            open,
            name: name.into(),
            next_try: clock.now(),
            clock,
            source: None,
            has_suited: false,
            said: None,
        }
    }

    /// One that also waits where the camera lacks what it is asked for, if that `has_suited` the camera before: another
    /// one may be there in its place.
    #[must_use]
    pub fn knowing(mut self, has_suited: bool) -> Self {
        self.has_suited = has_suited;
        self
    }

    /// Whether to wait after this.
    fn may_pass(&self, error: &CaptureError) -> bool {
        match error {
            // A device that has just come is root's alone for a moment.
            CaptureError::Permission { .. } => true,
            CaptureError::Config { .. } => self.has_suited,
            other => other.may_pass(),
        }
    }

    fn try_open(&mut self) -> Result<(), CaptureError> {
        match (self.open)() {
            Ok(source) => {
                if self.said.take().is_some() {
                    tracing::warn!("{}: the camera is there", self.name);
                }
                self.source = Some(source);
                Ok(())
            }
            Err(e) if self.may_pass(&e) => {
                let reason = e.to_string();
                if self.said.as_ref() != Some(&reason) {
                    tracing::warn!("waiting for the camera: {reason}; --no-wait ends instead");
                    self.said = Some(reason);
                }
                self.next_try = self.clock.now() + TRY_EVERY;
                Ok(())
            }
            Err(e) => Err(e),
        }
    }

    /// Tries to open it when it is time, and says why there is no picture yet.
    fn wait(&mut self) -> Result<bool, CaptureError> {
        let left = self.next_try.saturating_duration_since(self.clock.now());
        if left.is_zero() {
            self.try_open()?;
        } else {
            self.clock.sleep(left.min(STEP));
        }
        Err(CaptureError::NoPictureYet {
            device: self.name.clone(),
            reason: self
                .said
                .clone()
                .unwrap_or_else(|| "opened just now".into()),
            is_away: self.source.is_none(),
        })
    }
}

impl<O, C> Source for AwaitedSource<O, C>
where
    O: FnMut() -> Result<Box<dyn Source>, CaptureError> + Send,
    C: Clock,
{
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        if let Some(source) = &mut self.source {
            return source.next_into(frame);
        }
        self.wait()
    }

    fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
        if let Some(source) = &mut self.source {
            return source.next_raw(raw);
        }
        self.wait()
    }

    fn judged(&mut self, failure: Option<&str>) {
        if let Some(source) = &mut self.source {
            source.judged(failure);
        }
    }

    fn fps(&self) -> Option<f64> {
        self.source.as_ref().and_then(|s| s.fps())
    }

    fn is_live(&self) -> bool {
        true
    }

    fn name(&self) -> &str {
        &self.name
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    struct Still;

    impl Source for Still {
        fn next_into(&mut self, _: &mut Frame) -> Result<bool, CaptureError> {
            Ok(true)
        }

        fn name(&self) -> &str {
            "still"
        }
    }

    #[derive(Clone)]
    struct Turned(Arc<Mutex<Instant>>);

    impl Clock for Turned {
        fn now(&self) -> Instant {
            *self.0.lock().unwrap()
        }

        fn sleep(&self, duration: Duration) {
            *self.0.lock().unwrap() += duration;
        }
    }

    fn absent() -> CaptureError {
        CaptureError::Unavailable {
            what: "camera".into(),
            reason: "none".into(),
        }
    }

    #[test]
    fn it_is_tried_until_it_is_there() {
        let clock = Turned(Arc::new(Mutex::new(Instant::now())));
        let mut left = 3;
        let open = move || {
            left -= 1;
            if left > 0 {
                return Err(absent());
            }
            Ok(Box::new(Still) as Box<dyn Source>)
        };
        let start = clock.now();
        let mut source = AwaitedSource::new("camera", open, clock.clone());
        let mut frame = Frame::default();
        let (mut steps, mut away) = (0, Vec::new());
        loop {
            match source.next_into(&mut frame) {
                Ok(more) => break assert!(more),
                Err(CaptureError::NoPictureYet { is_away, .. }) => away.push(is_away),
                Err(e) => panic!("{e}"),
            }
            steps += 1;
        }
        let there = away.pop();
        assert!(there == Some(false) && away.iter().all(|a| *a), "{away:?}");
        assert_eq!(clock.now() - start, 2 * TRY_EVERY);
        assert_eq!(steps, 7, "no step takes longer than its limit");
    }

    #[test]
    fn what_does_not_pass_ends_it() {
        for has_suited in [false, true] {
            let open = || {
                Err(CaptureError::Config {
                    setting: "camera".into(),
                    reason: "no such control".into(),
                })
            };
            let clock = Turned(Arc::new(Mutex::new(Instant::now())));
            let mut source = AwaitedSource::new("camera", open, clock).knowing(has_suited);
            let refused = source.next_into(&mut Frame::default()).unwrap_err();
            // Where it had that control, another camera is there, and it may come back.
            assert_eq!(refused.is_skippable(), has_suited, "{refused}");
        }
    }

    #[test]
    fn a_device_that_is_not_this_users_yet_is_waited_for() {
        let mut left = 2;
        let open = move || {
            left -= 1;
            if left > 0 {
                return Err(CaptureError::Permission {
                    input: "camera".into(),
                    remedy: "ask".into(),
                });
            }
            Ok(Box::new(Still) as Box<dyn Source>)
        };
        let clock = Turned(Arc::new(Mutex::new(Instant::now())));
        let mut source = AwaitedSource::new("camera", open, clock);
        let mut frame = Frame::default();
        let came = (0..10).any(|_| match source.next_into(&mut frame) {
            Ok(more) => more,
            Err(e) => {
                assert!(e.is_skippable(), "{e}");
                false
            }
        });
        assert!(came);
    }
}

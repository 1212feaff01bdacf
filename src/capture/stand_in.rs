//! A camera that a file stands for, so that what happens to cameras can be shown without one.
//!
//! The file is TOML. As long as it exists the camera is plugged in; taken away it is unplugged, put back it is plugged
//! in again. Replace it by renaming another one over it.
//!
//! ```toml
//! film = "clip.y4m"   # what it shows, over and over; the bundled clip when not given
//! fps = 30.0          # pictures are lost while nobody takes them
//! silent = false      # plugged in, but no pictures come
//! ```

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::Deserialize;

use super::demo;
use super::error::{CaptureError, name_of};
use super::frame::Frame;
use super::source::Source;
use super::stored::{open_bytes, open_stored};
use crate::camera::{Clock, monotonic_ns};

/// Longest that one step takes while no picture comes.
const STEP: Duration = Duration::from_millis(100);

/// What the file says.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct State {
    film: Option<PathBuf>,
    fps: f64,
    silent: bool,
}

impl Default for State {
    fn default() -> Self {
        Self {
            film: None,
            fps: 30.0,
            silent: false,
        }
    }
}

/// A camera's stand-in.
pub struct StandIn<C> {
    path: PathBuf,
    name: String,
    clock: C,
    /// `None` while it is unplugged.
    plugged: Option<Plugged>,
    /// Count of the next picture: it goes on when the camera is back.
    next: u64,
}

struct Plugged {
    film: Box<dyn Source>,
    state: State,
    /// When it was plugged in, by both clocks, and the count that its first picture had.
    began: (Instant, u64),
    first: u64,
}

impl<C: Clock> StandIn<C> {
    /// Opens the camera.
    ///
    /// # Errors
    /// [`CaptureError::Unavailable`] where the file is not there, [`CaptureError::Config`] for other content, and those
    /// of its film.
    pub fn open(path: &Path, clock: C) -> Result<Self, CaptureError> {
        let name = name_of(path);
        let state = read(path)?.ok_or_else(|| CaptureError::Unavailable {
            what: name.clone(),
            reason: "expected a camera's stand-in, found no such file; make it".into(),
        })?;
        let mut camera = Self {
            path: path.to_owned(),
            name,
            clock,
            plugged: None,
            next: 0,
        };
        camera.plug_in(state)?;
        Ok(camera)
    }

    fn plug_in(&mut self, state: State) -> Result<(), CaptureError> {
        self.plugged = Some(Plugged {
            film: self.film(&state)?,
            began: (self.clock.now(), monotonic_ns()),
            first: self.next,
            state,
        });
        Ok(())
    }

    fn film(&self, state: &State) -> Result<Box<dyn Source>, CaptureError> {
        match &state.film {
            None => open_bytes("demo", demo::CLIP),
            Some(film) => open_stored(film, None),
        }
    }

    fn away(&self, reason: &str) -> CaptureError {
        self.nothing(reason, true)
    }

    fn nothing(&self, reason: &str, is_away: bool) -> CaptureError {
        CaptureError::NoPictureYet {
            device: self.name.clone(),
            reason: reason.into(),
            is_away,
        }
    }

    /// Follows what the file says now.
    fn look(&mut self) -> Result<(), CaptureError> {
        let now = read(&self.path)?;
        match (&self.plugged, now) {
            (Some(_), None) => {
                tracing::warn!("{}: the camera was unplugged; reconnecting", self.name);
                self.plugged = None;
            }
            (Some(was), Some(now)) if was.state == now => {}
            (Some(_), Some(now)) => self.plug_in(now)?,
            (None, Some(now)) => {
                tracing::info!("{}: camera is back", self.name);
                self.plug_in(now)?;
            }
            (None, None) => {}
        }
        Ok(())
    }
}

impl<C: Clock> Source for StandIn<C> {
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        self.look()?;
        let Some(camera) = &mut self.plugged else {
            self.clock.sleep(STEP);
            return Err(self.away("the camera was unplugged"));
        };
        if camera.state.silent {
            self.clock.sleep(STEP);
            return Err(self.away("no picture yet"));
        }
        let (began, began_ns) = camera.began;
        let interval = Duration::from_secs_f64(1.0 / camera.state.fps);
        let taken_at = |count: u64| interval.mul_f64((count - camera.first) as f64);
        let mut now = self.clock.now() - began;
        let due = taken_at(self.next);
        if now < due {
            self.clock.sleep((due - now).min(STEP));
            now = self.clock.now() - began;
            if now < due {
                return Err(self.nothing("the next picture is not due yet", false));
            }
        }
        // The newest that is due; those before it are lost.
        let newest = camera.first + now.div_duration_f64(interval) as u64;
        let time = began_ns + taken_at(newest.max(self.next)).as_nanos() as u64;
        if !camera.film.next_into(frame)? {
            let state = camera.state.clone();
            let film = self.film(&state)?;
            let Some(camera) = &mut self.plugged else {
                return Ok(false);
            };
            camera.film = film;
            if !camera.film.next_into(frame)? {
                return Ok(false);
            }
        }
        frame.sequence = newest.max(self.next);
        frame.time_ns = time.min(monotonic_ns());
        self.next = frame.sequence + 1;
        Ok(true)
    }

    fn fps(&self) -> Option<f64> {
        self.plugged.as_ref().map(|c| c.state.fps)
    }

    fn is_live(&self) -> bool {
        true
    }

    fn name(&self) -> &str {
        &self.name
    }
}

/// What the file says; `None` where there is none.
fn read(path: &Path) -> Result<Option<State>, CaptureError> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(CaptureError::from_io(path, e)),
    };
    let wrong = |reason: String| CaptureError::Config {
        setting: name_of(path),
        reason,
    };
    let state: State = toml::from_str(&text).map_err(|e| wrong(e.message().to_owned()))?;
    if !(0.1..=100_000.0).contains(&state.fps) {
        return Err(wrong(format!(
            "expected fps from 0.1 to 100000, found {}",
            state.fps
        )));
    }
    Ok(Some(state))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::camera::SystemClock;

    #[test]
    fn it_comes_and_goes_with_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.toml");
        let absent = StandIn::open(&path, SystemClock).err().unwrap();
        assert!(absent.may_pass(), "{absent}");
        fs::write(&path, "fps = 1000.0").unwrap();
        let mut camera = StandIn::open(&path, SystemClock).unwrap();
        let mut frame = Frame::default();
        let take = |camera: &mut StandIn<SystemClock>, frame: &mut Frame| {
            while let Err(e) = camera.next_into(frame) {
                assert!(e.is_skippable(), "{e}");
            }
            (frame.sequence, frame.time_ns)
        };
        let first = take(&mut camera, &mut frame);
        std::thread::sleep(Duration::from_millis(20));
        let second = take(&mut camera, &mut frame);
        assert!(
            second.0 >= first.0 + 20,
            "pictures are lost while nobody takes them"
        );
        assert!(second.1 > first.1 && second.1 <= monotonic_ns());

        fs::write(&path, "fps = 1000.0\nsilent = true").unwrap();
        let is_away =
            |e: CaptureError| matches!(e, CaptureError::NoPictureYet { is_away: true, .. });
        assert!(camera.next_into(&mut frame).is_err_and(is_away));
        fs::remove_file(&path).unwrap();
        assert!(camera.next_into(&mut frame).is_err_and(is_away));
        // Opened just now it has a picture at once, and the next one takes its time.
        fs::write(&path, "fps = 0.5").unwrap();
        take(&mut camera, &mut frame);
        let slow = camera.next_into(&mut frame).unwrap_err();
        assert!(slow.is_skippable() && !is_away(slow));
        fs::write(&path, "fps = 1000.0").unwrap();
        let back = take(&mut camera, &mut frame);
        assert!(back.0 > second.0 && back.1 > second.1);
    }

    #[test]
    fn other_content_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.toml");
        for text in ["fps = 0.0", "rate = 30", "fps"] {
            fs::write(&path, text).unwrap();
            let refused = StandIn::open(&path, SystemClock).err().unwrap();
            assert_eq!(refused.exit_code(), 78, "{refused}");
        }
    }
}

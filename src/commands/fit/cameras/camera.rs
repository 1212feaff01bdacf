//! One camera whose observations are fitted with those of others: whether it sends, and whether it can be combined.

use std::time::{Duration, Instant};

use crate::multiview::live::LeftOut;
use crate::sink::Rhythm;

/// Silence of a camera that is said, where its frames do not come more slowly.
const SAID_AFTER: Duration = Duration::from_secs(1);
/// A camera that has not come at all, or comes and cannot be combined with the others, is spoken of after this.
pub const AWAITED: Duration = Duration::from_secs(5);

/// What is known of a camera besides what it sees.
#[derive(Clone, Default)]
pub struct Camera {
    /// When its frames come.
    pub rhythm: Rhythm,
    /// It said that no more come.
    pub ended: bool,
    /// Size of its pictures, pixels, once it has fitted the calibration.
    pub size: Option<[u32; 2]>,
    /// Its times are those of a file.
    pub is_file: bool,
    /// It was said that it is missing.
    pub said: bool,
    /// Since when its pictures are of another shape or size than the calibration's.
    pub other: Option<Instant>,
    /// That was said.
    pub is_other: bool,
    /// Whether its frames can be combined.
    pub apart: Apart,
}

/// Since when a camera's frames come and are in no instant, and whether that was said.
#[derive(Clone, Copy, Default)]
pub struct Apart {
    since: Option<Instant>,
    said: bool,
}

impl Apart {
    /// What is to be said now, if anything.
    pub fn look(&mut self, why: Option<LeftOut>, now: Instant) -> Option<LeftOut> {
        let Some(why) = why else {
            *self = Self::default();
            return None;
        };
        let since = *self.since.get_or_insert(now);
        if self.said || now.saturating_duration_since(since) < AWAITED {
            return None;
        }
        self.said = true;
        Some(why)
    }
}

impl Camera {
    /// Whether more time has passed without a frame than usually does; of one that has not come at all, since `began`.
    pub fn is_silent(&self, began: Instant, now: Instant) -> bool {
        let is_awaited = || now.saturating_duration_since(began) > AWAITED;
        let is_silent = self.rhythm.is_silent(SAID_AFTER, now);
        is_silent.unwrap_or_else(is_awaited)
    }

    /// Whether it comes, and goes with the calibration.
    pub fn counts(&self, began: Instant, now: Instant) -> bool {
        let comes = !self.ended && !self.is_silent(began, now);
        comes && self.size.is_some() && self.other.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_camera_is_not_missed_between_its_frames() {
        let began = Instant::now();
        let at = |seconds: f64| began + Duration::from_secs_f64(seconds);
        let mut camera = Camera::default();
        assert!(!camera.is_silent(began, at(4.0)) && camera.is_silent(began, at(6.0)));
        for k in 0..3 {
            camera.rhythm.hear(at(10.0 + 2.0 * f64::from(k)));
        }
        assert!(!camera.is_silent(began, at(17.9)));
        assert!(camera.is_silent(began, at(18.1)));
        // A fast one is, and one that was away for long is no slow one.
        camera.rhythm.hear(at(1000.0));
        camera.rhythm.hear(at(1000.1));
        assert!(!camera.is_silent(began, at(1001.0)) && camera.is_silent(began, at(1001.2)));
    }

    #[test]
    fn a_camera_that_cannot_be_combined_is_spoken_of_once() {
        let began = Instant::now();
        let at = |seconds: f64| began + Duration::from_secs_f64(seconds);
        let mut apart = Apart::default();
        let mut look = |why, seconds| apart.look(why, at(seconds));
        let slow = Some(LeftOut::Slow(0.6));
        assert_eq!((look(slow, 0.0), look(slow, 4.9)), (None, None));
        assert_eq!((look(slow, 5.1), look(slow, 60.0)), (slow, None), "once");
        // It was combined in between.
        assert_eq!((look(None, 61.0), look(slow, 62.0)), (None, None));
        let late = Some(LeftOut::Late(1.2));
        assert_eq!(look(late, 67.1), late);
    }
}

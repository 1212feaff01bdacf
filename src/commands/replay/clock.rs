//! When a record's frames are due.

use std::thread;
use std::time::{Duration, Instant};

use crate::record::Times;
use crate::record::clock::{self, RATE};

/// How long a signal may take to be heard.
const LOOK_UP: Duration = Duration::from_millis(100);
/// Between frames whose times say nothing, nanoseconds.
const STILL_NS: u64 = (1e9 / RATE) as u64;

/// The times of a record, brought to this machine's clock.
pub struct Clock {
    speed: f64,
    began: Instant,
    times: clock::Clock,
    /// Usually between two frames, nanoseconds; `None` where times do not rise: then frames are evenly spaced.
    step: Option<u64>,
    /// What of the record was due when it began: its first frame, or of several records the first one of all.
    zero: Option<u64>,
    /// On the clock of the record's beginning.
    newest: Option<u64>,
}

impl Clock {
    /// Of a record that is played so many times as fast, from when it `began`.
    pub fn new(speed: f64, began: Instant, step: Option<u64>, zero: Option<u64>) -> Self {
        Self {
            speed,
            began,
            times: clock::Clock::default(),
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
    pub fn look(&mut self, time: u64) -> u64 {
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
    pub fn next_pass(mut self, now: Instant) -> Self {
        let step = self.step.unwrap_or(STILL_NS);
        let end = self.newest.unwrap_or_default().saturating_add(step);
        let began = self.began + self.after_zero(end);
        Self::new(self.speed, began.max(now), self.step, None)
    }

    /// Waits until a frame is due, or must not be waited for any more, which is asked several times a second.
    pub fn wait(&mut self, frame: &impl Times, mut must_end: impl FnMut() -> bool) {
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
    use crate::record::clock::{Stamp, usual_step};

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

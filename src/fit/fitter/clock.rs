//! In: the times of frames. Out: how much time has passed since the last one, and whether the input started over.

use super::Fitter;
use super::identities::Gone;
use crate::camera::RESTART_NS;
use crate::message::{FLAG_FILE_TIME, ObservationFrame};

/// Shortest and longest step between frames, seconds.
pub(super) const STEP: [f64; 2] = [1e-3, 1.0];
/// Longest interval that a camera's frames may usually have, seconds: what is longer is a gap.
const LONGEST_INTERVAL: f64 = 10.0;

impl Fitter {
    /// Seconds since the last frame; `None` for a stale frame. Starts over where the input did.
    pub(super) fn step(&mut self, frame: &ObservationFrame) -> Option<f64> {
        let Some(last) = self.header else {
            self.slept = 0.0;
            return Some(STEP[0]);
        };
        if self.config.stills {
            self.present.clear();
            self.gone.clear();
            self.forget_floor();
            return Some(STEP[0]);
        }
        let (now, before) = (frame.capture_ns, last.capture_ns);
        if (frame.flags ^ last.flags) & FLAG_FILE_TIME != 0 {
            self.start_over();
            return Some(STEP[0]);
        }
        if now <= before {
            if before - now <= RESTART_NS {
                return None;
            }
            self.start_over();
            return Some(STEP[0]);
        }
        let slept = std::mem::take(&mut self.slept);
        let interval = (now - before) as f64 * 1e-9;
        let dt = interval + slept;
        // Of the first two frames nobody knows whether there is a gap between them.
        let interval = interval.min(LONGEST_INTERVAL);
        let usual = self.interval.replace(interval).unwrap_or(interval);
        if dt - usual > self.config.identity.memory.max(STEP[1]) {
            // The camera is the same: where it was moved meanwhile, feet will contradict the floor.
            self.forget_people();
            return Some(STEP[0]);
        }
        if dt > STEP[1] {
            // A long pause: everybody is somewhere else now, but may be recognised. Those without identity are
            // remembered until the next frame: where frames are so far apart, somebody seen in two of them has been
            // seen often enough.
            self.gone.extend(self.present.drain(..).map(Gone::from));
        }
        Some(dt.max(STEP[0]))
    }

    fn start_over(&mut self) {
        self.slept = 0.0;
        self.interval = None;
        self.forget_people();
        self.forget_floor();
    }

    /// Starts over with nobody.
    fn forget_people(&mut self) {
        self.present.clear();
        self.gone.clear();
        self.counters.restarts += 1;
    }
}

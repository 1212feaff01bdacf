//! The times and the number of a message: what a replay sets anew.

use crate::message::{BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, ObservationFrame};

/// A message that is recorded and replayed.
pub trait Times {
    /// Whether it says that the input has ended.
    fn is_end(&self) -> bool;
    /// Whether it says so of a film. A camera may come back: it ends where its process is started again, too.
    fn is_film_end(&self) -> bool;
    /// Its frame's number.
    fn number(&self) -> u64;
    /// Gives it another number.
    fn renumber(&mut self, number: u64);
    /// When it is due, on the record's own clock: when it was published, or of a file, when it is shown.
    fn due_ns(&self) -> u64;
    /// Lets its times of capture stay, as a file's: those of several cameras go together.
    fn keep_times(&mut self);
    /// Moves its times as if it were published `now`. A file's presentation times stay.
    fn publish_at(&mut self, now: u64);
}

/// `now`, as long before as `time` was before `published`.
fn moved(time: u64, published: u64, now: u64) -> u64 {
    now.saturating_add_signed(time.wrapping_sub(published).cast_signed())
}

impl Times for BodyFrame {
    fn is_end(&self) -> bool {
        self.flags & FLAG_END_OF_STREAM != 0
    }

    fn is_film_end(&self) -> bool {
        self.is_end() && self.flags & FLAG_FILE_TIME != 0
    }

    fn number(&self) -> u64 {
        self.sequence
    }

    fn renumber(&mut self, number: u64) {
        self.sequence = number;
    }

    fn due_ns(&self) -> u64 {
        if self.flags & FLAG_FILE_TIME != 0 || self.publish_ns == 0 {
            self.pose_ns
        } else {
            self.publish_ns
        }
    }

    fn keep_times(&mut self) {
        self.flags |= FLAG_FILE_TIME;
    }

    fn publish_at(&mut self, now: u64) {
        if self.flags & FLAG_FILE_TIME == 0 {
            let due = self.due_ns();
            self.capture_ns = moved(self.capture_ns, due, now);
            self.pose_ns = moved(self.pose_ns, due, now);
        }
        self.publish_ns = now;
    }
}

impl Times for ObservationFrame {
    fn is_end(&self) -> bool {
        self.flags & FLAG_END_OF_STREAM != 0
    }

    fn is_film_end(&self) -> bool {
        self.is_end() && self.flags & FLAG_FILE_TIME != 0
    }

    fn number(&self) -> u64 {
        self.sequence
    }

    fn renumber(&mut self, number: u64) {
        self.sequence = number;
    }

    fn due_ns(&self) -> u64 {
        if self.flags & FLAG_FILE_TIME != 0 || self.publish_ns == 0 {
            self.capture_ns
        } else {
            self.publish_ns
        }
    }

    fn keep_times(&mut self) {
        self.flags |= FLAG_FILE_TIME;
    }

    fn publish_at(&mut self, now: u64) {
        if self.flags & FLAG_FILE_TIME == 0 {
            self.capture_ns = moved(self.capture_ns, self.due_ns(), now);
        }
        self.publish_ns = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_live_frame_keeps_its_latency_and_a_file_s_its_times() {
        let live = BodyFrame {
            capture_ns: 1_000,
            pose_ns: 1_200,
            publish_ns: 1_100,
            ..BodyFrame::default()
        };
        let mut again = live;
        again.publish_at(5_000);
        let times = (again.capture_ns, again.pose_ns, again.publish_ns);
        assert_eq!(times, (4_900, 5_100, 5_000));
        // One that was fitted from a record was never published.
        let mut fitted = BodyFrame {
            publish_ns: 0,
            ..live
        };
        fitted.publish_at(5_000);
        let times = (fitted.capture_ns, fitted.pose_ns, fitted.publish_ns);
        assert_eq!(times, (4_800, 5_000, 5_000));
        let mut film = BodyFrame {
            flags: FLAG_FILE_TIME,
            ..live
        };
        film.publish_at(5_000);
        let times = (film.capture_ns, film.pose_ns, film.publish_ns);
        assert_eq!(times, (1_000, 1_200, 5_000));
        assert_eq!((live.due_ns(), film.due_ns()), (1_100, 1_200));
    }

    #[test]
    fn a_live_frame_whose_times_are_kept_is_due_by_them() {
        let mut live = ObservationFrame {
            capture_ns: 1_000,
            publish_ns: 1_100,
            ..ObservationFrame::default()
        };
        live.keep_times();
        assert_eq!(live.due_ns(), 1_000);
        live.publish_at(5_000);
        assert_eq!((live.capture_ns, live.publish_ns), (1_000, 5_000));
    }
}

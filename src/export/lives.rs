//! Lives of the publisher of a record: with each its ids begin at 1 anew. Frames go in as they were recorded; they come
//! out with ids that belong to one person each.

use crate::camera::RESTART_NS;
use crate::message::{BodyFrame, FLAG_FILE_TIME};

/// Counts the ids of a life on after the highest of those before.
#[derive(Debug, Default)]
pub struct Lives {
    /// What ids of this life are counted from, and the highest of all.
    from: u32,
    highest: u32,
    /// The number of this life's last frame; `None` before its first.
    last: Option<u64>,
    /// The newest time of this life, nanoseconds.
    newest: u64,
}

impl Lives {
    /// Takes in the next frame of the record, whose ids are counted on. Another life begins where numbers go back, or
    /// the times of a camera by more than [`RESTART_NS`].
    pub fn count_on(&mut self, frame: &mut BodyFrame) {
        let counts_anew = self.last.is_some_and(|last| frame.sequence < last);
        // The clock of cameras goes back where the machine was started again. Where a film's times go back, its
        // publisher goes on, and so do ids.
        let goes_back = frame.flags & FLAG_FILE_TIME == 0
            && frame.pose_ns.saturating_add(RESTART_NS) < self.newest;
        if counts_anew || goes_back {
            self.begin_anew();
        }
        self.last = Some(frame.sequence);
        self.newest = self.newest.max(frame.pose_ns);
        let count = frame.bodies().len();
        for body in &mut frame.bodies[..count] {
            body.id = body.id.saturating_add(self.from);
            self.highest = self.highest.max(body.id);
        }
    }

    /// Says that the next frame is another life's, whatever its number and time.
    pub fn begin_anew(&mut self) {
        (self.from, self.last, self.newest) = (self.highest, None, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The id that a recorded 1 becomes.
    fn id(lives: &mut Lives, sequence: u64, seconds: u64, flags: u32) -> u32 {
        let mut frame = BodyFrame {
            sequence,
            pose_ns: seconds * 1_000_000_000,
            flags,
            count: 1,
            ..BodyFrame::default()
        };
        frame.bodies[0].id = 1;
        lives.count_on(&mut frame);
        frame.bodies[0].id
    }

    #[test]
    fn nobody_has_an_id_of_another_life() {
        let lives = &mut Lives::default();
        let first = [id(lives, 70, 10, 0), id(lives, 71, 11, 0)];
        assert_eq!(first, [1, 1]);
        let numbers_go_back = [id(lives, 3, 12, 0), id(lives, 4, 13, 0)];
        assert_eq!(numbers_go_back, [2, 2]);
        let times_go_back = [id(lives, 5, 2, 0), id(lives, 6, 3, 0)];
        assert_eq!(times_go_back, [3, 3]);
        assert_eq!(id(lives, 7, 1, FLAG_FILE_TIME), 3, "a film's may");
        lives.begin_anew();
        assert_eq!([id(lives, 8, 20, 0), id(lives, 9, 21, 0)], [4, 4]);
    }
}

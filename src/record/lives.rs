//! Lives of the publisher of a record: with each its ids begin at 1 anew. Frames go in as they were recorded; they come
//! out with ids that belong to one person each.
//!
//! Where a publisher ends another life may begin, or one that counts on by itself may follow, as where `run` starts its
//! `fit` again: which of the two the ids tell.

use crate::camera::RESTART_NS;
use crate::message::{Body, BodyFrame, FLAG_FILE_TIME};

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
    /// The highest id, as recorded, of those before the last end in this life: whoever has one of these after it is
    /// somebody else.
    taken: u32,
}

impl Lives {
    /// Takes in the next frame of the record, whose ids are counted on; whether another life begins with it: where
    /// numbers go back, or the times of a camera by more than [`RESTART_NS`], or where after an end somebody has an id
    /// that was there before it.
    pub fn count_on(&mut self, frame: &mut BodyFrame) -> bool {
        let counts_anew = self.last.is_some_and(|last| frame.sequence < last);
        // The clock of cameras goes back where the machine was started again. Where a film's times go back, its
        // publisher goes on, and so do ids.
        let goes_back = frame.flags & FLAG_FILE_TIME == 0
            && frame.pose_ns.saturating_add(RESTART_NS) < self.newest;
        let is_taken = |body: &Body| (1..=self.taken).contains(&body.id);
        let gives_again = frame.bodies().iter().any(is_taken);
        let begins_anew = counts_anew || goes_back || gives_again;
        if begins_anew {
            self.begin_anew();
        }
        self.last = Some(frame.sequence);
        self.newest = self.newest.max(frame.pose_ns);
        let count = frame.bodies().len();
        for body in &mut frame.bodies[..count] {
            body.id = body.id.saturating_add(self.from);
            self.highest = self.highest.max(body.id);
        }
        begins_anew
    }

    /// What the id of somebody in the newest frame is in the record.
    pub fn recorded(&self, id: u32) -> u32 {
        id.saturating_sub(self.from)
    }

    /// Says that the next frame is another life's, whatever its number, its time and its ids.
    pub fn begin_anew(&mut self) {
        *self = Self {
            from: self.highest,
            highest: self.highest,
            ..Self::default()
        };
    }

    /// Says that a publisher has ended: nobody of before is there any more.
    pub fn end(&mut self) {
        self.taken = self.highest - self.from;
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

    #[test]
    fn after_an_end_ids_are_counted_on_where_they_begin_anew_and_nowhere_else() {
        // Of one person a frame, and where there is none an end; each life's numbers and times go on.
        let counted = |recorded: &[Option<u32>]| -> Vec<u32> {
            let mut lives = Lives::default();
            let frames = (0..).zip(recorded).filter_map(|(sequence, id)| {
                let Some(id) = *id else {
                    lives.end();
                    return None;
                };
                let mut frame = BodyFrame {
                    sequence,
                    count: 1,
                    ..BodyFrame::default()
                };
                frame.bodies[0].id = id;
                lives.count_on(&mut frame);
                Some(frame.bodies[0].id)
            });
            frames.collect()
        };
        let end = None;
        let goes_on = [Some(1), Some(2), end, Some(3), Some(3)];
        assert_eq!(counted(&goes_on), [1, 2, 3, 3]);
        let begins_anew = [Some(1), Some(2), end, Some(1), Some(2)];
        assert_eq!(counted(&begins_anew), [1, 2, 3, 4]);
        let both = [Some(1), end, Some(2), end, Some(1), end, Some(2)];
        assert_eq!(counted(&both), [1, 2, 3, 4]);
        // The first of another life to be published need not be the first that it has seen.
        assert_eq!(counted(&[Some(2), end, Some(3), Some(1)]), [2, 3, 4]);
    }
}

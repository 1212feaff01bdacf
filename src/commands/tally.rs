//! What a reader of bodies has received.

use edgecap_client::message::BodyFrame;

/// What was received so far.
#[derive(Debug, Default)]
pub struct Tally {
    /// Messages.
    pub frames: u64,
    /// Frames that were left out between them.
    pub left_out: u64,
    last_sequence: Option<u64>,
    /// How many people were in them.
    pub people: u64,
    /// The highest id: they count up, so that not all need be kept for months.
    newest: u32,
}

impl Tally {
    /// Takes in one message.
    pub fn count(&mut self, frame: &BodyFrame) {
        if let Some(last) = self.last_sequence
            && frame.sequence > last
        {
            self.left_out += frame.sequence - last - 1;
        }
        self.last_sequence = Some(frame.sequence);
        self.frames += 1;
        let ids = frame.bodies().iter().map(|b| b.id);
        self.people += ids.clone().filter(|id| *id > self.newest).count() as u64;
        self.newest = ids.fold(self.newest, u32::max);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(sequence: u64, ids: &[u32]) -> BodyFrame {
        let mut frame = BodyFrame {
            sequence,
            count: ids.len() as u32,
            ..BodyFrame::default()
        };
        for (body, id) in frame.bodies.iter_mut().zip(ids) {
            body.id = *id;
        }
        frame
    }

    #[test]
    fn people_are_counted_once_whatever_is_started_again() {
        let mut tally = Tally::default();
        tally.count(&frame(0, &[1, 2]));
        tally.count(&frame(1, &[3, 1, 2]));
        // The camera's process was started again, and whoever is there is known.
        tally.count(&frame(0, &[2, 3]));
        assert_eq!(tally.people, 3);
        // Another `fit` gives other ids.
        tally.count(&frame(5, &[4]));
        tally.count(&frame(6, &[4]));
        assert_eq!((tally.people, tally.frames, tally.left_out), (4, 5, 4));
    }
}

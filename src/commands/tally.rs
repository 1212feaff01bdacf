//! What a reader of bodies has received.

use std::collections::BTreeSet;

use edgecap_client::message::BodyFrame;

/// What was received so far.
#[derive(Debug, Default)]
pub struct Tally {
    /// Messages.
    pub frames: u64,
    /// Frames that were left out between them.
    pub lost: u64,
    last_sequence: Option<u64>,
    /// Everybody who was in one.
    pub ids: BTreeSet<u32>,
}

impl Tally {
    /// Takes in one message.
    pub fn count(&mut self, frame: &BodyFrame) {
        if let Some(last) = self.last_sequence
            && frame.sequence > last
        {
            self.lost += frame.sequence - last - 1;
        }
        self.last_sequence = Some(frame.sequence);
        self.frames += 1;
        self.ids.extend(frame.bodies().iter().map(|b| b.id));
    }
}

//! What waits for one client: the newest frame of each camera. A client that is too slow loses what was replaced.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::Packet;

/// The newest frames that a client has not taken, one a camera, in the order in which they came.
#[derive(Debug, Default)]
pub struct Mailbox {
    waiting: Mutex<Waiting>,
    arrived: Condvar,
}

#[derive(Debug, Default)]
struct Waiting {
    packets: Vec<Arc<Packet>>,
    replaced: u64,
}

impl Mailbox {
    /// Puts a frame in, in place of an older one of the same camera.
    pub fn put(&self, packet: &Arc<Packet>) {
        let mut waiting = self.lock();
        let before = waiting.packets.len();
        waiting.packets.retain(|p| p.camera() != packet.camera());
        waiting.replaced += (before - waiting.packets.len()) as u64;
        waiting.packets.push(Arc::clone(packet));
        self.arrived.notify_one();
    }

    /// Takes the frame that waits longest; waits up to `patience` for one.
    pub fn take(&self, patience: Duration) -> Option<Arc<Packet>> {
        let waiting = self.lock();
        let waited = self
            .arrived
            .wait_timeout_while(waiting, patience, |w| w.packets.is_empty());
        let (mut waiting, _) = waited.unwrap_or_else(PoisonError::into_inner);
        (!waiting.packets.is_empty()).then(|| waiting.packets.remove(0))
    }

    /// Frames that this client has lost.
    pub fn replaced(&self) -> u64 {
        self.lock().replaced
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::BodyFrame;

    #[test]
    fn a_newer_frame_replaces_its_own_camera_s() {
        let mailbox = Mailbox::default();
        let packet = |camera: &str, sequence| {
            let frame = BodyFrame {
                sequence,
                ..BodyFrame::default()
            };
            Arc::new(Packet::new(camera, &frame))
        };
        for (camera, sequence) in [("a", 0), ("b", 0), ("a", 1), ("a", 2)] {
            mailbox.put(&packet(camera, sequence));
        }
        let mut taken = Vec::new();
        while let Some(p) = mailbox.take(Duration::ZERO) {
            taken.push((p.camera().to_owned(), p.binary()[8]));
        }
        assert_eq!(taken, [("b".to_owned(), 0), ("a".to_owned(), 2)]);
        assert_eq!(mailbox.replaced(), 2);
    }
}

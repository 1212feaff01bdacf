//! What waits for one client. Nobody waits for a client that is too slow: it loses what has to make room.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Events that wait for a client; more of them lose the oldest.
const MOST_WAITING: usize = 1024;

/// What a client has not taken, in the order in which it came.
#[derive(Debug)]
pub struct Mailbox<T> {
    waiting: Mutex<Waiting<T>>,
    arrived: Condvar,
}

#[derive(Debug)]
struct Waiting<T> {
    items: VecDeque<T>,
    lost: u64,
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Self {
            waiting: Mutex::new(Waiting {
                items: VecDeque::new(),
                lost: 0,
            }),
            arrived: Condvar::new(),
        }
    }
}

/// What a newer one of the same camera takes the place of.
pub trait OfCamera {
    /// Whose it is.
    fn camera(&self) -> &str;
}

impl<T: OfCamera> Mailbox<Arc<T>> {
    /// Puts something in, in place of what waits of the same camera: behind the others a camera that publishes often
    /// would never have its turn.
    pub fn replace(&self, item: &Arc<T>) {
        let mut waiting = self.lock();
        let waiting = &mut *waiting;
        let is_same = |other: &&mut Arc<T>| other.camera() == item.camera();
        match waiting.items.iter_mut().find(is_same) {
            Some(older) => {
                *older = Arc::clone(item);
                waiting.lost += 1;
            }
            None => waiting.items.push_back(Arc::clone(item)),
        }
        self.arrived.notify_one();
    }
}

impl<T> Mailbox<T> {
    /// Puts something in behind what waits.
    pub fn queue(&self, item: T) {
        let mut waiting = self.lock();
        while waiting.items.len() >= MOST_WAITING {
            waiting.items.pop_front();
            waiting.lost += 1;
        }
        waiting.items.push_back(item);
        self.arrived.notify_one();
    }

    /// Takes what waits longest; waits up to `patience` for something.
    pub fn take(&self, patience: Duration) -> Option<T> {
        let waiting = self.lock();
        let waited = self
            .arrived
            .wait_timeout_while(waiting, patience, |w| w.items.is_empty());
        let (mut waiting, _) = waited.unwrap_or_else(PoisonError::into_inner);
        waiting.items.pop_front()
    }

    /// How much this client has lost.
    pub fn lost(&self) -> u64 {
        self.lock().lost
    }

    fn lock(&self) -> MutexGuard<'_, Waiting<T>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Packet;
    use super::*;
    use crate::message::BodyFrame;

    #[test]
    fn a_newer_frame_takes_the_place_of_its_own_camera_s() {
        let mailbox = Mailbox::default();
        let packet = |camera: &str, sequence| {
            let frame = BodyFrame {
                sequence,
                ..BodyFrame::default()
            };
            Arc::new(Packet::new(camera, &frame))
        };
        for (camera, sequence) in [("a", 0), ("b", 0), ("a", 1), ("a", 2)] {
            mailbox.replace(&packet(camera, sequence));
        }
        let mut taken = Vec::new();
        while let Some(p) = mailbox.take(Duration::ZERO) {
            taken.push((p.camera().to_owned(), p.binary()[8]));
        }
        assert_eq!(taken, [("a".to_owned(), 2), ("b".to_owned(), 0)]);
        assert_eq!(mailbox.lost(), 2);
    }

    #[test]
    fn a_queue_keeps_the_newest() {
        let mailbox = Mailbox::default();
        for n in 0..MOST_WAITING + 3 {
            mailbox.queue(n);
        }
        let taken = std::iter::from_fn(|| mailbox.take(Duration::ZERO));
        assert!(taken.eq(3..MOST_WAITING + 3));
        assert_eq!(mailbox.lost(), 3);
    }
}

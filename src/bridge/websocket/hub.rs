//! Joins who publishes with the clients that are connected.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use tungstenite::Bytes;

use super::client::{Client, handshake};
use super::mailbox::Mailbox;
use super::packet::Packet;
use super::sink::HubSink;
use crate::http::{Answer, Request};
use crate::message::BodyFrame;

/// Most bytes of the kept past, whatever the time.
const MOST_HISTORY: usize = 64 << 20;

/// Frames of all cameras go in; every client gets them. A handle: its clones are the same hub.
#[derive(Debug, Clone)]
pub struct Hub(Arc<Mutex<Inner>>);

#[derive(Debug)]
struct Inner {
    clients: Vec<(Option<String>, Weak<Mailbox>)>,
    history: VecDeque<(Instant, Bytes)>,
    bytes: usize,
    keep: Duration,
}

impl Hub {
    /// Keeps the past of so long for clients that come later; zero: none.
    pub fn new(keep: Duration) -> Self {
        Self(Arc::new(Mutex::new(Inner {
            clients: Vec::new(),
            history: VecDeque::new(),
            bytes: 0,
            keep,
        })))
    }

    /// Hands a frame to everybody. Never waits for a client.
    pub fn publish(&self, camera: &str, frame: &BodyFrame) {
        let mut inner = self.lock();
        if inner.clients.is_empty() && inner.keep.is_zero() {
            return;
        }
        let packet = Arc::new(Packet::new(camera, frame));
        inner.clients.retain(|(wanted, mailbox)| {
            let Some(mailbox) = mailbox.upgrade() else {
                return false;
            };
            if wanted.as_ref().is_none_or(|w| w == camera) {
                mailbox.put(&packet);
            }
            true
        });
        if !inner.keep.is_zero() && !packet.is_end() {
            inner.remember(packet.binary());
        }
    }

    /// Where one camera's frames go in.
    pub fn sink(&self, camera: &str) -> HubSink {
        HubSink {
            hub: self.clone(),
            camera: camera.to_owned(),
        }
    }

    /// What a request for bodies gets: a stream, or why there is none.
    pub fn answer(&self, request: &Request) -> Answer {
        if request.path != "/bodies" {
            let line = "bodies are at /bodies, over WebSocket";
            return Answer::refusal("404 Not Found", line);
        }
        let client = match Client::of(request) {
            Ok(client) => client,
            Err(refused) => return refused,
        };
        let hub = self.clone();
        let answer = match handshake(request) {
            Ok(answer) => answer,
            Err(refused) => return refused,
        };
        Answer::Stream(Box::new(move |stream, ends| {
            let (mailbox, past) = hub.join(&client);
            client.serve(stream, &answer, past, &mailbox, &ends);
        }))
    }

    /// A client's place, and what it is to see of the past.
    fn join(&self, client: &Client) -> (Arc<Mailbox>, Vec<Bytes>) {
        let mailbox = Arc::new(Mailbox::default());
        let mut inner = self.lock();
        let place = (client.camera.clone(), Arc::downgrade(&mailbox));
        inner.clients.push(place);
        let past = inner.history.iter().map(|(_, bytes)| bytes.clone());
        let past = past.filter(|_| client.wants_history).collect();
        (mailbox, past)
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    fn remember(&mut self, bytes: Bytes) {
        self.bytes += bytes.len();
        self.history.push_back((Instant::now(), bytes));
        while let Some((at, oldest)) = self.history.front()
            && (at.elapsed() > self.keep || self.bytes > MOST_HISTORY)
        {
            self.bytes -= oldest.len();
            self.history.pop_front();
        }
    }
}

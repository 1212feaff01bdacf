//! Joins who publishes with the clients that are connected.

use std::hash::{BuildHasher, RandomState};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use tungstenite::{Bytes, Message};

use super::binary;
use super::client::{Client, Line, handshake};
use super::history::History;
use super::mailbox::{Mailbox, OfCamera};
use super::packet::Packet;
use super::report::Report;
use super::sink::{HealthSink, HubSink};
use crate::events;
use crate::http::{Answer, Request};
use crate::message::{BodyFrame, EventFrame, HealthFrame, PictureFrame};

/// Frames and events of all cameras go in, and how these are doing; every client gets what it wants of them. A handle:
/// its clones are the same hub.
#[derive(Debug, Clone)]
pub struct Hub(Arc<Mutex<Inner>>);

/// The least time between two frames of a camera, nanoseconds: the page tells them apart by when they were published,
/// in numbers that after months of uptime no longer hold one.
pub const APART: u64 = 1000;

/// What a client that wants a mark is sent after the past, as text.
const MARK: &str = "now";

/// What serves one client.
type Serve = Box<dyn FnOnce(Line<'_>) + Send>;

/// A picture on its way to those who look.
#[derive(Debug)]
struct Picture {
    camera: String,
    bytes: Bytes,
}

impl OfCamera for Picture {
    fn camera(&self) -> &str {
        &self.camera
    }
}

/// A client's mailbox, for as long as it is there, and the one camera that it wants.
#[derive(Debug)]
struct Place<T> {
    camera: Option<String>,
    mailbox: Weak<Mailbox<T>>,
}

#[derive(Debug)]
struct Inner {
    clients: Vec<Place<Arc<Packet>>>,
    /// Those of events; `true`: in binary.
    listeners: Vec<(Place<Message>, bool)>,
    /// Those of how cameras are doing.
    watchers: Vec<Place<Arc<Report>>>,
    /// Those of pictures; `None`: there are none to be had.
    viewers: Option<Vec<Place<Arc<Picture>>>>,
    history: History,
    /// What has happened in a record, oldest first.
    happened: Vec<Happened>,
    /// A record is still read: of a part of it nobody is told.
    is_loading: bool,
    /// Another one is another server.
    id: u64,
}

/// What has happened by a frame of a camera, as messages.
#[derive(Debug)]
struct Happened {
    camera: String,
    /// One an event.
    json: Vec<Message>,
    /// One for all events.
    binary: Message,
}

impl Happened {
    fn new(camera: &str, frame: &EventFrame) -> Self {
        let lines = events::Line::all(camera, frame);
        Self {
            camera: camera.to_owned(),
            json: lines.map(|line| Message::text(line.json())).collect(),
            binary: Message::binary(binary::encode_events(camera, frame)),
        }
    }

    fn messages(&self, is_binary: bool) -> &[Message] {
        match is_binary {
            true => std::slice::from_ref(&self.binary),
            false => &self.json,
        }
    }
}

impl Hub {
    /// Keeps the past of so long for clients that come later; zero: none, [`Duration::MAX`]: a record, which is there
    /// for them once it is [`loaded`](Self::loaded). Pictures go to nobody unless the user `shows` them.
    pub fn new(keep: Duration, shows: bool) -> Self {
        Self(Arc::new(Mutex::new(Inner {
            clients: Vec::new(),
            listeners: Vec::new(),
            watchers: Vec::new(),
            viewers: shows.then(Vec::new),
            history: History::new(keep),
            happened: Vec::new(),
            is_loading: keep == Duration::MAX,
            // Keyed by the system's random numbers.
            id: RandomState::new().hash_one(keep),
        })))
    }

    /// Hands a frame to everybody. Never waits for a client.
    pub fn publish(&self, camera: &str, frame: &BodyFrame) {
        let mut inner = self.lock();
        if inner.clients.is_empty() && inner.history.keep().is_zero() {
            return;
        }
        let packet = Arc::new(Packet::new(camera, frame));
        inner
            .clients
            .retain(|place| place.put(camera, |mailbox| mailbox.replace(&packet)));
        // Who comes after a camera's end hears of it; a record is shown to its last frame.
        let keep = inner.history.keep();
        if !keep.is_zero() && (keep != Duration::MAX || !packet.is_end()) {
            inner
                .history
                .remember(Instant::now(), camera, packet.binary());
        }
    }

    /// Nobody is shown any more where no frame has come after the `newest` for a while.
    pub fn quiet(&self, camera: &str, newest: &mut BodyFrame) {
        if newest.count > 0 {
            newest.count = 0;
            newest.publish_ns += APART;
            self.publish(camera, newest);
        }
    }

    /// All of a record has been published.
    pub fn loaded(&self) {
        self.lock().is_loading = false;
    }

    /// Of a record that is kept, every so-manieth frame is: 1 where there is room for all.
    pub fn kept_every(&self) -> u64 {
        self.lock().history.every()
    }

    /// Hands what has happened to everybody who listens, and of a record to who comes later.
    pub fn tell(&self, camera: &str, frame: &EventFrame) {
        if frame.count == 0 {
            return;
        }
        let happened = Happened::new(camera, frame);
        let mut inner = self.lock();
        inner.listeners.retain(|(place, is_binary)| {
            place.put(camera, |mailbox| {
                let messages = happened.messages(*is_binary);
                messages.iter().for_each(|m| mailbox.queue(m.clone()));
            })
        });
        if inner.history.keep() == Duration::MAX {
            inner.happened.push(happened);
        }
    }

    /// Hands on how a camera is doing to everybody who watches; one that is too slow gets the newest.
    pub fn report(&self, camera: &str, health: &HealthFrame) {
        let watchers = &mut self.lock().watchers;
        if watchers.is_empty() {
            return;
        }
        let report = Arc::new(Report::new(camera, health));
        watchers.retain(|place| place.put(camera, |mailbox| mailbox.replace(&report)));
    }

    /// Whether pictures go to anybody.
    pub fn shows_pictures(&self) -> bool {
        self.lock().viewers.is_some()
    }

    /// Hands a camera's picture to everybody who looks, if the user shows them; one that is too slow gets the newest.
    pub fn show(&self, camera: &str, picture: &PictureFrame) {
        let Some(viewers) = &mut self.lock().viewers else {
            return;
        };
        let bytes = Bytes::from(binary::encode_picture(camera, picture));
        let picture = Arc::new(Picture {
            camera: camera.to_owned(),
            bytes,
        });
        viewers.retain(|place| place.put(camera, |mailbox| mailbox.replace(&picture)));
    }

    /// Where one camera's frames go in.
    pub fn sink(&self, camera: &str) -> HubSink {
        HubSink {
            hub: self.clone(),
            camera: camera.to_owned(),
            newest: Box::default(),
        }
    }

    /// Where goes in how one camera is doing.
    pub fn health_sink(&self, camera: &str) -> HealthSink {
        HealthSink {
            hub: self.clone(),
            camera: camera.to_owned(),
            newest: HealthFrame::default(),
        }
    }

    /// What a request for bodies, events, health or pictures gets: a stream, or why there is none.
    pub fn answer(&self, request: &Request) -> Answer {
        let path = &*request.path;
        if path == "/features" {
            return self.features(request.is_full);
        }
        if !["/bodies", "/events", "/health", "/pictures"].contains(&path) {
            let line = "bodies are at /bodies, events at /events, and how cameras are doing at /health, over WebSocket";
            return Answer::refusal("404 Not Found", line);
        }
        if path == "/pictures" && !self.shows_pictures() {
            let line = "pictures are shown to nobody: --show-picture was not given";
            return Answer::refusal("404 Not Found", line);
        }
        if self.lock().is_loading {
            let line = "the record is still read: ask again in a second";
            return Answer::refusal("503 Service Unavailable", line);
        }
        let both = Client::of(request).and_then(|client| Ok((client, handshake(request)?)));
        let (client, answer) = match both {
            Ok(both) => both,
            Err(refused) => return refused,
        };
        if path != "/bodies" && !client.history.is_zero() {
            let line =
                "history=1: expected at /bodies; what has happened in a record comes unasked";
            return Answer::refusal("400 Bad Request", line);
        }
        if path == "/health" && client.is_binary {
            let line = "format=binary: how cameras are doing comes as JSON alone";
            return Answer::refusal("400 Bad Request", line);
        }
        let hub = self.clone();
        let serve: Serve = match path {
            "/bodies" => Box::new(move |line| hub.serve_bodies(&client, line)),
            "/events" => Box::new(move |line| hub.serve_events(&client, line)),
            "/health" => Box::new(move |line| hub.serve_health(&client, line)),
            _ => Box::new(move |line| hub.serve_pictures(&client, line)),
        };
        Answer::Stream(Box::new(move |stream, ends| {
            serve(Line {
                stream,
                answer: &answer,
                ends: &ends,
            });
        }))
    }

    /// What the page may show; `is_full`: a stream more is not to be had.
    fn features(&self, is_full: bool) -> Answer {
        let pictures = self.shows_pictures();
        // Of a record, which is kept for ever, the page keeps all as well.
        let (keep, loading, id) = {
            let inner = self.lock();
            (inner.history.keep(), inner.is_loading, inner.id)
        };
        let (recorded, seconds) = (keep == Duration::MAX, keep.as_secs().min(u32::MAX.into()));
        Answer::Body {
            status: "200 OK",
            kind: "application/json",
            headers: &[("Cache-Control", "no-store")],
            body: format!(
                "{{\"pictures\":{pictures},\"recorded\":{recorded},\"loading\":{loading},\"full\":{is_full},\
                 \"seconds\":{seconds},\"server\":\"{id:016x}\"}}\n"
            )
            .into_bytes()
            .into(),
        }
    }

    fn serve_bodies(&self, client: &Client, line: Line<'_>) {
        let (mailbox, past) = self.join(client, Instant::now());
        let take = |patience| {
            let packet: Arc<Packet> = mailbox.take(patience)?;
            Some(match client.is_binary {
                true => Message::Binary(packet.binary()),
                false => Message::Text(packet.json()),
            })
        };
        line.serve(past, &take);
        say_lost("frames", mailbox.lost());
    }

    fn serve_events(&self, client: &Client, line: Line<'_>) {
        let (mailbox, past) = self.listen(client);
        line.serve(past, &|patience| mailbox.take(patience));
        say_lost("events", mailbox.lost());
    }

    fn serve_health(&self, client: &Client, line: Line<'_>) {
        let mailbox = self.watch(client);
        let take = |patience| {
            let report: Arc<Report> = mailbox.take(patience)?;
            Some(Message::Text(report.json()))
        };
        line.serve(Vec::new(), &take);
    }

    fn serve_pictures(&self, client: &Client, line: Line<'_>) {
        let mailbox = self.look(client);
        let take = |patience| {
            let picture: Arc<Picture> = mailbox.take(patience)?;
            Some(Message::Binary(picture.bytes.clone()))
        };
        line.serve(Vec::new(), &take);
    }

    /// A client's place, and what it is to see of the past: nothing old, however long no frame has come.
    fn join(&self, client: &Client, now: Instant) -> (Arc<Mailbox<Arc<Packet>>>, Vec<Message>) {
        let mailbox = Arc::new(Mailbox::default());
        let mut inner = self.lock();
        inner.clients.retain(Place::is_taken);
        inner.clients.push(Place::new(client, &mailbox));
        let past: Vec<Message> = match client.history {
            Duration::ZERO => Vec::new(),
            within => {
                let past = inner.history.frames(now, within, client.camera.as_deref());
                past.map(|bytes| Message::Binary(bytes.clone())).collect()
            }
        };
        let mark = client.wants_mark.then(|| Message::text(MARK));
        (mailbox, past.into_iter().chain(mark).collect())
    }

    /// The place of a client of events, and what it is to hear of the past.
    fn listen(&self, client: &Client) -> (Arc<Mailbox<Message>>, Vec<Message>) {
        let mailbox = Arc::new(Mailbox::default());
        let mut inner = self.lock();
        inner.listeners.retain(|(place, _)| place.is_taken());
        let place = Place::new(client, &mailbox);
        inner.listeners.push((place, client.is_binary));
        let camera = client.camera.as_ref();
        let past = inner.happened.iter();
        let past = past.filter(|h| camera.is_none_or(|wanted| *wanted == h.camera));
        let past = past.flat_map(|h| h.messages(client.is_binary).iter().cloned());
        let past = past.collect();
        (mailbox, past)
    }

    /// The place of a client that hears how cameras are doing: of each within a second.
    fn watch(&self, client: &Client) -> Arc<Mailbox<Arc<Report>>> {
        let mailbox = Arc::new(Mailbox::default());
        let watchers = &mut self.lock().watchers;
        watchers.retain(Place::is_taken);
        watchers.push(Place::new(client, &mailbox));
        mailbox
    }

    /// The place of a client of pictures.
    fn look(&self, client: &Client) -> Arc<Mailbox<Arc<Picture>>> {
        let mailbox = Arc::new(Mailbox::default());
        if let Some(viewers) = &mut self.lock().viewers {
            viewers.retain(Place::is_taken);
            viewers.push(Place::new(client, &mailbox));
        }
        mailbox
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn say_lost(what: &str, lost: u64) {
    if lost > 0 {
        tracing::debug!("a client was too slow for {lost} {what}");
    }
}

impl<T> Place<T> {
    fn new(client: &Client, mailbox: &Arc<Mailbox<T>>) -> Self {
        Self {
            camera: client.camera.clone(),
            mailbox: Arc::downgrade(mailbox),
        }
    }

    /// Whether the client is still there. Who comes looks for it, too: where nothing is published nobody else does.
    fn is_taken(&self) -> bool {
        self.mailbox.strong_count() > 0
    }

    /// Lets `put` fill it where it wants this camera; whether the client is still there.
    fn put(&self, camera: &str, put: impl FnOnce(&Mailbox<T>)) -> bool {
        let Some(mailbox) = self.mailbox.upgrade() else {
            return false;
        };
        if self.camera.as_ref().is_none_or(|wanted| wanted == camera) {
            put(&mailbox);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::FLAG_END_OF_STREAM;

    #[test]
    fn who_wants_one_camera_gets_the_past_of_that_one() {
        let hub = Hub::new(Duration::from_secs(60), false);
        for camera in ["hall", "door", "hall"] {
            hub.publish(camera, &BodyFrame::default());
        }
        let past = |camera: Option<&str>| {
            let client = Client {
                camera: camera.map(ToOwned::to_owned),
                history: Duration::MAX,
                wants_mark: false,
                is_binary: true,
            };
            hub.join(&client, Instant::now()).1.len()
        };
        assert_eq!(
            [None, Some("hall"), Some("door"), Some("attic")].map(past),
            [3, 2, 1, 0]
        );
    }

    #[test]
    fn who_comes_again_gets_what_it_has_missed_and_a_mark() {
        let minute = Duration::from_secs(60);
        let hub = Hub::new(minute, false);
        hub.publish("hall", &BodyFrame::default());
        let now = Instant::now();
        let past = |history, wants_mark, ago| {
            let client = Client {
                camera: None,
                history,
                wants_mark,
                is_binary: true,
            };
            let (_, past) = hub.join(&client, now + ago);
            let is_mark = |m: &Message| *m == Message::text(MARK);
            (past.len(), past.last().is_some_and(is_mark))
        };
        let [soon, late] = [3, 20].map(Duration::from_secs);
        let ten = Duration::from_secs(10);
        for (history, ago, frames) in [(ten, soon, 1), (ten, late, 0), (Duration::MAX, late, 1)] {
            assert_eq!(past(history, false, ago), (frames, false));
            assert_eq!(past(history, true, ago), (frames + 1, true));
        }
        assert_eq!(past(Duration::ZERO, false, soon), (0, false));
    }

    #[test]
    fn who_has_gone_leaves_no_place_behind_where_nothing_is_published() {
        let hub = Hub::new(Duration::ZERO, true);
        let client = Client {
            camera: None,
            history: Duration::ZERO,
            wants_mark: false,
            is_binary: false,
        };
        let stays = (
            hub.join(&client, Instant::now()),
            hub.listen(&client),
            hub.watch(&client),
            hub.look(&client),
        );
        for _ in 0..100 {
            hub.join(&client, Instant::now());
            hub.listen(&client);
            hub.watch(&client);
            hub.look(&client);
        }
        let inner = hub.lock();
        let viewers = inner.viewers.as_ref().unwrap().len();
        // Who stays, and who came last.
        let (listeners, watchers) = (inner.listeners.len(), inner.watchers.len());
        let places = [inner.clients.len(), listeners, watchers, viewers];
        assert_eq!(places, [2; 4]);
        drop((inner, stays));
    }

    #[test]
    fn a_silence_has_a_moment_of_its_own() {
        let hub = Hub::new(Duration::from_secs(60), false);
        // On a machine that has been up for half a year.
        let mut newest = BodyFrame {
            count: 1,
            publish_ns: 15_768_000_000_000_001,
            ..BodyFrame::default()
        };
        hub.publish("hall", &newest);
        hub.quiet("hall", &mut newest);
        let client = Client {
            camera: None,
            history: Duration::MAX,
            wants_mark: false,
            is_binary: true,
        };
        let (_, past) = hub.join(&client, Instant::now());
        let [shown, silent] = [0, 1].map(|k| {
            let bytes = past[k].clone().into_data();
            // A number as the page has it.
            u64::from_le_bytes(bytes[32..40].try_into().unwrap()) as f64
        });
        assert!(shown < silent, "{shown} and {silent}");
    }

    #[test]
    fn who_comes_after_the_end_of_a_camera_hears_of_it() {
        let minute = Duration::from_secs(60);
        for (keep, kept) in [(minute, 2), (Duration::MAX, 1), (Duration::ZERO, 0)] {
            let hub = Hub::new(keep, false);
            let mut frame = BodyFrame {
                count: 1,
                ..BodyFrame::default()
            };
            hub.publish("hall", &frame);
            (frame.count, frame.flags) = (0, FLAG_END_OF_STREAM);
            hub.publish("hall", &frame);
            let client = Client {
                camera: None,
                history: Duration::MAX,
                wants_mark: false,
                is_binary: true,
            };
            let (_, past) = hub.join(&client, Instant::now());
            // Flags and people, where the page reads them.
            let read = |message: Message| {
                let bytes = message.into_data();
                [bytes[84], bytes[6]]
            };
            let past: Vec<[u8; 2]> = past.into_iter().map(read).collect();
            assert_eq!(past, [[0, 1], [1, 0]][..kept]);
        }
    }

    #[test]
    fn who_comes_after_a_silence_sees_nothing_old_but_all_of_a_record() {
        let client = Client {
            camera: None,
            history: Duration::MAX,
            wants_mark: false,
            is_binary: true,
        };
        let minute = Duration::from_secs(60);
        for (keep, kept_after) in [(minute, [1, 0]), (Duration::MAX, [1, 1])] {
            let hub = Hub::new(keep, false);
            hub.publish("hall", &BodyFrame::default());
            let now = Instant::now();
            let past = |later| hub.join(&client, now + later).1.len();
            assert_eq!([Duration::ZERO, 2 * minute].map(past), kept_after);
        }
    }
}

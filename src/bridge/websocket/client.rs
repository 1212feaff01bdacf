//! One client: what it wants, and its connection from the handshake to the end.

use std::io::{ErrorKind, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use tungstenite::error::Error;
use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::protocol::{CloseFrame, Role, WebSocketConfig};
use tungstenite::{Bytes, Message, WebSocket};

use super::ear::Ear;
use crate::http::{Answer, Ends, Request};

/// How often a client is listened to, and the end looked for.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// A client that takes nothing for so long has gone.
const PATIENCE: Duration = Duration::from_secs(30);
/// After so long without a message the client is sent a ping: proxies end a connection on which nothing goes for a
/// minute, and what happens before it is made again would be lost.
const SILENCE: Duration = Duration::from_secs(20);
/// Bytes that the kernel may hold for a client of the past, which comes the sooner the more there are of it on the way.
const PAST_BUFFER: usize = 64 << 10;
/// The same of what is published, or as many as its largest message has: what lies there cannot be replaced any more,
/// and is old when it is read. What the client's own system has taken for it lies before that, and is the client's to
/// limit. With twice as much eight cameras' JSON would lose no frame at 30 ms there and back, but what comes over a
/// link of 40 kB/s would be two to three times as old.
const LIVE_BUFFER: usize = 16 << 10;
/// Clients have nothing to say.
const MOST_HEARD: usize = 4096;

/// What a client wants.
#[derive(Debug)]
pub struct Client {
    /// One camera's frames only.
    pub camera: Option<String>,
    /// The kept past first: what came within so long, and all of a record; [`Duration::MAX`]: all of it, zero: none.
    pub history: Duration,
    /// A word after the past.
    pub wants_mark: bool,
    /// The compact form instead of JSON.
    pub is_binary: bool,
}

impl Client {
    /// By the request's parameters.
    ///
    /// # Errors
    /// What cannot be had, as an answer.
    pub fn of(request: &Request) -> Result<Self, Answer> {
        let is_binary = match request.parameter("format") {
            None | Some("json") => false,
            Some("binary") => true,
            Some(other) => {
                let line = format!("format={other}: expected json or binary");
                return Err(Answer::refusal("400 Bad Request", line));
            }
        };
        let wants_history = request.parameter("history") == Some("1");
        if wants_history && !is_binary {
            let line = "history=1 is kept in binary: ask for format=binary";
            return Err(Answer::refusal("400 Bad Request", line));
        }
        let history = match (wants_history, request.parameter("seconds")) {
            (false, _) => Duration::ZERO,
            (true, None) => Duration::MAX,
            (true, Some(given)) => match given.parse() {
                Ok(seconds) => Duration::from_secs(seconds),
                Err(_) => {
                    let line = format!("seconds={given}: expected a whole number");
                    return Err(Answer::refusal("400 Bad Request", line));
                }
            },
        };
        Ok(Self {
            camera: request.parameter("camera").map(ToOwned::to_owned),
            history,
            wants_mark: wants_history && request.parameter("mark") == Some("1"),
            is_binary,
        })
    }
}

/// How long is waited for what.
#[derive(Debug, Clone, Copy)]
struct Spans {
    patience: Duration,
    silence: Duration,
}

const SPANS: Spans = Spans {
    patience: PATIENCE,
    silence: SILENCE,
};

/// A connection that is to become a WebSocket.
pub struct Line<'a> {
    pub stream: TcpStream,
    /// Of the handshake.
    pub answer: &'a str,
    pub ends: &'a Ends,
}

impl Line<'_> {
    /// Sends the past, then what `take` gives within the time it is told, until the client leaves or the server ends.
    pub fn serve(self, past: Vec<Message>, take: &dyn Fn(Duration) -> Option<Message>) {
        self.serve_within(SPANS, past, take);
    }

    fn serve_within(
        self,
        spans: Spans,
        past: Vec<Message>,
        take: &dyn Fn(Duration) -> Option<Message>,
    ) {
        let mut stream = self.stream;
        let _ = stream.set_nodelay(true);
        if stream.write_all(self.answer.as_bytes()).is_err()
            || stream.set_write_timeout(Some(LOOK_EVERY)).is_err()
        {
            return;
        }
        let config = WebSocketConfig::default()
            .max_message_size(Some(MOST_HEARD))
            .max_frame_size(Some(MOST_HEARD));
        let socket = WebSocket::from_raw_socket(Ear::new(stream), Role::Server, Some(config));
        let mut line = Open {
            socket,
            ends: self.ends,
            spans,
        };
        let why = match line.run(past, take) {
            Err(Over::Refused(frame)) => Some(frame),
            Err(Over::Gone) | Ok(()) => None,
        };
        line.close(why);
    }
}

/// What a request for anything but a WebSocket is to ask for.
const WANTED: &[(&str, &str)] = &[
    ("Upgrade", "websocket"),
    ("Connection", "Upgrade"),
    ("Sec-WebSocket-Version", "13"),
];

/// The answer that makes a connection a WebSocket.
///
/// # Errors
/// Where the request does not ask for one, or not as it should, as an answer.
pub fn handshake(request: &Request) -> Result<String, Answer> {
    let asks = request
        .header("upgrade")
        .is_some_and(|u| u.eq_ignore_ascii_case("websocket"));
    let version = request.header("sec-websocket-version");
    match request.header("sec-websocket-key") {
        Some(key) if asks && version == Some("13") => match is_key(key) {
            true => Ok(format!(
                "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
                 Sec-WebSocket-Accept: {}\r\n\r\n",
                derive_accept_key(key.as_bytes())
            )),
            false => Err(Answer::refusal(
                "400 Bad Request",
                "Sec-WebSocket-Key: expected 16 bytes in base64",
            )),
        },
        _ => Err(Answer::refusal_with(
            "426 Upgrade Required",
            WANTED,
            "expected a WebSocket of version 13: open ws:// instead of http://",
        )),
    }
}

/// Whether this is 16 bytes in base64: 22 letters, and two signs that fill up to 24.
fn is_key(text: &str) -> bool {
    let is_letter = |b: u8| b.is_ascii_alphanumeric() || b"+/".contains(&b);
    let letters = text.strip_suffix("==");
    letters.is_some_and(|l| l.len() == 22 && l.bytes().all(is_letter))
}

/// Why a connection is over.
enum Over {
    /// The client has left, or takes nothing any more, or the server ends.
    Gone,
    /// The client said what it may not: what it is told.
    Refused(CloseFrame),
}

impl Over {
    fn refused(code: CloseCode, line: impl Into<String>) -> Self {
        let reason = line.into().into();
        Self::Refused(CloseFrame { code, reason })
    }

    /// By an error of what was heard.
    fn of(error: &Error) -> Self {
        match error {
            Error::Capacity(_) => {
                let line = format!("expected messages of {MOST_HEARD} bytes at most");
                Self::refused(CloseCode::Size, line)
            }
            Error::Utf8(_) => Self::refused(CloseCode::Invalid, "expected text in UTF-8"),
            Error::Protocol(_) => Self::refused(
                CloseCode::Protocol,
                "expected frames as RFC 6455 has them of clients",
            ),
            _ => Self::Gone,
        }
    }
}

/// An open connection.
struct Open<'a> {
    socket: WebSocket<Ear>,
    ends: &'a Ends,
    spans: Spans,
}

impl Open<'_> {
    /// Sends the past, then what `take` gives, until the server ends.
    fn run(
        &mut self,
        past: Vec<Message>,
        take: &dyn Fn(Duration) -> Option<Message>,
    ) -> Result<(), Over> {
        self.socket.get_ref().hold(PAST_BUFFER);
        for message in past {
            self.send(message)?;
        }
        let mut held = LIVE_BUFFER;
        self.socket.get_ref().hold(held);
        let (mut listened, mut sent) = (Instant::now(), Instant::now());
        let mut had_room = Instant::now();
        while !self.ends.now() {
            // What is not taken yet can be replaced by what is newer.
            if self.socket.get_ref().has_room(LOOK_EVERY) {
                let ping = || {
                    let is_silent = sent.elapsed() >= self.spans.silence;
                    is_silent.then(|| Message::Ping(Bytes::new()))
                };
                if let Some(message) = take(LOOK_EVERY).or_else(ping) {
                    // Of what does not fit as a whole the rest waits until the client's system says that it has the
                    // beginning: on one machine it does so 40 ms late, over a network after a way there and back.
                    if message.len() > held {
                        held = message.len();
                        self.socket.get_ref().hold(held);
                    }
                    self.send(message)?;
                    sent = Instant::now();
                }
                had_room = Instant::now();
            } else if had_room.elapsed() > self.spans.patience {
                return Err(Over::Gone);
            }
            if listened.elapsed() >= LOOK_EVERY {
                listened = Instant::now();
                self.listen()?;
            }
        }
        Ok(())
    }

    /// Sends, for as long as the client takes something now and then.
    fn send(&mut self, message: Message) -> Result<(), Over> {
        let began = Instant::now();
        let mut sent = self.socket.send(message);
        loop {
            match sent {
                Ok(()) => return Ok(()),
                Err(Error::Io(e)) if waits(e.kind()) => {}
                Err(_) => return Err(Over::Gone),
            }
            if self.ends.now() || began.elapsed() > self.spans.patience {
                return Err(Over::Gone);
            }
            sent = self.socket.flush();
        }
    }

    /// Hears what the client has said: pings, and that it leaves.
    fn listen(&mut self) -> Result<(), Over> {
        self.socket.get_mut().open().map_err(|_| Over::Gone)?;
        let heard = loop {
            match self.socket.read() {
                Ok(Message::Close(_)) => break Err(Over::Gone),
                Ok(_) => {}
                Err(Error::Io(e)) if waits(e.kind()) => break Ok(()),
                Err(e) => break Err(Over::of(&e)),
            }
        };
        let goes_on = self.socket.get_mut().close().map_err(|_| Over::Gone)?;
        match heard {
            Ok(()) if !goes_on => Err(Over::refused(
                CloseCode::Policy,
                "expected a client that says little",
            )),
            heard => heard,
        }
    }

    fn close(&mut self, why: Option<CloseFrame>) {
        let _ = self.socket.close(why);
        let _ = self.socket.flush();
        self.socket.get_mut().leave();
    }
}

fn waits(kind: ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

#[cfg(test)]
mod tests {
    use std::io::Read;
    use std::net::{SocketAddr, TcpListener};
    use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

    use rustix::net::{AddressFamily, SocketType, connect, socket, sockopt};

    use super::super::mailbox::Mailbox;
    use super::*;

    /// A client, and what serves it.
    fn pair() -> (TcpStream, TcpStream) {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        client
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        (client, listener.accept().unwrap().0)
    }

    /// Serves a connection, from its first message on, until it is over.
    fn serve(stream: TcpStream, spans: Spans, take: &dyn Fn(Duration) -> Option<Message>) {
        let line = Line {
            stream,
            answer: "",
            ends: &Ends::default(),
        };
        line.serve_within(spans, Vec::new(), take);
    }

    #[test]
    fn a_key_is_sixteen_bytes() {
        for (text, wanted) in [
            ("dGhlIHNhbXBsZSBub25jZQ==", true),
            ("dGhlIHNhbXBsZSBub25jZ+/=", false),
            ("dGhlIHNhbXBsZSBub25j", false),
            ("dGhlIHNhbXBsZSBub25jZWVlZWU=", false),
            ("dGhlIHNhbXBsZSBub25j-_==", false),
            ("==", false),
            ("", false),
        ] {
            assert_eq!(is_key(text), wanted, "{text}");
        }
    }

    #[test]
    fn a_client_that_talks_without_end_gets_its_frames_and_is_left() {
        // A message without words, with its mask; twice as many as are heard before it is enough.
        let words = [0x81, 0x80, 0, 0, 0, 0].repeat(30_000);
        let (mut client, stream) = pair();
        let given = AtomicU32::new(0);
        std::thread::scope(|threads| {
            let mut hears = client.try_clone().unwrap();
            threads.spawn(move || {
                let mut all = Vec::new();
                let _ = hears.read_to_end(&mut all);
            });
            // Fails when the other end has had enough.
            threads.spawn(move || client.write_all(&words).is_ok());
            serve(stream, SPANS, &|_| {
                let before = given.fetch_add(1, Ordering::Relaxed);
                assert!(before < 1000, "it is still listened to");
                std::thread::sleep(Duration::from_millis(20));
                Some(Message::Text("frame".into()))
            });
        });
        // One between two turns at the least.
        assert!(given.into_inner() >= 5);
    }

    #[test]
    fn little_is_on_the_way_to_a_client_that_reads_nothing() {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let client = socket(AddressFamily::INET, SocketType::STREAM, None).unwrap();
        sockopt::set_socket_recv_buffer_size(&client, 4096).unwrap();
        let SocketAddr::V4(address) = listener.local_addr().unwrap() else {
            panic!("expected an address of IPv4");
        };
        connect(&client, &address).unwrap();
        let (stream, _) = listener.accept().unwrap();
        let patience = Duration::from_millis(500);
        let given = AtomicU32::new(0);
        serve(stream, Spans { patience, ..SPANS }, &|_| {
            given.fetch_add(1, Ordering::Relaxed);
            Some(Message::Binary(vec![0; 1000].into()))
        });
        // Two thirds of twice the buffer, what the client's own holds, and the last one.
        let given = given.into_inner();
        assert!((1..40).contains(&given), "{given} kB");
        drop(client);
    }

    #[test]
    fn a_large_message_is_sent_as_a_whole() {
        const LARGE: usize = 100_000;
        let (mut client, stream) = pair();
        let same = stream.try_clone().unwrap();
        let held = || sockopt::socket_send_buffer_size(&same).unwrap();
        let (given, before, after) = (AtomicU32::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|threads| {
            threads.spawn(move || {
                // Each with its length before it.
                client.read_exact(&mut [0; 2 + 10]).unwrap();
                client.read_exact(&mut vec![0; 10 + LARGE]).unwrap();
            });
            serve(stream, SPANS, &|_| {
                let bytes = match given.fetch_add(1, Ordering::Relaxed) {
                    0 => 10,
                    1 => {
                        before.store(held(), Ordering::Relaxed);
                        LARGE
                    }
                    _ => {
                        after.store(held(), Ordering::Relaxed);
                        return None;
                    }
                };
                Some(Message::Binary(vec![0; bytes].into()))
            });
        });
        // The system doubles what it is told.
        assert_eq!(before.into_inner(), 2 * LIVE_BUFFER);
        assert_eq!(after.into_inner(), 2 * LARGE);
    }

    #[test]
    fn a_client_to_which_nothing_is_sent_gets_a_ping() {
        let (mut client, stream) = pair();
        let nothing = Mailbox::<Message>::default();
        std::thread::scope(|threads| {
            threads.spawn(|| {
                let silence = Duration::ZERO;
                serve(stream, Spans { silence, ..SPANS }, &|p| nothing.take(p));
            });
            let mut heard = [0; 2];
            client.read_exact(&mut heard).unwrap();
            assert_eq!(heard, [0x89, 0]);
            drop(client);
        });
    }

    #[test]
    fn a_client_that_says_what_it_may_not_is_told_why_it_is_left() {
        let mut large = vec![0x82, 0x80 | 126, 0x13, 0x88, 0, 0, 0, 0];
        large.resize(large.len() + 5000, 0);
        for (words, wanted) in [
            (large, 1009),
            // Not UTF-8, and without a mask.
            (vec![0x81, 0x81, 0, 0, 0, 0, 0xff], 1007),
            (vec![0x81, 0x01, b'x'], 1002),
        ] {
            let (mut client, stream) = pair();
            client.write_all(&words).unwrap();
            let nothing = Mailbox::<Message>::default();
            serve(stream, SPANS, &|p| nothing.take(p));
            let mut heard = Vec::new();
            client.read_to_end(&mut heard).unwrap();
            let [0x88, _, code @ ..] = &heard[..4] else {
                panic!("expected the end of the connection, found {heard:?}");
            };
            assert_eq!(u16::from_be_bytes([code[0], code[1]]), wanted);
        }
    }
}

//! One client: what it wants, and its connection from the handshake to the end.

use std::io::{ErrorKind, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use tungstenite::error::Error;
use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Message, WebSocket};

use super::ear::Ear;
use crate::http::{Answer, Ends, Request};

/// How often a client is listened to, and the end looked for.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// A client that takes nothing for so long has gone.
const PATIENCE: Duration = Duration::from_secs(30);
/// What the kernel may hold for a client: what lies there is old when it is read.
const SEND_BUFFER: usize = 64 << 10;
/// Clients have nothing to say.
const MOST_HEARD: usize = 4096;

/// What a client wants.
#[derive(Debug)]
pub struct Client {
    /// One camera's frames only.
    pub camera: Option<String>,
    /// The kept past first.
    pub wants_history: bool,
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
        Ok(Self {
            camera: request.parameter("camera").map(ToOwned::to_owned),
            wants_history,
            is_binary,
        })
    }
}

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
        let mut stream = self.stream;
        // Small: an old frame in the kernel's buffer cannot be taken back any more.
        let _ = rustix::net::sockopt::set_socket_send_buffer_size(&stream, SEND_BUFFER);
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
        };
        for message in past {
            if line.send(message).is_none() {
                return;
            }
        }
        let mut listened = Instant::now();
        while !self.ends.now() {
            if let Some(message) = take(LOOK_EVERY)
                && line.send(message).is_none()
            {
                break;
            }
            if listened.elapsed() >= LOOK_EVERY {
                listened = Instant::now();
                if line.listen().is_none() {
                    break;
                }
            }
        }
        line.close();
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

/// An open connection; `None` of its functions says that it is over.
struct Open<'a> {
    socket: WebSocket<Ear>,
    ends: &'a Ends,
}

impl Open<'_> {
    /// Sends, for as long as the client takes something now and then.
    fn send(&mut self, message: Message) -> Option<()> {
        let began = Instant::now();
        let mut sent = self.socket.send(message);
        loop {
            match sent {
                Ok(()) => return Some(()),
                Err(Error::Io(e)) if waits(e.kind()) => {}
                Err(_) => return None,
            }
            if self.ends.now() || began.elapsed() > PATIENCE {
                return None;
            }
            sent = self.socket.flush();
        }
    }

    /// Hears what the client has said: pings, and that it leaves.
    fn listen(&mut self) -> Option<()> {
        self.socket.get_mut().open().ok()?;
        let heard = loop {
            match self.socket.read() {
                Ok(Message::Close(_)) => break None,
                Ok(_) => {}
                Err(Error::Io(e)) if waits(e.kind()) => break Some(()),
                Err(_) => break None,
            }
        };
        let goes_on = self.socket.get_mut().close().ok()?;
        heard.filter(|()| goes_on)
    }

    fn close(&mut self) {
        let _ = self.socket.close(None);
        let _ = self.socket.flush();
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
    use std::net::TcpListener;
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

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
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let mut client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (stream, _) = listener.accept().unwrap();
        let given = AtomicU32::new(0);
        std::thread::scope(|threads| {
            let mut hears = client.try_clone().unwrap();
            threads.spawn(move || {
                let mut all = Vec::new();
                let _ = hears.read_to_end(&mut all);
            });
            // Fails when the other end has had enough.
            threads.spawn(move || client.write_all(&words).is_ok());
            let line = Line {
                stream,
                answer: "",
                ends: &Ends::default(),
            };
            line.serve(Vec::new(), &|_| {
                let before = given.fetch_add(1, Ordering::Relaxed);
                assert!(before < 1000, "it is still listened to");
                std::thread::sleep(Duration::from_millis(20));
                Some(Message::Text("frame".into()))
            });
        });
        // One between two turns at the least.
        assert!(given.into_inner() >= 5);
    }
}

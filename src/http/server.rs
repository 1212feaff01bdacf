//! Listens, and gives every connection its thread.

use std::borrow::Cow;
use std::fmt::{self, Write as _};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::net::sockopt;

use super::Request;

/// How long a connection may take to ask, and to take some more of its answer.
const PATIENCE: Duration = Duration::from_secs(1);
/// How long it may take to take all of it: the largest is 140 kB.
const ANSWERED: Duration = Duration::from_secs(10);
/// How often the end is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Connections at a time, streams among them. Who comes then is told to come later.
const MOST: usize = 64;
/// Streams at a time. The other places are for short answers: a browser asks for six at once, and a page that lacks one
/// of its files shows nothing.
const MOST_STREAMS: usize = 48;
/// Bytes of a request that are read although it is refused unheard.
const UNHEARD: u64 = 1 << 20;
/// After so long without a word the kernel asks whether the other end of a stream is still there, so often, so far
/// apart. A machine that fell asleep or lost its network would keep its place for ever.
const ASKED_AFTER: Duration = Duration::from_secs(20);
const ASKED_EVERY: Duration = Duration::from_secs(5);
const ASKED: u32 = 4;

/// The status of a request for something that is not to be had in this way.
const NOT_ALLOWED: &str = "405 Method Not Allowed";

/// What a request gets.
pub enum Answer {
    /// A whole answer.
    Body {
        /// Such as `200 OK`.
        status: &'static str,
        /// Content type.
        kind: &'static str,
        /// Other headers.
        headers: &'static [(&'static str, &'static str)],
        /// What it holds.
        body: Cow<'static, [u8]>,
    },
    /// The connection is another protocol's from now on; it ends with the function, which looks at [`Ends`].
    Stream(Box<dyn FnOnce(TcpStream, Ends) + Send>),
}

impl fmt::Debug for Answer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Body { status, body, .. } => write!(f, "{status}, {} bytes", body.len()),
            Self::Stream(_) => f.write_str("a stream"),
        }
    }
}

impl Answer {
    /// A line that says why there is nothing.
    pub fn refusal(status: &'static str, line: impl fmt::Display) -> Self {
        Self::refusal_with(status, &[], line)
    }

    /// The same, with headers that say what there is.
    pub fn refusal_with(
        status: &'static str,
        headers: &'static [(&'static str, &'static str)],
        line: impl fmt::Display,
    ) -> Self {
        Self::Body {
            status,
            kind: "text/plain; charset=utf-8",
            headers,
            body: format!("{line}\n").into_bytes().into(),
        }
    }
}

/// Whether the server ends.
#[derive(Debug, Clone, Default)]
pub struct Ends(Arc<AtomicBool>);

impl Ends {
    /// Whether it does.
    pub fn now(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// How many there are.
#[derive(Debug, Clone, Default)]
struct Taken {
    connections: Arc<AtomicUsize>,
    streams: Arc<AtomicUsize>,
}

/// One of so many, until it is dropped, whatever ends its thread.
struct Place(Arc<AtomicUsize>);

impl Place {
    /// `None` where all are taken.
    fn take(taken: &Arc<AtomicUsize>, most: usize) -> Option<Self> {
        let before = taken.fetch_add(1, Ordering::Relaxed);
        let place = Self(Arc::clone(taken));
        (before < most).then_some(place)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Serves until it is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    ends: Ends,
    taken: Taken,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves what `answer` says to each `GET`, and its head alone to each `HEAD`.
    ///
    /// # Errors
    /// If the address cannot be had.
    pub fn start(
        address: SocketAddr,
        answer: impl Fn(&Request) -> Answer + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let (ends, taken) = (Ends::default(), Taken::default());
        let (end, count) = (ends.clone(), taken.clone());
        let answer: Arc<dyn Fn(&Request) -> Answer + Send + Sync> = Arc::new(answer);
        let serve = move || {
            while !end.now() {
                match listener.accept() {
                    Ok((stream, _)) => connect(stream, &answer, &end, &count),
                    Err(_) => std::thread::sleep(LOOK_EVERY),
                }
            }
        };
        let thread = std::thread::Builder::new()
            .name("http".into())
            .spawn(serve)?;
        Ok(Self {
            address,
            ends,
            taken,
            thread: Some(thread),
        })
    }

    /// Where it serves; the port where 0 was asked for.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.ends.0.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        // Who does not end in time ends with the process.
        let began = Instant::now();
        while self.taken.connections.load(Ordering::Relaxed) > 0 && began.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// What who comes gets where all places are taken.
fn busy() -> Answer {
    // A browser that was to show the answer itself asks again on its own.
    let headers = &[("Retry-After", "5"), ("Refresh", "5")];
    let line = "too many connections: close one";
    Answer::refusal_with("503 Service Unavailable", headers, line)
}

fn connect(
    mut stream: TcpStream,
    answer: &Arc<dyn Fn(&Request) -> Answer + Send + Sync>,
    ends: &Ends,
    taken: &Taken,
) {
    let Some(place) = Place::take(&taken.connections, MOST) else {
        let _ = write(&mut stream, &busy(), LOOK_EVERY);
        let _ = take_leave(&mut stream);
        return;
    };
    let (answer, ends) = (Arc::clone(answer), ends.clone());
    let streams = Arc::clone(&taken.streams);
    let talk = move || {
        let _place = place;
        // Who left before the end of the answer does not need it.
        let _ = talk(stream, &*answer, ends, &streams);
    };
    // Without a thread the connection is closed, and whoever asked asks again.
    let _ = std::thread::Builder::new()
        .name("http connection".into())
        .spawn(talk);
}

/// Reads what has come, without waiting for more: a connection that is closed with something unread is reset, and the
/// reset may overtake the answer. Nothing can be sent any more.
///
/// # Errors
/// The system's, one that nothing is there any more to read among them.
pub fn take_leave(stream: &mut TcpStream) -> io::Result<()> {
    stream.shutdown(Shutdown::Write)?;
    stream.set_nonblocking(true)?;
    // Who never stops sending is not listened to for ever.
    io::copy(&mut stream.take(UNHEARD), &mut io::sink())?;
    Ok(())
}

fn talk(
    mut stream: TcpStream,
    answer: &dyn Fn(&Request) -> Answer,
    ends: Ends,
    streams: &Arc<AtomicUsize>,
) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut request = match Request::read(&mut stream, PATIENCE) {
        Ok(Some(request)) => request,
        Ok(None) => return Ok(()),
        Err(e) if e.kind() == ErrorKind::InvalidData => {
            let refusal = Answer::refusal("431 Request Header Fields Too Large", e);
            return write(&mut stream, &refusal, ANSWERED);
        }
        Err(e) => return Err(e),
    };
    request.is_full = streams.load(Ordering::Relaxed) >= MOST_STREAMS;
    match &*request.method {
        "GET" => match answer(&request) {
            Answer::Stream(talk) => {
                let Some(_place) = Place::take(streams, MOST_STREAMS) else {
                    return write(&mut stream, &busy(), ANSWERED);
                };
                keep_asking(&stream)?;
                talk(stream, ends);
                Ok(())
            }
            body => write(&mut stream, &body, ANSWERED),
        },
        "HEAD" => match answer(&request) {
            Answer::Stream(_) => {
                let line = "expected GET: a stream has no head alone";
                let refusal = Answer::refusal_with(NOT_ALLOWED, &[("Allow", "GET")], line);
                write_head(&mut Timed::new(&stream, ANSWERED), &refusal)
            }
            body => write_head(&mut Timed::new(&stream, ANSWERED), &body),
        },
        _ => {
            let allowed = &[("Allow", "GET, HEAD")];
            let refusal = Answer::refusal_with(NOT_ALLOWED, allowed, "expected GET or HEAD");
            write(&mut stream, &refusal, ANSWERED)
        }
    }
}

/// Has the kernel end a connection whose other end is silent.
fn keep_asking(stream: &TcpStream) -> io::Result<()> {
    sockopt::set_tcp_keepidle(stream, ASKED_AFTER)?;
    sockopt::set_tcp_keepintvl(stream, ASKED_EVERY)?;
    sockopt::set_tcp_keepcnt(stream, ASKED)?;
    sockopt::set_socket_keepalive(stream, true)?;
    // The same patience with an end that does not say that it has got what was sent.
    let patience = ASKED_AFTER + ASKED * ASKED_EVERY;
    sockopt::set_tcp_user_timeout(stream, patience.as_millis() as u32)?;
    Ok(())
}

/// A connection that is written to for so long in all: who takes a little now and then would keep its place for ever.
struct Timed<'a> {
    stream: &'a TcpStream,
    until: Instant,
}

impl<'a> Timed<'a> {
    fn new(stream: &'a TcpStream, patience: Duration) -> Self {
        Self {
            stream,
            until: Instant::now() + patience,
        }
    }
}

impl Write for Timed<'_> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        self.stream.set_write_timeout(Some(left.min(PATIENCE)))?;
        self.stream.write(buffer)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

fn write(stream: &mut TcpStream, answer: &Answer, patience: Duration) -> io::Result<()> {
    let mut timed = Timed::new(stream, patience);
    write_head(&mut timed, answer)?;
    match answer {
        Answer::Body { body, .. } => timed.write_all(body),
        Answer::Stream(_) => Ok(()),
    }
}

/// Writes what comes before the body, whose length it says.
fn write_head(stream: &mut Timed<'_>, answer: &Answer) -> io::Result<()> {
    let Answer::Body {
        status,
        kind,
        headers,
        body,
    } = answer
    else {
        return Ok(());
    };
    let mut head = format!("HTTP/1.1 {status}\r\nContent-Type: {kind}\r\n");
    for (name, value) in *headers {
        let _ = write!(head, "{name}: {value}\r\n");
    }
    let _ = write!(
        head,
        "Content-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[test]
    fn a_head_is_answered_however_long_it_is() {
        let found = |_: &Request| Answer::refusal("200 OK", "found");
        let server = Server::start(([127, 0, 0, 1], 0).into(), found).unwrap();
        for (bytes, status) in [(60_000, "200 OK"), (70_000, "431 "), (200_000, "431 ")] {
            let mut client = TcpStream::connect(server.address()).unwrap();
            let cookie = "c".repeat(bytes);
            write!(client, "GET / HTTP/1.1\r\nCookie: {cookie}\r\n\r\n").unwrap();
            let mut answer = String::new();
            client.read_to_string(&mut answer).unwrap();
            assert!(
                answer.starts_with(&format!("HTTP/1.1 {status}")),
                "{answer}"
            );
            let (_, line) = answer.split_once("\r\n\r\n").unwrap();
            assert_eq!(line.lines().count(), 1, "{answer}");
        }
    }

    #[test]
    fn a_stream_has_no_head_alone() {
        let server = Server::start(([127, 0, 0, 1], 0).into(), |_| {
            Answer::Stream(Box::new(|_, _| panic!("nobody has asked for it")))
        });
        let server = server.unwrap();
        let mut client = TcpStream::connect(server.address()).unwrap();
        client.write_all(b"HEAD / HTTP/1.1\r\n\r\n").unwrap();
        let mut answer = String::new();
        client.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 405 "), "{answer}");
        assert!(answer.contains("\r\nAllow: GET\r\n"), "{answer}");
        assert!(answer.ends_with("\r\n\r\n"), "{answer}");
    }

    #[test]
    fn who_comes_when_all_places_are_taken_is_told_so_and_not_reset() {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let found: Arc<dyn Fn(&Request) -> Answer + Send + Sync> =
            Arc::new(|_: &Request| Answer::refusal("200 OK", "found"));
        for (taken, status) in [(MOST - 1, "200 OK"), (MOST, "503 ")] {
            let mut client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let cookie = "c".repeat(10_000);
            write!(client, "GET / HTTP/1.1\r\nCookie: {cookie}\r\n\r\n").unwrap();
            let (stream, _) = listener.accept().unwrap();
            let taken_now = Taken::default();
            taken_now.connections.store(taken, Ordering::Relaxed);
            connect(stream, &found, &Ends::default(), &taken_now);
            let mut answer = String::new();
            client.read_to_string(&mut answer).unwrap();
            let wanted = format!("HTTP/1.1 {status}");
            assert!(answer.starts_with(&wanted), "{taken} taken: {answer}");
            let (_, line) = answer.split_once("\r\n\r\n").unwrap();
            assert_eq!(line.lines().count(), 1, "{answer}");
        }
    }

    #[test]
    fn streams_leave_places_for_short_answers() {
        let server = Server::start(([127, 0, 0, 1], 0).into(), |request| {
            match &*request.path {
                "/full" => Answer::refusal("200 OK", request.is_full),
                // Until the client leaves.
                "/stream" => Answer::Stream(Box::new(|mut stream, _| {
                    let _ = stream.write_all(b"begun");
                    let _ = stream.set_read_timeout(None);
                    let _ = stream.read(&mut [0]);
                })),
                _ => Answer::refusal("200 OK", "found"),
            }
        });
        let server = server.unwrap();
        let ask = |path: &str| {
            let mut client = TcpStream::connect(server.address()).unwrap();
            write!(client, "GET {path} HTTP/1.1\r\n\r\n").unwrap();
            client
        };
        let read = |mut client: TcpStream| {
            let mut answer = String::new();
            client.read_to_string(&mut answer).unwrap();
            answer
        };
        let begin = |_| {
            let mut client = ask("/stream");
            let mut begun = [0; 5];
            client.read_exact(&mut begun).unwrap();
            assert_eq!(&begun, b"begun");
            client
        };
        assert!(read(ask("/full")).ends_with("\r\n\r\nfalse\n"));
        let mut streams: Vec<_> = (0..MOST_STREAMS).map(begin).collect();
        assert!(read(ask("/full")).ends_with("\r\n\r\ntrue\n"));
        // Its own place is free a moment after its answer.
        while server.taken.connections.load(Ordering::Relaxed) > MOST_STREAMS {
            std::thread::yield_now();
        }
        let refused = read(ask("/stream"));
        assert!(refused.starts_with("HTTP/1.1 503 "), "{refused}");
        assert!(refused.contains("\r\nRetry-After: 5\r\n"), "{refused}");
        // All that are left, at once; the one that was refused may not have gone yet.
        let answers: Vec<_> = (1..MOST - MOST_STREAMS).map(|_| ask("/")).collect();
        for answer in answers.into_iter().map(read) {
            assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
        }
        // Who leaves makes room.
        streams.pop();
        while server.taken.streams.load(Ordering::Relaxed) == MOST_STREAMS {
            std::thread::yield_now();
        }
        begin(0);
    }

    #[test]
    fn who_takes_an_answer_little_by_little_is_left() {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        sockopt::set_socket_recv_buffer_size(&client, 2048).unwrap();
        let (mut stream, _) = listener.accept().unwrap();
        client
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        // Little lies in the kernel, so that all of it would take far longer than the answer may.
        sockopt::set_socket_send_buffer_size(&stream, 4096).unwrap();
        let large = Answer::Body {
            status: "200 OK",
            kind: "text/plain",
            headers: &[],
            body: vec![0; 1 << 20].into(),
        };
        let is_over = AtomicBool::new(false);
        std::thread::scope(|threads| {
            threads.spawn(|| {
                let mut client = client;
                while !is_over.load(Ordering::Relaxed) {
                    let _ = client.read(&mut [0; 2048]);
                    std::thread::sleep(Duration::from_millis(10));
                }
            });
            let written = write(&mut stream, &large, 4 * LOOK_EVERY);
            is_over.store(true, Ordering::Relaxed);
            let kinds = [ErrorKind::TimedOut, ErrorKind::WouldBlock];
            assert!(kinds.contains(&written.unwrap_err().kind()));
        });
    }

    #[test]
    fn the_kernel_asks_whether_who_has_a_stream_is_still_there() {
        let (tell, told) = mpsc::channel();
        let server = Server::start(([127, 0, 0, 1], 0).into(), move |_| {
            let tell = tell.clone();
            Answer::Stream(Box::new(move |stream, _| {
                let asks = sockopt::socket_keepalive(&stream).unwrap();
                let after = sockopt::tcp_keepidle(&stream).unwrap();
                let patience = sockopt::tcp_user_timeout(&stream).unwrap();
                tell.send((asks, after, patience)).unwrap();
            }))
        });
        let server = server.unwrap();
        let mut client = TcpStream::connect(server.address()).unwrap();
        client.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
        assert_eq!(told.recv().unwrap(), (true, ASKED_AFTER, 40_000));
    }
}

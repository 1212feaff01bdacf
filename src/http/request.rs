//! What a client asks: the head of a request.

use std::io::{self, ErrorKind, Read};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// A longer head is none of ours. Names of this machine share their cookies with every other server on it.
const MOST_BYTES: usize = 64 << 10;

/// The head of a request.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Request {
    /// Such as `GET`.
    pub method: String,
    /// The path without what follows `?`.
    pub path: String,
    /// Whether the server had no place for a stream when it came.
    pub is_full: bool,
    query: String,
    headers: Vec<(String, String)>,
}

impl Request {
    /// Reads one within `patience`; `None` where none came.
    ///
    /// # Errors
    /// Those of the connection; [`ErrorKind::InvalidData`] for a head that is too long.
    pub fn read(stream: &mut TcpStream, patience: Duration) -> io::Result<Option<Self>> {
        let until = Instant::now() + patience;
        let mut bytes = Vec::new();
        let mut some = [0; 1024];
        let mut is_too_long = false;
        let is_whole = loop {
            if bytes.len() > MOST_BYTES {
                // Heard to its end all the same: over words that nobody has read a connection ends with a reset, which
                // may overtake the answer.
                is_too_long = true;
                bytes.drain(..bytes.len() - 3);
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break false;
            }
            stream.set_read_timeout(Some(left))?;
            let n = stream.read(&mut some)?;
            let before = bytes.len().saturating_sub(3);
            bytes.extend_from_slice(&some[..n]);
            let is_end = bytes[before..].windows(4).any(|w| w == b"\r\n\r\n");
            if is_end || n == 0 {
                break is_end;
            }
        };
        if is_too_long {
            let expected = format!("expected a request whose head has {MOST_BYTES} bytes or fewer");
            return Err(io::Error::new(ErrorKind::InvalidData, expected));
        }
        let text = String::from_utf8_lossy(&bytes);
        Ok(Self::parse(&text).filter(|_| is_whole))
    }

    /// A head's text up to its empty line; `None` for one without a method and a target.
    pub fn parse(text: &str) -> Option<Self> {
        let mut lines = text.split("\r\n");
        let mut words = lines.next()?.split(' ');
        let (method, target) = (words.next()?, words.next()?);
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let headers = lines
            .take_while(|l| !l.is_empty())
            .filter_map(|l| l.split_once(':'))
            .map(|(name, value)| (name.trim().to_ascii_lowercase(), value.trim().to_owned()));
        Some(Self {
            method: method.to_owned(),
            path: path.to_owned(),
            is_full: false,
            query: query.to_owned(),
            headers: headers.collect(),
        })
    }

    /// A header by its name in small letters.
    pub fn header(&self, name: &str) -> Option<&str> {
        let found = self.headers.iter().find(|(n, _)| n == name);
        found.map(|(_, value)| value.as_str())
    }

    /// A parameter of the query. Its letters stand for themselves: none of ours needs an escape.
    pub fn parameter(&self, name: &str) -> Option<&str> {
        let mut pairs = self.query.split('&').filter_map(|p| p.split_once('='));
        pairs.find(|(n, _)| *n == name).map(|(_, value)| value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_head_is_taken_apart() {
        let text = "GET /bodies?format=json&camera=hall HTTP/1.1\r\nHost: localhost:1\r\nORIGIN : x\r\n\r\nrest: 1";
        let request = Request::parse(text).unwrap();
        assert_eq!((&*request.method, &*request.path), ("GET", "/bodies"));
        assert_eq!(request.parameter("camera"), Some("hall"));
        assert_eq!(request.parameter("form"), None);
        assert_eq!(request.header("host"), Some("localhost:1"));
        assert_eq!(request.header("origin"), Some("x"));
        assert_eq!(request.header("rest"), None);
        assert_eq!(Request::parse("GET\r\n\r\n"), None);
    }
}

//! What a client asks: the head of a request.

use std::io::{self, Read};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// A longer head is none of ours.
const MOST_BYTES: usize = 8192;

/// The head of a request.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Request {
    /// Such as `GET`.
    pub method: String,
    /// The path without what follows `?`.
    pub path: String,
    query: String,
    headers: Vec<(String, String)>,
}

impl Request {
    /// Reads one within `patience`; `None` where none came.
    ///
    /// # Errors
    /// Those of the connection.
    pub fn read(stream: &mut TcpStream, patience: Duration) -> io::Result<Option<Self>> {
        let until = Instant::now() + patience;
        let mut bytes = Vec::new();
        let mut some = [0; 1024];
        while !bytes.windows(4).any(|w| w == b"\r\n\r\n") {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() || bytes.len() > MOST_BYTES {
                return Ok(None);
            }
            stream.set_read_timeout(Some(left))?;
            match stream.read(&mut some)? {
                0 => return Ok(None),
                n => bytes.extend_from_slice(&some[..n]),
            }
        }
        Ok(Self::parse(&String::from_utf8_lossy(&bytes)))
    }

    fn parse(text: &str) -> Option<Self> {
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

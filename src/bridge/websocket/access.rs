//! Who may read: everybody on this machine, or whoever has the token.
//!
//! A browser carries out what any page of the internet says. So without a token the request must name this machine
//! itself (else a foreign name could be made to lead here), and must come of a page that was served here, or of a
//! program.

use std::fs::File;
use std::io::{self, Read};
use std::net::{IpAddr, Ipv6Addr, SocketAddr};

use crate::http::{Answer, Request};

/// What a client must know.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Access {
    token: Option<String>,
}

impl Access {
    /// Whoever has the token; `None`: this machine.
    pub fn new(token: Option<String>) -> Self {
        Self { token }
    }

    /// A token that nobody guesses: 128 bits of the system's.
    ///
    /// # Errors
    /// If the system has none.
    pub fn random_token() -> io::Result<String> {
        let mut random = [0; 16];
        File::open("/dev/urandom")?.read_exact(&mut random)?;
        Ok(format!("{:032x}", u128::from_ne_bytes(random)))
    }

    /// The answer for who may not.
    pub fn refuse(&self, request: &Request) -> Option<Answer> {
        let refused = |line: &str| Some(Answer::refusal("403 Forbidden", line));
        if let Some(token) = &self.token {
            let given = request.parameter("token").unwrap_or_default();
            return match same(given.as_bytes(), token.as_bytes()) {
                true => None,
                false => refused("expected ?token= with the token that was shown at the start"),
            };
        }
        let host = request.header("host").unwrap_or_default();
        if !is_this_machine(host) {
            return refused("expected the name localhost or 127.0.0.1 of this machine");
        }
        match request.header("origin") {
            Some(origin) if !was_served_at(origin, host) => refused(
                "this page was not served here: give a token at the start and in the address",
            ),
            _ => None,
        }
    }
}

/// Whether a `Host` is a name that leads nowhere but here.
fn is_this_machine(host: &str) -> bool {
    let bracketed = host.strip_prefix('[').and_then(|h| h.strip_suffix(']'));
    let ip = match (host.parse::<SocketAddr>(), bracketed) {
        (Ok(address), _) => Ok(address.ip()),
        (_, Some(ip)) => ip.parse::<Ipv6Addr>().map(IpAddr::V6),
        (_, None) => host.parse::<IpAddr>(),
    };
    let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
    ip.map_or_else(
        |_| name.eq_ignore_ascii_case("localhost"),
        |ip| ip.is_loopback(),
    )
}

/// Whether a page's `Origin` is the `Host` that is asked.
fn was_served_at(origin: &str, host: &str) -> bool {
    let served = origin.strip_prefix("http://");
    served.is_some_and(|served| served.eq_ignore_ascii_case(host))
}

/// Takes as long for a near miss as for a far one.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_this_machine() {
        for own in [
            "localhost",
            "localhost:80",
            "127.0.0.1:9",
            "[::1]:9",
            "[::1]",
            "127.0.0.1",
            "LocalHost:80",
        ] {
            assert!(is_this_machine(own), "{own}");
            assert!(was_served_at(&format!("http://{own}").to_lowercase(), own));
        }
        for foreign in [
            "",
            "evil.example",
            "evil.example:80",
            "10.0.0.1:9",
            "localhost.evil:1",
            "[::2]",
            "[127.0.0.1]",
            "[localhost]",
            "[::1]evil.example",
        ] {
            assert!(!is_this_machine(foreign), "{foreign}");
            assert!(!was_served_at(&format!("http://{foreign}"), "localhost:80"));
        }
    }

    #[test]
    fn tokens_differ_and_are_long() {
        let token = || Access::random_token().unwrap();
        let (a, b) = (token(), token());
        assert!(a != b && a.len() == 32);
        assert!(same(b"abc", b"abc") && !same(b"abc", b"abd") && !same(b"", b"abc"));
    }
}

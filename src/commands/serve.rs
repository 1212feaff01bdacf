//! The page and the WebSocket at one address, for the verbs that have bodies.

use std::fmt::Write;
use std::fs;
use std::net::SocketAddr;
use std::time::Duration;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::exit::Failure;
use super::log;
use crate::bridge::websocket::{Access, Hub};
use crate::http::Server;
use crate::view;

/// Where the page is when nobody says otherwise.
const ADDRESS: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 9744);
/// What the page of running cameras can go back to.
const LAST_MINUTE: Duration = Duration::from_secs(60);
/// A shorter token is guessed.
const SHORTEST_TOKEN: usize = 8;

/// Options of the page.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PageArgs {
    /// Serve at this address, such as 0.0.0.0:9744 for other machines, which then need the token [default:
    /// 127.0.0.1:9744]
    #[arg(long, value_name = "ADDRESS", value_parser = parse_address)]
    pub listen: Option<SocketAddr>,
    /// What clients have to know: 8 or more letters, digits, '-', '_' [default: none on this machine, else a random
    /// one]
    #[arg(long, value_name = "TOKEN", value_parser = parse_token)]
    pub token: Option<String>,
}

/// Reads an address with its port.
///
/// # Errors
/// What was expected.
pub fn parse_address(text: &str) -> Result<SocketAddr, String> {
    let expected = "expected an address in numbers and a port, such as 127.0.0.1:9000";
    text.parse().map_err(|_| expected.to_owned())
}

/// Reads an address of the settings, with the same words.
///
/// # Errors
/// As [`parse_address`].
pub fn address<'de, D: Deserializer<'de>>(from: D) -> Result<Option<SocketAddr>, D::Error> {
    let text = Option::<String>::deserialize(from)?;
    let read =
        |text: String| parse_address(&text).map_err(|e| D::Error::custom(format!("'{text}': {e}")));
    text.map(read).transpose()
}

/// Reads a token.
///
/// # Errors
/// What is wrong with it.
pub fn parse_token(text: &str) -> Result<String, String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    if text.len() < SHORTEST_TOKEN || !text.chars().all(plain) {
        return Err(format!(
            "expected {SHORTEST_TOKEN} or more letters, digits, '-' or '_'"
        ));
    }
    Ok(text.to_owned())
}

/// What the page can go back to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Past {
    /// Of running cameras.
    LastMinute,
    /// A whole record.
    Record,
}

/// Serves until it is dropped.
#[derive(Debug)]
pub struct PageServer {
    server: Server,
    hub: Hub,
    token: Option<String>,
    /// Whoever may open the page has the token from where it was set.
    is_token_known: bool,
}

impl PageServer {
    /// Serves what its hub is given at the address that `flag` names; pictures only to a user who wants to
    /// `show_picture`.
    ///
    /// # Errors
    /// Exit code 69 where the address cannot be had.
    pub fn start(
        flag: &str,
        args: &PageArgs,
        past: Past,
        show_picture: bool,
    ) -> anyhow::Result<Self> {
        let address = args.listen.unwrap_or(ADDRESS);
        let token = match &args.token {
            None if !address.ip().is_loopback() => Some(Access::random_token()?),
            given => given.clone(),
        };
        let keep = match past {
            Past::LastMinute => LAST_MINUTE,
            Past::Record => Duration::MAX,
        };
        let (access, hub) = (Access::new(token.clone()), Hub::new(keep, show_picture));
        let bodies = hub.clone();
        let server = Server::start(address, move |request| {
            // The page itself tells nothing of anybody.
            view::answer(request)
                .or_else(|| access.refuse(request))
                .unwrap_or_else(|| bodies.answer(request))
        });
        let server = server.map_err(|e| {
            Failure::unavailable(format!(
                "{flag} {address}: {e}; choose another address, or stop who has it"
            ))
        })?;
        if show_picture {
            tracing::warn!(
                "--show-picture: whoever opens the page at {} sees what cameras see that publish their pictures",
                server.address()
            );
        }
        Ok(Self {
            server,
            hub,
            token,
            is_token_known: args.token.is_some(),
        })
    }

    /// What a browser opens.
    fn url(&self) -> String {
        let mut url = self.place();
        if let Some(token) = &self.token {
            let _ = write!(url, "?token={token}");
        }
        url
    }

    /// The same as this process says it. More people read the journal than the settings: a token that was set, it does
    /// not hold.
    pub fn url_for_log(&self) -> String {
        match self.is_token_known && log::to_journal() {
            true => format!("{} (with the token that was set)", self.place()),
            false => self.url(),
        }
    }

    fn place(&self) -> String {
        let address = self.server.address();
        let host = fs::read_to_string("/proc/sys/kernel/hostname");
        match host {
            // Other machines reach it by this one's name.
            Ok(host) if address.ip().is_unspecified() => {
                format!("http://{}:{}/", host.trim(), address.port())
            }
            _ => format!("http://{address}/"),
        }
    }

    /// Where frames go.
    pub fn hub(&self) -> &Hub {
        &self.hub
    }
}

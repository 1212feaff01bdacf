//! Whether and where figures are served.

use std::fmt;
use std::net::SocketAddr;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Options of the figures.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MetricsArgs {
    /// Serve figures for Prometheus on this address of the machine itself, such as 127.0.0.1:9733 (cameras only)
    #[arg(long = "metrics", value_name = "ADDRESS")]
    pub address: Option<Loopback>,
}

/// An address that only this machine reaches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Loopback(pub SocketAddr);

impl FromStr for Loopback {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<SocketAddr>() {
            Ok(address) if address.ip().is_loopback() => Ok(Self(address)),
            Ok(_) => Err(format!(
                "'{text}': expected an address of this machine itself, such as 127.0.0.1:9733; a proxy can serve others"
            )),
            Err(_) => Err(format!(
                "'{text}': expected address and port, such as 127.0.0.1:9733"
            )),
        }
    }
}

impl TryFrom<String> for Loopback {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Loopback> for String {
    fn from(address: Loopback) -> Self {
        address.to_string()
    }
}

impl fmt::Display for Loopback {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

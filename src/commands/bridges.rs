//! Where bodies go besides shared memory while a camera runs: OSC, VMC, the page with its WebSocket.

use std::net::SocketAddr;

use serde::{Deserialize, Serialize};

use super::exit::Failure;
use super::serve::{PageArgs, PageServer, parse_token};
use crate::bridge::osc::OscBridge;
use crate::bridge::vmc::VmcBridge;
use crate::bridge::websocket::Hub;
use crate::message::BodyFrame;
use crate::sink::Sinks;

/// Options of the bridges, all of them off when not given.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BridgeArgs {
    /// Serve the page of 'edgecap view' and bodies over WebSocket at this address [--view alone: 127.0.0.1:9744]
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "127.0.0.1:9744")]
    pub view: Option<SocketAddr>,
    /// What clients of the page have to know [default: none on this machine, else a random one]
    #[arg(long, value_name = "TOKEN", value_parser = parse_token)]
    pub token: Option<String>,
    /// Send joints as OSC over UDP to this address, such as 127.0.0.1:9000
    #[arg(long, value_name = "ADDRESS")]
    pub osc: Option<SocketAddr>,
    /// Send bone rotations for avatars as VMC over UDP to this address, such as 127.0.0.1:39539, each further person to the next port
    #[arg(long, value_name = "ADDRESS")]
    pub vmc: Option<SocketAddr>,
}

impl BridgeArgs {
    /// Whether nothing goes anywhere.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The page, if there is to be one.
    ///
    /// # Errors
    /// Exit code 69 where the address cannot be had.
    pub fn serve(&self) -> anyhow::Result<Option<PageServer>> {
        let Some(address) = self.view else {
            return Ok(None);
        };
        let page = PageArgs {
            listen: Some(address),
            token: self.token.clone(),
        };
        PageServer::start(&page).map(Some)
    }

    /// Adds what `camera`'s bodies go to.
    ///
    /// # Errors
    /// Exit code 69 where the system has no socket.
    pub fn add_to(
        &self,
        sinks: &mut Sinks<BodyFrame>,
        camera: &str,
        page: Option<&Hub>,
    ) -> anyhow::Result<()> {
        if let Some(hub) = page {
            sinks.push(hub.sink(camera));
        }
        let failed = |flag: &str, to: SocketAddr, e: std::io::Error| {
            Failure::unavailable(format!("--{flag} {to}: {e}; choose another address"))
        };
        if let Some(to) = self.osc {
            sinks.push(OscBridge::new(camera, to).map_err(|e| failed("osc", to, e))?);
        }
        if let Some(to) = self.vmc {
            sinks.push(VmcBridge::new(to).map_err(|e| failed("vmc", to, e))?);
        }
        Ok(())
    }
}

//! Where bodies and events go besides shared memory while a camera runs: OSC, VMC, the page with its WebSocket.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Deserializer, Serialize};
use signal_hook::SigId;
use signal_hook::consts::SIGUSR1;

use super::exit::Failure;
use super::input::path_in_words;
use super::serve::{PageArgs, PageServer, Past, address, parse_address, parse_token};
use crate::bridge::expect_port;
use crate::bridge::osc::{OscBridge, OscEvents, OscHealth};
use crate::bridge::vmc::{VmcBridge, expect_ports};
use crate::bridge::websocket::Hub;
use crate::message::{BodyFrame, EventFrame, HealthFrame};
use crate::sink::{FlightSink, Sinks};

/// Options of the bridges, all of them off when not given.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BridgeArgs {
    /// Serve the page of 'edgecap view', and bodies, events and health over WebSocket, at this address [--view alone:
    /// 127.0.0.1:9744]
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1,
        default_missing_value = "127.0.0.1:9744", value_parser = parse_address)]
    #[serde(deserialize_with = "address")]
    pub view: Option<SocketAddr>,
    /// What clients of the page have to know: 8 or more letters, digits, '-', '_' [default: none on this machine, else
    /// a random one]
    #[arg(long, value_name = "TOKEN", value_parser = parse_token)]
    pub token: Option<String>,
    /// Send joints, events and health as OSC over UDP to this address, such as 127.0.0.1:9000
    #[arg(long, value_name = "ADDRESS", value_parser = parse_osc_address)]
    #[serde(deserialize_with = "osc_address")]
    pub osc: Option<SocketAddr>,
    /// Send bone rotations for avatars as VMC over UDP to this address, such as 127.0.0.1:39539, each further person to
    /// the next port
    #[arg(long, value_name = "ADDRESS", value_parser = parse_vmc_address)]
    #[serde(deserialize_with = "vmc_address")]
    pub vmc: Option<SocketAddr>,
    /// Keep the last minute of a camera's bodies, and write it to this folder on SIGUSR1, or when a process has crashed
    #[arg(long, value_name = "DIR", value_parser = path_in_words())]
    pub flight: Option<PathBuf>,
}

/// Saves the last minute: when this process gets SIGUSR1, and when it is told of a crash.
#[derive(Debug)]
pub struct Flight {
    sink: FlightSink,
    asked: Arc<AtomicBool>,
    /// Of the handler, which goes with this.
    handler: SigId,
}

impl Flight {
    fn new(sink: FlightSink) -> anyhow::Result<Self> {
        let asked = Arc::new(AtomicBool::new(false));
        let handler = signal_hook::flag::register(SIGUSR1, Arc::clone(&asked))?;
        Ok(Self {
            sink,
            asked,
            handler,
        })
    }

    /// Saves if somebody has asked, or something `crashed`. A folder that cannot be written stops nothing.
    pub fn look(&self, crashed: bool) {
        if self.asked.swap(false, Ordering::Relaxed) {
            self.sink.save();
        } else if crashed {
            self.sink.save_after_crash();
        }
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        signal_hook::low_level::unregister(self.handler);
    }
}

impl BridgeArgs {
    /// Whether nothing goes anywhere.
    pub fn is_empty(&self) -> bool {
        let Self {
            view,
            token: _,
            osc,
            vmc,
            flight,
        } = self;
        [view, osc, vmc].iter().all(|to| to.is_none()) && flight.is_none()
    }

    /// Refuses a token without the page that it is for.
    ///
    /// # Errors
    /// Exit code 64 where there is none.
    pub fn expect_page(&self) -> anyhow::Result<()> {
        match (&self.token, self.view) {
            (Some(_), None) => Err(Failure::usage(
                "--token: expected --view, whose page it is for, found none; add --view, or leave out --token",
            )
            .into()),
            _ => Ok(()),
        }
    }

    /// The page, if there is to be one, with pictures where the user wants them.
    ///
    /// # Errors
    /// Exit code 69 where the address cannot be had.
    pub fn serve(&self, show_picture: bool) -> anyhow::Result<Option<PageServer>> {
        let Some(address) = self.view else {
            return Ok(None);
        };
        let page = PageArgs {
            listen: Some(address),
            token: self.token.clone(),
        };
        PageServer::start("--view", &page, Past::LastMinute, show_picture).map(Some)
    }

    /// Adds what `camera`'s bodies go to; returns who saves the last minute, if somebody is to.
    ///
    /// # Errors
    /// Exit code 69 where the system has no socket, 73 where the folder cannot be made.
    pub fn add_to(
        &self,
        sinks: &mut Sinks<BodyFrame>,
        camera: &str,
        page: Option<&Hub>,
    ) -> anyhow::Result<Option<Flight>> {
        if let Some(hub) = page {
            sinks.push(hub.sink(camera));
        }
        if let Some(to) = self.osc {
            sinks.push(OscBridge::new(camera, to).map_err(|e| failed("osc", to, e))?);
        }
        if let Some(to) = self.vmc {
            sinks.push(VmcBridge::new(to).map_err(|e| failed("vmc", to, e))?);
        }
        let Some(folder) = &self.flight else {
            return Ok(None);
        };
        let sink = FlightSink::create(folder, camera)?;
        sinks.push(sink.clone());
        Flight::new(sink).map(Some)
    }

    /// Adds what `camera`'s events go to. VMC has no place for them.
    ///
    /// # Errors
    /// Exit code 69 where the system has no socket.
    pub fn add_events_to(
        &self,
        sinks: &mut Sinks<EventFrame>,
        camera: &str,
        page: Option<&Hub>,
    ) -> anyhow::Result<()> {
        if let Some(hub) = page {
            sinks.push(hub.sink(camera));
        }
        if let Some(to) = self.osc {
            sinks.push(OscEvents::new(camera, to).map_err(|e| failed("osc", to, e))?);
        }
        Ok(())
    }

    /// Adds what hears how `camera` is doing. VMC says no more than that nobody is sent.
    ///
    /// # Errors
    /// Exit code 69 where the system has no socket.
    pub fn add_health_to(
        &self,
        sinks: &mut Sinks<HealthFrame>,
        camera: &str,
        page: Option<&Hub>,
    ) -> anyhow::Result<()> {
        if let Some(hub) = page {
            sinks.push(hub.health_sink(camera));
        }
        if let Some(to) = self.osc {
            sinks.push(OscHealth::new(camera, to).map_err(|e| failed("osc", to, e))?);
        }
        Ok(())
    }
}

/// Reads an address to send to.
fn parse_osc_address(text: &str) -> Result<SocketAddr, String> {
    let to = parse_address(text)?;
    expect_port(to).map(|()| to)
}

/// Reads an address from whose port on everybody has one.
fn parse_vmc_address(text: &str) -> Result<SocketAddr, String> {
    let to = parse_address(text)?;
    expect_ports(to).map(|()| to)
}

/// The same of the settings.
fn osc_address<'de, D: Deserializer<'de>>(from: D) -> Result<Option<SocketAddr>, D::Error> {
    expected(address(from)?, expect_port)
}

fn vmc_address<'de, D: Deserializer<'de>>(from: D) -> Result<Option<SocketAddr>, D::Error> {
    expected(address(from)?, expect_ports)
}

fn expected<E: serde::de::Error>(
    to: Option<SocketAddr>,
    expect: impl Fn(SocketAddr) -> Result<(), String>,
) -> Result<Option<SocketAddr>, E> {
    let refused = |to| expect(to).map_err(|e| E::custom(format!("'{to}': {e}")));
    to.map(refused).transpose()?;
    Ok(to)
}

fn failed(flag: &str, to: SocketAddr, e: std::io::Error) -> Failure {
    Failure::unavailable(format!("--{flag} {to}: {e}; choose another address"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A camera that is tried again and again would leave one each time.
    #[test]
    fn the_handler_of_a_flight_goes_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let sink = FlightSink::create(folder.path(), "hall").unwrap();
        let flight = Flight::new(sink).unwrap();
        let asked = Arc::downgrade(&flight.asked);
        assert!(asked.strong_count() > 1);
        drop(flight);
        assert_eq!(asked.strong_count(), 0);
    }
}

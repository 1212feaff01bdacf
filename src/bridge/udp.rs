//! Datagrams to somebody who may be there or not.

use std::cell::RefCell;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};

use super::outcome::Outcomes;
use crate::camera::monotonic_ns;
use crate::message::FLAG_FILE_TIME;

/// Most bytes of a datagram that goes through Ethernet in one piece, over IPv4 and IPv6. Of one in pieces all is lost
/// with any of them.
const MOST_BYTES: [usize; 2] = [1472, 1452];
/// Seconds from 1900, where OSC's time begins, to 1970.
const FROM_1900: u64 = 2_208_988_800;

/// Refuses an address that nothing can be sent to.
///
/// # Errors
/// What was expected.
pub fn expect_port(to: SocketAddr) -> Result<(), String> {
    match to.port() {
        0 => Err("expected a port to send to, from 1 to 65535, found 0".to_owned()),
        _ => Ok(()),
    }
}

/// Sends packets of OSC to one machine.
#[derive(Debug)]
pub struct Outlet {
    socket: UdpSocket,
    to: SocketAddr,
    outcomes: RefCell<Outcomes>,
}

impl Outlet {
    /// To `to`; nobody need be there.
    ///
    /// # Errors
    /// The system's.
    pub fn new(to: SocketAddr) -> io::Result<Self> {
        let any: SocketAddr = match to {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(any)?;
        // A full network loses a frame; the next one is newer.
        socket.set_nonblocking(true)?;
        // An address of all machines of a network is as good as one.
        socket.set_broadcast(true)?;
        Ok(Self {
            socket,
            to,
            outcomes: RefCell::default(),
        })
    }

    /// Where it sends to, `above` the first port.
    pub fn to(&self, above: u16) -> SocketAddr {
        let mut to = self.to;
        to.set_port(self.to.port().saturating_add(above));
        to
    }

    /// Sends messages as one bundle to the port so far `above` the first, as several with one time tag where one would
    /// be too large. Whether anybody takes it is not known; that it cannot be sent is logged.
    pub fn send(&self, above: u16, timetag: OscTime, messages: Vec<OscMessage>) {
        let content = messages.into_iter().map(OscPacket::Message).collect();
        self.send_bundle(above, OscBundle { timetag, content });
    }

    fn send_bundle(&self, above: u16, bundle: OscBundle) {
        let whole = OscPacket::Bundle(bundle);
        let Ok(bytes) = encoder::encode(&whole) else {
            return;
        };
        let most = MOST_BYTES[usize::from(self.to.is_ipv6())];
        match whole {
            OscPacket::Bundle(mut first) if bytes.len() > most && first.content.len() > 1 => {
                let timetag = first.timetag;
                let content = first.content.split_off(first.content.len().div_ceil(2));
                self.send_bundle(above, first);
                self.send_bundle(above, OscBundle { timetag, content });
            }
            _ => self.send_bytes(above, &bytes),
        }
    }

    fn send_bytes(&self, above: u16, bytes: &[u8]) {
        let to = self.to(above);
        let sent = self.socket.send_to(bytes, to).map(drop);
        match self.outcomes.borrow_mut().note(sent) {
            None => {}
            Some(Ok(())) => tracing::warn!("datagrams reach {to} again"),
            Some(Err(e)) => {
                tracing::warn!(
                    "cannot send datagrams to {to}: {e}; check the address and the network"
                );
            }
        }
    }
}

/// A message.
pub fn message(address: impl Into<String>, args: Vec<OscType>) -> OscMessage {
    OscMessage {
        addr: address.into(),
        args,
    }
}

/// A message's time in OSC's, by its `FLAG_*` bits. A file's clock is no clock: its frames are of now.
pub fn time_of(time_ns: u64, flags: u32) -> OscTime {
    let since_1970 = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap_or_default();
    let ago = match flags & FLAG_FILE_TIME {
        0 => monotonic_ns() as i128 - i128::from(time_ns),
        _ => 0,
    };
    let ns = (since_1970.as_nanos() as i128 - ago).max(0) as u128;
    let (seconds, rest) = ((ns / 1_000_000_000) as u64, ns % 1_000_000_000);
    OscTime {
        seconds: (seconds + FROM_1900) as u32,
        fractional: ((rest << 32) / 1_000_000_000) as u32,
    }
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddrV6;

    use super::*;

    #[test]
    fn a_further_port_is_on_the_same_interface() {
        let to = SocketAddrV6::new("fe80::1".parse().unwrap(), 39539, 0, 3);
        let outlet = Outlet {
            socket: UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap(),
            to: to.into(),
            outcomes: RefCell::default(),
        };
        let to = [0, 1].map(|above| outlet.to(above).to_string());
        assert_eq!(to, ["[fe80::1%3]:39539", "[fe80::1%3]:39540"]);
    }

    #[test]
    fn all_machines_of_a_network_may_be_told() {
        let outlet = Outlet::new((Ipv4Addr::BROADCAST, 9).into()).unwrap();
        assert!(outlet.socket.broadcast().unwrap());
    }
}

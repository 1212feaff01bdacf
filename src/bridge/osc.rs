//! OSC over UDP: one bundle a body, with the time its pose is given for; one for what has happened by a frame. What is
//! too large for one datagram comes in several of the same time.
//!
//! | address | arguments |
//! |---|---|
//! | `/edgecap/<camera>/frame` | i number of the frame, i people, s `floor` or `camera`: the axes of what follows; a bundle of its own, first |
//! | `/edgecap/<camera>/body/<id>/<joint>` | f x, f y, f z in metres, f confidence 0–1; 21 of them, named as the joints are |
//! | `/edgecap/<camera>/body/<id>/gone` | – ; once, when somebody is not published any more, or no frame comes |
//! | `/edgecap/<camera>/event/<event>` | i person, 0 nobody; s zone or hand, or empty; f seconds, or 0 |
//! | `/edgecap/<camera>/health` | s state, f seconds of it, s pace, f pictures a second, i cameras that send, i all |
//!
//! How a camera is doing comes at every change of its state and about once a second, also while no frame does.
//!
//! Axes: the floor's where one is known (x to the camera's right, y up, z towards the viewer), else the camera's (x
//! right, y down, z forward).

use std::io;
use std::net::SocketAddr;

use rosc::OscType::{Float, Int, String as Text};

use super::udp::{Outlet, message, time_of};
use crate::camera::monotonic_ns;
use crate::joints::JOINT_NAMES;
use crate::message::{
    BodyFrame, EventFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME, Hand, HealthFrame,
};
use crate::sink::{Packet, Sink, SinkError, Streamed};

/// Sends every frame.
#[derive(Debug)]
pub struct OscBridge {
    outlet: Outlet,
    camera: String,
    present: Vec<u32>,
    /// Of the newest frame.
    number: u64,
}

impl OscBridge {
    /// Sends `camera`'s frames to `to`.
    ///
    /// # Errors
    /// The system's.
    pub fn new(camera: &str, to: SocketAddr) -> io::Result<Self> {
        Ok(Self {
            outlet: Outlet::new(to)?,
            camera: camera.to_owned(),
            present: Vec::new(),
            number: 0,
        })
    }

    fn send(&mut self, frame: &BodyFrame) {
        let (root, time) = (
            format!("/edgecap/{}", self.camera),
            time_of(frame.pose_ns, frame.flags),
        );
        let (bodies, world) = (frame.bodies(), frame.world);
        let axes = if world.is_known() { "floor" } else { "camera" };
        let head = vec![
            Int(frame.sequence as i32),
            Int(bodies.len() as i32),
            Text(axes.to_owned()),
        ];
        let head = message(format!("{root}/frame"), head);
        self.outlet.send(0, time, vec![head]);
        for body in bodies {
            let joints = JOINT_NAMES.iter().enumerate().map(|(j, name)| {
                let [x, y, z] = match world.is_known() {
                    true => world.point(body.joints3d[j]),
                    false => body.joints3d[j],
                };
                let numbers = [x, y, z, body.confidence[j]];
                let address = format!("{root}/body/{}/{name}", body.id);
                message(address, numbers.map(Float).to_vec())
            });
            self.outlet.send(0, time, joints.collect());
        }
        let is_gone = |id: &&u32| !bodies.iter().any(|b| b.id == **id);
        for id in self.present.iter().filter(is_gone) {
            let gone = message(format!("{root}/body/{id}/gone"), Vec::new());
            self.outlet.send(0, time, vec![gone]);
        }
        self.present = bodies.iter().map(|b| b.id).collect();
        self.number = frame.sequence;
    }

    /// Nobody is there any more, as of now.
    fn send_nobody(&mut self) {
        self.send(&BodyFrame {
            sequence: self.number,
            flags: FLAG_FILE_TIME,
            ..BodyFrame::default()
        });
    }
}

impl Sink<BodyFrame> for OscBridge {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        self.send(packet.message);
        Ok(())
    }

    fn quiet(&mut self) {
        if !self.present.is_empty() {
            self.send_nobody();
        }
    }

    fn end(&mut self) -> Result<(), SinkError> {
        self.send_nobody();
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        Ok(None)
    }
}

/// Sends what has happened.
#[derive(Debug)]
pub struct OscEvents {
    outlet: Outlet,
    camera: String,
}

impl OscEvents {
    /// Sends `camera`'s events to `to`.
    ///
    /// # Errors
    /// The system's.
    pub fn new(camera: &str, to: SocketAddr) -> io::Result<Self> {
        Ok(Self {
            outlet: Outlet::new(to)?,
            camera: camera.to_owned(),
        })
    }
}

impl Sink<EventFrame> for OscEvents {
    fn take(&mut self, packet: &Packet<'_, EventFrame>) -> Result<(), SinkError> {
        let frame = packet.message;
        let messages = frame.events().iter().filter_map(|event| {
            let address = format!("/edgecap/{}/event/{}", self.camera, event.kind.name()?);
            let which = match event.hand {
                Hand::NONE => event.zone(),
                hand => hand.name().unwrap_or_default(),
            };
            let args = vec![
                Int(event.person as i32),
                Text(which.to_owned()),
                Float(event.seconds),
            ];
            Some(message(address, args))
        });
        let messages: Vec<_> = messages.collect();
        if !messages.is_empty() {
            let time = time_of(frame.time_ns, frame.flags);
            self.outlet.send(0, time, messages);
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        Ok(None)
    }
}

/// Sends how a camera is doing.
#[derive(Debug)]
pub struct OscHealth {
    outlet: Outlet,
    camera: String,
    /// What it said last.
    newest: HealthFrame,
}

impl OscHealth {
    /// Sends to `to` how `camera` is doing.
    ///
    /// # Errors
    /// The system's.
    pub fn new(camera: &str, to: SocketAddr) -> io::Result<Self> {
        Ok(Self {
            outlet: Outlet::new(to)?,
            camera: camera.to_owned(),
            newest: HealthFrame::default(),
        })
    }

    fn send(&self) {
        let health = &self.newest;
        let args = vec![
            Text(health.state.name().unwrap_or_default().to_owned()),
            Float(health.state_seconds()),
            Text(health.pace.name().unwrap_or_default().to_owned()),
            Float(health.observed_hz),
            Int(health.cameras_live as i32),
            Int(health.cameras as i32),
        ];
        // Its own times are of this machine's clock, those of films, too.
        let time = time_of(health.publish_ns, 0);
        let told = message(format!("/edgecap/{}/health", self.camera), args);
        self.outlet.send(0, time, vec![told]);
    }
}

impl Sink<HealthFrame> for OscHealth {
    fn take(&mut self, packet: &Packet<'_, HealthFrame>) -> Result<(), SinkError> {
        self.newest = *packet.message;
        self.send();
        Ok(())
    }

    fn end(&mut self) -> Result<(), SinkError> {
        if self.newest.flags & FLAG_END_OF_STREAM == 0 {
            self.newest.end();
            self.newest.stamp(monotonic_ns());
            self.send();
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        Ok(None)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::net::{Ipv4Addr, UdpSocket};
    use std::time::Duration;

    use rosc::{OscMessage, OscPacket, OscTime, decoder};

    use super::*;
    use crate::message::HealthState;

    /// Somebody on this machine to whom bundles are sent.
    pub struct Listener(UdpSocket);

    impl Default for Listener {
        fn default() -> Self {
            let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
            let patience = Some(Duration::from_secs(60));
            socket.set_read_timeout(patience).unwrap();
            Self(socket)
        }
    }

    impl Listener {
        pub fn address(&self) -> SocketAddr {
            self.0.local_addr().unwrap()
        }

        /// The messages of the next bundle.
        pub fn bundle(&self) -> Vec<OscMessage> {
            self.datagram().2
        }

        /// The bytes of the next datagram, and of its bundle the time and the messages.
        pub fn datagram(&self) -> (usize, OscTime, Vec<OscMessage>) {
            let mut bytes = [0; 65536];
            let length = self.0.recv(&mut bytes).unwrap();
            let (_, packet) = decoder::decode_udp(&bytes[..length]).unwrap();
            let OscPacket::Bundle(bundle) = packet else {
                panic!("expected a bundle, found {packet:?}");
            };
            let messages = bundle.content.into_iter().map(|packet| match packet {
                OscPacket::Message(message) => message,
                OscPacket::Bundle(_) => panic!("expected messages"),
            });
            (length, bundle.timetag, messages.collect())
        }
    }

    #[test]
    fn a_body_of_a_camera_with_a_long_name_comes_in_datagrams_that_are_not_cut() {
        let listener = Listener::default();
        let mut frame = BodyFrame {
            count: 1,
            ..BodyFrame::default()
        };
        frame.bodies[0].id = 6;
        for (camera, datagrams) in [("hall".to_owned(), 1), ("h".repeat(60), 2)] {
            let mut bridge = OscBridge::new(&camera, listener.address()).unwrap();
            bridge.send(&frame);
            let (_, time, _) = listener.datagram();
            let (mut names, mut received) = (Vec::new(), 0);
            while names.len() < JOINT_NAMES.len() {
                let (length, at, messages) = listener.datagram();
                assert!(length <= 1472, "{length} bytes");
                assert_eq!(at, time);
                names.extend(messages.into_iter().map(|m| m.addr));
                received += 1;
            }
            let wanted = JOINT_NAMES.map(|joint| format!("/edgecap/{camera}/body/6/{joint}"));
            assert_eq!(names, wanted);
            assert_eq!(received, datagrams, "{camera}");
        }
    }

    #[test]
    fn how_a_camera_is_doing_is_told_and_its_end_once() {
        let listener = Listener::default();
        let mut sink = Box::new(OscHealth::new("hall", listener.address()).unwrap());
        let away = HealthFrame {
            publish_ns: 5_000_000_000,
            since_ns: 3_000_000_000,
            state: HealthState::AWAY,
            cameras: 1,
            ..HealthFrame::default()
        };
        let packet = Packet {
            message: &away,
            source: "",
            picture: None,
        };
        let told = || {
            let [told] = &listener.bundle()[..] else {
                panic!("expected one message");
            };
            assert_eq!(told.addr, "/edgecap/hall/health");
            told.args.clone()
        };
        let text = |word: &str| Text(word.to_owned());
        sink.take(&packet).unwrap();
        let pace = text("unknown");
        assert_eq!(
            told(),
            [
                text("away"),
                Float(2.0),
                pace.clone(),
                Float(0.0),
                Int(0),
                Int(1)
            ]
        );
        sink.end().unwrap();
        sink.end().unwrap();
        assert_eq!(told()[0], text("ended"));
        // It goes on, as of a camera whose process is started again.
        sink.take(&packet).unwrap();
        assert_eq!(told()[0], text("away"));
        sink.finish().unwrap();
    }

    #[test]
    fn everybody_is_gone_once_when_frames_stay_away_and_comes_back_with_them() {
        let listener = Listener::default();
        let mut bridge = OscBridge::new("hall", listener.address()).unwrap();
        let mut frame = BodyFrame {
            sequence: 3,
            count: 1,
            ..BodyFrame::default()
        };
        frame.bodies[0].id = 6;
        let people = || {
            let [head] = &listener.bundle()[..] else {
                panic!("expected a head");
            };
            assert_eq!(head.addr, "/edgecap/hall/frame");
            assert_eq!(head.args[0], Int(3));
            head.args[1].clone()
        };
        for _ in 0..2 {
            bridge.send(&frame);
            assert_eq!(people(), Int(1));
            assert_eq!(listener.bundle().len(), JOINT_NAMES.len());
            bridge.quiet();
            assert_eq!(people(), Int(0));
            assert_eq!(listener.bundle()[0].addr, "/edgecap/hall/body/6/gone");
            bridge.quiet();
        }
    }
}

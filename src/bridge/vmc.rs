//! VMC (Virtual Motion Capture) over UDP: bone rotations for avatars, one person a port, from the given port upwards.
//!
//! Axes are Unity's: left-handed, x right, y up, z forward, metres; an avatar without rotation faces forward in a
//! T-pose. Somebody who stands and faces the camera is without rotation. Hips are where the pelvis is on the floor, or
//! where no floor is known, at the height that the legs give, sidewards and forward as seen from the camera.
//!
//! Who listens at a port whose person has gone gets `/VMC/Ext/OK` 0: at every port in use when no frames come any more,
//! and at the end.

use std::io;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use rosc::OscType::{Float, Int, String as Text};
use rosc::{OscMessage, OscTime, OscType};

use super::udp::{Outlet, message, time_of};
use crate::body::skeleton::{Skeleton, TPose};
use crate::joints::PELVIS;
use crate::message::{Body, BodyFrame, FLAG_FILE_TIME, HUMANOID_BONE_COUNT, HUMANOID_BONES};
use crate::sink::{Packet, Sink, SinkError};

/// People at a time: ports from the first on.
pub const MOST_PEOPLE: usize = 8;
/// A port is kept for somebody who is away for less.
const KEPT: Duration = Duration::from_secs(2);

/// Sends every frame.
#[derive(Debug)]
pub struct VmcBridge {
    outlet: Outlet,
    began: Instant,
    /// Who has which port, and when they were last there.
    ports: [Option<(u32, Instant)>; MOST_PEOPLE],
}

impl VmcBridge {
    /// Sends people to `to` and the ports above.
    ///
    /// # Errors
    /// The system's.
    pub fn new(to: SocketAddr) -> io::Result<Self> {
        Ok(Self {
            outlet: Outlet::new(to)?,
            began: Instant::now(),
            ports: [None; MOST_PEOPLE],
        })
    }

    fn send(&mut self, frame: &BodyFrame) {
        let (now, time) = (Instant::now(), time_of(frame.pose_ns, frame.flags));
        for port in 0..MOST_PEOPLE {
            if self.ports[port].is_some_and(|(_, seen)| now - seen > KEPT) {
                self.free(port, time);
            }
        }
        for body in frame.bodies() {
            let Some(port) = self.port_of(body.id) else {
                continue;
            };
            self.ports[port] = Some((body.id, now));
            let clock = self.began.elapsed().as_secs_f32();
            let mut messages = vec![
                message("/VMC/Ext/OK", vec![Int(1)]),
                message("/VMC/Ext/T", vec![Float(clock)]),
                pose("Root/Pos", "root", DVec3::ZERO, DQuat::IDENTITY),
            ];
            messages.extend(bones(frame, body));
            self.outlet.send(port as u16, time, messages);
        }
    }

    /// Lets a port go, and tells who listens there that nobody is sent any more.
    fn free(&mut self, port: usize, time: OscTime) {
        self.ports[port] = None;
        let clock = self.began.elapsed().as_secs_f32();
        let gone = vec![
            message("/VMC/Ext/OK", vec![Int(0)]),
            message("/VMC/Ext/T", vec![Float(clock)]),
        ];
        self.outlet.send(port as u16, time, gone);
    }

    /// Lets every port go, as of now, whatever clock the frames had.
    fn free_all(&mut self) {
        let time = time_of(0, FLAG_FILE_TIME);
        for port in 0..MOST_PEOPLE {
            if self.ports[port].is_some() {
                self.free(port, time);
            }
        }
    }

    /// The port of somebody, or a free one.
    fn port_of(&self, id: u32) -> Option<usize> {
        let theirs = self
            .ports
            .iter()
            .position(|p| p.is_some_and(|(i, _)| i == id));
        theirs.or_else(|| self.ports.iter().position(Option::is_none))
    }
}

/// The bones of a body, as messages.
fn bones(frame: &BodyFrame, body: &Body) -> impl Iterator<Item = OscMessage> {
    let rest = TPose::new(Skeleton::builtin(), &body.bone_lengths.map(f64::from));
    let hips = hips(frame, body);
    let mut rotations = body.bone_rotations;
    if frame.world.is_known() {
        // On the floor, however the camera is tilted.
        rotations[0] = frame.world.orientation(body.orientation);
    }
    (0..HUMANOID_BONE_COUNT).map(move |b| {
        let place = if b == 0 { hips } else { rest.offsets[b] };
        let turn = DQuat::from_array(rotations[b].map(f64::from));
        pose("Bone/Pos", &unity_name(HUMANOID_BONES[b]), place, turn)
    })
}

/// Where the hips are: x to the left of who faces the camera, y above the floor, z towards the camera.
fn hips(frame: &BodyFrame, body: &Body) -> DVec3 {
    let in_camera = body.joints3d[PELVIS];
    if frame.world.is_known() {
        return DVec3::from_array(frame.world.point(in_camera).map(f64::from));
    }
    let lowest = body.joints3d.iter().map(|j| j[1]).fold(f32::MIN, f32::max);
    let [x, y, z] = in_camera;
    DVec3::new(x.into(), (lowest - y).into(), (-z).into())
}

/// A place and a rotation in right-handed axes with x to the left, as Unity has them: with x mirrored.
fn pose(kind: &str, name: &str, p: DVec3, q: DQuat) -> OscMessage {
    let mut args: Vec<OscType> = vec![Text(name.to_owned())];
    let numbers = [-p.x, p.y, p.z, q.x, -q.y, -q.z, q.w];
    args.extend(numbers.map(|n| Float(n as f32)));
    message(format!("/VMC/Ext/{kind}"), args)
}

/// `HumanBodyBones` of Unity begin with a capital.
fn unity_name(bone: &str) -> String {
    let mut letters = bone.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_ascii_uppercase().to_string() + letters.as_str()
    })
}

impl Sink<BodyFrame> for VmcBridge {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        self.send(packet.message);
        Ok(())
    }

    fn quiet(&mut self) {
        self.free_all();
    }

    fn end(&mut self) -> Result<(), SinkError> {
        self.free_all();
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bridge::osc::tests::Listener;

    #[test]
    fn who_listens_hears_once_that_frames_stay_away_and_then_goes_on() {
        let listener = Listener::default();
        let mut bridge = VmcBridge::new(listener.address()).unwrap();
        let mut frame = BodyFrame {
            count: 1,
            ..BodyFrame::default()
        };
        frame.bodies[0].id = 6;
        let ok = || {
            let [first, ..] = &listener.bundle()[..] else {
                panic!("expected messages");
            };
            assert_eq!(first.addr, "/VMC/Ext/OK");
            first.args.clone()
        };
        for _ in 0..2 {
            bridge.send(&frame);
            assert_eq!(ok(), [Int(1)]);
            bridge.quiet();
            assert_eq!(ok(), [Int(0)]);
            bridge.quiet();
        }
    }
}

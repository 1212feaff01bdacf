//! VMC (Virtual Motion Capture) over UDP: bone rotations for avatars, one person a port, from the given port upwards.
//!
//! Axes are Unity's: left-handed, x right, y up, z forward, metres; an avatar without rotation faces forward in a
//! T-pose. Somebody who stands and faces the camera is without rotation. Hips are where the pelvis is on the floor, or
//! where no floor is known, at the height that the legs give, sidewards and forward as seen from the camera. The root
//! is below them, and their own place is above it: programs that leave the bones of an avatar as they are take no
//! bone's place, the hips' neither, but the root's.
//!
//! Who listens at a port whose person has gone gets `/VMC/Ext/OK` 0: at every port in use when no frames come any more,
//! and at the end. Ports in use are the first ones: where one is let go of, who has the highest takes it.

use std::io;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use rosc::OscType::{Float, Int, String as Text};
use rosc::{OscMessage, OscTime, OscType};

use super::udp::{Outlet, expect_port, message, time_of};
use crate::body::skeleton::{Skeleton, TPose};
use crate::joints::PELVIS;
use crate::message::{Body, BodyFrame, FLAG_FILE_TIME, HUMANOID_BONE_COUNT, HUMANOID_BONES};
use crate::sink::{Packet, Sink, SinkError};

/// People at a time: ports from the first on.
pub const MOST_PEOPLE: usize = 8;
/// The highest first port: above it not everybody would have one.
const LAST_PORT: u16 = u16::MAX - (MOST_PEOPLE as u16 - 1);
/// A port is kept for somebody who is away for less.
const KEPT: Duration = Duration::from_secs(2);
/// Seconds after which `/VMC/Ext/T` begins anew: as f32, frames of later ones would share a time.
const CLOCK: f64 = 86_400.0;

/// Sends every frame.
#[derive(Debug)]
pub struct VmcBridge {
    outlet: Outlet,
    began: Instant,
    ports: [Option<Holder>; MOST_PEOPLE],
}

/// Who has a port.
#[derive(Debug, Clone, Copy)]
struct Holder {
    id: u32,
    /// When they were last there.
    seen: Instant,
    /// Whether who listens there was told that nobody is sent.
    is_silent: bool,
}

impl VmcBridge {
    /// Sends people to `to` and the ports above.
    ///
    /// # Errors
    /// As [`expect_ports`], and the system's.
    pub fn new(to: SocketAddr) -> io::Result<Self> {
        expect_ports(to).map_err(|e| io::Error::new(io::ErrorKind::InvalidInput, e))?;
        Ok(Self {
            outlet: Outlet::new(to)?,
            began: Instant::now(),
            ports: [None; MOST_PEOPLE],
        })
    }

    fn send(&mut self, frame: &BodyFrame) {
        self.send_at(Instant::now(), frame);
    }

    fn send_at(&mut self, now: Instant, frame: &BodyFrame) {
        let time = time_of(frame.pose_ns, frame.flags);
        // Whoever is in the frame keeps the port, however long no frame has come.
        for body in frame.bodies() {
            if let Some(port) = self.port_of(body.id) {
                self.hold(port, body.id, now);
            }
        }
        let is_over = |h: &Holder| now.saturating_duration_since(h.seen) > KEPT;
        for port in 0..MOST_PEOPLE {
            if self.ports[port].as_ref().is_some_and(is_over) {
                self.hush(port, time);
                self.ports[port] = None;
            }
        }
        self.close_gaps(time);
        for body in frame.bodies() {
            let free = || self.ports.iter().position(Option::is_none);
            let Some(port) = self.port_of(body.id).or_else(free) else {
                continue;
            };
            self.hold(port, body.id, now);
            let mut messages = self.sign(1);
            let hips = hips(frame, body);
            let walked = DVec3::new(hips.x, 0.0, hips.z);
            messages.push(pose("Root/Pos", "root", walked, DQuat::IDENTITY));
            messages.extend(bones(frame, body, hips.y));
            self.outlet.send(port as u16, time, messages);
        }
    }

    fn hold(&mut self, port: usize, id: u32, now: Instant) {
        self.ports[port] = Some(Holder {
            id,
            seen: now,
            is_silent: false,
        });
    }

    /// Where one avatar is shown, it must not stand still while somebody is there.
    fn close_gaps(&mut self, time: OscTime) {
        let ends = |ports: &[Option<Holder>]| {
            let gap = ports.iter().position(Option::is_none)?;
            let last = ports.iter().rposition(Option::is_some)?;
            (gap < last).then_some((gap, last))
        };
        while let Some((gap, last)) = ends(&self.ports) {
            self.hush(last, time);
            self.ports.swap(gap, last);
        }
    }

    /// Tells who listens at a port that nobody is sent any more, once.
    fn hush(&mut self, port: usize, time: OscTime) {
        let gone = self.sign(0);
        if let Some(holder) = self.ports[port].as_mut().filter(|h| !h.is_silent) {
            holder.is_silent = true;
            self.outlet.send(port as u16, time, gone);
        }
    }

    /// The same at every port, as of now, whatever clock the frames had.
    fn hush_all(&mut self) {
        let time = time_of(0, FLAG_FILE_TIME);
        for port in 0..MOST_PEOPLE {
            self.hush(port, time);
        }
    }

    /// What every bundle begins with.
    fn sign(&self, ok: i32) -> Vec<OscMessage> {
        let time = clock(self.began.elapsed());
        vec![
            message("/VMC/Ext/OK", vec![Int(ok)]),
            message("/VMC/Ext/T", vec![Float(time)]),
        ]
    }

    fn port_of(&self, id: u32) -> Option<usize> {
        let is_theirs = |p: &Option<Holder>| p.is_some_and(|h| h.id == id);
        self.ports.iter().position(is_theirs)
    }
}

/// Whether there is a port for everybody.
///
/// # Errors
/// What was expected.
pub fn expect_ports(to: SocketAddr) -> Result<(), String> {
    expect_port(to)?;
    match to.port() {
        0..=LAST_PORT => Ok(()),
        port => Err(format!(
            "expected a port up to {LAST_PORT}, as {MOST_PEOPLE} people have one each, found {port}"
        )),
    }
}

/// The time that is told after a bridge has run for so long, seconds.
fn clock(run: Duration) -> f32 {
    (run.as_secs_f64() % CLOCK) as f32
}

/// The bones of a body whose hips are so high, as messages.
fn bones(frame: &BodyFrame, body: &Body, height: f64) -> impl Iterator<Item = OscMessage> {
    let skeleton = Skeleton::builtin();
    let rest = TPose::new(skeleton, &body.bone_lengths.map(f64::from));
    let hips = DVec3::new(0.0, height, 0.0);
    let mut rotations = body.bone_rotations;
    if frame.world.is_known() {
        // On the floor, however the camera is tilted.
        rotations[0] = frame.world.orientation(body.orientation);
    }
    let rotations = rotations.map(|q| DQuat::from_array(q.map(f64::from)));
    let offsets = rest.offsets_in_message(skeleton, &rotations);
    (0..HUMANOID_BONE_COUNT).map(move |b| {
        let (place, turn) = (if b == 0 { hips } else { offsets[b] }, rotations[b]);
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
        self.hush_all();
    }

    fn everybody_leaves(&mut self) {
        self.hush_all();
        self.ports = Default::default();
    }

    fn end(&mut self) -> Result<(), SinkError> {
        self.everybody_leaves();
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

    /// A frame of these people.
    fn frame(ids: &[u32]) -> BodyFrame {
        let mut frame = BodyFrame {
            count: ids.len() as u32,
            ..BodyFrame::default()
        };
        for (body, id) in frame.bodies.iter_mut().zip(ids) {
            body.id = *id;
        }
        frame
    }

    fn holders(bridge: &VmcBridge) -> Vec<Option<u32>> {
        let all = bridge.ports.iter().map(|p| p.map(|h| h.id));
        let held = 1 + bridge.ports.iter().rposition(Option::is_some).unwrap_or(0);
        all.take(held).collect()
    }

    #[test]
    fn somebody_who_is_there_has_the_first_port() {
        let listener = Listener::default();
        let mut bridge = VmcBridge::new(listener.address()).unwrap();
        let (start, after) = (Instant::now(), Duration::from_secs_f64);
        let mut send = |seconds: f64, ids: &[u32]| {
            bridge.send_at(start + after(seconds), &frame(ids));
            holders(&bridge)
        };
        // A successor, while the first port is kept for who has just left.
        assert_eq!(send(0.0, &[1]), [Some(1)]);
        assert_eq!(send(1.0, &[2]), [Some(1), Some(2)]);
        assert_eq!(send(2.1, &[2]), [Some(2)]);
        // Who leaves is replaced by the last; the others stay where they are.
        assert_eq!(send(2.2, &[2, 3, 4]), [Some(2), Some(3), Some(4)]);
        send(2.3, &[3, 4]);
        assert_eq!(send(4.4, &[3, 4]), [Some(4), Some(3)]);
        // Nobody changes places by a pause.
        bridge.quiet();
        bridge.send_at(start + after(60.0), &frame(&[3, 4]));
        assert_eq!(holders(&bridge), [Some(4), Some(3)]);
        // Nobody keeps a port for who comes back under another id.
        bridge.everybody_leaves();
        bridge.send_at(start + after(60.1), &frame(&[5]));
        assert_eq!(holders(&bridge), [Some(5)]);
    }

    #[test]
    fn an_avatar_whose_bones_stay_as_long_as_they_are_walks() {
        let listener = Listener::default();
        let mut bridge = VmcBridge::new(listener.address()).unwrap();
        let mut frame = frame(&[6]);
        frame.bodies[0].joints3d.fill([0.5, 2.0, 4.0]);
        frame.bodies[0].joints3d[PELVIS] = [0.5, 1.0, 4.0];
        bridge.send(&frame);
        let messages = listener.bundle();
        let place = |name: &str| {
            let is_it = |m: &&OscMessage| m.args[0] == Text(name.to_owned());
            let found = messages.iter().find(is_it).unwrap();
            found.args[1..4].to_vec()
        };
        // Half a metre to the left of who faces the camera, which Unity's x counts down, and four away from it.
        assert_eq!(place("root"), [-0.5, 0.0, -4.0].map(Float));
        assert_eq!(place("Hips"), [-0.0, 1.0, 0.0].map(Float));
    }

    #[test]
    fn there_is_a_port_for_everybody() {
        let new = |port| VmcBridge::new(([127, 0, 0, 1], port).into());
        let bridge = new(65528).unwrap();
        let last = bridge.outlet.to(MOST_PEOPLE as u16 - 1);
        assert_eq!(last.port(), 65535);
        for port in [65529, 65535] {
            let said = new(port).unwrap_err().to_string();
            let wanted = "expected a port up to 65528, as 8 people have one each, found ";
            assert_eq!(said, format!("{wanted}{port}"));
        }
        let said = new(0).unwrap_err().to_string();
        assert_eq!(said, "expected a port to send to, from 1 to 65535, found 0");
    }

    #[test]
    fn after_weeks_frames_still_have_times_of_their_own() {
        let at =
            |ms: u64| clock(Duration::from_secs(15 * 86_400 + 86_000) + Duration::from_millis(ms));
        let step = at(33) - at(0);
        assert!((0.02..0.05).contains(&step), "{step}");
    }

    #[test]
    fn who_listens_hears_once_that_frames_stay_away_and_then_goes_on() {
        let listener = Listener::default();
        let mut bridge = VmcBridge::new(listener.address()).unwrap();
        let frame = frame(&[6]);
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

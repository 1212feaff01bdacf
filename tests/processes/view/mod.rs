//! `edgecap view`: the page, and bodies over WebSocket.

mod browser;
mod records;
mod requests;
mod streams;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use edgecap::record::{BodiesRow, Format, RecordWriter};
use edgecap_client::Publisher;
use edgecap_client::joints::BODY_JOINTS;
use edgecap_client::message::{
    Body, BodyFrame, BodyState, Intrinsics, JointState, World, WorldState,
};
use tungstenite::{Message, WebSocket};

use crate::program::{Running, eventually, stream};

/// `edgecap view` on a port of its own.
struct View {
    run: Running,
    camera: String,
    url: String,
}

impl View {
    fn start(test: &str, more: &[&str]) -> Self {
        let camera = stream(test);
        let mut args = vec!["view", "--camera", &camera, "--listen", "127.0.0.1:0"];
        args.extend(more);
        Self::of(&camera, &args)
    }

    fn of(camera: &str, args: &[&str]) -> Self {
        let camera = camera.to_owned();
        let mut run = Running::start(args);
        let mut said = String::new();
        let stdout = run.0.stdout.as_mut().unwrap();
        BufReader::new(stdout).read_line(&mut said).unwrap();
        let url = said.split(' ').next().unwrap().to_owned();
        assert!(url.starts_with("http://127.0.0.1:"), "{said}");
        Self { run, camera, url }
    }

    fn host(&self) -> &str {
        self.url[7..].split('/').next().unwrap()
    }

    fn get(&self, path: &str, headers: &str) -> (String, Vec<u8>) {
        self.ask("GET", path, headers)
    }

    fn ask(&self, method: &str, path: &str, headers: &str) -> (String, Vec<u8>) {
        let mut stream = TcpStream::connect(self.host()).unwrap();
        let patience = Some(Duration::from_secs(60));
        stream.set_read_timeout(patience).unwrap();
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nHost: {}\r\n{headers}\r\n",
            self.host()
        )
        .unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
        let head = String::from_utf8(answer[..end].to_vec()).unwrap();
        (head, answer[end + 4..].to_vec())
    }

    fn connect(&self, query: &str) -> WebSocket<TcpStream> {
        self.connect_to(&format!("bodies{query}"))
    }

    fn connect_to(&self, path: &str) -> WebSocket<TcpStream> {
        let stream = TcpStream::connect(self.host()).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        let url = format!("ws://{}/{path}", self.host());
        tungstenite::client(url, stream).unwrap().0
    }
}

/// People in a row, every number another one.
fn crowd(people: u32, sequence: u64) -> BodyFrame {
    let mut frame = BodyFrame {
        sequence,
        capture_ns: 1_000_000 + sequence,
        pose_ns: 1_000_000 + sequence,
        publish_ns: 2_000_000 + sequence * 33_000_000,
        width: 1280,
        height: 720,
        intrinsics: Intrinsics::from_horizontal_fov(1280, 720, 60.0),
        count: people,
        world: World {
            // Tilted down by 0.2 rad, 2.1 m up.
            rotation: [0.1f32.cos(), 0.0, 0.0, 0.1f32.sin()],
            translation: [0.0, 2.1, 0.0],
            state: WorldState::ESTIMATED,
        },
        ..BodyFrame::default()
    };
    for (n, body) in frame.bodies[..people as usize].iter_mut().enumerate() {
        *body = person(n as u32, sequence);
    }
    frame
}

fn person(n: u32, sequence: u64) -> Body {
    let walked = 0.02 * (sequence % 100) as f32;
    let place = [n as f32 * 0.9 - 1.5 + walked, 1.1, 4.0 + 0.3 * n as f32];
    let skeleton = edgecap::body::skeleton::Skeleton::builtin();
    let mut posed = edgecap::body::skeleton::Posed::default();
    let mut pose = edgecap::body::skeleton::Pose::facing_camera(0.0);
    pose.angles[3] = 0.3 * f64::from(n);
    skeleton.pose(&pose, skeleton.lengths(), &mut posed);
    let mut body = Body {
        id: n + 1,
        state: BodyState::TRACKED,
        score: 0.5 + 0.01 * n as f32,
        position: place,
        orientation: pose.rotation.as_quat().to_array(),
        height: 1.7,
        confidence: [0.9; BODY_JOINTS],
        joint_states: [JointState::OBSERVED; BODY_JOINTS],
        ..Body::default()
    };
    for (joint, p) in body.joints3d.iter_mut().zip(posed.joints) {
        let p = p.as_vec3().to_array();
        *joint = std::array::from_fn(|i| p[i] + place[i]);
    }
    body
}

/// Publishes until a client has heard it: it may only just be connecting.
fn heard(publisher: &mut Publisher<BodyFrame>, client: &mut WebSocket<TcpStream>) -> Message {
    let socket = client.get_ref().try_clone().unwrap();
    eventually("a frame", || {
        publisher.publish(&crowd(3, 7)).unwrap();
        socket
            .set_read_timeout(Some(Duration::from_millis(200)))
            .unwrap();
        client.read().ok()
    })
}

/// A number of a message's compact form.
fn number(message: &Message, at: usize) -> u64 {
    let Message::Binary(bytes) = message else {
        panic!("expected the compact form, found {message}");
    };
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// A frame every 10 ms of somebody who runs at 6 m/s, as a record. The first is 3 ms early: the record is not so many
/// hundredths of a second long.
fn recorded(path: &std::path::Path, frames: u64) {
    let mut writer = RecordWriter::<BodiesRow>::create(path, Format::Binary).unwrap();
    for sequence in 0..frames {
        let mut frame = crowd(1, sequence);
        let early = if sequence == 0 { 3_000_000 } else { 0 };
        frame.publish_ns = 5_000_000_000 + sequence * 10_000_000 - early;
        frame.pose_ns = frame.publish_ns;
        for joint in &mut frame.bodies[0].joints3d {
            joint[0] += 0.06 * sequence as f32;
        }
        writer.write(&frame, "").unwrap();
    }
    writer.finish().unwrap();
}

//! `edgecap view`: the page, and bodies over WebSocket.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use edgecap::camera::monotonic_ns;
use edgecap_client::Publisher;
use edgecap_client::joints::{BODY_JOINTS, JOINT_NAMES, PELVIS};
use edgecap_client::message::{
    Body, BodyFrame, BodyState, EventFrame, EventKind, FLAG_FILE_TIME, Hand, Intrinsics,
    JointState, World, WorldState,
};
use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use crate::program::browser::Browser;
use crate::program::{Running, assert_fails, eventually, pipe_to_reader, signal, stderr, stream};
use edgecap::record::{BodiesRow, Format, RecordWriter};

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

#[test]
fn bodies_come_over_websocket_as_they_were_published() {
    let view = View::start("websocket", &[]);
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let frame = crowd(3, 7);
    let mut json = view.connect("");
    let line = heard(&mut publisher, &mut json);
    let line: Value = serde_json::from_str(line.to_text().unwrap()).unwrap();
    assert_eq!(line["camera"], *view.camera);
    assert_eq!(line["frame"], 7);
    let people = line["people"].as_array().unwrap();
    assert_eq!(people.len(), 3);
    for (row, body) in people.iter().zip(frame.bodies()) {
        assert_eq!(row["id"], body.id);
        let joints: Vec<[f32; 3]> = serde_json::from_value(row["joints3d"].clone()).unwrap();
        assert_eq!(joints, body.joints3d);
    }

    let mut binary = view.connect("?format=binary");
    let bytes = heard(&mut publisher, &mut binary).into_data();
    let name = view.camera.len().next_multiple_of(4);
    assert_eq!(bytes.len(), 128 + name + 3 * 468);
    let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    for (n, body) in frame.bodies().iter().enumerate() {
        let at = 128 + name + n * 468;
        for (j, joint) in body.joints3d.iter().enumerate() {
            let read = [0, 4, 8].map(|k| float(at + 44 + 12 * j + k));
            assert_eq!(read, *joint, "body {n}, joint {j}");
        }
    }
    // Another camera's frames are not this client's.
    let mut other = view.connect("?camera=another");
    publisher.publish(&frame).unwrap();
    let wait = Some(Duration::from_millis(600));
    other.get_ref().set_read_timeout(wait).unwrap();
    let Err(tungstenite::Error::Io(e)) = other.read() else {
        panic!("expected silence");
    };
    assert_eq!(e.kind(), ErrorKind::WouldBlock, "{e}");
}

#[test]
fn who_was_published_before_somebody_looked_is_shown_for_two_seconds_only() {
    let camera = stream("view-late");
    let mut publisher = Publisher::<BodyFrame>::open(&camera).unwrap();
    let published = |sequence: u64, ago_ns: u64| BodyFrame {
        publish_ns: monotonic_ns() - ago_ns,
        ..crowd(2, sequence)
    };
    // The camera was unplugged after this one.
    publisher.publish(&published(1, 3_000_000_000)).unwrap();
    let view = View::of(
        &camera,
        &["view", "--camera", &camera, "--listen", "127.0.0.1:0"],
    );
    let mut client = view.connect("?format=binary&history=1");
    // It is looked at five times a second.
    std::thread::sleep(Duration::from_millis(600));
    publisher.publish(&published(2, 0)).unwrap();
    assert_eq!(number(&client.read().unwrap(), 8), 2);
    // Another page that comes now sees who is there.
    let late = View::of(
        &camera,
        &["view", "--camera", &camera, "--listen", "127.0.0.1:0"],
    );
    let mut client = late.connect("?format=binary&history=1");
    let wait = Some(Duration::from_millis(200));
    client.get_ref().set_read_timeout(wait).unwrap();
    let first = eventually("a frame", || {
        publisher.publish(&published(3, 0)).unwrap();
        client.read().ok()
    });
    assert!([2, 3].contains(&number(&first, 8)));
}

/// A number of a message's compact form.
fn number(message: &Message, at: usize) -> u64 {
    let Message::Binary(bytes) = message else {
        panic!("expected the compact form, found {message}");
    };
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

#[test]
fn a_record_is_there_from_its_first_frame_to_its_last() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("take.record");
    let mut writer = RecordWriter::<BodiesRow>::create(&path, Format::Binary).unwrap();
    // Two minutes.
    for sequence in 0..240 {
        let mut frame = crowd(2, sequence);
        frame.publish_ns = 5_000_000_000 + sequence * 500_000_000;
        writer.write(&frame, "").unwrap();
    }
    writer.finish().unwrap();
    let view = View::of(
        "view-record",
        &[
            "view",
            "--record",
            path.to_str().unwrap(),
            "--listen",
            "127.0.0.1:0",
        ],
    );
    let (head, body) = view.get("/features", "");
    assert!(head.contains(" 200 "), "{head}");
    let features: Value = serde_json::from_slice(&body).unwrap();
    assert_eq!(features["recorded"], true);
    assert_eq!(features["server"].as_str().unwrap().len(), 16);
    assert!(features["seconds"].as_u64().unwrap() > 1_000_000);
    let mut client = view.connect("?format=binary&history=1");
    for sequence in 0..240_u64 {
        let frame = client.read().unwrap();
        assert_eq!(number(&frame, 8), sequence);
        let published = 5_000_000_000 + sequence * 500_000_000;
        assert_eq!(number(&frame, 32), published);
    }
    let empty = folder.path().join("empty.jsonl");
    std::fs::write(&empty, "").unwrap();
    let args = [
        "view",
        "--record",
        empty.to_str().unwrap(),
        "--listen",
        "127.0.0.1:0",
    ];
    assert_fails(&args, 65, &["expected a record of bodies"]);
}

/// A page that was left open asks again at once, whatever is read at its address.
#[test]
fn who_asks_while_a_record_is_read_gets_all_of_it_later() {
    const FRAMES: u64 = 400;
    let folder = tempfile::tempdir().unwrap();
    let [record, pipe] = ["record", "pipe"].map(|name| folder.path().join(name));
    recorded(&record, FRAMES);
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    // An address that no other test has: it is said only once all is read.
    let [.., high, low] = std::process::id().to_be_bytes();
    let host = format!("127.77.{high}.{low}:9744");
    let args = ["--record", pipe.to_str().unwrap(), "--listen", &host];
    let view = View {
        run: Running::start(&[&["view"][..], &args].concat()),
        camera: "pipe".into(),
        url: format!("http://{host}/"),
    };
    let bytes = std::fs::read(&record).unwrap();
    let (first, rest) = bytes.split_at(bytes.len() / 2);
    let mut writer = pipe_to_reader(&pipe);
    writer.write_all(first).unwrap();
    eventually("the server", || TcpStream::connect(&host).ok());
    for path in ["/bodies?format=binary&history=1", "/events"] {
        let (head, _) = view.get(path, "");
        assert!(head.starts_with("HTTP/1.1 503"), "{path}: {head}");
    }
    let is_loading = || -> bool {
        let (_, features) = view.get("/features", "");
        let features: Value = serde_json::from_slice(&features).unwrap();
        features["loading"].as_bool().unwrap()
    };
    assert!(is_loading());
    writer.write_all(rest).unwrap();
    drop(writer);
    eventually("the end of the record", || (!is_loading()).then_some(()));
    let mut client = view.connect("?format=binary&history=1");
    for sequence in 0..FRAMES {
        assert_eq!(number(&client.read().unwrap(), 8), sequence);
    }
}

/// Two takes of somebody, one after the other in one file: the page shows them as one, and so does what is told.
#[test]
fn what_has_happened_in_a_record_is_told_to_who_comes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("takes");
    let mut writer = RecordWriter::<BodiesRow>::create(&path, Format::Binary).unwrap();
    for sequence in (0..40).chain(0..40) {
        let mut frame = crowd(1, sequence);
        frame.flags = FLAG_FILE_TIME;
        frame.pose_ns = 1_000_000_000 + sequence * 100_000_000;
        writer.write(&frame, "").unwrap();
    }
    writer.finish().unwrap();
    let args = ["view", "--record", path.to_str().unwrap(), "--listen"];
    let view = View::of("takes", &[&args[..], &["127.0.0.1:0"]].concat());
    let mut client = view.connect_to("events");
    let told = (0..6).map(|_| {
        let line = client.read().unwrap();
        let line: Value = serde_json::from_str(line.to_text().unwrap()).unwrap();
        assert_eq!(line["camera"], "takes");
        let event = line["event"].as_str().unwrap().to_owned();
        (event, line["time_ns"].as_u64().unwrap())
    });
    let told: Vec<(String, u64)> = told.collect();
    let events: Vec<&str> = told.iter().map(|(event, _)| &**event).collect();
    let (come, gone) = (["entered", "main_person"], ["left", "main_person"]);
    assert_eq!(events, [come, gone, come].concat());
    assert!(told.is_sorted_by_key(|(_, time)| *time), "{told:?}");
    // The second take begins a step after the end of the first, at 4.9 s.
    assert_eq!(told[2].1, 5_000_000_000, "{told:?}");
    // In the compact form, too, and of this camera only.
    let mut binary = view.connect_to("events?format=binary&camera=takes");
    let first = binary.read().unwrap().into_data();
    assert_eq!(&first[..8], b"EVNT\x01\0\x01\0");
    let mut other = view.connect_to("events?camera=another");
    let wait = Some(Duration::from_millis(600));
    other.get_ref().set_read_timeout(wait).unwrap();
    assert!(matches!(other.read(), Err(tungstenite::Error::Io(_))));
}

#[test]
fn events_come_over_websocket_none_left_out() {
    let view = View::start("websocket-events", &[]);
    let mut publisher = Publisher::<EventFrame>::open(&view.camera).unwrap();
    let mut frame = EventFrame {
        sequence: 812,
        time_ns: 27,
        count: 2,
        ..EventFrame::default()
    };
    let [left, raised, ..] = &mut frame.events;
    (left.kind, left.person, left.seconds) = (EventKind::ZONE_LEFT, 3, 4.25);
    left.set_zone("door");
    (raised.kind, raised.person, raised.hand) = (EventKind::HAND_RAISED, 4, Hand::RIGHT);
    let mut heard = |client: &mut WebSocket<TcpStream>| {
        let wait = Some(Duration::from_millis(200));
        client.get_ref().set_read_timeout(wait).unwrap();
        let first = eventually("events", || {
            publisher.publish(&frame).unwrap();
            client.read().ok()
        });
        let long = Some(Duration::from_secs(60));
        client.get_ref().set_read_timeout(long).unwrap();
        first
    };
    let mut json = view.connect_to("events");
    let lines = [heard(&mut json), json.read().unwrap()];
    let lines = lines.map(|l| serde_json::from_str::<Value>(l.to_text().unwrap()).unwrap());
    let wanted = [
        json!({"camera": view.camera, "frame": 812, "time_ns": 27, "person": 3, "event": "zone_left",
            "zone": "door", "seconds": 4.25}),
        json!({"camera": view.camera, "frame": 812, "time_ns": 27, "person": 4, "event": "hand_raised",
            "hand": "right"}),
    ];
    assert_eq!(lines, wanted);
    let mut binary = view.connect_to("events?format=binary");
    let bytes = heard(&mut binary).into_data();
    assert_eq!(&bytes[..8], b"EVNT\x01\0\x02\0");
    let first = 56 + view.camera.len().next_multiple_of(4);
    assert_eq!(bytes[first..first + 8], [4, 0, 0, 0, 3, 0, 0, 0]);
    assert_eq!(&bytes[first + 16..first + 20], b"door");
    // Bodies and events are told apart, and so are cameras.
    let (head, _) = view.get("/events?history=1&format=binary", "");
    assert!(head.starts_with("HTTP/1.1 4"), "{head}");
    // What happens at once comes one by one.
    let mut rests = view.connect_to("events?format=binary");
    heard(&mut rests);
    for sequence in 1000..1012 {
        frame.sequence = sequence;
        publisher.publish(&frame).unwrap();
    }
    let numbers = std::iter::from_fn(|| {
        let bytes = rests.read().unwrap().into_data();
        Some(u64::from_le_bytes(bytes[8..16].try_into().unwrap()))
    });
    let numbers: Vec<u64> = numbers.skip_while(|n| *n < 1000).take(12).collect();
    assert!(numbers.iter().copied().eq(1000..1012), "{numbers:?}");
}

#[test]
fn a_client_that_is_too_slow_gets_the_newest() {
    const FRAMES: u64 = 3000;
    let view = View::start("slow-client", &[]);
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let (mut slow, mut quick) = (view.connect("?format=json"), view.connect("?format=binary"));
    heard(&mut publisher, &mut slow);
    heard(&mut publisher, &mut quick);
    // 32 people: more than 100 MB of text in all, which fit nowhere on the way.
    for sequence in 100..100 + FRAMES {
        publisher.publish(&crowd(32, sequence)).unwrap();
        std::thread::sleep(Duration::from_micros(300));
    }
    let last = 99 + FRAMES;
    let long = Some(Duration::from_secs(60));
    for client in [&slow, &quick] {
        client.get_ref().set_read_timeout(long).unwrap();
    }
    // The other client has not waited for it: it gets the last while nothing was read here.
    while number(&quick.read().unwrap(), 8) != last {}
    let mut received = 0;
    loop {
        let line = slow.read().unwrap();
        let line: Value = serde_json::from_str(line.to_text().unwrap()).unwrap();
        received += 1;
        if line["frame"] == last {
            break;
        }
    }
    assert!(received < FRAMES / 2, "{received} frames waited for it");
}

#[test]
fn a_browser_that_goes_without_a_word_disturbs_nobody() {
    let view = View::start("gone", &[]);
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut stays = view.connect("?format=binary");
    for path in ["bodies", "events", "bodies?format=binary&history=1"] {
        let mut goes = view.connect_to(path);
        if !path.starts_with("events") {
            heard(&mut publisher, &mut goes);
        }
        // Unread data and no word: the other side gets a reset.
        publisher.publish(&crowd(32, 9)).unwrap();
        drop(goes);
    }
    for sequence in 100..150 {
        publisher.publish(&crowd(3, sequence)).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
    let long = Some(Duration::from_secs(60));
    stays.get_ref().set_read_timeout(long).unwrap();
    loop {
        let bytes = stays.read().unwrap().into_data();
        if u64::from_le_bytes(bytes[8..16].try_into().unwrap()) == 149 {
            break;
        }
    }
    signal(view.run.pid(), "INT");
    let out = view.run.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0));
    assert_eq!(stderr(&out), "", "nobody need know");
}

#[test]
fn the_page_is_in_the_program_and_strangers_are_refused() {
    let view = View::start("page", &[]);
    let (head, page) = view.get("/", "");
    assert!(head.starts_with("HTTP/1.1 200 OK"), "{head}");
    assert!(head.contains("default-src 'self'"), "{head}");
    let page = String::from_utf8(page).unwrap();
    assert!(page.contains("main.js") && !page.contains("//"), "{page}");
    let (head, packed) = view.get("/three.min.js", "");
    assert!(head.contains("Content-Encoding: gzip") && packed.starts_with(&[0x1f, 0x8b]));
    let (head, nothing) = view.ask("HEAD", "/", "");
    let length = format!("Content-Length: {}\r\n", page.len());
    assert!(head.starts_with("HTTP/1.1 200 OK") && head.contains(&length));
    assert_eq!(nothing, b"");
    let key = "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: c2hvcnQ=\r\n";
    for (method, path, headers, status, says) in [
        ("GET", "/nothing", "", "404", ""),
        ("GET", "/bodies", "", "426", "\r\nUpgrade: websocket\r\n"),
        (
            "GET",
            "/bodies",
            "",
            "426",
            "\r\nSec-WebSocket-Version: 13\r\n",
        ),
        ("GET", "/bodies", key, "400", ""),
        ("GET", "/bodies?format=xml", "", "400", ""),
        (
            "GET",
            "/bodies",
            "Origin: http://evil.example\r\n",
            "403",
            "",
        ),
        ("POST", "/", "", "405", "\r\nAllow: GET, HEAD\r\n"),
    ] {
        let (head, line) = view.ask(method, path, headers);
        assert!(
            head.starts_with(&format!("HTTP/1.1 {status}")) && head.contains(says),
            "{method} {path}: {head}"
        );
        assert_eq!(line.iter().filter(|b| **b == b'\n').count(), 1, "{path}");
    }
    assert_fails(
        &["view", "--listen", view.host()],
        69,
        &["--listen", "choose another address"],
    );
    assert_fails(
        &["bridge", "--view", view.host()],
        69,
        &["--view", "choose another address"],
    );
    assert_fails(&["view", "--camera", "a/b"], 64, &["a/b"]);
    signal(view.run.pid(), "INT");
    let out = view.run.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
}

#[test]
fn with_a_token_only_who_knows_it_reads() {
    let view = View::start("token", &["--token", "open-sesame"]);
    assert!(view.url.ends_with("/?token=open-sesame"), "{}", view.url);
    for path in ["/bodies", "/bodies?token=open-sesam", "/bodies?token="] {
        assert!(view.get(path, "").0.starts_with("HTTP/1.1 403"), "{path}");
    }
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut client = view.connect("?token=open-sesame");
    heard(&mut publisher, &mut client);
}

/// Ten people cross the page: what is drawn is what was published. Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_shows_who_is_published() {
    let view = View::start("browser", &[]);
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let Some(mut browser) = Browser::start(1280, 800) else {
        eprintln!("skipped: no chromium on this machine");
        return;
    };
    browser.open(&view.url);
    browser.until("window.edgecap");
    let name = format!("{:?}", view.camera);
    for sequence in 0..150 {
        publisher.publish(&crowd(10, sequence)).unwrap();
        std::thread::sleep(Duration::from_millis(33));
    }
    browser.until(&format!(
        "edgecap.scene().camera === {name} && edgecap.scene().sequence === 149"
    ));
    let scene = browser.value("edgecap.scene()");
    shows(&scene, &crowd(10, 149));
    assert!(
        scene["state"].as_str().unwrap().ends_with(": live"),
        "{scene}"
    );
    assert!(scene["trailPoints"].as_u64().unwrap() > 20, "{scene}");
    assert_eq!(scene["frustum"].as_array().unwrap().len(), 4);
    let work = scene["workMs"].as_f64().unwrap();
    println!("the page's own work: {work:.1} ms a frame");
    // On an idle machine it is below 8; others may be at work on this one.
    assert!(work < 40.0, "{work} ms a frame");
    let rows = browser.value("document.querySelectorAll('#people tbody tr').length");
    assert_eq!(rows, 10);

    // What happens stands beside it, the newest first; and what had happened by an earlier frame.
    let mut events = Publisher::<EventFrame>::open(&view.camera).unwrap();
    for (sequence, kind) in [(30, EventKind::ENTERED), (140, EventKind::WAVED)] {
        let mut frame = EventFrame {
            sequence,
            time_ns: crowd(10, sequence).pose_ns,
            count: 1,
            ..EventFrame::default()
        };
        let event = &mut frame.events[0];
        (event.kind, event.person, event.hand) = (kind, 3, Hand::NONE);
        if kind == EventKind::WAVED {
            event.hand = Hand::LEFT;
        }
        events.publish(&frame).unwrap();
    }
    let lines = "[...document.querySelectorAll('#events tr')].map((r) => [...r.cells].map((c) => c.textContent))";
    browser.until(&format!("{lines}.length === 2"));
    assert_eq!(
        browser.value(lines),
        json!([
            ["#3", "waved with the left hand", "0 s ago"],
            ["#3", "came", "0 s ago"]
        ])
    );

    // Back to an earlier frame, and to the newest again.
    let all = browser.value("edgecap.frames()");
    let all: Vec<u64> = serde_json::from_value(all).unwrap();
    assert!(all.len() > 100 && all.is_sorted(), "{} frames", all.len());
    browser.value("edgecap.seek(-2.0)");
    browser.until("edgecap.scene().sequence < 120");
    let scene = browser.value("edgecap.scene()");
    shows(&scene, &crowd(10, scene["sequence"].as_u64().unwrap()));
    browser.until(&format!("{lines}.length === 1"));
    browser.value("edgecap.seek(0)");
    browser.until("edgecap.scene().sequence === 149");
    if let Some(path) = std::env::var_os("EDGECAP_SCREENSHOT") {
        browser.screenshot(path.as_ref());
    }
    // Opened again it has the past that was there before it.
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.frames().length > 100");
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);

    drop(view);
    browser.until("edgecap.scene().state.startsWith('not connected')");
}

/// Who lacks the token is told so; a room of several cameras has no one lens to be away from. Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_shows_a_room_to_who_has_the_token() {
    let view = View::start("browser-room", &["--token", "a-token-of-ours"]);
    let Some(mut browser) = Browser::start(1280, 800) else {
        eprintln!("skipped: no chromium on this machine");
        return;
    };
    browser.open(&format!("http://{}/?token=an-older-one", view.host()));
    browser.until("window.edgecap");
    let said = "document.getElementById('say').textContent";
    browser.until(&format!("{said}.startsWith('not let in: ')"));
    let refused = browser.value(said);
    assert!(refused.as_str().unwrap().contains("?token="), "{refused}");

    browser.open(&view.url);
    browser.until("window.edgecap");
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut frame = crowd(2, 1);
    (frame.width, frame.height) = (0, 0);
    frame.intrinsics = Intrinsics::default();
    let mut at = |sequence: u64| {
        frame.sequence = sequence;
        frame.publish_ns = 2_000_000 + sequence * 33_000_000;
        publisher.publish(&frame).unwrap();
        std::thread::sleep(Duration::from_millis(33));
    };
    (0..20).for_each(&mut at);
    browser.until("edgecap.scene().sequence === 19");
    let cell = "document.querySelector('#people tbody tr').cells[3].textContent";
    browser.until(&format!("{cell} !== ''"));
    let [x, _, z] = frame.in_world(&frame.bodies[0]).unwrap().joints3d[PELVIS];
    assert_eq!(browser.value(cell), *format!("{x:.2}, {z:.2} m"));
    let place = browser.value("document.getElementById('place').textContent");
    assert_eq!(place, "at x, z");
    let floor = "[...document.querySelectorAll('#times tr')].some((r) => r.cells[0].textContent === 'floor')";
    assert_eq!(browser.value(floor), false);
    assert_eq!(browser.value("edgecap.scene().frustum.length"), 0);

    // A name stands above the head, whichever way is up in the room's own axes: here its z.
    let quarter = std::f32::consts::FRAC_1_SQRT_2;
    frame.world = World {
        rotation: [-quarter, 0.0, 0.0, quarter],
        translation: [0.0; 3],
        state: WorldState::GIVEN,
    };
    frame.sequence = 20;
    frame.publish_ns = 2_000_000 + 20 * 33_000_000;
    publisher.publish(&frame).unwrap();
    browser.until("edgecap.scene().sequence === 20");
    let scene = browser.value("edgecap.scene()");
    let head = JOINT_NAMES.iter().position(|n| *n == "head_top").unwrap();
    for (drawn, body) in scene["people"]
        .as_array()
        .unwrap()
        .iter()
        .zip(frame.bodies())
    {
        let at: [f32; 3] = serde_json::from_value(drawn["labelAt"].clone()).unwrap();
        let [x, y, z] = frame.in_world(body).unwrap().joints3d[head];
        for (a, b) in at.into_iter().zip([x, y + 0.2, z]) {
            assert!((a - b).abs() < 1e-3, "{at:?}, above {x}, {y}, {z}");
        }
    }
}

/// Holds what the page drew against a frame: every joint in the floor's axes, every name.
fn shows(scene: &Value, frame: &BodyFrame) {
    let people = scene["people"].as_array().unwrap();
    assert_eq!(people.len(), frame.bodies().len());
    for (drawn, body) in people.iter().zip(frame.bodies()) {
        assert_eq!(drawn["id"], body.id);
        let label = format!("#{}  {:.0} %", body.id, body.score * 100.0);
        assert_eq!(drawn["label"], *label);
        let wanted = frame.in_world(body).unwrap();
        let joints: Vec<[f32; 3]> = serde_json::from_value(drawn["joints"].clone()).unwrap();
        for (j, (a, b)) in joints.iter().zip(wanted.joints3d).enumerate() {
            let off = (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
            assert!(off < 1e-3, "body {}, joint {j}: {a:?}, not {b:?}", body.id);
        }
        assert_eq!(joints.len(), BODY_JOINTS);
        let pelvis = joints[PELVIS];
        assert!((pelvis[1] - wanted.position[1]).abs() < 1e-3);
    }
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

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_goes_through_a_record_by_keys() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        eprintln!("skipped: no chromium on this machine");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (take, other) = (folder.path().join("take"), folder.path().join("other"));
    recorded(&take, 1200);
    recorded(&other, 30);
    let (take, other) = (take.to_str().unwrap(), other.to_str().unwrap());
    let view = View::of(
        "take",
        &["view", "--record", take, "--listen", "127.0.0.1:0"],
    );
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.scene().sequence === 1199");
    // The way of ten seconds, however many frames they have: each is a line further.
    let trail = browser.value("edgecap.scene().trailPoints");
    assert!(trail.as_u64().unwrap() > 1900, "{trail} points");
    // What happened is found in the record: nobody was there before its first frame.
    browser.until("edgecap.events().map((e) => e.event).join() === 'main_person,entered'");
    browser.value("edgecap.seek(-11.9)");
    browser.until("edgecap.scene().sequence < 20 && edgecap.events().length === 0");
    browser.value("edgecap.seek(0)");
    browser.until("edgecap.scene().sequence === 1199");

    browser.value(
        "window.press = (key, more, at = document.body) => at.dispatchEvent(new KeyboardEvent('keydown', \
         { key, code: key, bubbles: true, cancelable: true, ...more }))",
    );
    // Quicker one after the other than the tables are written: in the end they are those of the frame that is shown.
    browser.value("for (const ms of [0, 40, 80]) setTimeout(() => press('ArrowLeft'), ms)");
    browser.until("edgecap.scene().sequence === 1196");
    browser.until("document.querySelector('#times').textContent.includes('frame1196')");
    // What the browser itself does by a key, and who chooses a camera, moves nothing.
    browser.value("press('ArrowLeft', { altKey: true }); press('ArrowLeft', { ctrlKey: true })");
    browser.value("press('ArrowLeft', {}, document.getElementById('camera'))");
    // Nor does who turns the view.
    let turned = browser.value("edgecap.scene().turned").as_f64().unwrap();
    let canvas = "document.getElementById('space')";
    assert_eq!(browser.value(&format!("{canvas}.tabIndex")), 0);
    browser.value(&format!(
        "press('ArrowLeft', {{ shiftKey: true }}, {canvas})"
    ));
    let after = browser.value("edgecap.scene().turned").as_f64().unwrap();
    assert!((after - turned).abs() > 0.05, "{turned} and {after}");
    browser.value("press('ArrowLeft')");
    browser.until("edgecap.scene().sequence === 1195");
    // The slider goes along though it was used before.
    browser.value("document.getElementById('scrub').focus()");
    browser.value("press('ArrowLeft', {}, document.activeElement)");
    browser.until("Math.abs(document.getElementById('scrub').valueAsNumber + 0.05) < 0.002");

    // Dragged to its right end it is at the end of the record, however many milliseconds that is long.
    let slider = "document.getElementById('scrub')";
    let length = browser.value(&format!("-Number({slider}.min)"));
    let length = length.as_f64().unwrap();
    assert!((length - 11.993).abs() < 1e-6, "{length} s");
    let [left, right, y] = ["left", "right", "y"].map(|key| {
        let place = format!("{slider}.getBoundingClientRect().{key}");
        browser.value(&place).as_f64().unwrap()
    });
    browser.drag([(left + right) / 2.0, y + 5.0], [right + 20.0, y + 5.0]);
    browser.until("document.getElementById('when').textContent === 'end'");
    browser.until("edgecap.scene().sequence === 1199");

    // Another record at the same address is shown without anybody's doing.
    let host = view.host().to_owned();
    drop(view);
    let _view = View::of("other", &["view", "--record", other, "--listen", &host]);
    browser.until("window.edgecap && edgecap.scene().camera === 'other'");
    assert_eq!(browser.value("edgecap.frames().length"), 30);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// As where the network breaks off. Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_whose_connections_break_off_shows_all_of_a_record_once() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        eprintln!("skipped: no chromium on this machine");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let take = folder.path().join("take");
    // Somebody enters, and nothing else happens.
    recorded(&take, 50);
    let take = take.to_str().unwrap();
    let view = View::of(
        "take",
        &["view", "--record", take, "--listen", "127.0.0.1:0"],
    );
    // The first connection of each stream ends after so many messages.
    browser.before(
        "{ const Own = WebSocket; const most = { bodies: 10, events: 1 }; window.heard = { bodies: 0, events: 0 }; \
         window.WebSocket = class extends Own { constructor(url) { super(url); \
         const kind = new URL(url).pathname.slice(1); let left = most[kind]; most[kind] = 0; \
         this.addEventListener('message', () => { heard[kind]++; if (--left === 0) this.close(); }); } }; }",
    );
    browser.open(&view.url);
    browser.until("window.edgecap && edgecap.frames().length === 50");
    assert_eq!(browser.value("heard.bodies"), 60);
    browser.until("heard.events === 2");
    assert_eq!(browser.value("edgecap.events().length"), 1);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_waits_for_a_slow_camera_and_lets_go_of_who_has_gone() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        eprintln!("skipped: no chromium on this machine");
        return;
    };
    let gone = stream("page-gone");
    let view = View::start("page-slow", &["--camera", &gone]);
    let mut slow = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut other = Publisher::<BodyFrame>::open(&gone).unwrap();
    // The page's time, so that nobody has to wait for it.
    browser.before(
        "{ const now = performance.now.bind(performance); window.later = 0; \
         performance.now = () => now() + window.later; }",
    );
    browser.open(&view.url);
    browser.until("window.edgecap");
    let mut sequence = 0;
    let mut slowly = |browser: &mut Browser, wanted: &str| {
        eventually(wanted, || {
            sequence += 1;
            let mut frame = crowd(0, sequence);
            frame.publish_ns = sequence * 5_000_000_000;
            slow.publish(&frame).unwrap();
            (browser.value(wanted) == Value::Bool(true)).then_some(())
        });
    };
    slowly(&mut browser, "edgecap.frames().length > 3");
    let cameras = "[...document.getElementById('camera').options].map((o) => o.value).join()";
    let both = format!("{cameras} === '{},{gone}'", view.camera);
    let mut sequence = 0;
    let mut are_both = |browser: &mut Browser| {
        eventually("both cameras on the page", || {
            sequence += 1;
            other.publish(&crowd(1, sequence)).unwrap();
            (browser.value(&both) == Value::Bool(true)).then_some(())
        });
    };
    are_both(&mut browser);

    // Back to who was there before nobody came any more.
    browser.value(&format!("edgecap.choose('{gone}')"));
    browser.until("edgecap.scene().people.length === 0");
    browser.value("window.dispatchEvent(new KeyboardEvent('keydown', { code: 'ArrowLeft' }))");
    browser.until("edgecap.scene().people.length === 1");
    browser.value(&format!("edgecap.choose('{}')", view.camera));

    // A frame is not late in twice the time between the last ones.
    browser.value("window.known = edgecap.frames().at(-1)");
    slowly(&mut browser, "edgecap.frames().at(-1) > window.known");
    browser.value("window.later = 5000");
    std::thread::sleep(Duration::from_millis(300));
    let state = browser.value("edgecap.scene().state");
    assert_eq!(state, format!("{}: live", view.camera));
    browser.value("window.later = 200000");
    browser.until("edgecap.scene().state.endsWith(': no frames come')");
    // Nothing is kept of who has been away for a minute, but of who is looked at.
    browser.until(&format!("{cameras} === '{}'", view.camera));
    are_both(&mut browser);
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);
}

/// Needs Debian's chromium.
#[test]
#[ignore = "long: a browser"]
fn long_a_browser_tells_of_each_camera_and_keeps_what_is_paused() {
    let Some(mut browser) = Browser::start(1280, 800) else {
        eprintln!("skipped: no chromium on this machine");
        return;
    };
    let second = stream("second");
    let view = View::start("first", &["--camera", &second]);
    let mut publisher = Publisher::<BodyFrame>::open(&view.camera).unwrap();
    let mut other = Publisher::<BodyFrame>::open(&second).unwrap();
    browser.open(&view.url);
    browser.until("window.edgecap");
    let shown = |browser: &mut Browser, publisher: &mut Publisher<BodyFrame>, frame: &BodyFrame| {
        let name = format!("{:?}", view.camera);
        let wanted = format!(
            "edgecap.scene().camera === {name} && edgecap.scene().sequence === {}",
            frame.sequence
        );
        eventually("a frame on the page", || {
            publisher.publish(frame).unwrap();
            (browser.value(&wanted) == Value::Bool(true)).then_some(())
        });
    };
    // The view goes along with the floor when it becomes known.
    let mut floorless = crowd(2, 0);
    floorless.world = World::default();
    shown(&mut browser, &mut publisher, &floorless);
    let scene = browser.value("edgecap.scene()");
    assert!(scene["floor"].as_f64().unwrap() < -0.5, "{scene}");
    shown(&mut browser, &mut publisher, &crowd(2, 1));
    let scene = browser.value("edgecap.scene()");
    assert_eq!(scene["floor"], 0, "{scene}");
    let height = scene["looksAt"][1].as_f64().unwrap();
    assert!((height - 0.9).abs() < 0.01, "{scene}");

    // Paused for longer than a minute: the frame stays.
    for sequence in 2..60 {
        shown(&mut browser, &mut publisher, &crowd(2, sequence));
    }
    browser.value("edgecap.seek(-1.0)");
    browser.until("edgecap.scene().sequence < 59");
    let paused = browser.value("edgecap.scene().sequence");
    for late in 1..=40 {
        let mut frame = crowd(2, 60 * late);
        frame.sequence = 1000 + late;
        publisher.publish(&frame).unwrap();
        browser.until(&format!("edgecap.frames().at(-1) === {}", 1000 + late));
    }
    browser.until("!edgecap.frames().includes(59)");
    assert_eq!(browser.value("edgecap.scene().sequence"), paused);
    let frames = browser.value("edgecap.frames()");
    assert!(
        frames.as_array().unwrap().contains(&paused),
        "{frames}: without {paused}"
    );
    browser.value("edgecap.seek(0)");
    browser.until("edgecap.scene().sequence === 1040");

    // One is gone without a word, another goes on.
    let mut sequence = 0;
    eventually("that no frames come", || {
        sequence += 1;
        other.publish(&crowd(1, sequence)).unwrap();
        let said = browser.value("edgecap.scene().state");
        (said == format!("{}: no frames come", view.camera)).then_some(())
    });
    assert!(browser.complaints.is_empty(), "{:?}", browser.complaints);

    browser.before(
        "const get = HTMLCanvasElement.prototype.getContext; \
         HTMLCanvasElement.prototype.getContext = function (kind, ...more) { \
         return kind.startsWith('webgl') ? null : get.call(this, kind, ...more); };",
    );
    browser.open(&view.url);
    browser.until("document.getElementById('say')?.textContent.includes('has no WebGL')");
}

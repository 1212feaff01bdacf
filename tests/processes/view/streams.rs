//! Bodies and events over WebSocket, as they are published.

use std::io::ErrorKind;
use std::net::TcpStream;
use std::time::Duration;

use edgecap::camera::monotonic_ns;
use edgecap_client::Publisher;
use edgecap_client::message::{BodyFrame, EventFrame, EventKind, Hand, HealthFrame, HealthState};
use serde_json::{Value, json};
use tungstenite::WebSocket;

use super::{View, crowd, heard, number};
use crate::program::{eventually, signal, stderr, stream};

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

#[test]
fn how_a_camera_is_doing_comes_over_websocket() {
    let view = View::start("websocket-health", &[]);
    let mut publisher = Publisher::<HealthFrame>::open(&view.camera).unwrap();
    let mut heard = |state, path: &str| -> Option<Value> {
        let mut client = view.connect_to(path);
        let wait = Some(Duration::from_millis(200));
        client.get_ref().set_read_timeout(wait).unwrap();
        let mut tries = 0..if path.contains("another") { 5 } else { 300 };
        let line = tries.find_map(|_| {
            let health = HealthFrame {
                publish_ns: monotonic_ns(),
                state,
                observed: 812,
                cameras: 1,
                ..HealthFrame::default()
            };
            publisher.publish(&health).unwrap();
            client.read().ok()
        })?;
        Some(serde_json::from_str(line.to_text().unwrap()).unwrap())
    };
    let own = format!("health?camera={}", view.camera);
    for (path, state) in [("health", HealthState::AWAY), (&*own, HealthState::LIVE)] {
        let line = heard(state, path).unwrap();
        assert_eq!(line["camera"], *view.camera);
        assert_eq!(line["state"], state.name().unwrap());
        assert_eq!(
            (&line["observed"], &line["cameras"]),
            (&json!(812), &json!(1))
        );
    }
    assert_eq!(heard(HealthState::LIVE, "health?camera=another"), None);
    let asks = "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
                Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let (head, body) = view.get("/health?format=binary", asks);
    assert!(head.starts_with("HTTP/1.1 400 "), "{head}");
    assert!(String::from_utf8_lossy(&body).contains("JSON alone"));
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

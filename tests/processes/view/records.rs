//! Records: all of them over WebSocket, and what has happened in them.

use std::io::Write;
use std::net::TcpStream;
use std::time::Duration;

use edgecap::record::{BodiesRow, Format, RecordWriter};
use edgecap_client::message::FLAG_FILE_TIME;
use serde_json::Value;

use super::{View, crowd, number, recorded};
use crate::program::{Running, assert_fails, eventually, pipe_to_reader};

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
    // Who is in the second take has an id of their own, as in exported files.
    let mut bodies = view.connect("?format=binary&history=1");
    let shown = (0..80).map(|_| {
        let frame = bodies.read().unwrap().into_data();
        // Behind the head and the five bytes of the name, padded to eight.
        u32::from_le_bytes(frame[136..140].try_into().unwrap())
    });
    assert_eq!(shown.collect::<Vec<_>>(), [[1; 40], [2; 40]].concat());
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

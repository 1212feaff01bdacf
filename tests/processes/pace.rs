//! A camera that shows nobody, and then somebody.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::Duration;

use edgecap::capture::{AviWriter, Frame, demo, open_bytes};
use serde_json::Value;

use crate::program::{Running, assert_fails, eventually, signal, stderr};

/// The bundled clip after a grey wall of so many seconds, 15 pictures a second.
fn film(path: &Path, empty_seconds: usize) {
    let mut source = open_bytes("demo", demo::CLIP).unwrap();
    let mut frame = Frame::default();
    assert!(source.next_into(&mut frame).unwrap());
    let wall = Frame {
        rgb: vec![120; frame.rgb.len()],
        ..frame.clone()
    };
    let file = BufWriter::new(File::create(path).unwrap());
    let mut film = AviWriter::new(file, frame.width, frame.height, (15, 1)).unwrap();
    for _ in 0..15 * empty_seconds {
        film.write_frame(&wall, 80).unwrap();
    }
    loop {
        film.write_frame(&frame, 80).unwrap();
        if !source.next_into(&mut frame).unwrap() {
            break;
        }
    }
    film.finish().unwrap();
}

/// What `infer` says of the film played as by a camera, up to so many of its seconds.
fn observed(film: &Path, seconds: u64, more: &[&str]) -> Vec<Value> {
    let out = film.with_extension("jsonl");
    let [film, out] = [film, &out].map(|p| p.to_str().unwrap());
    let args = ["infer", "--live", "--input", film, "--jsonl", out];
    let run = Running::start(&[&args[..], &["--size", "256x160"], more].concat());
    let lines = || -> Vec<Value> {
        let text = std::fs::read_to_string(out).unwrap_or_default();
        let whole = text.split_inclusive('\n').filter(|l| l.ends_with('\n'));
        whole.map(|l| serde_json::from_str(l).unwrap()).collect()
    };
    eventually("the film", || {
        (sequence(lines().last()?) >= seconds * 15).then_some(())
    });
    signal(run.pid(), "TERM");
    let ended = run.wait(Duration::from_secs(60));
    assert!(ended.status.success(), "{}", stderr(&ended));
    lines()
}

fn sequence(line: &Value) -> u64 {
    line["frame"]
        .as_u64()
        .or(line["sequence"].as_u64())
        .unwrap()
}

fn people(line: &Value) -> usize {
    line["people"].as_array().unwrap().len()
}

#[test]
fn an_empty_place_is_only_glanced_at_until_somebody_enters() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.avi");
    // Nobody for 7 s: idle after 2.5 s, at the latest.
    film(&path, 7);
    let lines = observed(&path, 12, &[]);
    let within = |from: u64, to: u64| {
        lines
            .iter()
            .filter(move |l| (from * 15..to * 15).contains(&sequence(l)))
    };
    // Three glances a second, however slow the machine is.
    let glances = within(4, 7).count();
    assert!((1..=10).contains(&glances), "{glances} of 45 pictures");
    assert!(within(4, 7).all(|l| people(l) == 0));
    assert!(within(7, 12).any(|l| people(l) > 0), "nobody was seen");
}

#[test]
fn who_wants_every_picture_of_an_empty_place_gets_more_than_glances() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.avi");
    film(&path, 8);
    let lines = observed(&path, 8, &["--no-idle", "--max-fps", "5"]);
    let later = lines.iter().filter(|l| (60..120).contains(&sequence(l)));
    let looks: Vec<_> = later.collect();
    assert!((2..=21).contains(&looks.len()), "{}", looks.len());
    // A glance that shows what the one before showed does not go through the network.
    let is_seen = |l: &&Value| l["stage_times"]["stage1_us"].as_u64().unwrap() > 0;
    assert!(looks.iter().all(is_seen), "some were only glances");
}

#[test]
fn a_file_has_no_highest_rate() {
    let words = ["--max-fps", "--live"];
    for verb in ["infer", "run"] {
        assert_fails(&[verb, "--input", "demo", "--max-fps", "5"], 64, &words);
    }
    let asked = ["infer", "--input", "demo", "--rotate", "45"];
    let out = crate::program::output(&asked);
    assert_eq!(out.status.code(), Some(64));
    assert!(stderr(&out).contains("0, 90, 180 or 270"));
    assert_fails(
        &["infer", "--input", "demo", "--list-controls"],
        64,
        &["/dev/video0"],
    );
}

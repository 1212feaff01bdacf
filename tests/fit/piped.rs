//! `fit --input -`: observations from a pipe.

use std::io::Write;
use std::process::Stdio;
use std::time::Duration;

use edgecap::record::{ObservationsRow, Row};

use crate::program::{Running, edgecap, eventually, signal, stderr};
use crate::scene::people;
use crate::scene::{Noise, Scene};

const ROWS: usize = 5;

#[test]
fn whoever_stops_a_quiet_pipe_keeps_what_came() {
    let folder = tempfile::tempdir().unwrap();
    let bodies = folder.path().join("bodies.jsonl");
    let mut command = edgecap();
    command
        .args(["fit", "--input", "-", "--jsonl"])
        .arg(&bodies)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut run = Running(command.spawn().unwrap());
    let mut pipe = run.0.stdin.take().unwrap();
    let mut scene = Scene::new(people::everyday(), Noise::NONE, 30.0, 5);
    for _ in 0..ROWS {
        let row = ObservationsRow::new(&scene.next().0, "");
        serde_json::to_writer(&mut pipe, &row).unwrap();
        pipe.write_all(b"\n").unwrap();
    }
    // The next row has begun.
    pipe.write_all(b"{").unwrap();
    let rows = || {
        let text = std::fs::read_to_string(&bodies).unwrap_or_default();
        text.lines().count()
    };
    eventually("all bodies", || (rows() == ROWS).then_some(()));
    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
    assert!(!stderr(&out).contains("cut off"), "{}", stderr(&out));
    assert_eq!(rows(), ROWS);
    drop(pipe);
}

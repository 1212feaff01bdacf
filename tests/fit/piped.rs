//! `fit --input`: observations from pipes, and from a file as standard input.

use std::fs::File;
use std::io::Write;
use std::process::{Command, Stdio};
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

#[test]
fn a_pipe_to_which_nobody_has_come_is_left_where_the_user_stops() {
    let folder = tempfile::tempdir().unwrap();
    let [pipe, bodies] = ["pipe", "bodies.jsonl"].map(|name| folder.path().join(name));
    let made = Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let mut command = edgecap();
    command
        .args(["fit", "--jsonl"])
        .arg(&bodies)
        .arg("--input")
        .arg(&pipe)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let run = Running(command.spawn().unwrap());
    let open = format!("/proc/{}/fd", run.pid());
    eventually("the pipe, open", || {
        let mut files = std::fs::read_dir(&open).ok()?.flatten();
        let is_pipe =
            |file: &std::fs::DirEntry| std::fs::read_link(file.path()).is_ok_and(|to| to == pipe);
        files.any(|file| is_pipe(&file)).then_some(())
    });
    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
}

#[test]
fn a_file_as_standard_input_has_an_end_and_its_result_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let [seen, out] = ["seen.jsonl", "out"].map(|name| folder.path().join(name));
    let mut scene = Scene::new(people::everyday(), Noise::NONE, 30.0, 5);
    let row = ObservationsRow::new(&scene.next().0, "");
    std::fs::write(&seen, serde_json::to_string(&row).unwrap()).unwrap();
    std::fs::create_dir(&out).unwrap();
    for _ in 0..2 {
        let done = edgecap()
            .args(["fit", "--input", "-", "--jsonl"])
            .arg(out.join("bodies.jsonl"))
            .stdin(File::open(&seen).unwrap())
            .output()
            .unwrap();
        assert!(done.status.success(), "{}", stderr(&done));
    }
    let files: Vec<_> = std::fs::read_dir(&out).unwrap().collect();
    assert_eq!(files.len(), 1, "{files:?}");
}

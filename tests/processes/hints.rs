//! What a run that somebody starts by hand prints to go on with.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::program::{self, Running, eventually, signal, tools};

/// The line of Python reads exactly this run, as it is printed, whatever else publishes on this machine.
#[test]
fn the_line_of_python_reads_the_run_that_printed_it() {
    if !tools::has("python3") || edgecap::capture::list_cameras().is_ok() {
        eprintln!("skipped: no python3, or this machine has a camera");
        return;
    }
    let place = crate::program::short_folder();
    let mut child = program::edgecap()
        .env("EDGECAP_RUNTIME_DIR", place.path())
        .args(["--size", "256x160", "--threads", "1"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let said = BufReader::new(child.stderr.take().unwrap());
    let run = Running(child);
    let mut said = said.lines();
    let line = said
        .by_ref()
        .map(Result::unwrap)
        .find_map(|l| Some(l.split_once("read it:")?.1.trim().to_owned()))
        .expect("a line to read it with");
    // So that it never waits for somebody who reads.
    let rest = std::thread::spawn(move || said.map(Result::unwrap).collect::<Vec<_>>());
    let mut python = Command::new("sh")
        .args(["-c", &format!("exec env {line}")])
        .env("PYTHONUNBUFFERED", "1")
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let (send, first) = std::sync::mpsc::channel();
    let output = BufReader::new(python.stdout.take().unwrap());
    std::thread::spawn(move || send.send(output.lines().next()));
    let first = first.recv_timeout(Duration::from_secs(90));
    let _ = python.kill();
    let _ = python.wait();
    signal(run.pid(), "INT");
    eventually("its end", || run.has_ended().then_some(()));
    let rest = rest.join().unwrap().join("\n");
    let first = first.expect(&rest).expect("a line").unwrap();
    let (id, wrist) = first.split_once(' ').unwrap();
    assert!(id.parse::<u32>().unwrap() > 0, "{first}");
    let wrist = wrist.trim_matches(['(', ')']).split(", ");
    let wrist: Vec<f32> = wrist.map(|w| w.parse().unwrap()).collect();
    assert_eq!(wrist.len(), 3, "{first}");
}

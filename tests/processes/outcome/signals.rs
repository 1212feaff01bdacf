//! Programs that are asked to stop, killed, or are to outlive their terminal.

use std::io::Write;
use std::path::Path;
use std::process::{ChildStdin, Command, Stdio};
use std::time::{Duration, Instant};

use super::{SMALL, count};
use crate::program::{Running, edgecap, ends_when_asked, eventually, signal, stderr, stream};

/// The program in `folder`, reading what is written into the pipe.
fn fed(folder: &Path, args: &[&str]) -> (Running, ChildStdin) {
    let mut child = edgecap()
        .current_dir(folder)
        .args(args)
        .args(["--input", "-"])
        .args(SMALL)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let pipe = child.stdin.take().unwrap();
    (Running(child), pipe)
}

/// Whether programs of this one end when their terminal is closed: those of whoever was started with `nohup` do not.
fn is_hang_up_heard() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    let ignored = u64::from_str_radix(ignored.unwrap().trim(), 16).unwrap();
    let is_heard = ignored & 1 == 0;
    if !is_heard {
        eprintln!("skipped: tests were started with nohup, which has SIGHUP ignored");
    }
    is_heard
}

#[test]
fn a_silent_pipe_can_be_left() {
    let folder = tempfile::tempdir().unwrap();
    for verb in ["infer", "run"] {
        let name = stream("silent");
        let (run, mut pipe) = fed(folder.path(), &[verb, "--name", &name]);
        pipe.write_all(b"YUV4MPEG2 W640 H480 F30:1\nFRAME\n")
            .unwrap();
        ends_when_asked(run.pid());
        std::thread::sleep(Duration::from_millis(700));
        let asked = Instant::now();
        signal(run.pid(), "TERM");
        let out = run.wait(Duration::from_secs(60));
        assert!(asked.elapsed() < Duration::from_secs(8), "{verb}");
        assert_eq!(out.status.code(), Some(0), "{verb}: {}", stderr(&out));
        drop(pipe);
    }
}

/// As a power cut does after weeks.
#[test]
fn what_a_camera_saw_before_its_process_was_killed_is_there() {
    let folder = tempfile::tempdir().unwrap();
    for verb in ["infer", "run"] {
        let path = folder.path().join(format!("{verb}.jsonl"));
        std::fs::write(&path, "older\n").unwrap();
        let (name, jsonl) = (stream("killed"), path.to_str().unwrap());
        let args = [
            verb, "--input", "demo", "--live", "--name", &name, "--jsonl", jsonl,
        ];
        let run = Running::start(&[&args[..], &SMALL].concat());
        let whole = eventually("frames", || {
            let text = std::fs::read_to_string(&path).ok()?;
            let is_whole = |l: &&str| serde_json::from_str::<serde_json::Value>(l).is_ok();
            let whole = text.lines().filter(is_whole).count();
            (whole > 2).then_some(whole)
        });
        signal(run.pid(), "KILL");
        drop(run);
        let text = std::fs::read_to_string(&path).unwrap();
        // The last line may be cut off.
        for line in text.lines().take(whole) {
            assert!(serde_json::from_str::<serde_json::Value>(line).is_ok());
        }
        let aside = folder.path().join(format!("{verb}-1.jsonl"));
        assert_eq!(std::fs::read_to_string(aside).unwrap(), "older\n");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4);
}

/// `timeout`, and systemd together with a supervisor, ask twice within a moment.
#[test]
fn to_be_asked_twice_at_once_is_to_be_asked_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut asking = vec!["TERM", "INT", "TERM"];
    if is_hang_up_heard() {
        asking.push("HUP");
    }
    for (turn, asked) in asking.into_iter().enumerate() {
        let seen = folder.path().join(format!("{turn}.jsonl"));
        let name = stream("twice");
        let jsonl = seen.to_str().unwrap();
        let (run, mut pipe) = fed(folder.path(), &["infer", "--name", &name, "--jsonl", jsonl]);
        pipe.write_all(b"YUV4MPEG2 W64 H64 F30:1 C420\n").unwrap();
        for _ in 0..3 {
            pipe.write_all(b"FRAME\n").unwrap();
            pipe.write_all(&[128; 64 * 64 * 3 / 2]).unwrap();
        }
        let pid = run.pid().to_string();
        // The record of a pipe has its name with the first frame that was looked at.
        eventually("the record", || seen.exists().then_some(()));
        let kill = std::process::Command::new("kill")
            .args([&format!("-{asked}"), &pid, &pid])
            .status()
            .unwrap();
        assert!(kill.success());
        let out = run.wait(Duration::from_secs(60));
        assert_eq!(out.status.code(), Some(0), "{asked}: {}", stderr(&out));
        assert!(count(&seen) > 0, "{asked}: what was seen is lost");
        drop(pipe);
    }
}

/// A terminal that is closed asks everybody on it to stop; who was started with `nohup` goes on.
#[test]
fn what_is_to_outlive_its_terminal_does() {
    let folder = tempfile::tempdir().unwrap();
    let (seen, name) = (folder.path().join("seen.jsonl"), stream("nohup"));
    let mut command = Command::new("sh");
    command
        .args(["-c", "trap '' HUP; exec \"$0\" \"$@\""])
        .arg(edgecap().get_program())
        .args(["infer", "--input", "demo", "--live", "--name", &name])
        .args(SMALL)
        .arg("--jsonl")
        .arg(&seen)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let run = Running(command.spawn().unwrap());
    let frames = || std::fs::read_to_string(&seen).map_or(0, |t| t.lines().count());
    eventually("frames", || (frames() > 0).then_some(()));
    signal(run.pid(), "HUP");
    let before = frames();
    eventually("more frames", || (frames() > before + 5).then_some(()));
    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0), "{}", stderr(&out));
}

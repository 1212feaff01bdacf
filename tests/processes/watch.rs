//! What `run` and `watch` show: skeletons on a terminal, a line now and then elsewhere.

use std::fs::File;
use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::program::{Running, edgecap, eventually, signal, stream};
use edgecap_client::Publisher;
use edgecap_client::message::{BodyFrame, FLAG_END_OF_STREAM, FLAG_FILE_TIME};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};

/// A terminal from outside and from inside.
fn terminal(columns: u16, rows: u16) -> (File, File) {
    let terminal = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&terminal).unwrap();
    unlockpt(&terminal).unwrap();
    let size = Winsize {
        ws_row: rows,
        ws_col: columns,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    tcsetwinsize(&terminal, size).unwrap();
    let name = ptsname(&terminal, Vec::new()).unwrap();
    let inside = File::options()
        .read(true)
        .write(true)
        .open(name.to_str().unwrap())
        .unwrap();
    (File::from(terminal), inside)
}

/// Starts a program on a terminal of its own and returns everything that it shows.
fn shown_by(command: &mut Command, columns: u16, rows: u16) -> String {
    let (mut outside, inside) = terminal(columns, rows);
    let child = command
        .env("TERM", "xterm-256color")
        .env_remove("NO_COLOR")
        .stdout(Stdio::null())
        .stderr(inside)
        .spawn()
        .unwrap();
    // Ours, too, must be closed, or reading would not end with the program.
    command.stderr(Stdio::null());
    let child = Running(child);
    let mut shown = Vec::new();
    let mut part = [0; 65536];
    // A terminal that everybody has left answers with an error.
    while let Ok(n @ 1..) = outside.read(&mut part) {
        shown.extend(&part[..n]);
    }
    drop(child);
    String::from_utf8_lossy(&shown).into_owned()
}

fn demo(test: &str, folder: &tempfile::TempDir) -> Command {
    let mut command = edgecap();
    let result = folder.path().join("bodies.jsonl");
    command.args(["run", "--input", "demo", "--size", SIZE, "--name"]);
    command.args([&stream(test), "--jsonl"]);
    command.arg(result);
    command
}

/// A small input is soon through, and its people are found as well.
const SIZE: &str = "256x160";

/// What a program says up to `words` and a little after.
fn read_until(stderr: &mut impl Read, words: &str) -> String {
    read_until_any(stderr, &[words])
}

fn read_until_any(stderr: &mut impl Read, words: &[&str]) -> String {
    let mut said = String::new();
    let mut part = [0; 4096];
    while !words.iter().any(|words| said.contains(words)) {
        let n = stderr.read(&mut part).unwrap();
        assert!(n > 0, "it ended: {said}");
        said.push_str(&String::from_utf8_lossy(&part[..n]));
    }
    said
}

/// Whether there is a frame round skeletons, and how many characters hold dots; the spinner is made of such characters,
/// too.
fn skeletons(shown: &str) -> (bool, usize) {
    let with_dots = |c: &char| ('\u{2801}'..='\u{28ff}').contains(c);
    (shown.contains('┌'), shown.chars().filter(with_dots).count())
}

#[test]
fn a_terminal_shows_skeletons_with_their_names_and_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let shown = shown_by(&mut demo("terminal", &folder), 120, 40);
    let (framed, dots) = skeletons(&shown);
    assert!(framed && dots > 1000, "{dots} characters with dots");
    for part in ["#1", "\u{1b}[38;5;", "confidence", "tracked"] {
        assert!(shown.contains(part), "'{part}' is missing");
    }
}

#[test]
fn where_there_is_no_room_or_no_wish_only_the_table_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    for (command, rows) in [
        (&mut demo("small", &folder), 12),
        (demo("plain", &folder).arg("--plain"), 40),
    ] {
        let shown = shown_by(command, 120, rows);
        let (framed, dots) = skeletons(&shown);
        assert!(!framed && dots < 100, "{dots} characters with dots");
        assert!(shown.contains("tracked"));
    }
}

#[test]
fn watch_waits_shows_the_bodies_and_ends_with_the_input() {
    let name = stream("watch");
    let folder = tempfile::tempdir().unwrap();
    let mut watch = Running::start(&["watch", "--name", &name]);
    let mut stderr = watch.0.stderr.take().unwrap();
    let mut said = read_until(&mut stderr, &format!("nobody publishes {name} yet"));
    let mut run = edgecap();
    run.args([
        "run", "--input", "demo", "--size", SIZE, "--name", &name, "--jsonl",
    ]);
    run.arg(folder.path().join("bodies.jsonl"));
    assert!(run.output().unwrap().status.success());

    stderr.read_to_string(&mut said).unwrap();
    watch.0.stderr = Some(stderr);
    let out = watch.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0));
    assert!(said.contains(" people, "), "{said}");
    assert!(String::from_utf8_lossy(&out.stdout).contains("the input has ended"));
}

/// Who is asked to end, as `fit` by a SIGTERM, ends its stream, and is started again.
#[test]
fn watch_goes_on_where_a_camera_s_stream_ends_and_not_where_a_file_does() {
    let name = stream("watch-restart");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let mut ends = |more: u32| {
        let end = BodyFrame {
            flags: FLAG_END_OF_STREAM | more,
            ..BodyFrame::default()
        };
        publisher.publish(&end).unwrap();
    };
    ends(0);
    let mut watch = Running::start(&["watch", "--name", &name]);
    // Whether it says that no frames come or, on a busy machine, that nobody is there: it waits.
    let silence = ["no frames come", "nobody publishes"];
    read_until_any(watch.0.stderr.as_mut().unwrap(), &silence);
    ends(FLAG_FILE_TIME);
    let out = watch.wait(Duration::from_secs(60));
    assert_eq!(out.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&out.stdout).contains("the input has ended"));
}

#[test]
fn watch_says_that_a_run_has_ended_and_goes_on_with_the_next() {
    let name = stream("watch-ended");
    let mut publisher = Publisher::<BodyFrame>::open(&name).unwrap();
    let mut watch = Running::start(&["watch", "--name", &name]);
    let mut stderr = watch.0.stderr.take().unwrap();
    let mut said = read_until(&mut stderr, "watching");
    let frame = |sequence, flags| BodyFrame {
        sequence,
        flags,
        ..BodyFrame::default()
    };
    publisher.publish(&frame(7, 0)).unwrap();
    said += &read_until(&mut stderr, "frame 7");
    publisher.publish(&frame(7, FLAG_END_OF_STREAM)).unwrap();
    drop(publisher);
    said += &read_until(&mut stderr, "its run has ended");
    assert!(!said.contains("yet"), "{said}");
    // A line comes every 5 s.
    let mut next = Publisher::<BodyFrame>::open(&name).unwrap();
    let shown = std::thread::spawn(move || {
        read_until(&mut stderr, "frame ");
        stderr
    });
    for sequence in 0..1200 {
        next.publish(&frame(sequence, 0)).unwrap();
        if shown.is_finished() {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    watch.0.stderr = Some(shown.join().unwrap());
    signal(watch.pid(), "INT");
    assert_eq!(watch.wait(Duration::from_secs(60)).status.code(), Some(0));
}

#[test]
fn watch_stops_when_asked_and_the_run_goes_on() {
    let name = stream("leave");
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("bodies.jsonl");
    let args = [
        "run", "--live", "--input", "demo", "--name", &name, "--jsonl",
    ];
    let run = Running::start(&[&args[..], &[result.to_str().unwrap()]].concat());
    // What is asked while a child comes or goes may leave out others: asked again, they are there.
    let both = || Some([run.child("infer")?, run.child("fit")?]);
    eventually("both processes", both);
    let mut watch = Running::start(&["watch", "--name", &name]);
    read_until(watch.0.stderr.as_mut().unwrap(), "watching");
    signal(watch.pid(), "INT");
    assert_eq!(watch.wait(Duration::from_secs(60)).status.code(), Some(0));
    eventually("that both go on", both);
    signal(run.pid(), "TERM");
    let out = run.wait(Duration::from_secs(60));
    assert!(out.status.success(), "{}", crate::program::stderr(&out));
}

#[test]
fn a_terminal_that_takes_no_output_holds_nothing_up() {
    let folder = tempfile::tempdir().unwrap();
    let (mut outside, inside) = terminal(100, 40);
    let mut command = demo("deaf", &folder);
    command.arg("--live").stdout(Stdio::null()).stderr(inside);
    let run = Running(command.env("TERM", "xterm-256color").spawn().unwrap());
    command.stderr(Stdio::null());
    let result = folder.path().join("bodies.jsonl");
    let frames = || std::fs::read_to_string(&result).map_or(0, |t| t.lines().count());
    eventually("frames", || (frames() > 5).then_some(()));
    // Ctrl-S, and nobody reads what was shown before.
    outside.write_all(b"\x13").unwrap();
    let shown = frames();
    eventually("more frames", || (frames() > shown + 30).then_some(()));
    signal(run.pid(), "TERM");
    eventually("the end", || run.has_ended().then_some(()));
}

#[test]
fn names_that_cannot_be_are_refused() {
    for option in ["--name", "--camera"] {
        crate::program::assert_fails(&["watch", option, "a/b"], 64, &["expected", "a/b"]);
    }
}

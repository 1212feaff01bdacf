//! Where results go: standard output, readers that leave, full disks.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

use edgecap::message::BodyFrame;
use edgecap_client::Subscriber;
use rustix::fs::{AtFlags, Statx, StatxAttributes, StatxFlags};

use super::{SMALL, count, cut_film, photo};
use crate::program::stand_in::{StandIn, Watched};
use crate::program::{assert_fails, edgecap, eventually, stderr, stream, tools};

/// As by `--jsonl /dev/stdout >> all.txt`.
#[test]
fn standard_output_by_its_name_is_written_on_and_gets_nothing_but_lines() {
    let folder = tempfile::tempdir().unwrap();
    let (all, seen) = (folder.path().join("all.txt"), folder.path().join("1.jpg"));
    std::fs::write(&seen, photo()).unwrap();
    std::fs::write(&all, "a line of before\n").unwrap();
    let added = std::fs::File::options().append(true).open(&all).unwrap();
    let out = edgecap()
        .args(["run", "--jsonl", "/dev/stdout", "--input"])
        .arg(&seen)
        .args(["--name", &stream("stdout")])
        .args(SMALL)
        .stdout(added)
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    assert!(stderr(&out).contains("1 frame, "), "{}", stderr(&out));
    let text = std::fs::read_to_string(&all).unwrap();
    let (before, json) = text.split_once('\n').unwrap();
    assert_eq!(before, "a line of before");
    let row: serde_json::Value = serde_json::from_str(json).unwrap();
    assert!(row["people"].is_array());
}

#[test]
fn nobody_who_listens_is_no_reason_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let film = cut_film(folder.path());
    let lines = folder.path().join("b.jsonl");
    let full = std::fs::File::options()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let status = edgecap()
        .args(["run", "--name", &stream("full")])
        .args(SMALL)
        .arg("--input")
        .arg(&film)
        .arg("--jsonl")
        .arg(&lines)
        .env("EDGECAP_LOG", "debug")
        .stdout(full.try_clone().unwrap())
        .stderr(full)
        .status()
        .unwrap();
    assert_eq!(status.code(), Some(65), "the film is cut, that is all");
    assert!(count(&lines) >= 2);
}

#[test]
fn a_full_disk_under_a_record_does_not_end_a_camera() {
    let camera = StandIn::new(30.0);
    let watched = Watched::start("full-disk", &camera, &["--jsonl", "/dev/full"]);
    let bodies: Subscriber<BodyFrame> = watched.listen();
    for _ in 0..5 {
        eventually("a body", || {
            bodies.next(Duration::from_millis(100)).unwrap()
        });
    }
    drop(bodies);
    let out = watched.stop();
    let said = stderr(&out);
    let lines = said
        .lines()
        .filter(|l| l.contains("everything else goes on"));
    assert_eq!(lines.count(), 1, "{said}");
    // The record is not whole.
    assert_eq!(out.status.code(), Some(74), "{said}");
}

#[test]
fn lines_go_to_standard_output_and_a_reader_that_leaves_is_named() {
    let head = ["infer", "--input", "demo", "--jsonl", "-"];
    let mut child = edgecap()
        .args(head)
        .args(SMALL)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut first = String::new();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    stdout.read_line(&mut first).unwrap();
    assert!(serde_json::from_str::<serde_json::Value>(&first).is_ok());
    drop(stdout);
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(74));
    let said = stderr(&out);
    assert!(
        said.contains("standard output") && said.lines().count() == 1,
        "{said}"
    );
}

#[test]
fn a_full_disk_keeps_what_found_room() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("b.jsonl");
    // The limit of a file's size stands in for a full disk.
    let out = std::process::Command::new("bash")
        .args(["-c", "trap '' XFSZ; ulimit -f 64; exec \"$0\" \"$@\""])
        .arg(env!("CARGO_BIN_EXE_edgecap"))
        .args(["infer", "--input", "demo", "--jsonl"])
        .arg(&result)
        .args(SMALL)
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(74), "{}", stderr(&out));
    assert!(stderr(&out).contains("b.jsonl"), "{}", stderr(&out));
    assert!(count(&result) >= 2);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let readonly = ["infer", "--input", "demo", "--jsonl", "/proc/b.jsonl"];
    assert_fails(&readonly, 73, &["/proc/b.jsonl"]);
}

/// Who redirects a result to a file that has no room must not take half of it for the whole.
#[test]
fn results_on_a_full_disk_are_no_success() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("p.jsonl"),
        "{\"frame\":0,\"people\":[]}\n",
    )
    .unwrap();
    let eval = ["eval", "--predictions", "p.jsonl", "--no-people"];
    for args in [
        &["config", "sample"][..],
        &["config", "print"],
        &["config", "check"],
        &["model", "contract"],
        &["model", "info"],
        &["model", "verify"],
        &[
            "bench",
            "--seconds",
            "0.01",
            "--size",
            "64x64",
            "--save",
            "figures.json",
        ],
        &["completions", "bash"],
        &eval,
        &[&eval[..], &["--json", "-"]].concat(),
    ] {
        let run = || {
            let mut run = edgecap();
            run.current_dir(folder.path()).args(args);
            run
        };
        let full = std::fs::File::create("/dev/full").unwrap();
        let out = run().stdout(full).output().unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(74), "{args:?}: {said}");
        assert!(said.starts_with("edgecap: standard output: "), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let out = run().stdout(writer).output().unwrap();
        assert_eq!(out.status.code(), Some(0), "{args:?}: {}", stderr(&out));
    }
}

/// As containers have single files and folders of the same disk.
#[test]
fn a_mounted_folder_is_filled_and_a_mounted_file_refused_at_once() {
    let alone = ["--user", "--map-root-user", "--mount"];
    let folder = tempfile::tempdir().unwrap();
    let tried = Command::new("unshare")
        .args(alone)
        .args(["sh", "-c", "mount --bind \"$1\" \"$1\"", "sh"])
        .arg(folder.path())
        .output();
    if !tried.is_ok_and(|out| out.status.success()) {
        tools::skip("unshare", "no mounts of their own for programs");
        return;
    }
    let about = rustix::fs::statx(
        rustix::fs::CWD,
        folder.path(),
        AtFlags::empty(),
        StatxFlags::MNT_ID,
    );
    let tells = |about: Statx| {
        let is_told = about.stx_attributes_mask;
        is_told.contains(StatxAttributes::MOUNT_ROOT)
            && about.stx_mask & StatxFlags::MNT_ID.bits() != 0
    };
    if !about.is_ok_and(tells) {
        println!("skipped: this system does not tell where mounts begin");
        return;
    }
    let at = |name: &str| folder.path().join(name);
    for name in ["disk", "album"] {
        std::fs::create_dir(at(name)).unwrap();
    }
    for name in ["disk.avi", "film.avi"] {
        std::fs::write(at(name), "").unwrap();
    }
    let program = edgecap();
    let synth = |more: &[&str]| {
        let mounts = "mount --bind disk album && mount --bind disk.avi film.avi && exec \"$@\"";
        Command::new("unshare")
            .args(alone)
            .args(["sh", "-c", mounts, "sh"])
            .arg(program.get_program())
            .args(["synth", "--frames", "1", "--people", "1"])
            .args(["--width", "64", "--height", "64"])
            .args(more)
            .current_dir(folder.path())
            .output()
            .unwrap()
    };
    let made = synth(&["--stills", "--out", "album"]);
    assert!(made.status.success(), "{}", stderr(&made));
    for name in ["000000.jpg", "truth.json"] {
        assert!(at("disk").join(name).exists(), "{name}");
    }
    assert_eq!(std::fs::read_dir(at("disk")).unwrap().count(), 2);
    let refused = synth(&["--clip", "film.avi"]);
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(73), "{said}");
    assert!(said.contains("film.avi: it is mounted by itself"), "{said}");
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 4, "nothing is left beside them");
}

//! `edgecap doctor`: one line for each thing, and an exit code when one is broken.

use crate::program::{Running, edgecap, eventually};

const THINGS: [&str; 7] = [
    "build",
    "processor",
    "speed",
    "shared memory",
    "camera",
    "films",
    "running",
];

/// The line about each of [`THINGS`].
fn report(out: &std::process::Output) -> [String; 7] {
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(
        lines.len(),
        THINGS.len(),
        "{text}{}",
        crate::program::stderr(out)
    );
    std::array::from_fn(|i| {
        assert_eq!(lines[i][8..].find(THINGS[i]), Some(0), "{}", lines[i]);
        lines[i].to_owned()
    })
}

#[test]
fn every_thing_has_its_line() {
    let out = edgecap()
        .args(["doctor", "--threads", "1"])
        .output()
        .unwrap();
    let [build, processor, speed, memory, ..] = report(&out);
    assert!(build.ends_with(edgecap::BUILD), "{build}");
    assert!(processor.contains(" cores, "));
    assert!(speed.contains("on 1 of the cores: up to "), "{speed}");
    assert!(
        memory.starts_with("ok ") && memory.contains("µs"),
        "{memory}"
    );
    if edgecap::capture::list_cameras().is_err() {
        assert_eq!(out.status.code(), Some(0), "no camera is no fault");
    }
}

/// What a report of a fault must name: the digest is that of the file beside the sources.
#[test]
fn the_version_names_the_weights() {
    let out = edgecap().arg("--version").output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    let recorded = include_str!("../../models/edgecap.ecm.blake3");
    let expected = format!("weights {})", &recorded[..12]);
    assert!(said.starts_with("edgecap 0."), "{said}");
    assert!(said.trim_end().ends_with(&expected), "{said}");
    let out = edgecap()
        .args(["model", "info"])
        .env("EDGECAP_LOG", "info")
        .output()
        .unwrap();
    let log = crate::program::stderr(&out);
    assert!(log.contains(said.trim_end()), "{log}");
    assert!(!log.contains('\x1b'), "colours in a file: {log:?}");
}

#[test]
fn films_are_said_to_play_only_with_ffmpeg() {
    let out = edgecap().arg("doctor").env("PATH", "").output().unwrap();
    let [.., films, _] = report(&out);
    assert!(
        films.starts_with("note") && films.contains("install ffmpeg"),
        "{films}"
    );
    let folder = tempfile::tempdir().unwrap();
    for name in ["ffmpeg", "ffprobe"] {
        std::os::unix::fs::symlink("/bin/true", folder.path().join(name)).unwrap();
    }
    let out = edgecap()
        .arg("doctor")
        .env("PATH", folder.path())
        .output()
        .unwrap();
    let [.., films, _] = report(&out);
    assert!(films.starts_with("ok "), "{films}");
}

#[test]
fn instruction_sets_that_this_machine_lacks_are_broken() {
    let out = edgecap()
        .arg("doctor")
        .env("EDGECAP_ISA", "z80")
        .output()
        .unwrap();
    let [_, processor, speed, ..] = report(&out);
    for line in [processor, speed] {
        assert!(line.starts_with("BROKEN") && line.contains("z80"), "{line}");
    }
    assert_eq!(out.status.code(), Some(64));
}

#[test]
fn a_run_is_seen_and_its_shared_memory_is_cleared_only_when_it_has_gone() {
    // A place of its own: the default name belongs to whoever runs on this machine.
    let place = tempfile::tempdir().unwrap();
    let here = |args: &[&str]| {
        let mut command = edgecap();
        command
            .args(args)
            .env("EDGECAP_RUNTIME_DIR", place.path().join("edgecap"));
        command
    };
    let doctor = || here(&["doctor"]).output().unwrap();
    assert!(report(&doctor())[6].starts_with("note"));
    let fit = here(&["fit", "--name", "camera0"]).spawn().unwrap();
    let fit = Running(fit);
    eventually("fit", || {
        report(&doctor())[6].starts_with("ok ").then_some(())
    });
    let repair = || here(&["doctor", "--repair"]).output().unwrap();
    let refused = repair();
    assert_eq!(refused.status.code(), Some(69));
    assert!(crate::program::stderr(&refused).contains("camera0.bodies in use"));
    drop(fit);
    assert_eq!(repair().status.code(), Some(0));
    assert!(report(&doctor())[6].starts_with("note"));
}

//! `edgecap doctor`: one line for each thing, and an exit code when one is broken.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;

use crate::program::{Running, as_stranger, edgecap, eventually, script, stderr, tools};

const THINGS: [&str; 8] = [
    "build",
    "processor",
    "settings",
    "speed",
    "shared memory",
    "camera",
    "films",
    "running",
];

/// The line about each of [`THINGS`].
fn report(out: &std::process::Output) -> [String; 8] {
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
    let [build, processor, settings, speed, memory, ..] = report(&out);
    assert!(
        settings.starts_with("ok ") && settings.contains("edgecap.toml: right"),
        "{settings}"
    );
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

#[test]
fn without_settings_defaults_hold() {
    if std::path::Path::new("/etc/edgecap/edgecap.toml").exists() {
        eprintln!("skipped: this machine has settings");
        return;
    }
    let mut doctor = edgecap();
    doctor.args(["doctor", "--threads", "1"]);
    let out = doctor.env("XDG_CONFIG_HOME", "/nonexistent").output();
    let [_, _, settings, ..] = report(&out.unwrap());
    assert!(
        settings.starts_with("note") && settings.contains("defaults hold"),
        "{settings}"
    );
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
    // What is not UTF-8 is no name, and not nothing.
    for (variable, value) in [
        ("EDGECAP_ISA", &b"z80"[..]),
        ("EDGECAP_ISA", b"z80\xff"),
        ("EDGECAP_ALGORITHM", b"z80\xff"),
    ] {
        let out = edgecap()
            .arg("doctor")
            .env(variable, OsStr::from_bytes(value))
            .output()
            .unwrap();
        let [_, processor, _, speed, ..] = report(&out);
        for line in [processor, speed] {
            assert!(line.starts_with("BROKEN") && line.contains("z80"), "{line}");
        }
        assert_eq!(out.status.code(), Some(64));
    }
}

#[test]
fn a_run_is_seen_and_its_shared_memory_is_cleared_only_when_it_has_gone() {
    // A place of its own: the default name belongs to whoever runs on this machine.
    let place = crate::program::short_folder();
    let here = |args: &[&str]| {
        let mut command = edgecap();
        command
            .args(args)
            .env("EDGECAP_RUNTIME_DIR", place.path().join("edgecap"));
        command
    };
    let doctor = || here(&["doctor"]).output().unwrap();
    assert!(report(&doctor())[7].starts_with("note"));
    let fit = here(&["fit", "--name", "camera0"]).spawn().unwrap();
    let fit = Running(fit);
    eventually("fit", || {
        report(&doctor())[7].starts_with("ok ").then_some(())
    });
    let repair = || here(&["doctor", "--repair"]).output().unwrap();
    let refused = repair();
    assert_eq!(refused.status.code(), Some(69));
    let said = crate::program::stderr(&refused);
    assert!(
        said.contains("camera0.bodies") && said.contains(" in use"),
        "{said}"
    );
    drop(fit);
    // What a killed run told of itself goes, too; what one that lives tells is locked.
    let at = |name: &str| place.path().join("edgecap").join(name);
    let text = r#"{"pid":1,"build":"","written":0.0,"cameras":[]}"#;
    for name in ["status-dead", "status-alive"] {
        std::fs::write(at(&format!("{name}.json")), text).unwrap();
        std::fs::write(at(&format!("{name}.lock")), "").unwrap();
    }
    let alive = std::fs::File::open(at("status-alive.lock")).unwrap();
    alive.try_lock().unwrap();
    assert_eq!(repair().status.code(), Some(0));
    for (name, stays) in [("dead", false), ("alive", true)] {
        for ending in ["json", "lock"] {
            let file = at(&format!("status-{name}.{ending}"));
            assert_eq!(file.exists(), stays, "{}", file.display());
        }
    }
    assert!(report(&doctor())[7].starts_with("note"));
}

fn fifo(path: &std::path::Path) {
    let made = std::process::Command::new("mkfifo").arg(path).status();
    assert!(made.unwrap().success());
}

/// Whoever opens these waits for ever.
#[test]
fn pipes_in_place_of_files_do_not_hold_it_up() {
    let folder = crate::program::short_folder();
    let place = folder.path().join("place");
    std::fs::create_dir(&place).unwrap();
    let settings = folder.path().join("edgecap.toml");
    fifo(&settings);
    for name in ["camera0.bodies.v2", "camera0.bodies.lock", "status-1.json"] {
        fifo(&place.join(name));
    }
    std::fs::set_permissions(&place, std::os::unix::fs::PermissionsExt::from_mode(0o700)).unwrap();
    let doctor = edgecap()
        .args(["doctor", "--threads", "1", "--config"])
        .arg(&settings)
        .env("EDGECAP_RUNTIME_DIR", &place)
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn();
    let out = Running(doctor.unwrap()).wait(std::time::Duration::from_secs(120));
    let [_, _, settings, ..] = report(&out);
    assert!(
        settings.starts_with("BROKEN") && settings.contains("does not end"),
        "{settings}"
    );
    assert_eq!(out.status.code(), Some(78));
}

#[test]
fn a_program_that_hangs_does_not_hold_it_up_and_is_ended() {
    let folder = tempfile::tempdir().unwrap();
    let ffmpeg = folder.path().join("ffmpeg");
    let pid = folder.path().join("pid");
    let text = format!(
        "#!/bin/sh\necho $$ > {}\nexec /bin/sleep 600\n",
        pid.display()
    );
    script(&ffmpeg, &text);
    let doctor = edgecap()
        .args(["doctor", "--threads", "1"])
        .env("PATH", folder.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn();
    let out = Running(doctor.unwrap()).wait(std::time::Duration::from_secs(120));
    let [.., films, _] = report(&out);
    assert!(films.starts_with("note"), "{films}");
    let pid = std::fs::read_to_string(pid).unwrap();
    assert!(!std::path::Path::new("/proc").join(pid.trim()).exists());
}

#[test]
fn settings_are_looked_at_and_each_of_their_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edgecap.toml");
    let doctor = |text: &str| {
        std::fs::write(&file, text).unwrap();
        let mut command = edgecap();
        let out = command
            .args(["doctor", "--threads", "1", "--config"])
            .arg(&file)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        (out.status.code(), said)
    };
    let cameras = |yard: &str| {
        format!(
            "[[camera]]\nname = \"hall\"\ninput = \"demo\"\nlive = true\n[[camera]]\nname = \"yard\"\ninput = {yard:?}\nlive = true\n"
        )
    };
    let (code, said) = doctor(&cameras("demo"));
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("right; cameras: 2"), "{said}");
    assert!(said.contains("yard (demo); the first picture"), "{said}");
    // What no run would start with is not right, and the rest is looked at all the same.
    let (code, said) = doctor(&cameras("/nowhere.avi"));
    assert_eq!(code, Some(78), "{said}");
    assert!(!said.contains("right; cameras"), "{said}");
    let lines = || said.lines().filter(|l| l.starts_with("BROKEN"));
    assert_eq!(lines().count(), 2, "{said}");
    assert!(lines().all(|l| l.contains("nowhere.avi")), "{said}");
    assert!(said.contains("hall (demo); the first picture"), "{said}");
    assert!(said.contains("nobody publishes hall, yard"), "{said}");
    let model = folder.path().join("lens.toml");
    std::fs::write(&model, "fov_degrees = 75.0\n").unwrap();
    let (code, said) = doctor(&format!("[network]\nmodel = {model:?}\n"));
    assert_eq!(code, Some(65), "{said}");
    assert!(!said.contains("right; cameras"), "{said}");
    let (code, said) = doctor("[netwrok]\n");
    assert_eq!(code, Some(78));
    assert!(said.contains("did you mean 'network'?"), "{said}");
}

#[test]
fn only_root_becomes_the_service() {
    let folder = tempfile::tempdir().unwrap();
    let mut somebody = match rustix::process::geteuid().is_root() {
        true if !tools::has("setpriv") => return,
        true => as_stranger(folder.path()),
        false => edgecap(),
    };
    let out = somebody.args(["doctor", "--as-service"]).output().unwrap();
    let said = stderr(&out);
    assert_eq!(out.status.code(), Some(77), "{said}");
    assert!(said.contains("sudo"), "{said}");
}

//! Where the settings lie: in the user's file or in one that is named, behind links and in any folder, never in a pipe.

use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use crate::program::{self, Running, edgecap, stdout};

#[test]
fn the_users_file_is_found_and_another_is_named_with_a_flag() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("edgecap");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("edgecap.toml"), "[network]\nthreads = 3").unwrap();
    let print = |more: &[&str]| {
        let mut command = edgecap();
        command.env("XDG_CONFIG_HOME", home.path());
        stdout(
            &command
                .args(["config", "print"])
                .args(more)
                .output()
                .unwrap(),
        )
    };
    assert!(print(&[]).contains("threads = 3"));
    assert!(print(&["--config", "/dev/null"]).contains("#threads ="));
    let out = edgecap()
        .args(["run", "--config", "/nowhere.toml"])
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(78));
    let said = program::stderr(&out);
    assert!(said.contains("cannot read /nowhere.toml"), "{said}");
    assert!(
        said.contains("'edgecap config sample > /nowhere.toml'"),
        "{said}"
    );
}

/// Without it a kiosk would run by defaults after its settings have moved.
#[test]
fn settings_that_are_a_link_to_nowhere_are_no_lack_of_settings() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("edgecap");
    std::fs::create_dir(&folder).unwrap();
    std::os::unix::fs::symlink("/nowhere.toml", folder.join("edgecap.toml")).unwrap();
    for verb in [&["config", "check"][..], &["run"]] {
        let mut command = edgecap();
        command.args(verb).env("XDG_CONFIG_HOME", home.path());
        let out = command.output().unwrap();
        let said = program::stderr(&out);
        assert_eq!(out.status.code(), Some(78), "{verb:?}: {said}");
        assert!(
            said.contains("a link that leads nowhere"),
            "{verb:?}: {said}"
        );
    }
}

/// Whoever opens one waits for ever, deaf to signals.
#[test]
fn pipes_in_place_of_settings_and_of_what_they_name_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [file, pipe] = ["edgecap.toml", "pipe"].map(|name| folder.path().join(name));
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, 0o600.into()).unwrap();
    let refused = |settings: &Path, words: &str| {
        for verb in [&["config", "check"][..], &["run"]] {
            let mut command = edgecap();
            command.args(verb).arg("--config").arg(settings);
            let run = command
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn();
            let out = Running(run.unwrap()).wait(Duration::from_secs(60));
            let said = program::stderr(&out);
            assert_eq!(out.status.code(), Some(78), "{verb:?}: {said}");
            assert!(said.contains(words), "{verb:?}: {said}");
        }
    };
    refused(&pipe, "pipe: expected a file, found a pipe");
    for (section, key) in [
        ("[[camera]]", "lens"),
        ("[[camera]]", "fit"),
        ("[[camera]]", "events"),
        ("[network]", "model"),
        ("[network]", "stage2"),
    ] {
        std::fs::write(&file, format!("{section}\n{key} = \"pipe\"\n")).unwrap();
        refused(&file, &format!("edgecap.toml:2:1: {key}: cannot read "));
    }
    std::fs::write(&file, "[[camera]]\nlens = { fov_degrees = 81 }\n").unwrap();
    let typed = "\"$0\" config print --config <(cat \"$1\")";
    let mut shell = std::process::Command::new("bash");
    shell
        .args(["-c", typed, env!("CARGO_BIN_EXE_edgecap")])
        .arg(&file);
    let out = shell.output().unwrap();
    assert!(
        stdout(&out).contains("fov_degrees = 81"),
        "{}",
        program::stderr(&out)
    );
}

/// The tasks of children hold paths as text.
#[test]
fn settings_in_a_folder_of_other_bytes_may_name_what_is_not_below_it() {
    use std::os::unix::ffi::OsStrExt;
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join(std::ffi::OsStr::from_bytes(b"x\xff"));
    std::fs::create_dir(&folder).unwrap();
    let check = |text: &str| {
        std::fs::write(folder.join("edgecap.toml"), text).unwrap();
        edgecap()
            .args(["config", "print", "--config"])
            .arg(folder.join("edgecap.toml"))
            .output()
            .unwrap()
    };
    let out = check("[[camera]]\ninput = \"/dev/video0\"\nlens = \"/lens.toml\"\n");
    assert!(out.status.success(), "{}", program::stderr(&out));
    for text in [
        "[[camera]]\ninput = \"hall.avi\"\n",
        "[[camera]]\nlens = \"lens.toml\"\n",
        "[network]\nmodel = \"own.ecm\"\n",
    ] {
        let out = check(text);
        let said = program::stderr(&out);
        assert_eq!(out.status.code(), Some(64), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        let words = "settings (--config): expected a path in UTF-8, found ";
        assert!(said.contains(words), "{said}");
    }
}

//! `deploy/release` and `deploy/wheel`: what they need, what they find in the folder that they are given, and what they
//! tell the build.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::program::{stderr, stdout};

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("deploy")
        .join(name)
}

/// Puts a program into `bin` below the working folder, to be found before the machine's own.
fn stand_in(working: &Path, name: &str, text: &str) {
    let bin = working.join("bin");
    std::fs::create_dir_all(&bin).unwrap();
    crate::program::script(&bin.join(name), &format!("#!/bin/sh\n{text}\n"));
}

fn path_with_stand_ins(working: &Path) -> String {
    let path = std::env::var("PATH").unwrap_or_default();
    format!("{}:{path}", working.join("bin").display())
}

/// Makes a release into `folder`, where building fails at once.
fn release(working: &Path, folder: &str) -> Output {
    stand_in(working, "cargo", "exit 9");
    stand_in(working, "maturin", "exit 9");
    Command::new(script("release"))
        .arg(folder)
        .current_dir(working)
        .env("PATH", path_with_stand_ins(working))
        .env("SOURCE_DATE_EPOCH", "0")
        .output()
        .unwrap()
}

#[test]
fn a_folder_with_files_of_others_is_refused_before_anything_is_built() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("out");
    std::fs::create_dir(&place).unwrap();
    let earlier = ["SHA256SUMS", "edgecap-0.1.0-x86_64-linux.tar.gz"];
    for name in earlier {
        std::fs::write(place.join(name), "").unwrap();
    }
    // Files of an earlier release are no reason to refuse: it goes on to build.
    let out = release(folder.path(), "out");
    assert_eq!(out.status.code(), Some(9), "{}", stderr(&out));
    for foreign in ["notes.txt", "backup.tar.gz"] {
        let file = place.join(foreign);
        std::fs::write(&file, "").unwrap();
        let out = release(folder.path(), "out");
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(73), "{said}");
        assert!(said.contains(file.to_str().unwrap()), "{said}");
        std::fs::remove_file(file).unwrap();
    }
    assert!(earlier.iter().all(|name| place.join(name).exists()));
}

#[test]
fn without_maturin_nothing_is_built_or_removed() {
    let folder = tempfile::tempdir().unwrap();
    let earlier = folder.path().join("out/edgecap-0.1.0-py3-none-any.whl");
    std::fs::create_dir(folder.path().join("out")).unwrap();
    std::fs::write(&earlier, "").unwrap();
    // Nothing but the shell is found.
    let bin = folder.path().join("bin");
    std::fs::create_dir(&bin).unwrap();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut shells = std::env::split_paths(&path).map(|folder| folder.join("bash"));
    let shell = shells.find(|shell| shell.exists()).expect("bash");
    std::os::unix::fs::symlink(shell, bin.join("bash")).unwrap();
    for name in ["release", "wheel"] {
        let out = Command::new(script(name))
            .arg("out")
            .current_dir(folder.path())
            .env("PATH", &bin)
            .output()
            .unwrap();
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(69), "{name}: {said}");
        assert!(said.contains("expected maturin"), "{name}: {said}");
        assert!(earlier.exists(), "{name}");
    }
}

/// What is built with other weights is built from a copy of the sources, which has no repository.
#[test]
fn a_wheel_with_open_weights_is_of_the_commit_that_it_is_made_of() {
    let folder = tempfile::tempdir().unwrap();
    let git =
        "case $1 in ls-files) printf 'pyproject.toml\\0' ;; describe) echo 0123456789ab ;; esac";
    stand_in(folder.path(), "git", git);
    // Where the wheel goes is its last argument.
    let maturin = "for out; do :; done\necho \"$EDGECAP_COMMIT\" >\"$out/edgecap-0.1.0.whl\"";
    stand_in(folder.path(), "maturin", maturin);
    let out = Command::new(script("wheel"))
        .arg("out")
        .current_dir(folder.path())
        .env("PATH", path_with_stand_ins(folder.path()))
        .env("FEATURES", "open-weights")
        .env_remove("EDGECAP_COMMIT")
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    let wheel = std::fs::read_to_string(stdout(&out).trim()).unwrap();
    assert_eq!(wheel, "0123456789ab\n");
}

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

/// Makes a wheel into `out`, and returns its name and the commit that it was built as.
fn wheel(working: &Path, features: &str) -> (String, String) {
    let out = Command::new(script("wheel"))
        .arg("out")
        .current_dir(working)
        .env("PATH", path_with_stand_ins(working))
        .env("FEATURES", features)
        .env_remove("EDGECAP_COMMIT")
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    let path = PathBuf::from(stdout(&out).trim());
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    (name, std::fs::read_to_string(path).unwrap())
}

/// What is built with other weights is built from a copy of the sources, which has no repository.
#[test]
fn wheels_are_of_the_commit_that_they_are_made_of_and_named_by_their_weights() {
    let folder = tempfile::tempdir().unwrap();
    let git =
        "case $1 in ls-files) printf 'pyproject.toml\\0' ;; describe) echo 0123456789ab ;; esac";
    stand_in(folder.path(), "git", git);
    // Where the wheel goes is its last argument.
    let maturin = r#"for out; do :; done
version=$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
echo "$EDGECAP_COMMIT" >"$out/edgecap-${version:-0.1.0}-py3-none-any.whl""#;
    stand_in(folder.path(), "maturin", maturin);
    let of_commit = |name: &str| (name.to_owned(), "0123456789ab\n".to_owned());
    let academic = of_commit("edgecap-0.1.0-py3-none-any.whl");
    let open = of_commit("edgecap-0.1.0+open-py3-none-any.whl");
    for _ in 0..2 {
        assert_eq!(wheel(folder.path(), ""), academic);
        assert_eq!(wheel(folder.path(), "open-weights"), open);
    }
    assert!(folder.path().join("out").join(academic.0).exists());
}

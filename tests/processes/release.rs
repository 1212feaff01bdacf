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
    release_with_stand_ins(working, folder)
}

fn release_with_stand_ins(working: &Path, folder: &str) -> Output {
    Command::new(script("release"))
        .arg(folder)
        .current_dir(working)
        .env("PATH", path_with_stand_ins(working))
        .env("SOURCE_DATE_EPOCH", "0")
        .env("CARGO_TARGET_DIR", working.join("target"))
        .env_remove("FEATURES")
        .output()
        .unwrap()
}

/// What lies in a folder and what is in it, sorted.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path());
    let content = |path: PathBuf| {
        let name = path.file_name().unwrap().to_str().unwrap();
        (name.to_owned(), std::fs::read(&path).unwrap())
    };
    let mut contents: Vec<_> = entries.map(content).collect();
    contents.sort();
    contents
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

/// Builds of several machines and of both weights are offered together.
#[test]
fn a_release_replaces_its_own_kind_and_only_once_it_is_built() {
    let folder = tempfile::tempdir().unwrap();
    let (place, built) = (
        folder.path().join("out"),
        folder.path().join("target/release"),
    );
    for made in [&place, &built] {
        std::fs::create_dir_all(made).unwrap();
    }
    for name in ["edgecap", "libedgecap_c.so", "libedgecap_c.a"] {
        std::fs::write(built.join(name), "").unwrap();
    }
    let machine = Command::new("uname").arg("-m").output().unwrap();
    let machine = stdout(&machine);
    let machine = machine.trim();
    let replaced = [
        format!("edgecap-0.0.1-{machine}-linux.tar.gz"),
        format!("edgecap-c-0.0.1-{machine}-linux.tar.gz"),
        format!("edgecap-0.0.1-py3-none-manylinux_2_31_{machine}.whl"),
    ];
    let others = [
        format!("edgecap-open-0.0.1-{machine}-linux.tar.gz"),
        format!("edgecap-0.0.1+open-py3-none-manylinux_2_31_{machine}.whl"),
        "edgecap-0.0.1-another-linux.tar.gz".to_owned(),
        "edgecap-c-0.0.1-another-linux.tar.gz".to_owned(),
        "edgecap-0.0.1-py3-none-manylinux_2_31_another.whl".to_owned(),
    ];
    for name in replaced.iter().chain(&others) {
        std::fs::write(place.join(name), "earlier").unwrap();
    }
    std::fs::write(place.join("SHA256SUMS"), "earlier").unwrap();
    let before = contents(&place);
    stand_in(folder.path(), "cargo", "");
    let git = "case $1 in ls-files) printf 'README.md\\0' ;; describe) echo 0123456789ab ;; esac";
    stand_in(folder.path(), "git", git);
    stand_in(folder.path(), "maturin", "exit 9");
    let out = release_with_stand_ins(folder.path(), "out");
    assert_eq!(out.status.code(), Some(9), "{}", stderr(&out));
    assert_eq!(contents(&place), before, "the wheel is not built");

    // Where the wheel goes is its last argument.
    let wheel = format!("edgecap-9.9.9-py3-none-manylinux_2_34_{machine}.whl");
    let maturin = format!("for out; do :; done\necho built >\"$out/{wheel}\"");
    stand_in(folder.path(), "maturin", &maturin);
    let out = release_with_stand_ins(folder.path(), "out");
    assert!(out.status.success(), "{}", stderr(&out));
    let after = contents(&place);
    let names: Vec<&str> = after.iter().map(|(name, _)| &**name).collect();
    let version = env!("CARGO_PKG_VERSION");
    let made = [
        format!("edgecap-{version}-{machine}-linux.tar.gz"),
        format!("edgecap-c-{version}-{machine}-linux.tar.gz"),
        wheel,
    ];
    let mut expected: Vec<&str> = made.iter().chain(&others).map(|name| &**name).collect();
    let sums = stdout(&out);
    for name in &expected {
        assert!(sums.contains(&format!("  {name}\n")), "{name} in {sums}");
    }
    expected.push("SHA256SUMS");
    expected.sort_unstable();
    assert_eq!(names, expected);
    assert!(after.contains(&("SHA256SUMS".to_owned(), sums.into_bytes())));
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

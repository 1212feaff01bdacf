//! What `deploy/release` packs: the program that was built, and the documents, from a clone and from an archive of it.

use std::process::Command;
use std::time::{Duration, UNIX_EPOCH};

use super::{COMMIT, GIT, Sources, machine};
use crate::program::{stderr, stdout};

/// The archive of the program: what `tar` says with this option, of this file in it or of all.
fn archive(sources: &Sources, option: &str, file: &str) -> String {
    let version = env!("CARGO_PKG_VERSION");
    let folder = format!("edgecap-{version}-{}-linux", machine());
    let out = Command::new("tar")
        .args([option, "--utc", "--full-time", "--verbose", "--file"])
        .arg(sources.at("out").join(format!("{folder}.tar.gz")))
        .arg(format!("{folder}{file}"))
        .args((option == "--extract").then_some("--to-stdout"))
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", stderr(&out));
    stdout(&out)
}

/// What a distribution builds from, be it in a repository of its own.
#[test]
fn without_a_repository_everything_is_packed_all_the_same() {
    let sources = Sources::unpacked();
    sources.with_maturin();
    let manifest = sources.at("sources/Cargo.toml");
    let manifest = std::fs::File::options().write(true).open(manifest).unwrap();
    let time = UNIX_EPOCH + Duration::from_secs(1_234_567_890);
    manifest.set_modified(time).unwrap();
    // What was built there is no document.
    let built = sources.at("sources/target/package/usr/share/doc");
    std::fs::create_dir_all(&built).unwrap();
    std::fs::write(built.join("README.md"), "").unwrap();
    let around = std::fs::read_to_string(sources.at("bin/git")).unwrap();
    for git in [&*around, "exit 128"] {
        sources.stand_in("git", git);
        let out = sources.output("release");
        assert!(out.status.success(), "{}", stderr(&out));
        let list = archive(&sources, "--list", "");
        for file in [
            "/edgecap",
            "/LICENSE",
            "/THIRD-PARTY.txt",
            "/README.md",
            "/models/open/attribution.txt",
        ] {
            let line = list.lines().find(|l| l.ends_with(file));
            let line = line.unwrap_or_else(|| panic!("{file} in {list}"));
            assert!(line.contains(" 2009-02-13 23:31:30 "), "{line}");
        }
        assert!(!list.contains("target"), "{list}");
        // Nor is it of a commit of the repository around it.
        assert!(archive(&sources, "--extract", "/edgecap").contains("(commit )"));
    }
}

/// The open weights' licence asks for one of them, and a build takes minutes.
#[test]
fn documents_that_are_missing_are_told_before_anything_is_built() {
    for document in ["README.md", "models/open/attribution.txt"] {
        let sources = Sources::unpacked();
        sources.stand_in("cargo", "exit 9");
        std::fs::remove_file(sources.at("sources").join(document)).unwrap();
        let out = sources.output("release");
        assert_eq!(out.status.code(), Some(66), "{}", stderr(&out));
        assert!(
            stderr(&out).contains(&format!("expected {document}")),
            "{}",
            stderr(&out)
        );
    }
}

/// Whatever this machine's settings of cargo say of where it builds.
#[test]
fn a_program_of_an_earlier_build_is_not_packed() {
    for (variable, value) in [
        ("UNSET", ""),
        ("CARGO_TARGET_DIR", "relative"),
        ("CARGO_BUILD_TARGET_DIR", "elsewhere"),
        ("CARGO_BUILD_TARGET", "another-machine"),
        ("TRIPLE", "of-the-settings"),
    ] {
        let sources = Sources::cloned();
        sources.with_maturin();
        for folder in ["sources/target/release", "relative/release"] {
            let older = sources.at(folder);
            std::fs::create_dir_all(&older).unwrap();
            for file in ["edgecap", "libedgecap_c.so", "libedgecap_c.a"] {
                std::fs::write(older.join(file), "older").unwrap();
            }
        }
        let out = sources
            .script("release")
            .env(variable, value)
            .output()
            .unwrap();
        assert!(out.status.success(), "{variable}: {}", stderr(&out));
        let packed = archive(&sources, "--extract", "/edgecap");
        assert!(packed.contains(COMMIT), "{variable}: {packed}");
        // The archive is named by this machine's architecture.
        assert!(!sources.at("sources/target/another-machine").exists());
        // What is relative is so to where the script was called.
        assert!(!sources.at("sources/relative").exists());
    }
}

/// As one for another architecture.
#[test]
fn a_program_that_does_not_say_what_was_built_is_not_packed() {
    let sources = Sources::cloned();
    sources.with_maturin();
    let version = |version: &str, commit: &str| {
        let mut release = sources.script("release");
        sources.stand_in("git", &GIT.replace("echo 0123456789ab", "echo \"$TOLD\""));
        let cargo = super::CARGO.replace("$EDGECAP_COMMIT", commit);
        sources.stand_in("cargo", &cargo);
        release
            .env("VERSION", version)
            .env("TOLD", COMMIT)
            .output()
            .unwrap()
    };
    let this = env!("CARGO_PKG_VERSION");
    for (told, commit) in [(this, "fedcba987654"), ("9.9.9", COMMIT)] {
        let out = version(told, commit);
        assert_eq!(out.status.code(), Some(70), "{}", stderr(&out));
        assert!(stderr(&out).contains("found: edgecap"), "{}", stderr(&out));
        assert!(!sources.at("out").exists());
    }
    assert!(version(this, COMMIT).status.success());
}

//! What packages are made of, and what the documents say of them.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use super::{files, install};
use crate::program::{edgecap, stderr};

/// Whatever an installation of a package has, the Debian package takes.
#[test]
fn the_debian_package_has_every_file() {
    let manifest: toml::Table = include_str!("../../../Cargo.toml").parse().unwrap();
    let deb = &manifest["package"]["metadata"]["deb"];
    let sources: Vec<String> = deb["assets"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|a| a[0].as_str()?.strip_prefix("target/package/"))
        .map(|source| source.trim_end_matches('*').to_owned())
        .collect();
    let root = tempfile::tempdir().unwrap();
    install(root.path(), &["--system", "--prefix", "/usr"]);
    let there = files(root.path());
    for file in &there {
        let folder = file.rsplit_once('/').unwrap().0.to_owned() + "/";
        assert!(
            sources.iter().any(|s| s == file || *s == folder),
            "{file} in {sources:?}"
        );
    }
    for source in &sources {
        assert!(
            there.iter().any(|f| f.starts_with(source)),
            "{source} in {there:?}"
        );
    }
    let settings = format!("/{}", there.iter().find(|f| f.ends_with(".toml")).unwrap());
    assert_eq!(deb["conf-files"][0].as_str(), Some(&*settings));
    let assets = deb["assets"].as_array().unwrap();
    let is_settings = |a: &&toml::Value| a[0].as_str().is_some_and(|s| s.ends_with(&settings));
    let asset = assets.iter().find(is_settings).unwrap();
    assert_eq!(asset[2].as_str(), Some("640"));
}

/// The commands of a document's block of a shell that holds `word`.
fn printed_commands<'a>(document: &'a str, word: &str) -> Vec<&'a str> {
    let blocks = document.split("```sh\n").skip(1);
    let mut blocks = blocks.filter_map(|rest| rest.split("```").next());
    let block = blocks.find(|block| block.contains(word)).expect(word);
    block.lines().collect()
}

#[test]
fn a_package_is_made_of_this_version_alone() {
    let place = tempfile::tempdir().unwrap();
    let at = |path: &str| place.path().join(path);
    let old = at("target/package/usr/share/man/man1/edgecap-gone.1");
    let settings = at("target/package/etc/edgecap/edgecap.toml");
    for (file, text) in [(&old, "gone"), (&settings, "# Of an earlier version.\n")] {
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    }
    std::fs::create_dir_all(at("target/release")).unwrap();
    symlink(edgecap().get_program(), at("target/release/edgecap")).unwrap();
    let manual = include_str!("../../../docs/operate.md");
    for line in printed_commands(manual, "--root target/package") {
        if line.starts_with("cargo ") || line.starts_with("sudo ") {
            continue;
        }
        let mut shell = Command::new("sh");
        let out = shell.args(["-c", line]).current_dir(place.path()).output();
        let out = out.unwrap();
        assert!(out.status.success(), "{line}: {}", stderr(&out));
    }
    assert!(!old.exists());
    let sample = include_str!("../../../deploy/edgecap.toml");
    assert_eq!(std::fs::read_to_string(settings).unwrap(), sample);
}

/// Python's own environment is the system's on most of them, and takes no packages of others.
#[test]
fn what_is_printed_for_pip_has_an_environment_of_its_own() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for file in [
        "README.md",
        "docs/clients.md",
        "docs/operate.md",
        "deploy/release",
        "deploy/wheel",
        "src/commands/run/hints.rs",
    ] {
        let text = std::fs::read_to_string(root.join(file)).unwrap();
        for (at, _) in text.match_indices("pip install") {
            let line = text[at..].lines().next();
            assert!(text[..at].ends_with("/bin/"), "{file}: {line:?}");
        }
    }
}

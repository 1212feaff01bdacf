//! The folder that `deploy/release` is given: files of others, and of earlier releases.

use std::path::{Path, PathBuf};

use super::{Sources, machine};
use crate::program::{stderr, stdout};

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
    let sources = Sources::cloned();
    sources.stand_in("cargo", "exit 9");
    let place = sources.at("out");
    std::fs::create_dir(&place).unwrap();
    let earlier = ["SHA256SUMS", "edgecap-0.1.0-x86_64-linux.tar.gz"];
    for name in earlier {
        std::fs::write(place.join(name), "").unwrap();
    }
    // Files of an earlier release are no reason to refuse: it goes on to build.
    let out = sources.output("release");
    assert_eq!(out.status.code(), Some(9), "{}", stderr(&out));
    for foreign in ["notes.txt", "backup.tar.gz"] {
        let file = place.join(foreign);
        std::fs::write(&file, "").unwrap();
        let out = sources.output("release");
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
    let sources = Sources::cloned();
    let (place, machine) = (sources.at("out"), machine());
    std::fs::create_dir(&place).unwrap();
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
    let out = sources.output("release");
    assert_eq!(out.status.code(), Some(9), "{}", stderr(&out));
    assert_eq!(contents(&place), before, "the wheel is not built");

    let wheel = sources.with_maturin();
    let out = sources.output("release");
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

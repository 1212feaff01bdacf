//! What the build makes of the model that it is to embed, and which commit it names.

#[allow(dead_code, reason = "the rest is for Cargo")]
#[path = "../../build.rs"]
mod build;

use std::path::{Path, PathBuf};

use build::{SOURCES, checked, commit, watched};

#[test]
fn sources_without_a_repository_are_of_the_commit_that_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let of = |named: Option<&str>| commit(folder.path(), named.map(str::to_owned));
    assert_eq!(of(None), None);
    assert_eq!(of(Some("")), None);
    let named = "0123456789ab with changes";
    assert_eq!(of(Some(named)).as_deref(), Some(named));
}

#[test]
fn a_model_that_cannot_be_read_is_not_called_absent() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    assert!(checked(root, "m.ecm").is_none());
    // Nobody can read a folder as a file, not even root.
    std::fs::create_dir(root.join("m.ecm")).unwrap();
    let said = std::panic::catch_unwind(|| checked(root, "m.ecm")).unwrap_err();
    let said = said.downcast::<String>().unwrap();
    assert!(
        said.starts_with("expected to read m.ecm, or no such file: ") && !said.contains('\n'),
        "{said}"
    );
    std::fs::write(root.join("whole"), "weights").unwrap();
    let digest = blake3::hash(b"weights").to_hex().to_string();
    std::fs::write(root.join("whole.blake3"), format!("{digest}  whole\n")).unwrap();
    let found = checked(root, "whole").unwrap();
    assert_eq!(found, (root.join("whole"), digest));
}

/// Files with this extension below a folder.
fn files(folder: &Path, extension: &str, into: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let path = entry.path();
        if path.is_dir() {
            files(&path, extension, into);
        } else if path.extension().is_some_and(|e| e == extension) {
            into.push(path);
        }
    }
}

/// Else whoever runs Python there has the whole program built again.
#[test]
fn no_folder_of_python_is_watched() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut python = Vec::new();
    for source in SOURCES.map(|it| root.join(it)) {
        assert!(source.exists(), "{}", source.display());
        if source.is_dir() {
            files(&source, "py", &mut python);
        }
    }
    assert!(python.is_empty(), "{python:?}");
}

/// Else a build without weights would do everything again each time.
#[test]
fn of_a_file_that_is_absent_its_folder_is_watched() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    std::fs::create_dir(root.join("models")).unwrap();
    assert_eq!(watched(root, "models/m.ecm"), "models");
    std::fs::write(root.join("models/m.ecm"), "weights").unwrap();
    assert_eq!(watched(root, "models/m.ecm"), "models/m.ecm");
}

/// Else a changed one would leave the program of the commit before it.
#[test]
fn every_file_that_is_embedded_is_watched() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Vec::new();
    files(&root.join("src"), "rs", &mut sources);
    let mut embedded = 0;
    for source in sources {
        let text = std::fs::read_to_string(&source).unwrap();
        let code = text.split("#[cfg(test)]").next().unwrap();
        for call in [
            "include_str!(\"",
            "include_bytes!(\"",
            "include_str!(\n",
            "include_bytes!(\n",
        ] {
            for rest in code.split(call).skip(1) {
                let name = rest
                    .trim_start()
                    .trim_start_matches('"')
                    .split('"')
                    .next()
                    .unwrap();
                let file = source.parent().unwrap().join(name);
                // Made by the build itself.
                let Ok(file) = file.canonicalize() else {
                    continue;
                };
                let watched = SOURCES.iter().any(|it| file.starts_with(root.join(it)));
                let in_tests =
                    source.ends_with("tests.rs") || source.iter().any(|part| part == "tests");
                assert!(
                    watched || in_tests,
                    "{} in {}",
                    file.display(),
                    source.display()
                );
                embedded += 1;
            }
        }
    }
    assert!(embedded > 20, "{embedded}");
}

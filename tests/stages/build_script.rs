//! What the build makes of the model that it is to embed, and which commit it names.

#[allow(dead_code, reason = "the rest is for Cargo")]
#[path = "../../build.rs"]
mod build;

use build::{checked, commit};

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

//! `deploy/release`: what it finds in the folder that it is given.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// Makes a release into `folder`, where building fails at once.
fn release(working: &Path, folder: &str) -> Output {
    let cargo = working.join("bin/cargo");
    std::fs::create_dir_all(working.join("bin")).unwrap();
    std::fs::write(&cargo, "#!/bin/sh\nexit 9\n").unwrap();
    std::fs::set_permissions(&cargo, PermissionsExt::from_mode(0o755)).unwrap();
    let path = std::env::var("PATH").unwrap_or_default();
    Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/release"))
        .arg(folder)
        .current_dir(working)
        .env("PATH", format!("{}:{path}", working.join("bin").display()))
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
    assert_eq!(
        out.status.code(),
        Some(9),
        "{}",
        crate::program::stderr(&out)
    );
    for foreign in ["notes.txt", "backup.tar.gz"] {
        let file = place.join(foreign);
        std::fs::write(&file, "").unwrap();
        let out = release(folder.path(), "out");
        let said = crate::program::stderr(&out);
        assert_eq!(out.status.code(), Some(73), "{said}");
        assert!(said.contains(file.to_str().unwrap()), "{said}");
        std::fs::remove_file(file).unwrap();
    }
    assert!(earlier.iter().all(|name| place.join(name).exists()));
}

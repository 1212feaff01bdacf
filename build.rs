//! Build stamp; digest check and embedding of the shipped weights.

use std::path::{Path, PathBuf};
use std::{env, fs};

const MODEL: &str = "models/edgecap.ecm";
const DIGEST: &str = "models/edgecap.ecm.blake3";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // A folder, so that a file that appears later is seen too.
    println!("cargo:rerun-if-changed=models");
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("set by cargo"));
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    let bytes = match checked(&root) {
        Some(path) => format!("Some(include_bytes!({path:?}))"),
        None => {
            println!(
                "cargo:warning={MODEL} is absent: this build has no weights of its own and needs --model FILE"
            );
            "None".into()
        }
    };
    let code = format!(
        "/// The file, or none in a build without weights.\npub(super) const BYTES: Option<&[u8]> = {bytes};\n"
    );
    fs::write(out.join("shipped_model.rs"), code).expect("OUT_DIR is writable");
}

/// The model's path when it is there and its digest is the recorded one.
fn checked(root: &Path) -> Option<PathBuf> {
    let path = root.join(MODEL);
    let bytes = fs::read(&path).ok()?;
    let recorded = fs::read_to_string(root.join(DIGEST)).unwrap_or_else(|e| {
        panic!("expected the digest of {MODEL} in {DIGEST}: {e}; restore both files from the repository")
    });
    let recorded = recorded.split_whitespace().next().unwrap_or_default();
    let found = blake3::hash(&bytes).to_hex();
    assert!(
        recorded == found.as_str(),
        "{MODEL} has BLAKE3 digest {found}, {DIGEST} records {recorded}: restore both files from the repository"
    );
    Some(path)
}

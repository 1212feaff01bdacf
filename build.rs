//! Build stamp; digest check and embedding of the shipped weights.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

const MODEL: &str = "models/edgecap.ecm";
/// What is embedded in its place with the feature `open-weights`.
const OPEN_MODEL: &str = "models/open/edgecap-open.ecm";
/// What the program is made of. No folder in which Python lies: it keeps compiled files beside its sources, and each of
/// them would have the program built again.
pub(crate) const SOURCES: [&str; 21] = [
    "build.rs",
    MODEL,
    "models/edgecap.ecm.blake3",
    "models/association.toml",
    "models/skeleton.toml",
    "models/selecsls.toml",
    "models/selecsls42.toml",
    "models/selecsls60.toml",
    "models/selecsls84.toml",
    "models/resnet50.toml",
    "models/body/body.npz",
    "models/body/poses.npz",
    "models/demo",
    "models/open",
    "src",
    "kernels",
    "clients/rust",
    "deploy",
    "vendor",
    "Cargo.toml",
    "Cargo.lock",
];

/// Names the commit of the sources, as `deploy/release` and `deploy/wheel` do: a copy of them has no repository, and
/// what was built before a commit is not built again after it unless this changes.
const COMMIT: &str = "EDGECAP_COMMIT";

fn main() {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("set by cargo"));
    for source in SOURCES {
        println!("cargo:rerun-if-changed={}", watched(&root, source));
    }
    println!("cargo:rerun-if-env-changed={COMMIT}");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    let (name, kind) = match env::var_os("CARGO_FEATURE_OPEN_WEIGHTS") {
        Some(_) => (OPEN_MODEL, "open weights"),
        None => (MODEL, "weights"),
    };
    let model = checked(&root, name);
    let (bytes, weights) = match &model {
        Some((path, digest)) => (
            format!("Some(include_bytes!({path:?}))"),
            format!("{kind} {}", &digest[..12]),
        ),
        None => {
            println!(
                "cargo:warning={name} is absent: this build has no weights of its own and needs --model FILE"
            );
            ("None".into(), "no weights".into())
        }
    };
    let version = env::var("CARGO_PKG_VERSION").expect("set by cargo");
    let commit =
        commit(&root, env::var(COMMIT).ok()).map_or_else(String::new, |c| format!("commit {c}, "));
    println!("cargo:rustc-env=EDGECAP_BUILD={version} ({commit}{weights})");
    let code = format!(
        "/// The file, or none in a build without weights.\npub(super) const BYTES: Option<&[u8]> = {bytes};\n"
    );
    fs::write(out.join("shipped_model.rs"), code).expect("OUT_DIR is writable");
}

/// What is watched of a source. To Cargo a file that is absent has changed at every build; the folder in which it would
/// lie changes when it appears.
pub(crate) fn watched<'a>(root: &Path, source: &'a str) -> &'a str {
    match source.rsplit_once('/') {
        Some((folder, _)) if !root.join(source).exists() => folder,
        _ => source,
    }
}

/// The commit that the sources are of, and whether they were changed since: as it is `named`, else as their repository
/// says; none outside one.
///
/// HEAD is not watched: a commit that leaves [`SOURCES`] alone needs no new build, and what the last one says of itself
/// stays true.
pub(crate) fn commit(root: &Path, named: Option<String>) -> Option<String> {
    if let Some(named) = named.filter(|name| !name.is_empty()) {
        return Some(named);
    }
    if !root.join(".git").exists() {
        return None;
    }
    let asked = Command::new("git")
        .arg("-C")
        .arg(root)
        .args(["describe", "--always", "--abbrev=12", "--exclude=*"])
        .arg("--dirty= with changes")
        .output()
        .ok()?;
    let said = String::from_utf8(asked.stdout).ok()?.trim().to_owned();
    (asked.status.success() && !said.is_empty()).then_some(said)
}

/// The path and digest of the model of this name; none where there is no such file.
///
/// # Panics
/// When the file cannot be read, or its digest is not the one recorded beside it.
pub(crate) fn checked(root: &Path, model: &str) -> Option<(PathBuf, String)> {
    let path = root.join(model);
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == ErrorKind::NotFound => return None,
        Err(e) => panic!(
            "expected to read {model}, or no such file: {e}; make it readable, or remove it to build without weights"
        ),
    };
    let digest = format!("{model}.blake3");
    let recorded = fs::read_to_string(root.join(&digest)).unwrap_or_else(|e| {
        panic!("expected the digest of {model} in {digest}: {e}; restore both files from the repository")
    });
    let recorded = recorded.split_whitespace().next().unwrap_or_default();
    let found = blake3::hash(&bytes).to_hex();
    assert!(
        recorded == found.as_str(),
        "{model} has BLAKE3 digest {found}, {digest} records {recorded}: restore both files from the repository"
    );
    Some((path, recorded.to_owned()))
}

//! Walls of the house that the compiler does not hold.

use std::fs;
use std::path::{Path, PathBuf};

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn the_runtime_never_reaches_into_the_laboratory() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&src, &mut files);
    assert!(
        files.len() > 100,
        "expected the sources in {}",
        src.display()
    );
    let instruments =
        ["bench", "eval", "synth"].map(|verb| src.join(format!("commands/{verb}.rs")));
    let outside = |f: &&PathBuf| !f.starts_with(src.join("lab")) && !instruments.contains(f);
    let broken: Vec<_> = files
        .iter()
        .filter(outside)
        .filter(|f| fs::read_to_string(f).unwrap().contains("lab::"))
        .collect();
    assert!(
        broken.is_empty(),
        "expected only src/lab and its verbs to name lab::, found {broken:?}"
    );
}

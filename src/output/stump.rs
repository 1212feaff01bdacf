//! Where a file goes whose writing broke off: what is there and holds more is not given for it.

use std::path::{Path, PathBuf};

use super::suffix::suffixed;

/// `path`, or, where a longer file has this name, the first free one of `NAME-cut`, `NAME-cut-2` and so on, of which
/// the user is told.
pub fn place(path: &Path, bytes: u64) -> PathBuf {
    if !std::fs::metadata(path).is_ok_and(|older| older.is_file() && older.len() > bytes) {
        return path.to_owned();
    }
    let beside = (1..)
        .map(|n: u32| match n {
            1 => suffixed(path, "-cut"),
            n => suffixed(path, &format!("-cut-{n}")),
        })
        .find(|p| std::fs::symlink_metadata(p).is_err());
    let beside = beside.unwrap_or_else(|| path.to_owned());
    tracing::warn!(
        "{}: the file of the time before is longer and stays; what there is of this one is {}",
        path.display(),
        beside.display()
    );
    beside
}

#[cfg(test)]
mod tests {
    use crate::output::AtomicFile;
    use std::io::Write;

    #[test]
    fn what_broke_off_never_replaces_more() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a.jsonl"), "a long record\n").unwrap();
        let stump = |text: &str| {
            let mut file = AtomicFile::create(&at("a.jsonl")).unwrap();
            file.write_all(text.as_bytes()).unwrap();
            file.break_off();
            file.finish().unwrap();
        };
        stump("short\n");
        stump("short, too\n");
        let text = |name: &str| std::fs::read_to_string(at(name)).unwrap();
        assert_eq!(text("a.jsonl"), "a long record\n");
        assert_eq!(text("a-cut.jsonl"), "short\n");
        assert_eq!(text("a-cut-2.jsonl"), "short, too\n");
        stump("longer than the record before\n");
        assert_eq!(text("a.jsonl"), "longer than the record before\n");
        // A whole one replaces whatever is there.
        crate::output::write(&at("a.jsonl"), b"whole\n").unwrap();
        assert_eq!(text("a.jsonl"), "whole\n");
    }
}

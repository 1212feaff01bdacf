//! Where a file goes whose writing broke off: what is there and holds more is not given for it.

use std::fs::{self, File, Metadata};
use std::io::{self, BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use super::suffix::first_free;

/// How a line of JSON begins.
const LINE: &[u8] = b"{";

/// `path`, or, where a file of this name holds more than `stump`, the first free one of `NAME-cut`, `NAME-cut-2` and so
/// on, of which the user is told.
pub fn place(path: &Path, stump: &mut File) -> PathBuf {
    if !fs::metadata(path).is_ok_and(|older| older.is_file()) || !holds_more(path, stump) {
        return path.to_owned();
    }
    let beside = first_free(path, "-cut");
    tracing::warn!(
        "{}: the file of the time before is longer and stays; what there is of this one is {}",
        path.display(),
        beside.display()
    );
    beside
}

/// Whether the older file has more lines, or, where one of the two is no record in lines, more bytes: as many frames
/// make a longer file where numbers have more digits.
fn holds_more(older: &Path, stump: &mut File) -> bool {
    let before = File::open(older).and_then(|mut file| lines(&mut file));
    if let (Ok(Some(before)), Ok(Some(now))) = (before, lines(stump)) {
        return before > now;
    }
    let bytes = |found: io::Result<Metadata>| found.map_or(0, |m| m.len());
    bytes(fs::metadata(older)) > bytes(stump.metadata())
}

/// How many lines of JSON a file holds; `None` where it holds something else.
fn lines(file: &mut File) -> io::Result<Option<u64>> {
    file.rewind()?;
    let mut file = BufReader::new(file);
    if !file.fill_buf()?.starts_with(LINE) {
        return Ok(None);
    }
    let mut lines = 0;
    while file.skip_until(b'\n')? > 0 {
        lines += 1;
    }
    Ok(Some(lines))
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

    #[test]
    fn as_many_lines_are_as_much_whatever_their_digits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jsonl");
        let older = "{\"x\":0.123456789}\n{\"x\":0.123456789}\n";
        for (stump, stays) in [("{\"x\":1}\n", true), ("{\"x\":1}\n{\"x\":2}\n", false)] {
            std::fs::write(&path, older).unwrap();
            let mut file = AtomicFile::create(&path).unwrap();
            file.write_all(stump.as_bytes()).unwrap();
            file.break_off();
            assert_eq!(file.finish_beside().unwrap().is_some(), stays);
            let there = if stays { older } else { stump };
            assert_eq!(std::fs::read_to_string(&path).unwrap(), there);
        }
    }
}

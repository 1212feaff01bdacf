//! Where the result of a file goes when the user names no place for it.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::input::{InputArgs, NamedInput};
use crate::capture::InputSpec;

/// The folder.
pub const OUT: &str = "edgecap-out";
/// A longer line is no frame.
const MOST: u64 = 8 << 20;

/// `edgecap-out/NAME.KIND.jsonl`, called like the input; with a number where the result of another input is called so.
pub fn place(args: &InputArgs, chosen: &NamedInput, kind: &str) -> PathBuf {
    let title = match (&args.name, &chosen.spec) {
        (None, InputSpec::Path(path)) => title(path).unwrap_or_else(|| chosen.name.clone()),
        _ => chosen.name.clone(),
    };
    free(Path::new(OUT), &title, kind, &chosen.spec)
}

fn free(folder: &Path, title: &str, kind: &str, input: &InputSpec) -> PathBuf {
    let mut number = 1;
    loop {
        let name = match number {
            1 => format!("{title}.{kind}.jsonl"),
            n => format!("{title}-{n}.{kind}.jsonl"),
        };
        let path = folder.join(name);
        if source(&path).is_none_or(|source| is_of(&source, input)) {
            return path;
        }
        number += 1;
    }
}

/// The file's name without ending. Letters of every alphabet stay.
fn title(path: &Path) -> Option<String> {
    let stem = path.file_stem()?.to_string_lossy();
    let plain = |c: char| match c.is_ascii() {
        true => c.is_ascii_alphanumeric() || c == '-',
        false => !c.is_whitespace() && !c.is_control() && c != char::REPLACEMENT_CHARACTER,
    };
    let title = stem.chars().map(|c| if plain(c) { c } else { '_' });
    Some(title.take(64).collect()).filter(|t: &String| !t.is_empty())
}

/// What a record says that it came of; `None` where it says nothing, or there is none.
fn source(record: &Path) -> Option<String> {
    #[derive(Deserialize)]
    struct Line {
        source: String,
    }
    let mut line = Vec::new();
    let mut file = BufReader::new(File::open(record).ok()?).take(MOST);
    file.read_until(b'\n', &mut line).ok()?;
    let line: Line = serde_json::from_slice(&line).ok()?;
    Some(line.source).filter(|s| !s.is_empty())
}

/// Whether a record's source is this input, or a photo in it.
fn is_of(source: &str, input: &InputSpec) -> bool {
    let InputSpec::Path(path) = input else {
        // What comes on standard input has no name of its own.
        return *input == InputSpec::Stdin || source == input.to_string();
    };
    let source = Path::new(source);
    let source = match path.is_dir() {
        true => source.parent().unwrap_or(source),
        false => source,
    };
    let place = |p: &Path| p.canonicalize().ok();
    source == path || place(source).is_some_and(|s| Some(s) == place(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_input_has_a_result_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let film = |name: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "film").unwrap();
            path
        };
        let run = |path: &Path| {
            let input = InputSpec::Path(path.to_owned());
            let to = free(folder.path(), &title(path).unwrap(), "bodies", &input);
            let line = serde_json::json!({ "frame": 0, "source": path });
            std::fs::write(&to, format!("{line}\n")).unwrap();
            to.file_name().unwrap().to_str().unwrap().to_owned()
        };
        let (one, other) = (film("甲.avi"), film("乙.avi"));
        assert_eq!(
            [run(&one), run(&other)],
            ["甲.bodies.jsonl", "乙.bodies.jsonl"]
        );
        let (here, there) = (film("x y.avi"), film("t2/x y.avi"));
        assert_eq!(
            [run(&here), run(&there)],
            ["x_y.bodies.jsonl", "x_y-2.bodies.jsonl"]
        );
        let again = [run(&here), run(&there)];
        assert_eq!(again, ["x_y.bodies.jsonl", "x_y-2.bodies.jsonl"]);
        let photo = film("photos/a.jpg");
        run(&photo);
        assert!(is_of(
            photo.to_str().unwrap(),
            &InputSpec::Path(folder.path().join("photos"))
        ));
        assert!(!is_of(
            photo.to_str().unwrap(),
            &InputSpec::Path(folder.path().to_owned())
        ));
    }
}

//! Programs and folders in the text of a unit: as it names them, and which program it starts.

use std::path::{Path, PathBuf};

use crate::commands::exit::Failure;

/// A path as one word of a unit's command line.
///
/// # Errors
/// Exit code 64 where a unit cannot name it.
pub fn word(path: &Path) -> Result<String, Failure> {
    // What stands behind a dollar is a variable, but not in the program's own name.
    let is_kept = |text: &&str| !text.contains(|c: char| c == '$' || c.is_control());
    let Some(text) = path.to_str().filter(is_kept) else {
        return Err(Failure::usage(format!(
            "{}: expected a path in UTF-8 that a unit of systemd can name, without '$' and line breaks; choose another",
            path.display()
        )));
    };
    let escaped = text
        .replace('\\', r"\\")
        .replace('"', "\\\"")
        .replace('%', "%%");
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+%".contains(c);
    Ok(match escaped.chars().all(is_plain) {
        true => escaped,
        false => format!("\"{escaped}\""),
    })
}

/// The program that a unit starts, as [`word`] writes it; `None` where it says none.
pub fn program_of(unit: &str) -> Option<PathBuf> {
    // An empty one takes back those before; what stands before a path says how it is started.
    let how = |c: char| "-@:+!|".contains(c) || c.is_whitespace();
    let commands = unit.lines().filter_map(|l| l.strip_prefix("ExecStart="));
    let mut commands = commands.map(|command| command.trim_start_matches(how));
    let command = commands.rfind(|command| !command.is_empty())?;
    let (mut text, mut rest) = (String::new(), command.chars());
    let is_quoted = rest.as_str().starts_with('"');
    if is_quoted {
        rest.next();
    }
    while let Some(c) = rest.next() {
        match c {
            '"' if is_quoted => break,
            c if c.is_whitespace() && !is_quoted => break,
            '\\' | '%' => text.extend(rest.next()),
            c => text.push(c),
        }
    }
    (!text.is_empty()).then(|| text.into())
}

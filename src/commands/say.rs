//! Words for whoever watches. Nobody may be there any more: that is no reason to end.

use std::io::{self, Write};

use tracing::Level;

use super::log;
use super::stderr::Stderr;

/// A line on standard output.
pub fn out(line: &str) {
    let _ = writeln!(io::stdout(), "{line}");
}

/// A line of a result on standard output; `false` where nobody reads any more, for whoever could go on for ever.
///
/// # Errors
/// Where it cannot be written for another reason, such as a full disk.
pub fn result(line: &str) -> anyhow::Result<bool> {
    match writeln!(io::stdout(), "{line}") {
        Ok(()) => Ok(true),
        Err(e) if e.kind() == io::ErrorKind::BrokenPipe => Ok(false),
        Err(e) => Err(anyhow::Error::from(e).context("standard output: cannot write")),
    }
}

/// The whole result of a verb on standard output. Whoever has read enough of it may leave.
///
/// # Errors
/// As [`result`].
pub fn whole(text: &str) -> anyhow::Result<()> {
    result(text.trim_end()).map(drop)
}

/// What was done and, behind it, where the results are, as the sinks say.
pub fn concluded(done: &str, places: &[String]) -> String {
    let places = places.join("; ");
    match places.is_empty() || places.starts_with('→') {
        true => format!("{done} {places}").trim_end().to_owned(),
        false => format!("{done}; {places}"),
    }
}

/// A line on standard error.
pub fn err(line: &str) {
    at(Stderr::new(), Level::INFO, line);
}

/// Why this process ends, on standard error.
pub fn failure(line: &str) {
    at(Stderr::last(), Level::ERROR, line);
}

fn at(mut to: Stderr, level: Level, line: &str) {
    // In one piece, so that lines of several processes do not mix.
    let line = if log::to_journal() {
        log::record(level, line) + "\n"
    } else {
        format!("{line}\n")
    };
    let _ = to.write_all(line.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_done_stands_apart_from_where_it_is() {
        for (places, line) in [
            (&[][..], "2 frames"),
            (&["→ a.jsonl"], "2 frames → a.jsonl"),
            (&["2 pictures → ov"], "2 frames; 2 pictures → ov"),
            (
                &["→ a.jsonl", "2 pictures → ov"],
                "2 frames → a.jsonl; 2 pictures → ov",
            ),
        ] {
            let places: Vec<String> = places.iter().map(ToString::to_string).collect();
            assert_eq!(concluded("2 frames", &places), line);
        }
    }
}

//! Words for whoever watches. Nobody may be there any more: that is no reason to end.

use std::io::{self, Write};

use tracing::Level;

use super::log;

/// A line on standard output.
pub fn out(line: &str) {
    let _ = writeln!(io::stdout(), "{line}");
}

/// A line on standard error.
pub fn err(line: &str) {
    at(Level::INFO, line);
}

/// Why this process ends, on standard error.
pub fn failure(line: &str) {
    at(Level::ERROR, line);
}

fn at(level: Level, line: &str) {
    let _ = if log::to_journal() {
        writeln!(io::stderr(), "{}", log::record(level, line))
    } else {
        writeln!(io::stderr(), "{line}")
    };
}

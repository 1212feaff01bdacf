//! Words for whoever watches. Nobody may be there any more: that is no reason to end.

use std::io::{self, Write};

/// A line on standard output.
pub fn out(line: &str) {
    let _ = writeln!(io::stdout(), "{line}");
}

/// A line on standard error.
pub fn err(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}

//! Tools of other projects that tests run.

use std::process::Command;

/// What must be there: tools in a list with spaces between them, as `.ci/run` sets it.
const WANTED: &str = "EDGECAP_TEST_TOOLS";

/// Whether a tool is on this machine. Where it is not, the test says that it is skipped, or fails if the tool is
/// wanted.
pub fn has(tool: &str) -> bool {
    if Command::new(tool).arg("--version").output().is_ok() {
        return true;
    }
    let wanted = std::env::var(WANTED).unwrap_or_default();
    assert!(
        !wanted.split_whitespace().any(|w| w == tool),
        "expected {tool}, which {WANTED} lists; found none: install it"
    );
    eprintln!("skipped: no {tool} on this machine");
    false
}

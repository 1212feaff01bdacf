//! Tools of other projects that tests run.
#![allow(dead_code, reason = "every test file uses its own part")]

use std::process::Command;

/// What must be there: tools in a list with spaces between them, as `.ci/run` sets it.
const WANTED: &str = "EDGECAP_TEST_TOOLS";

/// Whether a tool is on this machine. Where it is not, the test says that it is skipped, or fails if the tool is
/// wanted.
pub fn has(tool: &str) -> bool {
    let has = Command::new(tool).arg("--version").output().is_ok();
    if !has {
        skip(tool, &format!("no {tool} on this machine"));
    }
    has
}

/// Says that a test is skipped because a tool cannot do its part, or fails if the tool is wanted.
pub fn skip(tool: &str, why: &str) {
    let wanted = std::env::var(WANTED).unwrap_or_default();
    assert!(
        !wanted.split_whitespace().any(|w| w == tool),
        "expected {tool}, which {WANTED} lists; found {why}: install it"
    );
    eprintln!("skipped: {why}");
}

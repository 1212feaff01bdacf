//! Scripts that stand in for other programs: a path and a text go in, and the file can be run.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// Writes a script that can be run. By a child: what this process has open for writing while a neighbour forks cannot
/// be run for as long as the fork has it open, too.
pub fn script(path: &Path, text: &str) {
    let mut write = Command::new("sh")
        .args(["-c", "cat > \"$0\" && chmod 755 \"$0\""])
        .arg(path)
        .stdin(Stdio::piped())
        .spawn()
        .expect("sh runs");
    let mut to = write.stdin.take().expect("piped");
    to.write_all(text.as_bytes()).expect("sh reads");
    drop(to);
    assert!(write.wait().expect("its end").success());
}

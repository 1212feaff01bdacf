//! What whoever starts a run by hand may do next, with the names of this run.

use std::path::{Path, PathBuf};

use edgecap_client::place::RUNTIME_DIR_VARIABLE;

/// How to read and how to look at a camera's bodies, a line each, to be typed in another terminal.
pub fn lines(camera: &str) -> [String; 2] {
    let mut before = String::new();
    if let Some(folder) = std::env::var_os(RUNTIME_DIR_VARIABLE) {
        before += &format!("{RUNTIME_DIR_VARIABLE}={} ", quoted(folder.as_ref()));
    }
    let mut path = String::new();
    if let Some(client) = client() {
        path = format!("PYTHONPATH={} ", quoted(&client));
    }
    let program = std::env::current_exe().unwrap_or_else(|_| "edgecap".into());
    [
        format!(
            "read it:    {before}{path}python3 -c \"import edgecap; [print(b.id, b.joint('r_wrist')) \
             for f in edgecap.bodies('{camera}') for b in f.people()]\""
        ),
        format!(
            "look at it: {before}{} view --camera {camera}",
            quoted(&program)
        ),
    ]
}

/// The folder of the Python client, where this program lies in the repository that it was built in.
fn client() -> Option<PathBuf> {
    let program = std::env::current_exe().ok()?;
    let found = program.ancestors().map(|a| a.join("clients/python"));
    found.into_iter().find(|c| c.join("edgecap.py").is_file())
}

/// As a shell takes it for one word.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+".contains(c);
    match text.chars().all(plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_a_shell() {
        assert_eq!(quoted("/a/b-c".as_ref()), "/a/b-c");
        assert_eq!(quoted("/a b/it's".as_ref()), r"'/a b/it'\''s'");
    }
}

//! What whoever starts a run by hand may do next, with the names of this run.

use std::path::Path;

use edgecap_client::place::RUNTIME_DIR_VARIABLE;

/// How to read and how to look at a camera's bodies, a line each, to be typed in another terminal.
pub fn lines(camera: &str) -> [String; 2] {
    let mut before = String::new();
    if let Some(folder) = std::env::var_os(RUNTIME_DIR_VARIABLE) {
        before += &format!("{RUNTIME_DIR_VARIABLE}={} ", quoted(folder.as_ref()));
    }
    let program = std::env::current_exe().unwrap_or_else(|_| "edgecap".into());
    let read = match python(&program) {
        Some(python) => format!(
            "{before}{python} -c \"import edgecap; [print(b.id, b.joint('r_wrist')) \
             for f in edgecap.bodies('{camera}') for b in f.people()]\""
        ),
        None => format!(
            "{before}{} watch --name {camera} (in Python edgecap.bodies('{camera}'), once PYTHONPATH names the \
             folder clients/python of edgecap's repository)",
            quoted(&program)
        ),
    };
    [
        format!("read it:    {read}"),
        format!(
            "look at it: {before}{} view --camera {camera}",
            quoted(&program)
        ),
    ]
}

/// The Python that has the client, if it is known to be on this machine: of the environment that this program was
/// installed into with it, else any, with the folder of the client where this program lies in the repository that it
/// was built in.
fn python(program: &Path) -> Option<String> {
    if let Some(environment) = program.parent().and_then(Path::parent)
        && environment.join("pyvenv.cfg").is_file()
        && program.with_file_name("python3").exists()
    {
        return Some(quoted(&program.with_file_name("python3")));
    }
    let mut folders = program.ancestors().map(|a| a.join("clients/python"));
    let client = folders.find(|c| c.join("edgecap/__init__.py").is_file())?;
    Some(format!("PYTHONPATH={} python3", quoted(&client)))
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
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn the_python_that_has_the_client() {
        let place = tempfile::tempdir().unwrap();
        let file = |path: &str| -> PathBuf {
            let path = place.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            path
        };
        let clone = file("clone/target/release/edgecap");
        assert_eq!(python(&clone), None);
        file("clone/clients/python/edgecap/__init__.py");
        let client = place.path().join("clone/clients/python");
        let expected = format!("PYTHONPATH={} python3", client.display());
        assert_eq!(python(&clone), Some(expected));
        let installed = file("venv/bin/edgecap");
        let own = file("venv/bin/python3");
        assert_eq!(python(&installed), None, "it is no environment");
        file("venv/pyvenv.cfg");
        assert_eq!(python(&installed), Some(own.display().to_string()));
    }

    #[test]
    fn words_of_a_shell() {
        assert_eq!(quoted("/a/b-c".as_ref()), "/a/b-c");
        assert_eq!(quoted("/a b/it's".as_ref()), r"'/a b/it'\''s'");
    }
}

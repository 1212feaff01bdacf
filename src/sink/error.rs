//! Why a result did not get where it should.

use std::io;
use std::path::{Path, PathBuf};

use edgecap_client::LinkError;

use crate::output::{kept_at, no_room};
use crate::overlay::OverlayError;

/// Why a sink failed.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    /// A file or folder cannot be made.
    #[error("cannot write {}: {}", path.display(), refusal(cause))]
    Create {
        /// What was to be made.
        path: PathBuf,
        /// The system's words.
        cause: io::Error,
    },
    /// Writing failed on the way.
    #[error("{}", stopped(path, cause, "what was written before is kept"))]
    Write {
        /// What was being written.
        path: PathBuf,
        /// The system's words.
        cause: io::Error,
    },
    /// Writing failed on the way, and what there is cannot be used.
    #[error("{}", stopped(path, cause, "nothing of this file is kept"))]
    Lost {
        /// What was being written.
        path: PathBuf,
        /// The system's words.
        cause: io::Error,
    },
    /// The name says something else than what is written.
    #[error("{}: expected {expected}; choose such a name", path.display())]
    Kind {
        /// What was to be made.
        path: PathBuf,
        /// What can be.
        expected: &'static str,
    },
    /// A picture cannot be written.
    #[error(transparent)]
    Picture(#[from] OverlayError),
    /// Shared memory failed.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// What a record is called.
pub(super) fn name(path: &Path) -> String {
    if path.as_os_str() == crate::output::STDOUT {
        return "standard output".to_owned();
    }
    path.display().to_string()
}

/// What became of a file, `rest` of it where it could not be written, all of it where it only has another name.
fn stopped(path: &Path, cause: &io::Error, rest: &str) -> String {
    let name = name(path);
    match kept_at(cause) {
        Some((at, why)) if no_room(why).is_some() => format!(
            "{name}: writing stopped ({}); what found room lies in {}",
            reason(why),
            at.display()
        ),
        Some((at, why)) => format!(
            "{name}: the file cannot have this name ({}); what was made lies in {}",
            reason(why),
            at.display()
        ),
        None => format!("{name}: writing stopped ({}); {rest}", reason(cause)),
    }
}

fn reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::BrokenPipe => "nobody reads it any more".to_owned(),
        _ => no_room(error).map_or_else(|| error.to_string(), str::to_owned),
    }
}

/// Of a full disk the place is not to blame.
fn refusal(error: &io::Error) -> String {
    let elsewhere = || format!("{error}; choose a writable place");
    no_room(error).map_or_else(elsewhere, str::to_owned)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;

    use super::*;
    use crate::output::AtomicFile;

    #[test]
    fn of_a_file_that_only_has_another_name_nothing_is_said_to_be_lost() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.avi");
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"a film").unwrap();
        fs::create_dir(&path).unwrap();
        let cause = file.finish().unwrap_err();
        let e = SinkError::Lost { path, cause }.to_string();
        let words = format!(
            "what was made lies in {}/a-new.avi",
            folder.path().display()
        );
        assert!(e.ends_with(&words) && !e.contains("nothing"), "{e}");
    }
}

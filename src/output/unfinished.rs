//! What is not finished yet: the names that it has until then, and errors without them.

use std::io;
use std::path::Path;

use tempfile::Builder;

/// Start of the names of what is not finished.
const PREFIX: &str = ".edgecap-";
const SUFFIX: &str = ".part";

/// Makes files and folders of such names.
pub(super) fn builder() -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX);
    builder
}

/// Whether a name is that of what is not finished.
pub fn is_unfinished(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with(PREFIX) && name.ends_with(SUFFIX)
}

/// The system's own error, without the name of a temporary file, which says nothing to the user. With that name it does
/// not have its number, which is all that tells of some what they are.
pub(crate) fn unnamed(error: io::Error) -> io::Error {
    let words = error.to_string();
    let Some((words, _)) = words.split_once(" at path ") else {
        return error;
    };
    let number = words
        .rsplit_once("(os error ")
        .and_then(|(_, number)| number.strip_suffix(')')?.parse().ok());
    match number {
        Some(number) => io::Error::from_raw_os_error(number),
        None => io::Error::new(error.kind(), words.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use rustix::io::Errno;

    use super::*;
    use crate::output::{AtomicFile, AtomicFolder};

    #[test]
    fn errors_do_not_name_what_is_only_on_the_way() {
        let file = AtomicFile::create(Path::new("/proc/nothing.jsonl")).unwrap_err();
        let folder = AtomicFolder::create(Path::new("/proc/nothing")).unwrap_err();
        for e in [file, folder] {
            assert!(!e.to_string().contains(SUFFIX), "{e}");
        }
    }

    #[test]
    fn errors_of_temporary_files_keep_the_system_s_number() {
        let folder = tempfile::tempdir().unwrap();
        let nowhere = folder.path().join("nowhere");
        let refused = tempfile::Builder::new().tempfile_in(nowhere).unwrap_err();
        let e = unnamed(refused);
        assert_eq!(Errno::from_io_error(&e), Some(Errno::NOENT), "{e}");
        for words in ["of no system", "(os error x)", "os error 5)"] {
            let named = format!("{words} at path \"/srv/a\"");
            let e = unnamed(io::Error::other(named));
            assert_eq!((e.raw_os_error(), e.to_string()), (None, words.to_owned()));
        }
    }
}

//! Where a name leads through links, so that none is replaced by a file, nor what this process has open.

use std::fs;
use std::io;
use std::iter;
use std::path::{Path, PathBuf};

use rustix::io::Errno;

use super::{STDOUT, parent};

/// As many links as the system itself follows.
const MOST_LINKS: usize = 40;

/// `path`, and what it leads to, link after link.
pub fn steps(path: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    let next = |link: &PathBuf| Some(parent(link).join(fs::read_link(link).ok()?));
    iter::successors(Some(path.to_owned()), next).take(MOST_LINKS + 1)
}

/// Whether `path` names standard output, by whatever name.
pub fn is_stdout(path: &Path) -> bool {
    descriptor(path) == Some(1)
}

/// The number of the descriptor of this process that `path` names, itself or by links, as `/dev/stdout` does; that of
/// standard output for `-`.
pub(super) fn descriptor(path: &Path) -> Option<u32> {
    if path.as_os_str() == STDOUT {
        return Some(1);
    }
    let own = fs::canonicalize("/proc/self/fd").ok()?;
    let is_own = |step: &PathBuf| parent(step).canonicalize().is_ok_and(|p| p == own);
    let named = steps(path).find(is_own)?;
    named.file_name()?.to_str()?.parse().ok()
}

/// The file behind `path`, which need not be there yet; `path` itself where it is no link.
///
/// # Errors
/// Links that lead in a circle, or into a folder that is not there: the disk that they lead to may be away, and what is
/// written in its place nobody would find.
pub fn behind_links(path: &Path) -> io::Result<PathBuf> {
    if let Ok(found) = path.canonicalize() {
        return Ok(found);
    }
    // Links of /proc, such as that of /dev/stdout, lead to what may have no name.
    if fs::metadata(path).is_ok() {
        return Ok(path.to_owned());
    }
    let target = steps(path).last().unwrap_or_else(|| path.to_owned());
    if target.is_symlink() {
        return Err(Errno::LOOP.into());
    }
    if target != path && !parent(&target).is_dir() {
        let what = format!(
            "it is a link to {}, whose folder is missing",
            target.display()
        );
        return Err(io::Error::new(io::ErrorKind::NotFound, what));
    }
    Ok(target)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;
    use crate::output::{try_place, write};

    #[test]
    fn a_link_to_what_is_not_there_yet_stays_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("disk")).unwrap();
        symlink("disk/file", at("second")).unwrap();
        symlink(at("second"), at("first")).unwrap();
        try_place(&at("first")).unwrap();
        for text in ["new", "newer"] {
            write(&at("first"), text.as_bytes()).unwrap();
            assert!(at("first").is_symlink() && at("second").is_symlink());
            assert_eq!(fs::read_to_string(at("disk/file")).unwrap(), text);
        }
    }

    #[test]
    fn a_link_that_leads_nowhere_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        symlink("away/file", at("link")).unwrap();
        for tried in [write(&at("link"), b"new"), try_place(&at("link"))] {
            let e = tried.unwrap_err().to_string();
            assert!(e.contains("away/file") && e.contains("missing"), "{e}");
        }
        assert!(!at("away").exists() && at("link").is_symlink());
        symlink("circle", at("circle")).unwrap();
        assert!(write(&at("circle"), b"new").is_err());
        assert!(at("circle").is_symlink());
    }
}

//! What killed processes left unfinished.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::time::Duration;

use rustix::fs::OFlags;

use super::link::{behind_links, descriptor};
use super::{is_unfinished, parent};

/// What nobody has written to for so long, and nobody holds, a killed process has left. The time is for file systems on
/// which locks of other machines are not seen.
const LEFT_AFTER: Duration = Duration::from_secs(24 * 60 * 60);

/// Removes from the folder in which `path` is written, behind links, the files that killed processes of this user have
/// not finished, a day after they were written to last. Folders stay, and so do files that nobody may write to: they
/// may be results that could not be moved to their place.
pub fn sweep(path: &Path) {
    // What is open already has nothing beside it, and where a link leads nowhere, nothing is written.
    if descriptor(path).is_some() {
        return;
    }
    let Ok(target) = behind_links(path) else {
        return;
    };
    let entries = fs::read_dir(parent(&target)).into_iter().flatten();
    let entries = entries.flatten();
    for path in entries.map(|e| e.path()).filter(|p| is_unfinished(p)) {
        // What cannot be looked at is not ours to remove.
        let _ = remove_if_left(&path);
    }
}

fn remove_if_left(path: &Path) -> io::Result<()> {
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    let file = File::options()
        .read(true)
        .custom_flags(flags.bits().cast_signed())
        .open(path)?;
    let meta = file.metadata()?;
    let is_own = meta.is_file() && meta.uid() == rustix::process::geteuid().as_raw();
    let is_writable = meta.mode() & 0o222 != 0;
    let is_old = meta.modified()?.elapsed().is_ok_and(|a| a > LEFT_AFTER);
    if is_own && is_writable && is_old && file.try_lock().is_ok() {
        fs::remove_file(path)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::super::AtomicFile;
    use super::*;

    #[test]
    fn what_killed_processes_left_is_swept_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let made = |name: &str, days: u64| {
            let path = folder.path().join(name);
            let file = File::create(&path).unwrap();
            let ago = Duration::from_secs(days * 24 * 60 * 60 + 60);
            let time = std::time::SystemTime::now() - ago;
            file.set_modified(time).unwrap();
            (path, file)
        };
        let (left, _) = made(".edgecap-left.part", 1);
        let kept = [
            made(".edgecap-new.part", 0),
            made(".edgecap-held.part", 9),
            made("edgecap-other.part", 9),
            made(".edgecap-other", 9),
        ];
        kept[1].1.lock().unwrap();
        let results = folder.path().join(".edgecap-folder.part");
        fs::create_dir(&results).unwrap();
        let mut writing = AtomicFile::create(&folder.path().join("file")).unwrap();
        writing.write_all(b"whole").unwrap();
        let beside = writing.beside().unwrap().as_file();
        beside.set_modified(std::time::UNIX_EPOCH).unwrap();
        sweep(&folder.path().join("result"));
        assert!(!left.exists());
        for (path, _) in &kept {
            assert!(path.exists(), "{}", path.display());
        }
        assert!(results.exists());
        writing.finish().unwrap();
        assert_eq!(fs::read(folder.path().join("file")).unwrap(), b"whole");
    }
}

//! Files for work on the way to a result, which nobody else may read.

use std::io;
use std::path::Path;

use tempfile::NamedTempFile;

use super::link::behind_links;
use super::parent::nearest_folder;
use super::unfinished::{builder, unnamed};

/// A file in the folder where `path` will be, or in the first around it that is there: where there is room for the
/// result, there is room for what it is made of. In the system's folder for temporary files where it cannot be there.
/// It goes when it is dropped.
///
/// # Errors
/// If it can be nowhere.
pub fn private_beside(path: &Path) -> io::Result<NamedTempFile> {
    let file = builder();
    let target = behind_links(path).unwrap_or_else(|_| path.to_owned());
    let made = file.tempfile_in(nearest_folder(&target));
    let made = made.or_else(|_| file.tempfile()).map_err(unnamed)?;
    // Held for as long as it is used: `sweep` takes only what nobody holds.
    let _ = made.as_file().try_lock();
    Ok(made)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::MetadataExt;

    use super::*;

    #[test]
    fn it_lies_where_the_result_will_be_or_where_it_can_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("disk")).unwrap();
        std::os::unix::fs::symlink(at("disk/a.glb"), at("link.glb")).unwrap();
        for (name, beside) in [
            ("a.glb", "."),
            ("new/deeper/a.glb", "."),
            ("link.glb", "disk"),
        ] {
            let file = private_beside(&at(name)).unwrap();
            assert_eq!(
                file.path().parent().unwrap().canonicalize().unwrap(),
                at(beside).canonicalize().unwrap(),
                "{name}"
            );
            assert_eq!(fs::metadata(file.path()).unwrap().mode() & 0o777, 0o600);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        assert_eq!(fs::read_dir(at("disk")).unwrap().count(), 0);
        let elsewhere = private_beside(Path::new("/proc/nowhere/a.glb")).unwrap();
        assert!(elsewhere.path().starts_with(std::env::temp_dir()));
    }
}

//! Where the file lies.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use rustix::process::geteuid;

/// The file's name.
pub const FILE_NAME: &str = "edgecap.toml";
/// The folder of the machine's own file.
pub const SYSTEM_FOLDER: &str = "/etc/edgecap";

/// The file that holds: this user's, else the machine's; `None` where there is neither. A link that leads nowhere is
/// one: whoever reads it hears of that. The machine's may hold secrets of its service: for who may not read it there is
/// none.
pub fn find() -> Option<PathBuf> {
    let own = user_file().and_then(|(home, path)| holds(&path, &home).then_some(path));
    own.or_else(|| {
        let machines = Path::new(SYSTEM_FOLDER).join(FILE_NAME);
        is_readable(&machines).then_some(machines)
    })
}

/// Whether anything has this name. Of what this user may not look at, whether `home` belongs to this user: another's
/// settings, to which `sudo` and containers may leave `HOME`, say nothing.
fn holds(path: &Path, home: &Path) -> bool {
    match fs::symlink_metadata(path).map_err(|e| e.kind()) {
        Err(ErrorKind::NotFound | ErrorKind::NotADirectory) => false,
        Err(ErrorKind::PermissionDenied) => {
            fs::metadata(home).is_ok_and(|home| home.uid() == geteuid().as_raw())
        }
        _ => true,
    }
}

/// Whether anything has this name that this user may read, or that is wrong in another way.
fn is_readable(path: &Path) -> bool {
    let no_wait = OFlags::NONBLOCK.bits().cast_signed();
    let opened = File::options().read(true).custom_flags(no_wait).open(path);
    match opened.map_err(|e| e.kind()) {
        Err(ErrorKind::PermissionDenied) => false,
        Err(ErrorKind::NotFound) => path.is_symlink(),
        _ => true,
    }
}

/// `edgecap/edgecap.toml` in `$XDG_CONFIG_HOME`, by default in `~/.config`, after the folder that the variable names.
fn user_file() -> Option<(PathBuf, PathBuf)> {
    let named = |variable| {
        let folder = std::env::var_os(variable).map(PathBuf::from);
        folder.filter(|folder| folder.is_absolute())
    };
    let own = Path::new("edgecap").join(FILE_NAME);
    if let Some(folder) = named("XDG_CONFIG_HOME") {
        let file = folder.join(own);
        return Some((folder, file));
    }
    let home = named("HOME")?;
    let file = home.join(".config").join(own);
    Some((home, file))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_link_that_leads_nowhere_is_a_file_that_cannot_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let [link, round, file] = ["link", "round", "file"].map(|name| folder.path().join(name));
        symlink(folder.path().join("away"), &link).unwrap();
        symlink(&round, &round).unwrap();
        fs::write(&file, "").unwrap();
        for there in [&link, &round, &file] {
            assert!(holds(there, folder.path()), "{}", there.display());
            assert!(is_readable(there), "{}", there.display());
        }
        let missing = [folder.path().join("away"), file.join("edgecap.toml")];
        assert!(!missing.iter().any(|path| holds(path, folder.path())));
        assert!(!is_readable(&missing[0]));
    }
}

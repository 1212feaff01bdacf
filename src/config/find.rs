//! Where the file lies.

use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The file's name.
pub const FILE_NAME: &str = "edgecap.toml";
/// The folder of the machine's own file.
pub const SYSTEM_FOLDER: &str = "/etc/edgecap";

/// The file that holds: this user's, else the machine's; `None` where there is neither. The machine's may hold secrets
/// of its service: for who may not read it there is none.
pub fn find() -> Option<PathBuf> {
    let own = user_folder().map(|folder| folder.join(FILE_NAME));
    own.filter(|path| path.exists()).or_else(|| {
        let machines = Path::new(SYSTEM_FOLDER).join(FILE_NAME);
        let is_not_ours = |kind| matches!(kind, ErrorKind::NotFound | ErrorKind::PermissionDenied);
        let opened = File::open(&machines);
        (!opened.is_err_and(|e| is_not_ours(e.kind()))).then_some(machines)
    })
}

/// `$XDG_CONFIG_HOME/edgecap`, by default `~/.config/edgecap`.
fn user_folder() -> Option<PathBuf> {
    let named = |variable| std::env::var_os(variable).map(PathBuf::from);
    let absolute = |path: &PathBuf| path.is_absolute();
    named("XDG_CONFIG_HOME")
        .filter(absolute)
        .or_else(|| Some(named("HOME").filter(absolute)?.join(".config")))
        .map(|folder| folder.join("edgecap"))
}

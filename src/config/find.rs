//! Where the file lies.

use std::path::{Path, PathBuf};

/// The file's name.
pub const FILE_NAME: &str = "edgecap.toml";
/// The folder of the machine's own file.
pub const SYSTEM_FOLDER: &str = "/etc/edgecap";

/// The file that holds: this user's, else the machine's; `None` where there is neither.
pub fn find() -> Option<PathBuf> {
    user_folder()
        .map(|folder| folder.join(FILE_NAME))
        .into_iter()
        .chain([Path::new(SYSTEM_FOLDER).join(FILE_NAME)])
        .find(|path| path.exists())
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

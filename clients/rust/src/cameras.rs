//! Which cameras publish on this machine.

use crate::place::reading_dirs;
use crate::stream::{Message, check_camera};

/// The cameras whose stream of `M` this user may read, by name: those published now, and those whose publisher was
/// killed.
pub fn cameras<M: Message>() -> Vec<String> {
    let suffix = format!(".{}.v{}", M::STREAM, M::VERSION);
    let entries = reading_dirs()
        .into_iter()
        .filter_map(|folder| std::fs::read_dir(folder).ok());
    let names = entries.flatten().flatten().filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        let camera = name.strip_suffix(&suffix)?;
        check_camera(camera).ok().map(|()| camera.to_owned())
    });
    let mut cameras: Vec<String> = names.collect();
    cameras.sort();
    cameras.dedup();
    cameras
}

//! Files and folders that appear whole or not at all: written beside their place, then renamed. What is no file, such
//! as `/dev/null` or a named pipe, is written into as it is, and so is what this process has open already, such as
//! `/dev/stdout`; a link stays a link, but where the program itself chose the name. Before a single file has its name
//! it is on the disk, so that not even a power cut leaves half of it.

mod aside;
mod device;
mod file;
mod folder;
mod full;
mod in_place;
mod kept;
mod left;
mod link;
mod made;
mod mount;
mod parent;
mod private;
mod stump;
mod suffix;
mod trial;
mod unfinished;
mod write;

pub use aside::set_aside;
pub use file::AtomicFile;
pub use folder::AtomicFolder;
pub use full::{is_full, no_room};
pub use in_place::is_in_place;
pub use kept::kept_at;
pub use left::sweep;
pub use link::{is_stdout, steps as link_steps};
pub use made::MadeFolders;
pub use mount::is_read_only;
pub use parent::parent;
pub use private::private_beside;
pub use suffix::suffixed;
pub use trial::try_place;
pub use unfinished::is_unfinished;
#[cfg(test)]
pub(crate) use unfinished::unnamed;
pub use write::{write, write_passing};

/// The name of standard output.
pub const STDOUT: &str = "-";

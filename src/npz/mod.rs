//! NumPy archives (`.npz`): named arrays go in, a file's bytes come out, and the other way round.

mod error;
mod header;
mod read;
mod stored;
mod up_to_failure;
mod write;

pub use error::NpzError;
pub use read::{Archive, Numbers};
pub use up_to_failure::UpToFailure;
pub use write::{Array, Values, Writer, write};

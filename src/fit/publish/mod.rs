//! In: people as the fit knows them. Out: the body frame that apps read, in metres and pixels.

mod body;
pub mod confidence;
mod header;

pub use body::{flat_angles, write_body};
pub use header::Header;

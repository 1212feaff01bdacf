//! Films in MP4 files without any other program. Feature `mp4`; what guards its reader, and what reads parameter sets,
//! is tested without it.

mod boxes;
#[cfg(feature = "mp4")]
mod film;
mod sps;

#[cfg(feature = "mp4")]
pub use film::Mp4Source;

#[cfg(all(test, feature = "mp4"))]
mod tests;

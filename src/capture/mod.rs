//! Pictures from cameras, video, photos: anything a user can point at goes in, [`Frame`]s come out.

mod avi;
mod error;
mod frame;
mod jpeg;
mod letterbox;
mod limits;
mod source;

pub use avi::{AviReader, AviWriter};
pub use error::CaptureError;
pub use frame::Frame;
pub use jpeg::JpegPicture;
pub use letterbox::Letterbox;
pub use limits::{MAX_PIXELS, MAX_SIDE};
pub use source::Source;

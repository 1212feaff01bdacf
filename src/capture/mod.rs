//! Pictures from cameras, video, photos: anything a user can point at goes in, [`Frame`]s come out.

mod frame;
mod letterbox;

pub use frame::Frame;
pub use letterbox::Letterbox;

//! What comes in: cameras, films, photos, and the network's input that they become.

mod avi;
mod camera;
mod film;
#[cfg(feature = "mp4")]
mod mp4;
mod photo;
mod resize;

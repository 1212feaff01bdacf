//! What comes in: cameras, films, photos, and the network's input that they become.

mod avi;
mod camera;
mod film;
mod photo;
mod resize;
#[path = "../program/tools.rs"]
mod tools;

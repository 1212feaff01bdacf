//! What comes in: cameras, films, photos, and the network's input that they become.

mod avi;
mod camera;
mod ffmpeg;
mod photo;
mod resize;
mod said;
#[path = "../program/script.rs"]
mod script;
mod spec;
mod stored;
#[path = "../program/tools.rs"]
mod tools;
mod y4m;
mod yuv;

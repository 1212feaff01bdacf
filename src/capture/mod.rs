//! Pictures from cameras, video, photos: anything a user can point at goes in, [`Frame`]s come out.
//!
//! [`open`] turns an [`InputSpec`] into a [`Source`]; [`Resizer`] turns its frames into the network's input.

mod album;
mod avi;
mod awaited;
mod brightness;
pub mod camera;
mod decode;
pub mod demo;
mod drawn;
mod error;
mod exif;
mod ffmpeg;
mod frame;
mod jfif;
mod jpeg;
mod letterbox;
mod limits;
mod mjpeg;
mod mounting;
#[cfg(any(test, feature = "mp4"))]
mod mp4;
mod natural;
mod paced;
mod photo;
mod pipe;
mod quiet;
mod rate;
mod raw;
mod resize;
mod signature;
mod source;
mod spec;
mod square;
mod stand_in;
mod stored;
mod y4m;
mod yuv;

pub use album::is_photo;
pub use avi::{AviReader, AviWriter};
pub use awaited::AwaitedSource;
pub use brightness::Brightness;
pub use camera::{CameraInfo, CameraSource, OpenOptions, list_cameras};
pub use decode::{PictureDecoder, PixelFormat, RawLayout};
pub use error::CaptureError;
pub use exif::Orientation;
pub use ffmpeg::{Ffmpeg, FfmpegSource};
pub use frame::Frame;
pub use jpeg::JpegPicture;
pub use letterbox::Letterbox;
pub use limits::{MAX_PIXELS, MAX_SIDE};
pub use mjpeg::MjpegReader;
pub use mounting::Mounting;
#[cfg(feature = "mp4")]
pub use mp4::Mp4Source;
pub use natural::natural_order;
pub use paced::PacedSource;
pub use photo::{PhotoDecoder, PhotoSource};
pub use rate::Rate;
pub use raw::{RawDecoder, RawPicture};
pub use resize::{Crop, PADDING, Resizer};
pub use source::Source;
pub use spec::{InputSpec, STDIN, is_camera_place, open};
pub use stand_in::StandIn;
pub use stored::{holds_stills, is_film, open_bytes};
pub use y4m::Y4mReader;
pub use yuv::{Matrix, Range, YuvToRgb};

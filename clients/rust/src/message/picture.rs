//! A picture, small and packed. No run publishes any unless `--show-picture` says so.

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Most bytes of a packed picture.
pub const MAX_PICTURE: usize = 48 << 10;

/// What a camera sees, made small, for whoever asked to look at it.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend, FromBytes, IntoBytes, Immutable)]
#[type_name("EdgecapPictureFrameV1")]
#[repr(C)]
pub struct PictureFrame {
    /// [`ObservationFrame::sequence`](super::ObservationFrame::sequence) of the picture.
    pub sequence: u64,
    /// When it was taken.
    pub capture_ns: u64,
    /// When this message was published.
    pub publish_ns: u64,
    /// Width of the packed picture, pixels.
    pub width: u32,
    /// Height of the packed picture, pixels.
    pub height: u32,
    /// `FLAG_*` bits.
    pub flags: u32,
    /// Valid bytes of `jpeg`.
    pub count: u32,
    /// The picture as JPEG.
    pub jpeg: [u8; MAX_PICTURE],
}

impl Default for PictureFrame {
    fn default() -> Self {
        Self {
            sequence: 0,
            capture_ns: 0,
            publish_ns: 0,
            width: 0,
            height: 0,
            flags: 0,
            count: 0,
            jpeg: [0; MAX_PICTURE],
        }
    }
}

impl PictureFrame {
    /// The valid bytes.
    pub fn jpeg(&self) -> &[u8] {
        &self.jpeg[..(self.count as usize).min(MAX_PICTURE)]
    }
}

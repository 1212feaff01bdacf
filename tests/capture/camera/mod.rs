//! Cameras without a camera: drivers that follow a script, buffers and files that are made up.

mod decoding;
mod lens;
mod lock;
mod opening;
mod recovery;

use edgecap::capture::{Matrix, Range};
use edgecap::capture::{PixelFormat, RawLayout};

/// How a buffer lies in memory, of limited range in the colours of BT.601.
fn layout(format: PixelFormat, width: u32, height: u32, stride: u32) -> RawLayout {
    RawLayout {
        format,
        width,
        height,
        stride,
        matrix: Matrix::Bt601,
        range: Range::Limited,
    }
}

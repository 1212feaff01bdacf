//! The kernel's camera interface: a device file goes in, mapped buffers come out.
//!
//! Written against the crate `v4l`'s definitions but not its stream: after one timeout that queues the same buffer
//! twice and fails for ever, and it panics when a camera goes away in a way that it does not expect. Here a buffer is
//! either with the driver or in our hands, by type: [`Filled`](stream::Filled) is what [`Stream::dequeue`] returns and
//! [`Stream::queue`] takes.

mod control;
mod stream;

use std::io;
use std::path::Path;
use std::sync::Arc;

use v4l::device::{Device, Handle};
use v4l::v4l_sys as sys;
use v4l::v4l2;
use v4l::v4l2::vidioc;

use crate::capture::yuv::{Matrix, Range};

pub(crate) use control::{Control, ControlKind, Controls};
pub(crate) use stream::{Ready, Stream};

/// `V4L2_BUF_TYPE_VIDEO_CAPTURE`.
const VIDEO_CAPTURE: u32 = 1;
/// `V4L2_FIELD_NONE`: whole pictures, no half-pictures.
const FIELD_NONE: u32 = 1;
/// `V4L2_CAP_VIDEO_CAPTURE`, `V4L2_CAP_VIDEO_CAPTURE_MPLANE`, `V4L2_CAP_STREAMING`, `V4L2_CAP_IO_MC`,
/// `V4L2_CAP_DEVICE_CAPS`.
const CAP_CAPTURE: u32 = 0x1;
const CAP_CAPTURE_MPLANE: u32 = 0x1000;
const CAP_STREAMING: u32 = 0x0400_0000;
const CAP_IO_MC: u32 = 0x2000_0000;
const CAP_DEVICE_CAPS: u32 = 0x8000_0000;
/// Most entries that are asked of any list: a driver that never says "no more" must not keep us.
const MAX_ENTRIES: u32 = 256;

/// One call into the driver, repeated when a signal interrupts it.
///
/// # Safety
/// `request` must be the request whose argument is a `T`.
unsafe fn ioctl<T>(
    handle: &Handle,
    request: vidioc::_IOC_TYPE,
    argument: &mut T,
) -> io::Result<()> {
    loop {
        // SAFETY: `argument` is one valid, exclusively borrowed `T`; the caller vouches that the request reads and
        // writes exactly size_of::<T>() bytes, which the kernel takes from the request's own number.
        let result =
            unsafe { v4l2::ioctl(handle.fd(), request, std::ptr::from_mut(argument).cast()) };
        match result {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            other => return other,
        }
    }
}

/// A C structure of the interface with every byte 0.
///
/// # Safety
/// All-zero bytes must be a valid `T`.
unsafe fn zeroed<T>() -> T {
    // SAFETY: the caller vouches for it.
    unsafe { std::mem::zeroed() }
}

/// What a camera says about itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Capabilities {
    pub card: String,
    pub driver: String,
    pub bus: String,
    /// Gives pictures in single-plane buffers that can be mapped.
    pub can_stream: bool,
    /// Gives pictures in multi-plane buffers only: chips of phones and boards, not webcams.
    pub multi_plane: bool,
    /// Gives pictures by itself. Image processors of chips (`bcm2835-isp` of the Raspberry Pi) look like cameras, and
    /// give what a program has put in; sensors of boards and some laptops want their parts joined before, as libcamera
    /// does.
    pub stands_alone: bool,
}

/// An open device file.
pub(crate) struct Camera {
    handle: Arc<Handle>,
}

/// A size or a range of sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sizes {
    One(u32, u32),
    /// (smallest, largest, step) across and down.
    Range([u32; 3], [u32; 3]),
}

/// What the driver agreed to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Agreed {
    pub fourcc: [u8; 4],
    pub width: u32,
    pub height: u32,
    pub stride: u32,
    pub matrix: Matrix,
    pub range: Range,
}

impl Camera {
    /// Opens without waiting.
    pub fn open(path: &Path) -> io::Result<Self> {
        if path.as_os_str().as_encoded_bytes().contains(&0) {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        Ok(Self {
            handle: Device::with_path(path)?.handle(),
        })
    }

    /// Who the camera is and what it can do.
    pub fn capabilities(&self) -> io::Result<Capabilities> {
        // SAFETY: integers and arrays of integers: all-zero is valid. VIDIOC_QUERYCAP takes a v4l2_capability.
        let caps = unsafe {
            let mut caps: sys::v4l2_capability = zeroed();
            ioctl(&self.handle, vidioc::VIDIOC_QUERYCAP, &mut caps)?;
            caps
        };
        // One driver may own several files; this is about ours.
        let flags = if caps.capabilities & CAP_DEVICE_CAPS != 0 {
            caps.device_caps
        } else {
            caps.capabilities
        };
        Ok(Capabilities {
            card: text(&caps.card),
            driver: text(&caps.driver),
            bus: text(&caps.bus_info),
            can_stream: flags & CAP_CAPTURE != 0 && flags & CAP_STREAMING != 0,
            multi_plane: flags & CAP_CAPTURE_MPLANE != 0,
            stands_alone: stands_alone(flags, &self.input()),
        })
    }

    /// Which of its inputs pictures come from.
    fn input(&self) -> io::Result<libc::c_int> {
        let mut input = 0;
        // SAFETY: VIDIOC_G_INPUT takes an int.
        unsafe { ioctl(&self.handle, vidioc::VIDIOC_G_INPUT, &mut input)? };
        Ok(input)
    }

    /// Four letters of every pixel format.
    pub fn formats(&self) -> Vec<[u8; 4]> {
        self.list(|index| {
            // SAFETY: integers, an enumeration stored as one, and arrays: all-zero is valid. VIDIOC_ENUM_FMT takes a
            // v4l2_fmtdesc.
            unsafe {
                let mut format: sys::v4l2_fmtdesc = zeroed();
                format.index = index;
                format.type_ = VIDEO_CAPTURE;
                ioctl(&self.handle, vidioc::VIDIOC_ENUM_FMT, &mut format)?;
                Ok(format.pixelformat.to_le_bytes())
            }
        })
    }

    /// Sizes of a format.
    pub fn sizes(&self, fourcc: [u8; 4]) -> Vec<Sizes> {
        self.list(|index| {
            // SAFETY: integers and a union of such: all-zero is valid. VIDIOC_ENUM_FRAMESIZES takes a v4l2_frmsizeenum.
            // Both members of the union are integers, so that any bits are valid; `type_` says which one is meant.
            unsafe {
                let mut size: sys::v4l2_frmsizeenum = zeroed();
                size.index = index;
                size.pixel_format = u32::from_le_bytes(fourcc);
                ioctl(&self.handle, vidioc::VIDIOC_ENUM_FRAMESIZES, &mut size)?;
                if size.type_ == sys::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE {
                    let d = size.__bindgen_anon_1.discrete;
                    return Ok(Sizes::One(d.width, d.height));
                }
                let s = size.__bindgen_anon_1.stepwise;
                Ok(Sizes::Range(
                    [s.min_width, s.max_width, s.step_width],
                    [s.min_height, s.max_height, s.step_height],
                ))
            }
        })
    }

    /// Most pictures per second of a format and size; 0 when the driver does not say.
    pub fn highest_rate(&self, fourcc: [u8; 4], width: u32, height: u32) -> f64 {
        let rates = self.list(|index| {
            // SAFETY: as for sizes; VIDIOC_ENUM_FRAMEINTERVALS takes a v4l2_frmivalenum.
            unsafe {
                let mut interval: sys::v4l2_frmivalenum = zeroed();
                interval.index = index;
                interval.pixel_format = u32::from_le_bytes(fourcc);
                interval.width = width;
                interval.height = height;
                ioctl(
                    &self.handle,
                    vidioc::VIDIOC_ENUM_FRAMEINTERVALS,
                    &mut interval,
                )?;
                let discrete = interval.type_ == sys::v4l2_frmivaltypes_V4L2_FRMIVAL_TYPE_DISCRETE;
                let shortest = if discrete {
                    interval.__bindgen_anon_1.discrete
                } else {
                    interval.__bindgen_anon_1.stepwise.min
                };
                Ok(rate(shortest.numerator, shortest.denominator).unwrap_or(0.0))
            }
        });
        rates.into_iter().fold(0.0, f64::max)
    }

    /// Asks for a format and size; the driver answers with what it will do.
    pub fn set_format(&self, fourcc: [u8; 4], width: u32, height: u32) -> io::Result<Agreed> {
        // SAFETY: integers and a union of such: all-zero is valid. VIDIOC_S_FMT takes a v4l2_format. For VIDEO_CAPTURE
        // the member of the union is `pix`, whose fields are integers.
        let pix = unsafe {
            let mut format: sys::v4l2_format = zeroed();
            format.type_ = VIDEO_CAPTURE;
            format.fmt.pix.width = width;
            format.fmt.pix.height = height;
            format.fmt.pix.pixelformat = u32::from_le_bytes(fourcc);
            format.fmt.pix.field = FIELD_NONE;
            ioctl(&self.handle, vidioc::VIDIOC_S_FMT, &mut format)?;
            format.fmt.pix
        };
        // SAFETY: both members of the union are the same integer.
        let encoding = unsafe { pix.__bindgen_anon_1.ycbcr_enc };
        let (matrix, range) = colours(pix.colorspace, encoding, pix.quantization);
        Ok(Agreed {
            fourcc: pix.pixelformat.to_le_bytes(),
            width: pix.width,
            height: pix.height,
            stride: pix.bytesperline,
            matrix,
            range,
        })
    }

    /// Asks for a rate; the answer is what the driver will do, `None` when it does not say.
    pub fn set_rate(&self, fps: f64) -> Option<f64> {
        // SAFETY: integers and a union of such: all-zero is valid. VIDIOC_S_PARM takes a v4l2_streamparm. For
        // VIDEO_CAPTURE the member of the union is `capture`, whose fields are integers.
        let interval = unsafe {
            let mut parameters: sys::v4l2_streamparm = zeroed();
            parameters.type_ = VIDEO_CAPTURE;
            parameters.parm.capture.timeperframe.numerator = 1000;
            parameters.parm.capture.timeperframe.denominator = (fps * 1000.0).round() as u32;
            ioctl(&self.handle, vidioc::VIDIOC_S_PARM, &mut parameters).ok()?;
            parameters.parm.capture.timeperframe
        };
        rate(interval.numerator, interval.denominator)
    }

    /// Entries 0, 1, 2 … until the driver refuses.
    fn list<T>(&self, entry: impl FnMut(u32) -> io::Result<T>) -> Vec<T> {
        (0..MAX_ENTRIES).map(entry).map_while(Result::ok).collect()
    }
}

/// Whether a device of these capabilities gives pictures by itself: a camera's driver knows of an input, though the
/// camera may fail to say of which.
fn stands_alone(flags: u32, input: &io::Result<libc::c_int>) -> bool {
    let refusal = input.as_ref().err().and_then(io::Error::raw_os_error);
    flags & CAP_IO_MC == 0 && refusal != Some(libc::ENOTTY)
}

/// What a driver's words about luma and chroma mean, by numbers of `linux/videodev2.h`: 0 leaves it to the colourspace,
/// as in the kernel's `V4L2_MAP_YCBCR_ENC_DEFAULT` and `V4L2_MAP_QUANTIZATION_DEFAULT`. Matrices that are not known
/// here count as the nearest one.
fn colours(colourspace: u32, encoding: u32, quantization: u32) -> (Matrix, Range) {
    // V4L2_COLORSPACE_SMPTE240M, _REC709, _BT2020, _DCI_P3, and the one of JPEG.
    const WIDE: [u32; 4] = [2, 3, 10, 12];
    const JPEG: u32 = 7;
    let matrix = match encoding {
        0 if WIDE.contains(&colourspace) => Matrix::Bt709,
        // V4L2_YCBCR_ENC_709, _XV709, _BT2020, _BT2020_CONST_LUM, _SMPTE240M.
        2 | 4 | 6 | 7 | 8 => Matrix::Bt709,
        _ => Matrix::Bt601,
    };
    let range = match quantization {
        1 => Range::Full,
        0 if colourspace == JPEG => Range::Full,
        _ => Range::Limited,
    };
    (matrix, range)
}

/// Seconds per picture as a fraction → pictures per second.
fn rate(numerator: u32, denominator: u32) -> Option<f64> {
    (numerator > 0 && denominator > 0).then(|| f64::from(denominator) / f64::from(numerator))
}

/// Text up to the first 0, whatever bytes a driver put there.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn image_processors_and_sensors_to_be_joined_give_nothing_by_themselves() {
        let fails = |code| Err(io::Error::from_raw_os_error(code));
        let webcam = CAP_CAPTURE | CAP_STREAMING;
        assert!(stands_alone(webcam, &Ok(0)));
        assert!(stands_alone(webcam, &fails(libc::EIO)));
        assert!(!stands_alone(webcam, &fails(libc::ENOTTY)));
        assert!(!stands_alone(webcam | CAP_IO_MC, &Ok(0)));
    }

    #[test]
    fn colours_are_what_the_driver_says_or_its_colourspace() {
        use Matrix::{Bt601, Bt709};
        use Range::{Full, Limited};
        for (said, expected) in [
            // Nothing; SMPTE 170M; sRGB, as UVC cameras say.
            ((0, 0, 0), (Bt601, Limited)),
            ((1, 0, 0), (Bt601, Limited)),
            ((8, 0, 0), (Bt601, Limited)),
            // BT.709, JPEG.
            ((3, 0, 0), (Bt709, Limited)),
            ((7, 0, 0), (Bt601, Full)),
            // Said in so many words.
            ((8, 2, 1), (Bt709, Full)),
            ((3, 1, 0), (Bt601, Limited)),
            ((7, 0, 2), (Bt601, Limited)),
        ] {
            let (colourspace, encoding, quantization) = said;
            assert_eq!(
                colours(colourspace, encoding, quantization),
                expected,
                "{said:?}"
            );
        }
    }
}

//! The kernel's camera interface: a device file goes in, mapped buffers come out.
//!
//! Written against the crate `v4l`'s definitions but not its stream: after one timeout that queues the same buffer twice and fails
//! for ever, and it panics when a camera goes away in a way that it does not expect. Here a buffer is either with the driver or
//! in our hands, by type: [`Filled`] is what [`Stream::dequeue`] returns and [`Stream::queue`] takes.

use std::ffi::c_void;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use v4l::device::{Device, Handle};
use v4l::v4l_sys as sys;
use v4l::v4l2;
use v4l::v4l2::vidioc;

/// `V4L2_BUF_TYPE_VIDEO_CAPTURE`.
const VIDEO_CAPTURE: u32 = 1;
/// `V4L2_MEMORY_MMAP`.
const MEMORY_MMAP: u32 = 1;
/// `V4L2_FIELD_NONE`: whole pictures, no half-pictures.
const FIELD_NONE: u32 = 1;
/// `V4L2_CAP_VIDEO_CAPTURE`, `V4L2_CAP_VIDEO_CAPTURE_MPLANE`, `V4L2_CAP_STREAMING`, `V4L2_CAP_DEVICE_CAPS`.
const CAP_CAPTURE: u32 = 0x1;
const CAP_CAPTURE_MPLANE: u32 = 0x1000;
const CAP_STREAMING: u32 = 0x0400_0000;
const CAP_DEVICE_CAPS: u32 = 0x8000_0000;
/// `V4L2_BUF_FLAG_ERROR`: the driver says that the picture is damaged.
const FLAG_ERROR: u32 = 0x40;
/// `V4L2_BUF_FLAG_TIMESTAMP_MASK`, `V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC`.
const FLAG_TIME_MASK: u32 = 0xE000;
const FLAG_TIME_MONOTONIC: u32 = 0x2000;
/// Most entries that are asked of any list: a driver that never says "no more" must not keep us.
const MAX_ENTRIES: u32 = 256;
/// Buffers that are asked for: one in our hands, one being filled, two ready.
const BUFFERS: u32 = 4;

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
        // SAFETY: `argument` is one valid, exclusively borrowed `T`; the caller vouches that the request reads and writes
        // exactly size_of::<T>() bytes, which the kernel takes from the request's own number.
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
    pub full_range: bool,
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
        })
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
            // SAFETY: integers and a union of such: all-zero is valid. VIDIOC_ENUM_FRAMESIZES takes a v4l2_frmsizeenum. Both
            // members of the union are integers, so that any bits are valid; `type_` says which one is meant.
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
        // SAFETY: integers and a union of such: all-zero is valid. VIDIOC_S_FMT takes a v4l2_format. For VIDEO_CAPTURE the member
        // of the union is `pix`, whose fields are integers.
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
        const FULL_RANGE: u32 = 1;
        Ok(Agreed {
            fourcc: pix.pixelformat.to_le_bytes(),
            width: pix.width,
            height: pix.height,
            stride: pix.bytesperline,
            full_range: pix.quantization == FULL_RANGE,
        })
    }

    /// Asks for a rate; the answer is what the driver will do, `None` when it does not say.
    pub fn set_rate(&self, fps: f64) -> Option<f64> {
        // SAFETY: integers and a union of such: all-zero is valid. VIDIOC_S_PARM takes a v4l2_streamparm. For VIDEO_CAPTURE the
        // member of the union is `capture`, whose fields are integers.
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

/// Seconds per picture as a fraction → pictures per second.
fn rate(numerator: u32, denominator: u32) -> Option<f64> {
    (numerator > 0 && denominator > 0).then(|| f64::from(denominator) / f64::from(numerator))
}

/// Text up to the first 0, whatever bytes a driver put there.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

/// One mapped buffer.
struct Mapping {
    start: *mut c_void,
    length: usize,
}

// SAFETY: the mapping is plain memory that belongs to the process, not to a thread; only its owner reads it.
unsafe impl Send for Mapping {}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: `start..start + length` is exactly what mmap returned and nothing borrows it: slices live no longer than the
        // stream that owns this. A failure would leave the mapping, which is harmless.
        let _ = unsafe { v4l2::munmap(self.start, self.length) };
    }
}

/// A buffer that the driver has filled and handed to us.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Filled {
    index: u32,
    used: usize,
    /// The camera's count of this picture.
    pub sequence: u32,
    /// CLOCK_MONOTONIC nanoseconds, `None` when the driver stamps something else.
    pub time_ns: Option<u64>,
    /// The driver says that the picture is damaged.
    pub damaged: bool,
}

/// What waiting for a picture brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ready {
    Yes,
    No,
}

/// A running stream of buffers.
pub(crate) struct Stream {
    handle: Arc<Handle>,
    mappings: Vec<Mapping>,
}

impl Stream {
    /// Asks for buffers, maps them, hands them all to the driver and starts.
    pub fn start(camera: &Camera) -> io::Result<Self> {
        let mut stream = Self {
            handle: camera.handle.clone(),
            mappings: Vec::new(),
        };
        let count = stream.request(BUFFERS)?;
        for index in 0..count {
            let mut buffer = buffer(index);
            // SAFETY: VIDIOC_QUERYBUF takes a v4l2_buffer. For MEMORY_MMAP the member of the union is `offset`. The mapping is
            // new memory at an address of the kernel's choice; `Mapping` owns it from here on.
            unsafe {
                ioctl(&stream.handle, vidioc::VIDIOC_QUERYBUF, &mut buffer)?;
                let length = buffer.length as usize;
                let start = v4l2::mmap(
                    std::ptr::null_mut(),
                    length,
                    libc::PROT_READ | libc::PROT_WRITE,
                    libc::MAP_SHARED,
                    stream.handle.fd(),
                    buffer.m.offset.into(),
                )?;
                stream.mappings.push(Mapping { start, length });
            }
            stream.enqueue(index)?;
        }
        let mut kind = VIDEO_CAPTURE as i32;
        // SAFETY: VIDIOC_STREAMON takes an int.
        unsafe { ioctl(&stream.handle, vidioc::VIDIOC_STREAMON, &mut kind)? };
        Ok(stream)
    }

    /// Waits until the driver has a picture. A signal ends the wait early.
    pub fn wait(&self, timeout: Duration) -> io::Result<Ready> {
        let mut poll = libc::pollfd {
            fd: self.handle.fd(),
            events: libc::POLLIN,
            revents: 0,
        };
        let milliseconds = timeout.as_millis().min(i32::MAX as u128) as i32;
        // SAFETY: one valid pollfd, count 1.
        let ready = unsafe { libc::poll(&mut poll, 1, milliseconds) };
        if ready < 0 {
            let error = io::Error::last_os_error();
            return match error.kind() {
                io::ErrorKind::Interrupted => Ok(Ready::No),
                _ => Err(error),
            };
        }
        if poll.revents & libc::POLLIN != 0 {
            return Ok(Ready::Yes);
        }
        if poll.revents & (libc::POLLERR | libc::POLLHUP | libc::POLLNVAL) != 0 {
            // The driver gives no picture any more; asking for one tells why.
            return match self.dequeue() {
                Err(e) => Err(e),
                Ok(_) => Err(io::Error::other(
                    "the driver reports an error on the camera",
                )),
            };
        }
        Ok(Ready::No)
    }

    /// Takes the oldest filled buffer, `None` when there is none.
    pub fn dequeue(&self) -> io::Result<Option<Filled>> {
        let mut buffer = buffer(0);
        // SAFETY: VIDIOC_DQBUF takes a v4l2_buffer.
        match unsafe { ioctl(&self.handle, vidioc::VIDIOC_DQBUF, &mut buffer) } {
            Ok(()) => {}
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => return Ok(None),
            Err(e) => return Err(e),
        }
        let Some(mapping) = self.mappings.get(buffer.index as usize) else {
            return Err(io::Error::other(
                "the driver returned a buffer that it was never given",
            ));
        };
        let monotonic = buffer.flags & FLAG_TIME_MASK == FLAG_TIME_MONOTONIC;
        let time = buffer.timestamp;
        Ok(Some(Filled {
            index: buffer.index,
            used: (buffer.bytesused as usize).min(mapping.length),
            sequence: buffer.sequence,
            time_ns: (monotonic && time.tv_sec >= 0)
                .then(|| time.tv_sec as u64 * 1_000_000_000 + time.tv_usec.max(0) as u64 * 1000),
            damaged: buffer.flags & FLAG_ERROR != 0,
        }))
    }

    /// The bytes of a filled buffer.
    pub fn bytes<'a>(&'a self, filled: &'a Filled) -> &'a [u8] {
        let mapping = &self.mappings[filled.index as usize];
        // SAFETY: `used <= length` of the mapping, which lives as long as `self`. The driver does not write to a buffer between
        // handing it out and getting it back, and it gets it back by `queue`, which consumes `filled`, borrowed here.
        unsafe { std::slice::from_raw_parts(mapping.start.cast(), filled.used) }
    }

    /// Hands a buffer back to the driver.
    pub fn queue(&self, filled: Filled) -> io::Result<()> {
        self.enqueue(filled.index)
    }

    fn enqueue(&self, index: u32) -> io::Result<()> {
        let mut buffer = buffer(index);
        // SAFETY: VIDIOC_QBUF takes a v4l2_buffer.
        unsafe { ioctl(&self.handle, vidioc::VIDIOC_QBUF, &mut buffer) }
    }

    /// Asks for `count` buffers; 0 gives them back.
    fn request(&self, count: u32) -> io::Result<u32> {
        // SAFETY: integers: all-zero is valid. VIDIOC_REQBUFS takes a v4l2_requestbuffers.
        unsafe {
            let mut request: sys::v4l2_requestbuffers = zeroed();
            request.count = count;
            request.type_ = VIDEO_CAPTURE;
            request.memory = MEMORY_MMAP;
            ioctl(&self.handle, vidioc::VIDIOC_REQBUFS, &mut request)?;
            Ok(request.count)
        }
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        let mut kind = VIDEO_CAPTURE as i32;
        // SAFETY: VIDIOC_STREAMOFF takes an int. A camera that is gone refuses, and there is nothing left to stop.
        let _ = unsafe { ioctl(&self.handle, vidioc::VIDIOC_STREAMOFF, &mut kind) };
        self.mappings.clear();
        let _ = self.request(0);
    }
}

/// A description of one mapped capture buffer.
fn buffer(index: u32) -> sys::v4l2_buffer {
    // SAFETY: integers and unions of integers and pointers: all-zero is valid.
    let mut buffer: sys::v4l2_buffer = unsafe { zeroed() };
    buffer.index = index;
    buffer.type_ = VIDEO_CAPTURE;
    buffer.memory = MEMORY_MMAP;
    buffer
}

//! A running camera: mapped buffers, each either with the driver or in our hands. Pictures are copied out of them: no
//! reference leads into a mapping, since a driver may write to it at any time.

use std::ffi::c_void;
use std::io;
use std::sync::Arc;
use std::time::Duration;

use v4l::device::Handle;
use v4l::v4l_sys as sys;
use v4l::v4l2;
use v4l::v4l2::vidioc;

use super::{Camera, VIDEO_CAPTURE, ioctl, zeroed};

/// `V4L2_MEMORY_MMAP`.
const MEMORY_MMAP: u32 = 1;
/// `V4L2_BUF_FLAG_ERROR`: the driver says that the picture is damaged.
const FLAG_ERROR: u32 = 0x40;
/// `V4L2_BUF_FLAG_TIMESTAMP_MASK`, `V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC`.
const FLAG_TIME_MASK: u32 = 0xE000;
const FLAG_TIME_MONOTONIC: u32 = 0x2000;
/// Buffers that are asked for: one in our hands, one being filled, two ready.
const BUFFERS: u32 = 4;

/// One mapped buffer.
struct Mapping {
    start: *mut c_void,
    length: usize,
}

// SAFETY: the mapping is plain memory that belongs to the process, not to a thread; only its owner reads it.
unsafe impl Send for Mapping {}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: `start..start + length` is exactly what mmap returned, and nothing borrows it: bytes are copied out.
        // A failure would leave the mapping, which is harmless.
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
            // SAFETY: VIDIOC_QUERYBUF takes a v4l2_buffer. For MEMORY_MMAP the member of the union is `offset`. The
            // mapping is new memory at an address of the kernel's choice; `Mapping` owns it from here on.
            unsafe {
                ioctl(&stream.handle, vidioc::VIDIOC_QUERYBUF, &mut buffer)?;
                let length = buffer.length as usize;
                let start = v4l2::mmap(
                    std::ptr::null_mut(),
                    length,
                    // Nothing is written; old drivers (videobuf) map in no other way.
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

    /// How many buffers there are.
    pub fn buffers(&self) -> usize {
        self.mappings.len()
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

    /// Puts the bytes of a filled buffer into `bytes`, in place of what was there. They may be of two pictures: a
    /// program that feeds v4l2loopback writes to buffers without looking who reads.
    pub fn copy(&self, filled: &Filled, bytes: &mut Vec<u8>) {
        let mapping = &self.mappings[filled.index as usize];
        // Of another stream's buffer it may be more.
        let used = filled.used.min(mapping.length);
        bytes.clear();
        bytes.reserve(used);
        // SAFETY: `used <= mapping.length`, by the line above, and `start..start + length` is mapped and readable for
        // as long as `self` lives: `Mapping` unmaps it, and only when the stream drops it. `used <= bytes.capacity()`
        // (`reserve`), in memory of the vector's own, so that both are apart; `0..used` is then initialised. Others may
        // change the mapping meanwhile: raw bytes are copied, of which every value is one, and no reference is made.
        unsafe {
            let from = mapping.start.cast::<u8>().cast_const();
            std::ptr::copy_nonoverlapping(from, bytes.as_mut_ptr(), used);
            bytes.set_len(used);
        }
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

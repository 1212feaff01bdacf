//! The real camera behind [`Live`](super::Live): opening, agreeing on a format, taking the newest picture.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use edgecap_client::place::runtime_dir;

use super::controls;
use super::identity::{Identity, Who};
use super::list::{CameraInfo, list_cameras};
use super::live::{CameraPort, CameraStream};
use super::lock::DeviceLock;
use super::mode::{Mode, candidates, with_room};
use super::options::OpenOptions;
use super::refusal::{refused, unusable};
use super::v4l2::{Camera, Capabilities, Ready, Sizes, Stream};
use crate::camera::monotonic_ns;
use crate::capture::decode::{PictureDecoder, PixelFormat, RawLayout};
use crate::capture::error::{CaptureError, name_of};
use crate::capture::raw::RawPicture;

/// Size that is asked for without a wish: enough for several people at a few metres.
const DEFAULT_SIZE: (u32, u32) = (1280, 720);
/// Rate that is asked for without a wish.
const DEFAULT_FPS: f64 = 30.0;
/// With fewer buffers than these a camera waits for us, not we for it.
const ENOUGH_BUFFERS: usize = 3;
/// How a JPEG picture begins.
const JPEG_START: [u8; 2] = [0xFF, 0xD8];
/// A time stamp further away from now than this is not to be believed.
const MAX_AGE_NS: u64 = 2_000_000_000;

/// A V4L2 device file.
pub struct V4l2Port {
    path: PathBuf,
    name: String,
    options: OpenOptions,
    /// Who was there when it was last opened.
    identity: Identity,
    lock: DeviceLock,
}

impl V4l2Port {
    /// A camera by its device file, with the user's wishes.
    pub fn new(path: &Path, options: &OpenOptions) -> Self {
        Self {
            path: path.to_owned(),
            name: name_of(path),
            options: options.clone(),
            identity: Identity::default(),
            lock: DeviceLock::new(runtime_dir()),
        }
    }

    /// The device file, or the one that the same camera got when it was plugged in again.
    fn find(&self) -> PathBuf {
        let Some(camera) = self.identity.camera().filter(|_| !self.path.exists()) else {
            return self.path.clone();
        };
        let others = list_cameras().unwrap_or_default();
        others
            .into_iter()
            .find(|other| other.is_same_camera(camera))
            .map_or_else(|| self.path.clone(), |other| other.path)
    }

    fn open_device(&self, path: &Path) -> Result<(Camera, Capabilities), CaptureError> {
        let camera = Camera::open(path).map_err(|e| refused(&self.name, e))?;
        let caps = camera.capabilities().map_err(|e| refused(&self.name, e))?;
        Ok((camera, caps))
    }

    /// Opens the device file of the camera that was there before, where that has another one now.
    fn open_same(&mut self) -> Result<(Camera, Capabilities, CameraInfo), CaptureError> {
        let path = self.find();
        // Opening a device that does not answer may wait without end: where another process waits so, or has the
        // camera, this one must not. One that had a camera before looks for it, also at devices that others have.
        if self.identity.camera().is_none() && path.exists() {
            self.lock.hold(&path)?;
        }
        let (camera, caps) = self.open_device(&path)?;
        let here = CameraInfo::new(path, caps.clone());
        let all = || list_cameras().unwrap_or_default();
        match self.identity.compare(&here, all) {
            Who::Same => Ok((camera, caps, here)),
            Who::At(path) => {
                let (camera, caps) = self.open_device(&path)?;
                let found = CameraInfo::new(path, caps.clone());
                match self.identity.compare(&found, Vec::new) {
                    Who::Same => Ok((camera, caps, found)),
                    // Gone again.
                    _ => Err(refused(
                        &self.name,
                        io::Error::from_raw_os_error(libc::ENODEV),
                    )),
                }
            }
            Who::Early(before) => {
                // Another process may have been there before with the camera that is here now.
                self.lock.release();
                Err(CaptureError::Unavailable {
                    what: self.name.clone(),
                    reason: format!(
                        "expected {} at {}, found {} at {}, which is another camera; plug the right one in",
                        before.name, before.bus, here.name, here.bus
                    ),
                })
            }
            Who::Another => Ok((camera, caps, here)),
        }
    }
}

/// Everything that the camera offers in formats that we understand, sizes of ranges fitted to the wish.
fn modes(camera: &Camera, wish: (u32, u32)) -> Vec<Mode> {
    let mut modes = Vec::new();
    for fourcc in camera.formats() {
        let Some(format) = PixelFormat::from_fourcc(fourcc) else {
            continue;
        };
        for (width, height) in fitted(&camera.sizes(fourcc), wish) {
            modes.push(Mode {
                format,
                fourcc,
                width,
                height,
                fps: camera.highest_rate(fourcc, width, height),
            });
        }
    }
    modes
}

/// The sizes that a camera names, of ranges the ones closest to the wish. Of a driver that names none the wish itself
/// is asked for: the driver answers with what it can do.
fn fitted(sizes: &[Sizes], wish: (u32, u32)) -> Vec<(u32, u32)> {
    if sizes.is_empty() {
        return vec![wish];
    }
    let fit = |sizes: &Sizes| match *sizes {
        Sizes::One(w, h) => (w, h),
        Sizes::Range(w, h) => (nearest(w, wish.0), nearest(h, wish.1)),
    };
    sizes.iter().map(fit).collect()
}

/// The value of `smallest..=largest` in steps that is closest to the wish from below.
fn nearest([smallest, largest, step]: [u32; 3], wish: u32) -> u32 {
    let within = wish.clamp(smallest, largest.max(smallest));
    smallest + (within - smallest) / step.max(1) * step.max(1)
}

impl CameraPort for V4l2Port {
    fn open(&mut self) -> Result<Box<dyn CameraStream>, CaptureError> {
        let (camera, caps, info) = self.open_same()?;
        self.lock.hold(&info.path)?;
        let stream = match self.start_closest(&camera, &caps, &info) {
            Ok(stream) => stream,
            Err(e) => {
                // One in another's place that is of no use may be of use to another process.
                if !self.identity.may_be(&info) {
                    self.lock.release();
                }
                return Err(e);
            }
        };
        let here = format!("{} at {}", info.name, info.bus);
        if let Some(before) = self.identity.remember(info) {
            tracing::warn!(
                "{}: another camera is here now, and its pictures are taken: {here} in place of {} at {}",
                self.name,
                before.name,
                before.bus
            );
        }
        Ok(Box::new(stream))
    }

    fn name(&self) -> &str {
        &self.name
    }
}

impl V4l2Port {
    fn wanted_fps(&self) -> f64 {
        self.options.fps.unwrap_or(DEFAULT_FPS)
    }

    /// Starts a camera in the mode closest to what is wished, in a compressed one where there is no room for that.
    fn start_closest(
        &self,
        camera: &Camera,
        caps: &Capabilities,
        info: &CameraInfo,
    ) -> Result<V4l2Stream, CaptureError> {
        if !caps.can_stream {
            let what = if caps.multi_plane {
                "gives multi-plane pictures, which are not supported"
            } else {
                "gives no pictures"
            };
            return Err(unusable(self.name.clone(), what));
        }
        let size = self.options.size.unwrap_or(DEFAULT_SIZE);
        let is_named = self.options.size.is_some();
        let offered = modes(camera, size);
        let candidates = candidates(&offered, size, is_named, self.wanted_fps()).ok_or_else(|| {
            unusable(
                self.name.clone(),
                "offers none of the formats YUYV, UYVY, NV12, YU12, GREY, RGB24, BGR24 and MJPEG",
            )
        })?;
        let started = with_room(candidates, |mode| self.start(camera, info, mode))?;
        started.map_err(|e| refused(&self.name, e))
    }

    /// Agrees on a format and starts; the inner answer is that of starting.
    fn start(
        &self,
        camera: &Camera,
        info: &CameraInfo,
        mode: Mode,
    ) -> Result<io::Result<V4l2Stream>, CaptureError> {
        let agreed = camera
            .set_format(mode.fourcc, mode.width, mode.height)
            .map_err(|e| refused(&self.name, e))?;
        let format = PixelFormat::from_fourcc(agreed.fourcc).ok_or_else(|| {
            unusable(
                self.name.clone(),
                "insists on a format other than YUYV, UYVY, NV12, YU12, GREY, RGB24, BGR24 and MJPEG",
            )
        })?;
        let decoder = PictureDecoder::new(RawLayout {
            format,
            width: agreed.width,
            height: agreed.height,
            stride: agreed.stride,
            matrix: agreed.matrix,
            range: agreed.range,
        })
        .map_err(|reason| CaptureError::data(self.name.clone(), reason))?;
        let fps = camera.set_rate(self.wanted_fps());
        controls::apply(camera, &self.name, &self.options.controls)?;
        let stream = match Stream::start(camera) {
            Ok(stream) => stream,
            Err(e) => return Ok(Err(e)),
        };
        tracing::info!(
            "{}: {} ({}), {}x{} {}",
            info.path.display(),
            info.name,
            info.driver,
            agreed.width,
            agreed.height,
            in_words(agreed.fourcc, fps),
        );
        Ok(Ok(V4l2Stream {
            stream,
            layout: decoder.layout(),
            needed: decoder.needed_bytes(),
            fps,
            damaged: 0,
        }))
    }
}

/// `MJPG at 30 fps`.
fn in_words(fourcc: [u8; 4], fps: Option<f64>) -> String {
    let fps = fps.map_or("unknown".into(), |fps| format!("{fps:.1}"));
    let code = String::from_utf8_lossy(&fourcc);
    format!("{code} at {} fps", fps.trim_end_matches(".0"))
}

/// A running V4L2 camera.
struct V4l2Stream {
    stream: Stream,
    layout: RawLayout,
    /// Bytes of a whole picture.
    needed: usize,
    fps: Option<f64>,
    /// Pictures left out because they were damaged.
    damaged: u64,
}

/// A picture that the camera gave.
struct Taken {
    /// The camera's count of it.
    sequence: u32,
    /// CLOCK_MONOTONIC nanoseconds, `None` when the driver stamps something else.
    time_ns: Option<u64>,
}

impl V4l2Stream {
    /// Whether these are the bytes of a picture.
    fn is_whole(&self, bytes: &[u8]) -> bool {
        bytes.len() >= self.needed
            && (self.layout.format != PixelFormat::Mjpeg || bytes.starts_with(&JPEG_START))
    }

    /// Takes every picture that is ready and hands its buffer back; `bytes` are those of the newest whole one, which is
    /// returned. After `None` they hold nothing useful.
    fn take_newest(&mut self, bytes: &mut Vec<u8>) -> io::Result<Option<Taken>> {
        let mut ready = Vec::new();
        while let Some(filled) = self.stream.dequeue()? {
            ready.push(filled);
        }
        // Where all buffers were full the camera had nowhere to put what came after: these pictures are old.
        let mut is_wanted = ready.len() < self.stream.buffers().max(ENOUGH_BUFFERS);
        let mut newest = None;
        for filled in ready.into_iter().rev() {
            if is_wanted {
                // Looked at once they are copied: in the buffer they may change.
                self.stream.copy(&filled, bytes);
                if !filled.damaged && self.is_whole(bytes) {
                    is_wanted = false;
                    newest = Some(Taken {
                        sequence: filled.sequence,
                        time_ns: filled.time_ns,
                    });
                } else {
                    self.damaged += 1;
                    tracing::debug!("damaged picture left out, {} so far", self.damaged);
                }
            }
            self.stream.queue(filled)?;
        }
        Ok(newest)
    }
}

impl CameraStream for V4l2Stream {
    fn newest(&mut self, timeout: Duration, raw: &mut RawPicture) -> io::Result<Option<u32>> {
        let deadline = Instant::now() + timeout;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if self.stream.wait(left)? == Ready::No {
                return Ok(None);
            }
            let Some(taken) = self.take_newest(&mut raw.bytes)? else {
                if left.is_zero() {
                    return Ok(None);
                }
                continue;
            };
            let now = monotonic_ns();
            raw.time_ns = taken
                .time_ns
                .filter(|t| t.abs_diff(now) < MAX_AGE_NS)
                // Some drivers stamp the end of a picture that they still expect.
                .map_or(now, |t| t.min(now));
            raw.layout = self.layout;
            raw.strict = false;
            return Ok(Some(taken.sequence));
        }
    }

    fn fps(&self) -> Option<f64> {
        self.fps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_driver_that_names_no_sizes_is_asked_for_the_wish() {
        let wish = (1280, 720);
        assert_eq!(fitted(&[], wish), [wish]);
        let range = Sizes::Range([16, 640, 16], [16, 4096, 32]);
        let sizes = [Sizes::One(320, 240), range];
        assert_eq!(fitted(&sizes, wish), [(320, 240), (640, 720)]);
    }

    #[test]
    fn a_device_that_another_process_has_is_not_opened() {
        let folder = tempfile::tempdir().unwrap();
        let device = folder.path().join("video0");
        std::fs::write(&device, "no camera").unwrap();
        let lock = || DeviceLock::new(folder.path());
        let mut port = V4l2Port {
            lock: lock(),
            ..V4l2Port::new(&device, &OpenOptions::default())
        };
        let mut code = || port.open().map(drop).unwrap_err().exit_code();
        let mut other = lock();
        other.hold(&device).unwrap();
        assert_eq!(code(), 75);
        other.release();
        assert_ne!(code(), 75, "it was opened");
    }

    #[test]
    fn what_was_agreed_is_said_as_the_book_has_it() {
        assert_eq!(in_words(*b"MJPG", Some(30.0)), "MJPG at 30 fps");
        assert_eq!(in_words(*b"YUYV", Some(29.97)), "YUYV at 30 fps");
        assert_eq!(in_words(*b"YUYV", Some(7.5)), "YUYV at 7.5 fps");
        assert_eq!(in_words(*b"GREY", None), "GREY at unknown fps");
    }
}

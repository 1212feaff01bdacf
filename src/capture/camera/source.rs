//! A camera as a [`Source`].

use std::path::Path;

use super::list::list_cameras;
use super::live::{CameraPort, Live, Step};
use super::options::OpenOptions;
use super::port::V4l2Port;
use crate::camera::{Clock, SystemClock};
use crate::capture::error::CaptureError;
use crate::capture::frame::Frame;
use crate::capture::raw::{RawDecoder, RawPicture};
use crate::capture::source::Source;

/// A camera that is reopened when it goes away.
pub struct CameraSource<P = V4l2Port, C = SystemClock> {
    live: Live<P, C>,
    name: String,
    /// For who wants the pictures decoded.
    raw: RawPicture,
    decoder: RawDecoder,
}

impl CameraSource {
    /// Opens a camera by its device file, or the first one there is that is of use and not in use.
    ///
    /// # Errors
    /// [`CaptureError::Unavailable`] without a camera, [`CaptureError::Busy`] when it is in use,
    /// [`CaptureError::Permission`] when this user may not open it.
    pub fn open(path: Option<&Path>, options: &OpenOptions) -> Result<Self, CaptureError> {
        let Some(path) = path else {
            let paths = list_cameras()?.into_iter().map(|camera| camera.path);
            return first(paths, |path| Self::open_path(&path, options));
        };
        Self::open_path(path, options)
    }

    fn open_path(path: &Path, options: &OpenOptions) -> Result<Self, CaptureError> {
        let live = Live::new(V4l2Port::new(path, options), SystemClock)?;
        Ok(Self::new(live))
    }
}

/// The first that opens; else why the first of them did not. One that is in use, or of no use, is not all there is.
fn first<P, T>(
    paths: impl IntoIterator<Item = P>,
    mut open: impl FnMut(P) -> Result<T, CaptureError>,
) -> Result<T, CaptureError> {
    let mut refusal = None;
    for path in paths {
        match open(path) {
            Err(e) if e.may_pass() => refusal = refusal.or(Some(e)),
            other => return other,
        }
    }
    // The list is never empty, so that without a camera there is a refusal.
    Err(refusal.unwrap_or(CaptureError::Unavailable {
        what: "camera".into(),
        reason: "no camera found; plug one in".into(),
    }))
}

impl<P: CameraPort, C: Clock> CameraSource<P, C> {
    /// Around a state machine.
    pub fn new(live: Live<P, C>) -> Self {
        Self {
            name: live.name().to_owned(),
            live,
            raw: RawPicture::default(),
            decoder: RawDecoder::default(),
        }
    }

    /// Whether the camera is there, as far as is known.
    pub fn is_streaming(&self) -> bool {
        self.live.is_streaming()
    }
}

impl<P: CameraPort, C: Clock> Source for CameraSource<P, C> {
    /// Waits at most about a quarter of a second; then [`CaptureError::NoPictureYet`], which is skippable.
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError> {
        let mut raw = std::mem::take(&mut self.raw);
        let decoded = self.next_raw(&mut raw).and_then(|more| {
            let drawn = self.decoder.decode(&mut raw, frame);
            self.judged(drawn.as_ref().err().map(String::as_str));
            drawn.map_err(|reason| CaptureError::Picture {
                input: self.name.clone(),
                reason,
            })?;
            Ok(more)
        });
        self.raw = raw;
        decoded
    }

    /// As [`next_into`](Self::next_into).
    fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
        match self.live.step(raw) {
            Step::Picture => Ok(true),
            Step::Waiting(reason) => Err(CaptureError::NoPictureYet {
                device: self.name.clone(),
                reason,
                is_away: self.live.is_away(),
            }),
        }
    }

    fn judged(&mut self, failure: Option<&str>) {
        self.live.judged(failure);
    }

    fn fps(&self) -> Option<f64> {
        self.live.fps()
    }

    fn is_live(&self) -> bool {
        true
    }

    fn name(&self) -> &str {
        &self.name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_cameras_that_cannot_be_used_the_first_is_named_and_the_next_is_taken() {
        let open = |name: &str| match name {
            "busy" => Err(CaptureError::Busy {
                device: name.into(),
                reason: String::new(),
            }),
            "infrared" => Err(CaptureError::Unavailable {
                what: name.into(),
                reason: String::new(),
            }),
            "wrong" => Err(CaptureError::Config {
                setting: name.into(),
                reason: String::new(),
            }),
            other => Ok(other.to_owned()),
        };
        let taken = first(["infrared", "busy", "webcam", "other"], open);
        assert_eq!(taken.unwrap(), "webcam");
        let refused = first(["infrared", "busy"], open).unwrap_err();
        assert!(refused.to_string().contains("infrared"), "{refused}");
        assert_eq!(
            first(["wrong", "webcam"], open).unwrap_err().exit_code(),
            78
        );
    }
}

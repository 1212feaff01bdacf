//! Pictures for whoever asked to look at them, made small and published, as a sink. Nothing makes one unless the user
//! has said `--show-picture`: it is the only way on which a picture leaves the process that sees it.

use std::time::{Duration, Instant};

use edgecap_client::LinkError;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageBuffer, Rgb};

use super::{Packet, SharedMemorySink, Sink, SinkError};
use crate::capture::Frame;
use crate::message::{BodyFrame, MAX_PICTURE, ObservationFrame, PictureFrame};

/// Most pixels across and down: enough to see who is who.
const MOST: [u32; 2] = [480, 360];
/// Of JPEG; where a picture is too large for a message, the next one is tried.
const QUALITIES: [u8; 4] = [70, 45, 25, 10];
/// Pictures do not come faster.
const EVERY: Duration = Duration::from_millis(90);

/// Publishes what the camera sees.
#[derive(Debug)]
pub struct PictureSink {
    stream: Box<SharedMemorySink<PictureFrame>>,
    message: Box<PictureFrame>,
    last: Option<Instant>,
}

impl PictureSink {
    /// Becomes the writer of `camera`'s pictures, and says so: people are in them.
    ///
    /// # Errors
    /// As those of shared memory.
    pub fn open(camera: &str) -> Result<Self, LinkError> {
        let stream = SharedMemorySink::open(camera)?;
        tracing::warn!(
            "--show-picture: pictures of {camera}, and whoever is in them, are published in shared memory for 'edgecap view'"
        );
        Ok(Self {
            stream: Box::new(stream),
            message: Box::default(),
            last: None,
        })
    }

    fn look(
        &mut self,
        picture: Option<&Frame>,
        (sequence, capture_ns, flags): (u64, u64, u32),
    ) -> Result<(), SinkError> {
        let Some(picture) = picture else {
            return Ok(());
        };
        if self.last.is_some_and(|last| last.elapsed() < EVERY) || !pack(picture, &mut self.message)
        {
            return Ok(());
        }
        self.last = Some(Instant::now());
        let message = &mut *self.message;
        (message.sequence, message.capture_ns, message.flags) = (sequence, capture_ns, flags);
        self.publish()
    }

    fn publish(&mut self) -> Result<(), SinkError> {
        self.stream.take(&Packet {
            message: &*self.message,
            source: "",
            picture: None,
        })
    }

    /// Publishes that there is nothing to be seen, where a picture was the last.
    fn blank(&mut self) {
        if self.message.count > 0 {
            self.message.count = 0;
            self.message.jpeg.fill(0);
            self.last = None;
            // Where it cannot be said, the next picture tells.
            let _ = self.publish();
        }
    }
}

/// Makes a picture small; `false` where it fits in no message.
fn pack(picture: &Frame, message: &mut PictureFrame) -> bool {
    let (width, height) = (picture.width, picture.height);
    if width == 0 || height == 0 {
        return false;
    }
    let Some(whole) = ImageBuffer::<Rgb<u8>, _>::from_raw(width, height, &picture.rgb[..]) else {
        return false;
    };
    let scale = |most: u32, of: u32| f64::from(most) / f64::from(of.max(1));
    let scale = scale(MOST[0], width).min(scale(MOST[1], height)).min(1.0);
    let [w, h] = [width, height].map(|n| ((f64::from(n) * scale).round() as u32).max(1));
    let small = image::imageops::thumbnail(&whole, w, h);
    for quality in QUALITIES {
        let mut jpeg = Vec::with_capacity(MAX_PICTURE);
        let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, quality);
        let encoded = encoder.encode(&small, w, h, ExtendedColorType::Rgb8);
        if encoded.is_ok() && jpeg.len() <= MAX_PICTURE {
            (message.width, message.height) = (w, h);
            message.count = jpeg.len() as u32;
            message.jpeg[..jpeg.len()].copy_from_slice(&jpeg);
            return true;
        }
    }
    false
}

impl Sink<ObservationFrame> for PictureSink {
    fn take(&mut self, packet: &Packet<'_, ObservationFrame>) -> Result<(), SinkError> {
        let m = packet.message;
        self.look(packet.picture, (m.sequence, m.capture_ns, m.flags))
    }

    fn quiet(&mut self) {
        self.blank();
    }

    fn end(&mut self) -> Result<(), SinkError> {
        self.stream.end()
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        self.stream.finish()
    }
}

impl Sink<BodyFrame> for PictureSink {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        let m = packet.message;
        self.look(packet.picture, (m.sequence, m.capture_ns, m.flags))
    }

    fn quiet(&mut self) {
        self.blank();
    }

    fn end(&mut self) -> Result<(), SinkError> {
        self.stream.end()
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        self.stream.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width: u32, height: u32) -> Frame {
        let mut state = 1_u32;
        let value = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        Frame {
            width,
            height,
            rgb: std::iter::repeat_with(value)
                .take((width * height * 3) as usize)
                .collect(),
            ..Frame::default()
        }
    }

    #[test]
    fn any_picture_fits_in_a_message_and_keeps_its_shape() {
        for (width, height, wanted) in [
            (1280, 720, (480, 270)),
            (720, 1280, (203, 360)),
            (160, 120, (160, 120)),
            (4000, 2, (480, 1)),
        ] {
            let mut message = PictureFrame::default();
            assert!(
                pack(&noise(width, height), &mut message),
                "{width}x{height}"
            );
            assert_eq!((message.width, message.height), wanted);
            let read = image::load_from_memory(message.jpeg()).unwrap();
            assert_eq!((read.width(), read.height()), wanted);
        }
        assert!(!pack(&Frame::default(), &mut PictureFrame::default()));
    }
}

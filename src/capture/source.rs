//! What every input looks like to the rest: pictures, one after the other.

use super::error::CaptureError;
use super::frame::Frame;
use super::rate::Rate;
use super::raw::RawPicture;

/// An input that gives pictures.
pub trait Source: Send {
    /// Overwrites `frame` with the next picture, its buffer reused. `Ok(false)`: the input has ended, `frame` is as it
    /// was.
    ///
    /// # Errors
    /// A [skippable](CaptureError::is_skippable) error concerns this one picture: the next call goes on after it. After
    /// any other error the source has ended. `frame` then holds nothing useful.
    fn next_into(&mut self, frame: &mut Frame) -> Result<bool, CaptureError>;

    /// The next picture in a buffer of its own, `None` at the end.
    ///
    /// # Errors
    /// As [`next_into`](Self::next_into).
    fn next(&mut self) -> Result<Option<Frame>, CaptureError> {
        let mut frame = Frame::default();
        Ok(self.next_into(&mut frame)?.then_some(frame))
    }

    /// Overwrites `raw` with the next picture, not decoded where that can be put off: who then leaves it out has not
    /// paid for it. Otherwise as [`next_into`](Self::next_into).
    ///
    /// # Errors
    /// As [`next_into`](Self::next_into).
    fn next_raw(&mut self, raw: &mut RawPicture) -> Result<bool, CaptureError> {
        let mut frame = Frame {
            rgb: std::mem::take(&mut raw.bytes),
            ..Frame::default()
        };
        let more = self.next_into(&mut frame)?;
        if more {
            raw.take_over(&mut frame);
        }
        Ok(more)
    }

    /// Begins anew with the first picture, without asking again what the input is; `false` where it has to be opened
    /// for that.
    ///
    /// # Errors
    /// Those of opening it.
    fn rewind(&mut self) -> Result<bool, CaptureError> {
        Ok(false)
    }

    /// Hears whether the picture that [`next_raw`](Self::next_raw) gave last could be decoded, or why not. A camera
    /// that sends nothing that can be is opened again.
    fn judged(&mut self, _failure: Option<&str>) {}

    /// How many pictures the whole input has, if that is known: for progress bars, not for allocation.
    fn frame_count(&self) -> Option<u64> {
        None
    }

    /// Pictures per second at which the input was taken, if it is a sequence in time.
    fn fps(&self) -> Option<f64> {
        None
    }

    /// [`fps`](Self::fps) for who asks before the first picture and needs it afterwards.
    fn rate(&self) -> Rate {
        self.fps().into()
    }

    /// Whether pictures are lost when nobody asks for them.
    fn is_live(&self) -> bool {
        false
    }

    /// Whether the pictures have nothing to do with each other in time: a photo, or photos without a rate.
    fn is_stills(&self) -> bool {
        false
    }

    /// What the user pointed at.
    fn name(&self) -> &str;

    /// Where the newest picture comes from: its file in a folder of photos, else [`name`](Self::name).
    fn picture(&self) -> String {
        self.name().to_owned()
    }
}

//! A source's pictures go in, [`ObservationFrame`]s come out.

use edgecap_client::message::{FLAG_FILE_TIME, MAX_PEOPLE, ObservationFrame};

use super::engine_args::{EngineArgs, InputSize};
use super::pipelines::Pipelines;
use crate::camera::{CameraFile, monotonic_ns};
use crate::capture::{CaptureError, Frame, Source};
use crate::commands::exit::Failure;

/// A source, its lens and the stages.
pub struct Observer<'a> {
    source: Box<dyn Source>,
    camera: CameraFile,
    pipelines: Pipelines<'a>,
    picture: Frame,
}

/// What a step brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// A picture, observed.
    Observed,
    /// None at the moment.
    Nothing,
    /// There are no more.
    Ended,
}

impl<'a> Observer<'a> {
    /// Builds the stages.
    ///
    /// # Errors
    /// As [`Pipelines::new`]; a size that follows people needs pictures that follow each other.
    pub fn new(
        source: Box<dyn Source>,
        camera: CameraFile,
        engine: &'a EngineArgs,
    ) -> anyhow::Result<Self> {
        if engine.size == Some(InputSize::Auto) && source.is_stills() {
            return Err(Failure::usage(
                "--size auto follows people from picture to picture: expected a film, a camera or a folder of its frames with --fps, found photos: give --size WxH",
            )
            .into());
        }
        Ok(Self {
            pipelines: Pipelines::new(engine, !source.is_stills())?,
            source,
            camera,
            picture: Frame::default(),
        })
    }

    /// The picture observed last.
    pub fn picture(&self) -> &Frame {
        &self.picture
    }

    /// Where it comes from.
    pub fn picture_name(&self) -> String {
        self.source.picture()
    }

    /// Observes the next picture. Damaged ones among many are skipped.
    ///
    /// # Errors
    /// When the source has ended in the middle, when the lens does not fit the picture; what was observed before stands.
    pub fn step(&mut self, message: &mut ObservationFrame) -> anyhow::Result<Step> {
        match self.source.next_into(&mut self.picture) {
            Ok(true) => {}
            Ok(false) => return Ok(Step::Ended),
            // The source has logged what is wrong and looks for the camera again.
            Err(CaptureError::NoPictureYet { .. }) => return Ok(Step::Nothing),
            Err(e) if e.is_skippable() => {
                tracing::warn!("{e}; skipped");
                return Ok(Step::Nothing);
            }
            Err(e) => return Err(e.into()),
        }
        let picture = &self.picture;
        let intrinsics = self
            .camera
            .for_frame(picture.width, picture.height)
            .map_err(Failure::config)?;
        let seen = self.pipelines.process(picture, &intrinsics)?;
        message.sequence = picture.sequence;
        message.capture_ns = picture.time_ns;
        message.width = picture.width;
        message.height = picture.height;
        message.intrinsics = intrinsics;
        message.stage_times = seen.times;
        message.flags = if self.source.is_live() {
            0
        } else {
            FLAG_FILE_TIME
        };
        message.without_neck = seen.without_neck;
        let total = self.source.frame_count().unwrap_or(0);
        message.frame_total = u32::try_from(total).unwrap_or(u32::MAX);
        message.count = seen.people.len().min(MAX_PEOPLE) as u32;
        for (slot, o) in message.people.iter_mut().zip(seen.people) {
            *slot = *o;
        }
        message.publish_ns = monotonic_ns();
        Ok(Step::Observed)
    }
}

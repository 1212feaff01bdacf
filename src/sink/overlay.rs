//! Pictures with the skeletons drawn, as a sink.

use std::path::{Path, PathBuf};

use super::{Packet, Sink, SinkError};
use crate::capture::Frame;
use crate::message::{BodyFrame, ObservationFrame};
use crate::overlay::{Person, draw, write_png};

/// Writes `<folder>/<frame>.png` for every result that comes with its picture.
#[derive(Debug)]
pub struct OverlaySink {
    folder: PathBuf,
    canvas: Frame,
    written: u64,
}

impl OverlaySink {
    /// Makes the folder.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn create(folder: &Path) -> Result<Self, SinkError> {
        std::fs::create_dir_all(folder).map_err(|cause| SinkError::Create {
            path: folder.to_owned(),
            cause,
        })?;
        Ok(Self {
            folder: folder.to_owned(),
            canvas: Frame::default(),
            written: 0,
        })
    }

    fn write<P: Person>(
        &mut self,
        picture: Option<&Frame>,
        sequence: u64,
        people: &[P],
    ) -> Result<(), SinkError> {
        let Some(picture) = picture else {
            return Ok(());
        };
        self.canvas.clone_from(picture);
        draw(&mut self.canvas, people);
        write_png(
            &self.canvas,
            &self.folder.join(format!("{sequence:06}.png")),
        )?;
        self.written += 1;
        Ok(())
    }

    fn words(&self) -> Option<String> {
        Some(format!(
            "{} pictures → {}",
            self.written,
            self.folder.display()
        ))
    }
}

impl Sink<ObservationFrame> for OverlaySink {
    fn take(&mut self, packet: &Packet<'_, ObservationFrame>) -> Result<(), SinkError> {
        let message = packet.message;
        self.write(packet.picture, message.sequence, message.people())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        Ok(self.words())
    }
}

impl Sink<BodyFrame> for OverlaySink {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        let message = packet.message;
        self.write(packet.picture, message.sequence, message.bodies())
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        Ok(self.words())
    }
}

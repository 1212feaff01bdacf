//! A record as a sink.

use std::path::{Path, PathBuf};

use super::{Packet, Sink, SinkError};
use crate::record::{Format, RecordWriter, Row};

/// Writes every result to a file.
#[derive(Debug)]
pub struct RecordSink<T>(RecordWriter<T>);

impl<T: Row> RecordSink<T> {
    /// Starts a record at `path`; `-` is standard output.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn create(path: &Path, format: Format) -> Result<Self, SinkError> {
        RecordWriter::create(path, format)
            .map(Self)
            .map_err(|cause| SinkError::Create {
                path: path.to_owned(),
                cause,
            })
    }
}

impl<T: Row> Sink<T::Message> for RecordSink<T> {
    fn take(&mut self, packet: &Packet<'_, T::Message>) -> Result<(), SinkError> {
        let written = self.0.write(packet.message, packet.source);
        written.map_err(|e| failed(self.0.path().to_owned(), e))
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        let path = self.0.path().to_owned();
        let is_file = path.as_os_str() != crate::output::STDOUT;
        let said = is_file.then(|| format!("→ {}", path.display()));
        self.0.finish().map_err(|e| failed(path, e))?;
        Ok(said)
    }
}

fn failed(path: PathBuf, cause: std::io::Error) -> SinkError {
    SinkError::Write { path, cause }
}

//! A record as a sink.

use std::path::{Path, PathBuf};

use super::{Packet, Sink, SinkError};
use crate::record::{Format, RecordWriter, Row};

/// Writes every result to a file.
#[derive(Debug)]
pub struct RecordSink<T> {
    writer: RecordWriter<T>,
    says: bool,
}

impl<T: Row> RecordSink<T> {
    /// Starts a record at `path`; `-` is standard output.
    ///
    /// # Errors
    /// [`SinkError::Create`].
    pub fn create(path: &Path, format: Format) -> Result<Self, SinkError> {
        let writer = RecordWriter::create(path, format).map_err(|cause| SinkError::Create {
            path: path.to_owned(),
            cause,
        })?;
        Ok(Self { writer, says: true })
    }

    /// The same for an input without an end, as [`RecordWriter::growing`].
    #[must_use]
    pub fn growing(self) -> Self {
        Self {
            writer: self.writer.growing(),
            ..self
        }
    }

    /// The same, of which the user is not told: it is a step on the way.
    #[must_use]
    pub fn untold(self) -> Self {
        Self {
            says: false,
            ..self
        }
    }
}

impl<T: Row> RecordSink<T> {
    /// Takes a result whose row is made already, which then has left this process.
    pub(super) fn take_row(&mut self, row: &[u8]) -> Result<(), SinkError> {
        let written = self.writer.put(row).and_then(|()| self.writer.flush());
        written.map_err(|e| self.failure(e))
    }

    /// After a failure: whether it can be tried again with this file.
    pub(super) fn go_back(&mut self) -> bool {
        self.writer.go_back().unwrap_or(false)
    }

    fn failure(&self, cause: std::io::Error) -> SinkError {
        let keeps = self.writer.keeps_anything();
        failed(self.writer.path().to_owned(), keeps, cause)
    }
}

impl<T: Row> Sink<T::Message> for RecordSink<T> {
    fn take(&mut self, packet: &Packet<'_, T::Message>) -> Result<(), SinkError> {
        let written = self.writer.write(packet.message, packet.source);
        written.map_err(|e| self.failure(e))
    }

    fn break_off(&mut self) {
        self.writer.break_off();
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        let path = self.writer.path().to_owned();
        let is_told = self.says && !crate::output::is_stdout(&path);
        let keeps = self.writer.keeps_anything();
        let there = self.writer.finish().map_err(|e| failed(path, keeps, e))?;
        let there = there.filter(|_| is_told);
        Ok(there.map(|path| format!("→ {}", path.display())))
    }
}

fn failed(path: PathBuf, keeps: bool, cause: std::io::Error) -> SinkError {
    match keeps {
        true => SinkError::Write { path, cause },
        false => SinkError::Lost { path, cause },
    }
}

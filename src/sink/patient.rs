//! A record of what goes on without it: where its disk is full, results go everywhere else, and it is tried again.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::{Packet, RecordSink, Sink, SinkError};
use crate::record::{Format, Row};

/// How often a record that failed is tried again.
const AGAIN: Duration = Duration::from_secs(60);

/// Writes every result to a file that grows under its name, as long as it can.
#[derive(Debug)]
pub struct PatientRecord<T> {
    path: PathBuf,
    format: Format,
    /// `None` where it has to be begun.
    record: Option<RecordSink<T>>,
    /// Why it cannot be written, and when it is tried again.
    failed: Option<(SinkError, Instant)>,
}

impl<T: Row> PatientRecord<T> {
    /// Starts a record at `path`. A full disk is waited for.
    ///
    /// # Errors
    /// [`SinkError::Create`] for a place that cannot be one.
    pub fn create(path: &Path, format: Format) -> Result<Self, SinkError> {
        let mut this = Self {
            path: path.to_owned(),
            format,
            record: None,
            failed: None,
        };
        match this.begin() {
            Err(e @ SinkError::Create { .. }) if is_full(&e) => this.fails(Instant::now(), e),
            begun => begun?,
        }
        Ok(this)
    }

    fn begin(&mut self) -> Result<(), SinkError> {
        self.record = Some(RecordSink::create(&self.path, self.format)?.growing());
        Ok(())
    }

    fn take_at(&mut self, now: Instant, packet: &Packet<'_, T::Message>) {
        if self.failed.as_ref().is_some_and(|(_, next)| now < *next) {
            return;
        }
        match self.write(packet) {
            Ok(()) if self.failed.take().is_some() => {
                tracing::warn!("{}: is recorded again", self.path.display());
            }
            Ok(()) => {}
            Err(e) => self.fails(now, e),
        }
    }

    fn write(&mut self, packet: &Packet<'_, T::Message>) -> Result<(), SinkError> {
        if self.record.is_none() {
            self.begin()?;
        }
        match &mut self.record {
            Some(record) => record.take_at_once(packet),
            None => Ok(()),
        }
    }

    fn fails(&mut self, now: Instant, why: SinkError) {
        if self.failed.is_none() {
            tracing::warn!("{why}; everything else goes on, and it is tried again every minute");
        }
        self.failed = Some((why, now + AGAIN));
        // One that nobody can find any more takes room.
        if !self.record.as_mut().is_some_and(RecordSink::go_back) {
            self.record = None;
        }
    }
}

fn is_full(error: &SinkError) -> bool {
    let full = [ErrorKind::StorageFull, ErrorKind::QuotaExceeded];
    matches!(error, SinkError::Create { cause, .. } if full.contains(&cause.kind()))
}

impl<T: Row> Sink<T::Message> for PatientRecord<T> {
    fn take(&mut self, packet: &Packet<'_, T::Message>) -> Result<(), SinkError> {
        self.take_at(Instant::now(), packet);
        Ok(())
    }

    fn break_off(&mut self) {
        if let Some(record) = &mut self.record {
            record.break_off();
        }
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        let said = self.record.map_or(Ok(None), |r| Box::new(r).finish());
        match self.failed {
            Some((why, _)) => Err(why),
            None => said,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::message::BodyFrame;
    use crate::record::BodiesRow;

    /// A folder that is away stands in for a full disk: the record cannot get its name there.
    #[test]
    fn a_record_that_fails_is_tried_again_after_a_minute_and_nothing_else_ends() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("disk");
        let path = place.join("hall.jsonl");
        fs::create_dir(&place).unwrap();
        let mut record = PatientRecord::<BodiesRow>::create(&path, Format::Jsonl).unwrap();
        fs::remove_dir_all(&place).unwrap();
        // No folder can be made there.
        fs::write(&place, "").unwrap();
        let message = BodyFrame::default();
        let packet = Packet {
            message: &message,
            source: "",
            picture: None,
        };
        let start = Instant::now();
        record.take_at(start, &packet);
        assert!(record.failed.is_some());
        fs::remove_file(&place).unwrap();
        record.take_at(start + AGAIN / 2, &packet);
        assert!(!path.exists(), "not yet");
        record.take_at(start + AGAIN, &packet);
        record.take_at(start + AGAIN, &packet);
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 2);
        assert!(Box::new(record).finish().unwrap().is_some());
    }

    #[test]
    fn at_the_end_it_is_said_that_a_record_is_not_whole() {
        let full = Path::new("/dev/full");
        let mut record = PatientRecord::<BodiesRow>::create(full, Format::Jsonl).unwrap();
        let message = BodyFrame::default();
        let taken = record.take(&Packet {
            message: &message,
            source: "",
            picture: None,
        });
        assert!(taken.is_ok());
        assert!(Box::new(record).finish().is_err());
    }
}

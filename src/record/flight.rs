//! The last minute of a stream in memory, to be written when somebody asks or something has gone wrong.

use std::collections::VecDeque;
use std::io;
use std::marker::PhantomData;
use std::path::Path;
use std::time::{Duration, Instant};

use super::rows::Row;
use super::writer::{Format, encode, head};
use crate::output;

/// What is kept.
pub const KEPT: Duration = Duration::from_secs(60);
/// Most bytes of it, whatever the time: a minute of ten people at 30 Hz takes a quarter.
const MOST_BYTES: usize = 64 << 20;

/// Rows of the last minute, encoded.
#[derive(Debug)]
pub struct FlightRecorder<T> {
    frames: VecDeque<(Instant, Vec<u8>)>,
    bytes: usize,
    rows: PhantomData<T>,
}

impl<T> Default for FlightRecorder<T> {
    fn default() -> Self {
        Self {
            frames: VecDeque::new(),
            bytes: 0,
            rows: PhantomData,
        }
    }
}

impl<T: Row> FlightRecorder<T> {
    /// Adds a frame that came `now`, and forgets what is too old.
    ///
    /// # Errors
    /// If the frame cannot be encoded.
    pub fn add(&mut self, now: Instant, message: &T::Message, source: &str) -> io::Result<()> {
        let mut bytes = Vec::new();
        encode(&T::new(message, source), Format::Binary, &mut bytes)?;
        self.bytes += bytes.len();
        self.frames.push_back((now, bytes));
        while let Some((at, oldest)) = self.frames.front()
            && (now - *at > KEPT || self.bytes > MOST_BYTES)
        {
            self.bytes -= oldest.len();
            self.frames.pop_front();
        }
        Ok(())
    }

    /// Frames that are kept.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Writes what is kept as a binary record; it stays kept.
    ///
    /// # Errors
    /// Those of the file.
    pub fn save(&self, path: &Path) -> io::Result<()> {
        let mut bytes = head::<T>(Format::Binary);
        bytes.reserve(self.bytes);
        for (_, frame) in &self.frames {
            bytes.extend(frame);
        }
        output::write(path, &bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::BodyFrame;
    use crate::record::{BodiesRow, RowReader};

    #[test]
    fn the_last_minute_is_kept_and_saved() {
        let mut flight = FlightRecorder::<BodiesRow>::default();
        let began = Instant::now();
        for second in 0..100 {
            let frame = BodyFrame {
                sequence: second,
                ..BodyFrame::default()
            };
            let now = began + Duration::from_secs(second);
            flight.add(now, &frame, "").unwrap();
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.record");
        flight.save(&path).unwrap();
        let bytes = std::fs::read(path).unwrap();
        let mut reader = RowReader::<_, BodiesRow>::new(&bytes[..], "flight");
        let mut numbers = Vec::new();
        while let Some(row) = reader.read().unwrap() {
            numbers.push(row.frame);
        }
        assert_eq!(numbers, (39..100).collect::<Vec<_>>());
        assert_eq!(flight.len(), 61);
    }
}

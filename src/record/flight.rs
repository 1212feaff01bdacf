//! The last minute of a stream in memory, to be written when somebody asks or something has gone wrong.

use std::collections::VecDeque;
use std::io;
use std::marker::PhantomData;
use std::time::{Duration, Instant};

use super::rows::Row;
use super::writer::{Format, encode, head};

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
            && (is_old(*at, now) || self.bytes > MOST_BYTES)
        {
            self.bytes -= oldest.len();
            self.frames.pop_front();
        }
        Ok(())
    }

    /// The frames of the last minute before `now` as a binary record, if there are any. They stay kept.
    pub fn minute(&self, now: Instant) -> Option<Vec<u8>> {
        // Only frames that come drive others out.
        let is_there = |(at, _): &&(Instant, Vec<u8>)| !is_old(*at, now);
        let mut frames = self.frames.iter().filter(is_there).peekable();
        frames.peek()?;
        let mut bytes = head::<T>(Format::Binary);
        bytes.reserve(self.bytes);
        bytes.extend(frames.flat_map(|(_, frame)| frame));
        Some(bytes)
    }
}

fn is_old(at: Instant, now: Instant) -> bool {
    now.saturating_duration_since(at) > KEPT
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::BodyFrame;
    use crate::record::{BodiesRow, RowReader};

    /// A frame a second for 100 s.
    fn flight(began: Instant) -> FlightRecorder<BodiesRow> {
        let mut flight = FlightRecorder::default();
        for second in 0..100 {
            let frame = BodyFrame {
                sequence: second,
                ..BodyFrame::default()
            };
            let now = began + Duration::from_secs(second);
            flight.add(now, &frame, "").unwrap();
        }
        flight
    }

    /// Numbers of the frames that are saved `now`; none where there is nothing to save.
    fn saved(flight: &FlightRecorder<BodiesRow>, now: Instant) -> Vec<u64> {
        let bytes = flight.minute(now);
        assert!(
            bytes
                .as_ref()
                .is_none_or(|b| b.len() > head::<BodiesRow>(Format::Binary).len())
        );
        let bytes = bytes.unwrap_or_default();
        let mut reader = RowReader::<_, BodiesRow>::new(&bytes[..], "flight");
        let rows = std::iter::from_fn(|| reader.read().unwrap());
        rows.map(|row| row.frame).collect()
    }

    #[test]
    fn the_last_minute_is_kept_and_saved() {
        let began = Instant::now();
        let flight = flight(began);
        let newest = began + Duration::from_secs(99);
        assert_eq!(saved(&flight, newest), (39..100).collect::<Vec<_>>());
        assert_eq!(flight.frames.len(), 61);
    }

    #[test]
    fn what_is_old_when_it_is_asked_for_is_not_saved() {
        let began = Instant::now();
        let flight = flight(began);
        let after = |seconds| saved(&flight, began + Duration::from_secs(seconds));
        assert_eq!(after(150), (90..100).collect::<Vec<_>>());
        assert!(after(36_000).is_empty());
    }
}

//! A writer that says once that it cannot go on, whatever is tried on it after that.

use std::io::{self, Seek, SeekFrom, Write};

/// What an archive is written into up to a failure; what follows that goes nowhere. `zip` tries on where it is dropped,
/// and would say on standard error why it cannot, which whoever has the failure says.
pub struct UpToFailure<W> {
    out: W,
    has_failed: bool,
    /// Where it is, and the end of what was written, bytes.
    position: u64,
    end: u64,
}

impl<W> UpToFailure<W> {
    pub(super) fn new(out: W) -> Self {
        Self {
            out,
            has_failed: false,
            position: 0,
            end: 0,
        }
    }

    fn note<T>(&mut self, outcome: io::Result<T>) -> io::Result<T> {
        let failure = outcome.as_ref().err();
        self.has_failed |= failure.is_some_and(|e| e.kind() != io::ErrorKind::Interrupted);
        outcome
    }
}

impl<W: Write> Write for UpToFailure<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.has_failed {
            self.end += bytes.len() as u64;
            return Ok(bytes.len());
        }
        let written = self.out.write(bytes);
        let written = self.note(written)?;
        self.position += written as u64;
        self.end = self.end.max(self.position);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.has_failed {
            return Ok(());
        }
        let flushed = self.out.flush();
        self.note(flushed)
    }
}

impl<W: Seek> Seek for UpToFailure<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        if self.has_failed {
            // An entry never ends before it began.
            return Ok(self.end);
        }
        let position = self.out.seek(to);
        self.position = self.note(position)?;
        self.end = self.end.max(self.position);
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::npz::{Array, Values, Writer};

    /// Has room for so many bytes; how often more were written.
    struct Full(usize, usize);

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let taken = bytes.len().min(self.0);
            self.0 -= taken;
            if taken == 0 {
                self.1 += 1;
                return Err(io::ErrorKind::StorageFull.into());
            }
            Ok(taken)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn what_is_full_is_told_once_and_not_tried_again() {
        let array = Array {
            name: "long",
            shape: &[100],
            data: Values::F64(&[0.5; 100]),
        };
        let mut bytes = Vec::new();
        let mut archive = Writer::in_stream(&mut bytes);
        archive.add(&array).unwrap();
        archive.finish().unwrap();
        for room in 0..bytes.len() {
            let mut full = Full(room, 0);
            let mut archive = Writer::in_stream(&mut full);
            let added = archive.add(&array);
            let finished = added.and_then(|()| archive.finish());
            let kind = finished.unwrap_err().kind();
            assert_eq!(kind, io::ErrorKind::StorageFull, "{room}");
            assert_eq!((full.0, full.1), (0, 1), "{room}");
        }
    }
}

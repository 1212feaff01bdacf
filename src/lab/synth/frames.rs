//! Frames of truth go in, a JSON file of one frame a line comes out, no longer than programs read.

use std::io::{self, Write};

use serde::Serialize;

/// What follows the last frame.
const END: &str = "\n]}\n";

/// Writes a file frame by frame, as far as it has room.
#[derive(Debug)]
pub struct FrameWriter<W> {
    out: W,
    bytes: u64,
    most: u64,
    is_first: bool,
}

impl<W: Write> FrameWriter<W> {
    /// Begins a file of at most `most` bytes with `head`: JSON up to the bracket that opens its frames.
    ///
    /// # Errors
    /// The system's, from writing.
    pub fn new(mut out: W, head: &str, most: u64) -> io::Result<Self> {
        out.write_all(head.as_bytes())?;
        Ok(Self {
            out,
            bytes: head.len() as u64,
            most,
            is_first: true,
        })
    }

    /// The text of the frame that is to follow. Nothing is written: what belongs to the frame may find no room
    /// elsewhere.
    ///
    /// # Errors
    /// [`io::ErrorKind::FileTooLarge`] where the file has no room for it.
    pub fn line(&self, frame: &impl Serialize) -> io::Result<String> {
        let between = if self.is_first { "\n" } else { ",\n" };
        let line = format!("{between}{}", serde_json::to_string(frame)?);
        if self.bytes + (line.len() + END.len()) as u64 > self.most {
            return Err(io::Error::new(
                io::ErrorKind::FileTooLarge,
                format!("a file of truth holds at most {} bytes", self.most),
            ));
        }
        Ok(line)
    }

    /// Writes the text of a frame, of which [`line`](Self::line) has said that it has room.
    ///
    /// # Errors
    /// The system's, from writing.
    pub fn add(&mut self, line: &str) -> io::Result<()> {
        self.out.write_all(line.as_bytes())?;
        self.bytes += line.len() as u64;
        self.is_first = false;
        Ok(())
    }

    /// Ends the file.
    ///
    /// # Errors
    /// The system's, from writing.
    pub fn finish(mut self) -> io::Result<W> {
        self.out.write_all(END.as_bytes())?;
        self.out.flush()?;
        Ok(self.out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::synth::{Truth, demo};

    #[test]
    fn a_full_file_is_whole_and_no_longer_than_allowed() {
        let truth = demo::truth();
        let head = truth.head();
        let write = |most: u64| {
            let mut writer = FrameWriter::new(Vec::new(), &head, most).unwrap();
            let mut refused = None;
            for frame in &truth.frames {
                match writer.line(frame) {
                    Ok(line) => writer.add(&line).unwrap(),
                    Err(e) => {
                        refused = Some(e.kind());
                        break;
                    }
                }
            }
            (
                String::from_utf8(writer.finish().unwrap()).unwrap(),
                refused,
            )
        };
        let (whole, refused) = write(u64::MAX);
        assert_eq!((&whole, refused), (&truth.to_text(), None));
        assert_eq!(Truth::parse(&whole, "whole").unwrap(), truth);
        let exact = whole.len() as u64;
        assert_eq!(write(exact), (whole, None));
        for (most, fewer) in [(exact - 1, 1..2), (exact / 2, 2..truth.frames.len())] {
            let (text, refused) = write(most);
            assert_eq!(refused, Some(io::ErrorKind::FileTooLarge));
            assert!(text.len() as u64 <= most, "{} of {most}", text.len());
            let some = Truth::parse(&text, "some").unwrap().frames;
            assert_eq!(some, truth.frames[..some.len()]);
            assert!(fewer.contains(&(truth.frames.len() - some.len())));
        }
    }
}

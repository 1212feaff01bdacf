//! Reading records frame by frame, whichever format they have.

use std::io::{BufRead, Read};
use std::marker::PhantomData;

use super::binary::{self, HEAD, MAGIC, Piece};
use super::camera::CameraSource;
use super::error::RecordError;
use super::kind::Kind;
use super::other;
use super::rows::{BodiesRow, ObservationsRow, Row};
use crate::message::ObservationFrame;

/// Longest line that can be a frame: an endless one must not take all memory.
const MAX_LINE: u64 = 8 << 20;

/// Reads the rows of a record; empty lines are skipped, unknown fields ignored.
pub struct RowReader<R, T> {
    input: R,
    name: String,
    line: u64,
    buffer: Vec<u8>,
    /// Known once the first bytes were seen.
    is_binary: Option<bool>,
    was_cut: bool,
    rows: PhantomData<T>,
}

impl<R: BufRead, T: Row> RowReader<R, T> {
    /// Reads from `input`; `name` is what errors call it.
    pub fn new(input: R, name: impl Into<String>) -> Self {
        Self {
            input,
            name: name.into(),
            line: 0,
            buffer: Vec::new(),
            is_binary: None,
            was_cut: false,
            rows: PhantomData,
        }
    }

    /// The line or frame read last, from 1; 0 before the first.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// Whether the file ended inside a frame, which was left out.
    pub fn was_cut(&self) -> bool {
        self.was_cut
    }

    /// The next row, `None` at the end. After an error in a line reading may go on with the next one.
    ///
    /// # Errors
    /// [`RecordError`], naming the line.
    pub fn read(&mut self) -> Result<Option<T>, RecordError> {
        let binary = match self.is_binary {
            Some(known) => known,
            None => {
                let known = self.read_head()?;
                self.is_binary = Some(known);
                known
            }
        };
        if binary {
            self.read_binary()
        } else {
            self.read_line()
        }
    }

    /// Whether the file is binary; its head is then read.
    fn read_head(&mut self) -> Result<bool, RecordError> {
        let (first, film) = match self.input.fill_buf() {
            Ok(bytes) => (bytes.first().copied(), other::is_film(bytes)),
            Err(e) => return Err(self.io(1, e)),
        };
        if film {
            return Err(self.other(other::film(T::KIND)));
        }
        // No line of JSON begins so.
        if first != Some(MAGIC[0]) {
            return Ok(false);
        }
        let mut head = [0; HEAD];
        if let Err(e) = self.input.read_exact(&mut head) {
            return Err(self.io(1, e));
        }
        if !head.starts_with(MAGIC) || head[MAGIC.len()] != T::KIND {
            self.line = 1;
            let kind = Kind::of(&mut &head[..]);
            return Err(match kind.and_then(|kind| other::kind(T::KIND, kind)) {
                Some(found) => self.other(found),
                None => self.bad("other bytes".to_owned()),
            });
        }
        Ok(true)
    }

    fn read_binary(&mut self) -> Result<Option<T>, RecordError> {
        match binary::take(&mut self.input, &mut self.buffer) {
            Err(e) => Err(self.io(self.line + 1, e)),
            Ok(Piece::End) => Ok(None),
            Ok(Piece::Cut) => {
                self.was_cut = true;
                Ok(None)
            }
            Ok(Piece::Frame) => {
                self.line += 1;
                let row = postcard::from_bytes(&self.buffer);
                row.map(Some).map_err(|e| self.bad(e.to_string()))
            }
        }
    }

    fn read_line(&mut self) -> Result<Option<T>, RecordError> {
        loop {
            self.buffer.clear();
            let mut limited = self.input.by_ref().take(MAX_LINE);
            let read = match limited.read_until(b'\n', &mut self.buffer) {
                Ok(read) => read,
                Err(e) => return Err(self.io(self.line + 1, e)),
            };
            if read == 0 {
                return Ok(None);
            }
            self.line += 1;
            if read as u64 == MAX_LINE && self.buffer.last() != Some(&b'\n') {
                // What follows would be read as another line: it is not.
                return Err(self.bad(format!("a line of more than {MAX_LINE} bytes")));
            }
            if !self.buffer.trim_ascii().is_empty() {
                break;
            }
        }
        match serde_json::from_slice(&self.buffer) {
            Ok(row) => Ok(Some(row)),
            // The writer was stopped inside this line.
            Err(e) if e.is_eof() && self.line > 1 && self.buffer.last() != Some(&b'\n') => {
                self.line -= 1;
                self.was_cut = true;
                Ok(None)
            }
            Err(e) => {
                let kind = Kind::of(&mut &self.buffer[..]);
                Err(match kind.and_then(|kind| other::kind(T::KIND, kind)) {
                    Some(found) => self.other(found),
                    None => self.bad(complaint(&e)),
                })
            }
        }
    }

    fn other(&self, found: &'static str) -> RecordError {
        RecordError::Other {
            name: self.name.clone(),
            expected: other::expected(T::KIND),
            found,
        }
    }

    fn io(&self, line: u64, source: std::io::Error) -> RecordError {
        let name = self.name.clone();
        RecordError::Io { name, line, source }
    }

    pub(super) fn bad(&self, found: String) -> RecordError {
        RecordError::Line {
            name: self.name.clone(),
            line: self.line,
            by: T::WRITTEN_BY,
            found,
        }
    }
}

/// serde_json counts lines within the one line it was given: keep only its column.
fn complaint(error: &serde_json::Error) -> String {
    let message = error.to_string();
    let text = message.split(" at line ").next().unwrap_or(&message);
    format!("{text} at column {}", error.column())
}

/// Reads recorded observations as the messages that `infer` publishes.
pub struct ObservationReader<'a, R> {
    rows: RowReader<R, ObservationsRow>,
    camera: CameraSource<'a>,
    source: String,
}

impl<'a, R: BufRead> ObservationReader<'a, R> {
    /// Reads from `input`; `name` is what errors call it.
    pub fn new(input: R, name: impl Into<String>, camera: CameraSource<'a>) -> Self {
        Self {
            rows: RowReader::new(input, name),
            camera,
            source: String::new(),
        }
    }

    /// The line or frame read last, from 1; 0 before the first.
    pub fn line(&self) -> u64 {
        self.rows.line()
    }

    /// Whether the file ended inside a frame, which was left out.
    pub fn was_cut(&self) -> bool {
        self.rows.was_cut()
    }

    /// The `source` of the frame read last: a picture or video name, empty if it has none.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Reads the next frame into `frame` and says whether there was one. After an error in a line reading may go on
    /// with the next one.
    ///
    /// # Errors
    /// [`RecordError`], naming the line.
    pub fn read(&mut self, frame: &mut ObservationFrame) -> Result<bool, RecordError> {
        let Some(row) = self.rows.read()? else {
            return Ok(false);
        };
        let message = self.camera.of(&row).and_then(|camera| row.message(camera));
        *frame = message.map_err(|found| self.rows.bad(found))?;
        self.source = row.source;
        Ok(true)
    }
}

/// The text of a record as JSON lines, whichever format it has; `name` is what errors call it. Lines of JSON are as
/// they were.
///
/// # Errors
/// [`RecordError`], naming the frame, for a binary record that is damaged.
pub fn lines(bytes: &[u8], name: &str) -> Result<Vec<u8>, RecordError> {
    match bytes.strip_prefix(MAGIC).and_then(|rest| rest.first()) {
        Some(&ObservationsRow::KIND) => to_json::<ObservationsRow>(bytes, name),
        Some(&BodiesRow::KIND) => to_json::<BodiesRow>(bytes, name),
        _ => Ok(bytes.to_vec()),
    }
}

fn to_json<T: Row>(bytes: &[u8], name: &str) -> Result<Vec<u8>, RecordError> {
    let mut reader = RowReader::<_, T>::new(bytes, name);
    let mut out = Vec::new();
    while let Some(row) = reader.read()? {
        serde_json::to_writer(&mut out, &row).map_err(|e| reader.bad(e.to_string()))?;
        out.push(b'\n');
    }
    Ok(out)
}

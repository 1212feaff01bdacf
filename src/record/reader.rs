//! Reading records frame by frame, whichever format they have.

use std::io::{BufRead, ErrorKind, Read};
use std::marker::PhantomData;

use super::binary::{self, HEAD, MAGIC, Piece};
use super::camera::CameraSource;
use super::error::RecordError;
use super::kind::{Kind, without_mark};
use super::lives::Lives;
use super::other;
use super::rows::{BodiesRow, ObservationsRow, Row};
use super::times::Times;
use crate::message::{BodyFrame, ObservationFrame};

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
        match self.input.read_exact(&mut head) {
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => {
                return Err(self.damaged(1, "the end of the file".to_owned()));
            }
            Err(e) => return Err(self.io(1, e)),
            Ok(()) => {}
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
            Ok(Piece::TooLong(length)) => {
                self.line += 1;
                Err(self.bad(format!("a length of {length} bytes")))
            }
            Ok(Piece::Frame) => {
                self.line += 1;
                match unpacked(&self.buffer) {
                    Ok(row) => Ok(Some(row)),
                    // No frame has no bytes: these are the zeros that some file systems leave after a power cut.
                    Err(found) => self.cut_or(self.buffer.is_empty(), found),
                }
            }
        }
    }

    /// The end, where nothing but zeros follows the piece read last, which was then cut off inside; else the error that
    /// was found in it. The first piece is an error, unless it `may_be_first`: a file of another kind is none cut off.
    fn cut_or(&mut self, may_be_first: bool, found: String) -> Result<Option<T>, RecordError> {
        let is_last = (may_be_first || self.line > 1)
            && only_zeros(&mut self.input).map_err(|e| self.io(self.line, e))?;
        if !is_last {
            return Err(self.bad(found));
        }
        self.line -= 1;
        self.was_cut = true;
        Ok(None)
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
                let found = format!("a line of more than {MAX_LINE} bytes");
                return match self.buffer.last() {
                    Some(0) => self.cut_or(false, found),
                    _ => Err(self.bad(found)),
                };
            }
            if self.line == 1 {
                remove_mark(&mut self.buffer);
            }
            if !self.buffer.trim_ascii().is_empty() {
                break;
            }
        }
        match serde_json::from_slice::<T>(&self.buffer) {
            Ok(row) => match row.check() {
                Ok(()) => Ok(Some(row)),
                Err(found) => Err(self.bad(found)),
            },
            // The writer was stopped inside this line, or the file system put zeros where its end was to be.
            Err(e) if !e.is_data() && self.buffer.last() != Some(&b'\n') => {
                self.cut_or(false, complaint(&e))
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

    fn damaged(&self, frame: u64, found: String) -> RecordError {
        let name = self.name.clone();
        RecordError::Frame { name, frame, found }
    }

    /// That the line or frame read last is none, because of what was `found` in it.
    pub(crate) fn bad(&self, found: String) -> RecordError {
        let (name, line) = (self.name.clone(), self.line);
        match self.is_binary {
            // Nobody repairs one of these by hand.
            Some(true) => self.damaged(line, found),
            _ => RecordError::Line {
                name,
                line,
                by: T::WRITTEN_BY,
                found,
            },
        }
    }
}

/// Leaves the text of a byte order mark.
fn remove_mark(text: &mut Vec<u8>) {
    let mark = text.len() - without_mark(text).len();
    text.drain(..mark);
}

/// A frame of a binary record.
fn unpacked<T: Row>(bytes: &[u8]) -> Result<T, String> {
    let (row, rest) = postcard::take_from_bytes::<T>(bytes).map_err(|e| e.to_string())?;
    // They read as a frame of nobody.
    if !rest.is_empty() && rest.iter().all(|b| *b == 0) {
        return Err("zeros in place of its bytes".to_owned());
    }
    row.check()?;
    Ok(row)
}

/// Whether nothing but zeros is left; these are read. Up to where something else lies, little is.
fn only_zeros(input: &mut impl BufRead) -> std::io::Result<bool> {
    loop {
        let bytes = input.fill_buf()?;
        if bytes.iter().any(|b| *b != 0) {
            return Ok(false);
        }
        match bytes.len() {
            0 => return Ok(true),
            n => input.consume(n),
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
        self.camera.turn(&row, frame);
        self.source = row.source;
        Ok(true)
    }
}

/// Reads recorded bodies as the messages that `fit` publishes, but with ids that belong to one person each, as
/// [`Lives`] counts them on. Ends of the stream are no frames.
pub struct BodyReader<R> {
    rows: RowReader<R, BodiesRow>,
    lives: Lives,
    begins_anew: bool,
    source: String,
}

impl<R: BufRead> BodyReader<R> {
    /// Reads from `input`; `name` is what errors call it.
    pub fn new(input: R, name: impl Into<String>) -> Self {
        Self {
            rows: RowReader::new(input, name),
            lives: Lives::default(),
            begins_anew: false,
            source: String::new(),
        }
    }

    /// Whether the file ended inside a frame, which was left out.
    pub fn was_cut(&self) -> bool {
        self.rows.was_cut()
    }

    /// The `source` of the frame read last: a picture, film or camera, empty if it has none.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Whether nobody who was there before the frame read last is there any more: another life begins with it, or it
    /// follows an end.
    pub fn begins_anew(&self) -> bool {
        self.begins_anew
    }

    /// The next frame, `None` at the end.
    ///
    /// # Errors
    /// [`RecordError`], naming the line.
    pub fn read(&mut self) -> Result<Option<BodyFrame>, RecordError> {
        let mut has_ended = false;
        while let Some(row) = self.rows.read()? {
            let mut frame = row.message();
            if frame.is_end() {
                self.lives.end();
                has_ended = true;
                continue;
            }
            self.begins_anew = self.lives.count_on(&mut frame) || has_ended;
            self.source = row.source;
            return Ok(Some(frame));
        }
        Ok(None)
    }

    /// What the id of somebody in the frame read last is in the record.
    pub(crate) fn recorded(&self, id: u32) -> u32 {
        self.lives.recorded(id)
    }

    /// As [`RowReader::bad`].
    pub(crate) fn bad(&self, found: String) -> RecordError {
        self.rows.bad(found)
    }
}

/// The text of a record as JSON lines, whichever format it has, and whether it ends inside a frame where it is binary;
/// `name` is what errors call it. Lines of JSON are as they were, without a byte order mark.
///
/// # Errors
/// [`RecordError`], naming the frame, for a binary record that is damaged.
pub fn lines(mut bytes: Vec<u8>, name: &str) -> Result<(Vec<u8>, bool), RecordError> {
    match bytes.strip_prefix(MAGIC).and_then(|rest| rest.first()) {
        Some(&ObservationsRow::KIND) => to_json::<ObservationsRow>(&bytes, name),
        Some(&BodiesRow::KIND) => to_json::<BodiesRow>(&bytes, name),
        _ => {
            remove_mark(&mut bytes);
            Ok((bytes, false))
        }
    }
}

fn to_json<T: Row>(bytes: &[u8], name: &str) -> Result<(Vec<u8>, bool), RecordError> {
    let mut reader = RowReader::<_, T>::new(bytes, name);
    let mut out = Vec::new();
    while let Some(row) = reader.read()? {
        serde_json::to_writer(&mut out, &row).map_err(|e| reader.bad(e.to_string()))?;
        out.push(b'\n');
    }
    Ok((out, reader.was_cut()))
}

//! Writing: named arrays go in, the archive's bytes come out, not compressed.

use std::io::{self, BufWriter, Cursor, Seek, Write};

use npyz::{WriterBuilder, npz};
use zip::ZipWriter;
use zip::result::ZipError;
use zip::write::{SimpleFileOptions, StreamWriter};

use super::UpToFailure;

/// So many bytes of an array are written at once: each value alone would have its own turn of the checksum.
const PIECE: usize = 64 << 10;

/// One array to be written, row-major.
pub struct Array<'a> {
    /// Its name in the archive.
    pub name: &'a str,
    /// Its shape.
    pub shape: &'a [usize],
    /// As many values as the shape says.
    pub data: Values<'a>,
}

/// Values of an array.
pub enum Values<'a> {
    /// `float32`.
    F32(&'a [f32]),
    /// `float64`.
    F64(&'a [f64]),
    /// `int64`.
    I64(&'a [i64]),
}

/// The bytes of an archive of `arrays`, not compressed; the same arrays give the same bytes.
///
/// # Errors
/// When an array holds fewer or more values than its shape says.
pub fn write(arrays: &[Array<'_>]) -> io::Result<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    let mut archive = Writer::new(&mut bytes);
    for array in arrays {
        archive.add(array)?;
    }
    archive.finish()?;
    Ok(bytes.into_inner())
}

/// An archive that is written array by array, none of which is held; not compressed, and without dates.
pub struct Writer<W: Write + Seek>(ZipWriter<W>);

impl<W: Write + Seek> Writer<UpToFailure<W>> {
    /// Begins one in what may be written over: how long an array is also stands before it, where some readers look.
    pub fn new(out: W) -> Self {
        Self(ZipWriter::new(UpToFailure::new(out)))
    }
}

impl<W: Write> Writer<StreamWriter<UpToFailure<W>>> {
    /// Begins one in a pipe: how long arrays are stands behind them, and in the directory.
    pub fn in_stream(out: W) -> Self {
        Self(ZipWriter::new_stream(UpToFailure::new(out)))
    }
}

impl<W: Write + Seek> Writer<W> {
    /// Adds an array.
    ///
    /// # Errors
    /// When it holds fewer or more values than its shape says; those of what is written into.
    pub fn add(&mut self, array: &Array<'_>) -> io::Result<()> {
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored)
            .last_modified_time(zip::DateTime::default());
        let name = npz::file_name_from_array_name(array.name);
        self.0.start_file(name, options).map_err(plain)?;
        let shape: Vec<u64> = array.shape.iter().map(|&n| n as u64).collect();
        match array.data {
            Values::F32(all) => write_array(&mut self.0, &shape, all),
            Values::F64(all) => write_array(&mut self.0, &shape, all),
            Values::I64(all) => write_array(&mut self.0, &shape, all),
        }
    }

    /// Writes the archive's directory.
    ///
    /// # Errors
    /// Those of what is written into.
    pub fn finish(self) -> io::Result<()> {
        self.0.finish().map(drop).map_err(plain)
    }
}

/// The system's own words, where they are the system's.
fn plain(error: ZipError) -> io::Error {
    match error {
        ZipError::Io(e) => e,
        other => other.into(),
    }
}

fn write_array<T: npyz::AutoSerialize + Copy>(
    out: impl Write,
    shape: &[u64],
    all: &[T],
) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(PIECE, out);
    let options = npyz::WriteOptions::new().default_dtype();
    let mut npy = options.shape(shape).writer(&mut out).begin_nd()?;
    npy.extend(all.iter().copied())?;
    npy.finish()?;
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::npz::Archive;

    #[test]
    fn what_is_written_is_read_and_has_no_date() {
        let array = Array {
            name: "heat",
            shape: &[2, 3],
            data: Values::F32(&[1.0, 2.5, -3.0, 4.0, 5.0, 6.0]),
        };
        let bytes = write(&[array]).unwrap();
        // DOS date and time of the first local header: 1980-01-01, midnight.
        assert_eq!(&bytes[10..14], &[0, 0, 0x21, 0]);
        let mut archive = Archive::new(Cursor::new(&bytes)).unwrap();
        assert_eq!(archive.names(), ["heat"]);
        let numbers = archive.numbers("heat").unwrap().unwrap();
        assert_eq!(numbers.shape, [2, 3]);
        assert_eq!(numbers.data, [1.0, 2.5, -3.0, 4.0, 5.0, 6.0]);
        assert_eq!(archive.numbers("other"), Ok(None));
        let short = Array {
            name: "a",
            shape: &[2],
            data: Values::F32(&[1.0]),
        };
        assert!(write(&[short]).is_err(), "a value is missing");
    }

    #[test]
    fn an_archive_in_a_pipe_holds_the_same() {
        let array = Array {
            name: "long",
            shape: &[100_000],
            data: Values::F64(&vec![0.5; 100_000]),
        };
        let mut bytes = Vec::new();
        let mut archive = Writer::in_stream(&mut bytes);
        archive.add(&array).unwrap();
        archive.finish().unwrap();
        let numbers = Archive::new(Cursor::new(&bytes))
            .unwrap()
            .numbers("long")
            .unwrap()
            .unwrap();
        assert_eq!(
            (numbers.shape, numbers.data),
            (vec![100_000], vec![0.5; 100_000])
        );
    }
}

//! NumPy archives (`.npz`): named arrays go in, a file's bytes come out, and the other way round.

use std::io::{self, BufWriter, Cursor, Read, Seek, SeekFrom, Write};

use npyz::{NpyFile, NpyHeader, WriterBuilder, npz};
use zip::ZipWriter;
use zip::result::ZipError;
use zip::write::{SimpleFileOptions, StreamWriter};

/// So many bytes of an array are written at once: each value alone would have its own turn of the checksum.
const PIECE: usize = 64 << 10;
/// Most bytes of an array, as it is stored and as it is in memory: a few of zeros deflate to a thousandth.
const MOST: usize = 2 << 30;
/// Bytes of a string in memory at least, with what the allocator needs beside it.
const STRING: usize = size_of::<String>() + 32;
/// Most bytes of an array's header. NumPy reads no longer ones, either.
const LONGEST_HEADER: usize = 10_000;
/// Most dimensions of an array, as many as NumPy's own: each costs time with every value.
const MOST_DIMENSIONS: usize = 64;
/// Most brackets within each other in a header. Its parser's time doubles with each, and its stack grows.
const DEEPEST: usize = 8;
/// Most characters of a file's own words in an error.
const SHOWN: usize = 80;

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
    fn new(out: W) -> Self {
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

/// Why an archive, or an array of it, cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, found {found}")]
pub struct NpzError {
    /// What was expected.
    pub expected: String,
    /// What was found, and what to do.
    pub found: String,
}

impl NpzError {
    fn new(expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self {
            expected: expected.into(),
            found: found.into(),
        }
    }

    fn damaged(what: &str, why: impl std::fmt::Display) -> Self {
        Self::new(
            format!("{what} in one piece"),
            format!("{why}; the file is damaged or cut short, write or download it again"),
        )
    }
}

/// Numbers of any kind as f64, row-major whatever the file's order is.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers {
    /// Shape.
    pub shape: Vec<usize>,
    /// Values.
    pub data: Vec<f64>,
}

/// An archive being read.
pub struct Archive<R> {
    zip: zip::ZipArchive<R>,
}

impl<R: Read + Seek> Archive<R> {
    /// Reads the directory of an archive.
    ///
    /// # Errors
    /// When `reader` does not hold one.
    pub fn new(reader: R) -> Result<Self, NpzError> {
        let zip = zip::ZipArchive::new(reader)
            .map_err(|e| NpzError::damaged("a NumPy archive (.npz)", e))?;
        Ok(Self { zip })
    }

    /// Names of the arrays, in the order of the archive's directory.
    pub fn names(&self) -> Vec<String> {
        let names = self.zip.file_names().flatten();
        names
            .filter_map(|file| npz::array_name_from_file_name(&file).map(str::to_owned))
            .collect()
    }

    /// An array of numbers or truth values; `None` when there is none of this name.
    ///
    /// # Errors
    /// When it holds something else or is damaged.
    pub fn numbers(&mut self, name: &str) -> Result<Option<Numbers>, NpzError> {
        let Some(raw) = self.raw(name, size_of::<f64>())? else {
            return Ok(None);
        };
        let stored = raw.numbers().ok_or_else(|| {
            let what = format!("'{name}' to be an array of numbers");
            NpzError::new(what, raw.description())
        })?;
        let stored = stored.map_err(|e| NpzError::damaged(&format!("array '{name}'"), e))?;
        Ok(Some(Numbers {
            data: raw.row_major(stored),
            shape: raw.shape,
        }))
    }

    /// An array of strings of any shape, or a single one; `None` when there is none of this name.
    ///
    /// # Errors
    /// When it holds something else or is damaged.
    pub fn texts(&mut self, name: &str) -> Result<Option<Vec<String>>, NpzError> {
        let Some(raw) = self.raw(name, STRING)? else {
            return Ok(None);
        };
        let stored = raw.texts().ok_or_else(|| {
            let what = format!("'{name}' to be an array of strings");
            NpzError::new(what, raw.description())
        })?;
        let stored = stored.map_err(|e| NpzError::damaged(&format!("array '{name}'"), e))?;
        Ok(Some(raw.row_major(stored)))
    }

    /// The array's header and bytes, which are as many as its header says. Each value will take at least `least` bytes
    /// in memory.
    fn raw(&mut self, name: &str, least: usize) -> Result<Option<Raw>, NpzError> {
        let array = format!("array '{name}'");
        let mut file = match self.zip.by_name(&npz::file_name_from_array_name(name)) {
            Ok(file) => file,
            Err(ZipError::FileNotFound) => return Ok(None),
            Err(e) => return Err(NpzError::damaged(&array, e)),
        };
        let header = header(&mut file).map_err(|why| NpzError::damaged(&array, why))?;
        if header.uses_pickled_array() {
            return Err(NpzError::new(
                format!("'{name}' to hold plain numbers or strings"),
                "pickled Python objects, which are programs and are not run; save it again as a plain array",
            ));
        }
        let dimensions = header.shape().len();
        if dimensions > MOST_DIMENSIONS {
            return Err(NpzError::new(
                format!("{array} to have at most {MOST_DIMENSIONS} dimensions"),
                format!("{dimensions}; save it again with fewer"),
            ));
        }
        let shape: Option<Vec<usize>> = header
            .shape()
            .iter()
            .map(|&n| usize::try_from(n).ok())
            .collect();
        let sizes = |shape: &Vec<usize>| {
            let count = shape.iter().try_fold(1_usize, |n, &m| n.checked_mul(m))?;
            let each = header.dtype().num_bytes()?;
            Some((each, count.checked_mul(each.max(least))?, count * each))
        };
        let Some((shape, (each, held, length))) = shape.and_then(|s| sizes(&s).map(|n| (s, n)))
        else {
            let found = format!("an impossible shape {:?}", header.shape());
            return Err(NpzError::damaged(&array, excerpt(&found)));
        };
        if held > MOST {
            return Err(NpzError::new(
                format!("array '{name}' to take at most {} MB of memory", MOST >> 20),
                excerpt(&format!("{} MB for shape {shape:?}", held >> 20))
                    + "; leave out what is not needed",
            ));
        }
        if each == 0 && held > least {
            let found = format!("values of 0 bytes in shape {shape:?}");
            return Err(NpzError::damaged(&array, excerpt(&found)));
        }
        // Grows with what is really there, whatever the header claims.
        let mut bytes = Vec::new();
        file.take(length as u64 + 1)
            .read_to_end(&mut bytes)
            .map_err(|e| NpzError::damaged(&array, e))?;
        if bytes.len() != length {
            let more = if bytes.len() > length {
                "more than "
            } else {
                ""
            };
            let found = format!(
                "{more}{} bytes where there should be {length} for shape {shape:?}",
                bytes.len().min(length)
            );
            return Err(NpzError::damaged(&array, excerpt(&found)));
        }
        Ok(Some(Raw {
            header,
            shape,
            bytes,
        }))
    }
}

/// An array's header; otherwise why it cannot be read, in one line.
fn header(file: &mut impl Read) -> Result<NpyHeader, String> {
    let mut fill = |bytes: &mut [u8]| file.read_exact(bytes).map_err(|e| e.to_string());
    let mut start = [0; 8];
    fill(&mut start)?;
    if !start.starts_with(b"\x93NUMPY") {
        return Err("no array of NumPy's".into());
    }
    // The first version of the format has two bytes for the length, later ones have four.
    let mut length = [0; 4];
    let width = if start[6] == 1 { 2 } else { 4 };
    fill(&mut length[..width])?;
    let long = u32::from_le_bytes(length) as usize;
    if long > LONGEST_HEADER {
        return Err(format!("a header of {long} bytes"));
    }
    let mut text = vec![0; long];
    fill(&mut text)?;
    let deepest = without_long(&mut text);
    let shown = || format!("the header {}", excerpt(&String::from_utf8_lossy(&text)));
    if deepest > DEEPEST {
        return Err(shown());
    }
    let bytes = [&start[..], &length[..width], &text].concat();
    NpyHeader::from_reader(&bytes[..]).map_err(|e| match e.to_string() {
        // The parser draws where it stopped, in many lines.
        drawn if drawn.contains('\n') => shown(),
        said => excerpt(&said),
    })
}

/// Takes away the `L` that Python 2 writes behind long integers, which NumPy does too; returns the greatest number of
/// brackets within each other.
fn without_long(header: &mut [u8]) -> usize {
    let (mut depth, mut deepest) = (0_usize, 0);
    let mut quote = None;
    let mut before = b' ';
    let mut bytes = header.iter_mut();
    while let Some(byte) = bytes.next() {
        match (quote, *byte) {
            // What is escaped ends no string.
            (Some(_), b'\\') => {
                bytes.next();
            }
            (Some(end), found) if end == found => quote = None,
            (Some(_), _) => {}
            (None, begin @ (b'\'' | b'"')) => quote = Some(begin),
            (None, b'(' | b'[' | b'{') => {
                depth += 1;
                deepest = deepest.max(depth);
            }
            (None, b')' | b']' | b'}') => depth = depth.saturating_sub(1),
            (None, b'L') if before.is_ascii_digit() => *byte = b' ',
            (None, _) => {}
        }
        before = *byte;
    }
    deepest
}

/// The beginning of `text`, in one line.
fn excerpt(text: &str) -> String {
    let line = |c: char| if c.is_control() { ' ' } else { c };
    let mut shown: String = text.trim().chars().take(SHOWN).map(line).collect();
    if shown.len() < text.trim().len() {
        shown.push('…');
    }
    shown
}

struct Raw {
    header: NpyHeader,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Raw {
    /// Values in the file's order if they are of type `T`.
    fn values<T: npyz::Deserialize>(&self) -> Option<io::Result<Vec<T>>> {
        let file = NpyFile::with_header(self.header.clone(), &self.bytes[..]);
        Some(file.try_data::<T>().ok()?.collect())
    }

    fn numbers(&self) -> Option<io::Result<Vec<f64>>> {
        macro_rules! first_of {
            ($($type:ty),*) => {
                $(if let Some(values) = self.values::<$type>() {
                    return Some(values.map(|v| v.into_iter().map(|x| x as f64).collect()));
                })*
            };
        }
        first_of!(f32, f64, u8, i8, u16, i16, u32, i32, u64, i64);
        let truth = self.values::<bool>()?;
        Some(truth.map(|v| v.into_iter().map(|x| f64::from(u8::from(x))).collect()))
    }

    fn texts(&self) -> Option<io::Result<Vec<String>>> {
        if let Some(unicode) = self.values::<String>() {
            return Some(unicode);
        }
        let bytes = self.values::<Vec<u8>>()?;
        let text = |b: Vec<u8>| String::from_utf8(b).map_err(io::Error::other);
        Some(bytes.and_then(|all| all.into_iter().map(text).collect()))
    }

    fn description(&self) -> String {
        let found = format!(
            "type {} of shape {:?}",
            self.header.dtype().descr(),
            self.shape
        );
        excerpt(&found) + "; save it again as what is expected"
    }

    /// Brings values from the file's order into row-major order.
    fn row_major<T: Clone>(&self, stored: Vec<T>) -> Vec<T> {
        if self.header.order() == npyz::Order::C || self.shape.len() < 2 {
            return stored;
        }
        let mut out = Vec::with_capacity(stored.len());
        let mut index = vec![0; self.shape.len()];
        for _ in 0..stored.len() {
            // Column-major: the first index runs fastest.
            let axes = index.iter().zip(&self.shape).rev();
            let at = axes.fold(0, |at, (&i, &n)| at * n + i);
            out.push(stored[at].clone());
            for (i, &n) in index.iter_mut().zip(&self.shape).rev() {
                *i += 1;
                if *i < n {
                    break;
                }
                *i = 0;
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An archive of one array whose `.npy` bytes are given.
    fn archive(name: &str, npy: &[u8]) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let deflated = SimpleFileOptions::default();
        zip.start_file(format!("{name}.npy"), deflated).unwrap();
        zip.write_all(npy).unwrap();
        zip.finish().unwrap().into_inner()
    }

    /// A `.npy` file (format 1.0, as NumPy writes it) from its header's dictionary.
    fn npy(dictionary: &str, data: &[u8]) -> Vec<u8> {
        let mut out = b"\x93NUMPY\x01\x00".to_vec();
        let header = format!("{dictionary}\n");
        out.extend((header.len() as u16).to_le_bytes());
        out.extend(header.as_bytes());
        out.extend(data);
        out
    }

    fn read(bytes: &[u8]) -> Archive<Cursor<&[u8]>> {
        Archive::new(Cursor::new(bytes)).unwrap()
    }

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
        let mut archive = read(&bytes);
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
        let numbers = read(&bytes).numbers("long").unwrap().unwrap();
        assert_eq!(
            (numbers.shape, numbers.data),
            (vec![100_000], vec![0.5; 100_000])
        );
    }

    #[test]
    fn no_array_has_more_dimensions_than_those_of_numpy() {
        let of = |dimensions: usize| {
            let shape = vec!["1"; dimensions].join(", ");
            let head = format!("{{'descr': '|u1', 'fortran_order': True, 'shape': ({shape}), }}");
            read(&archive("deep", &npy(&head, &[7]))).numbers("deep")
        };
        assert_eq!(of(64).unwrap().unwrap().data, [7.0]);
        let said = of(65).unwrap_err().to_string();
        let words = "array 'deep' to have at most 64 dimensions, found 65";
        assert!(said.contains(words) && said.len() < 240, "{said}");
    }

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

    #[test]
    fn column_major_big_endian_integers_come_out_row_major() {
        // [[1, 2, 3], [4, 5, 6]] stored by columns.
        let data: Vec<u8> = [1_i16, 4, 2, 5, 3, 6]
            .into_iter()
            .flat_map(i16::to_be_bytes)
            .collect();
        let text = "{'descr': '>i2', 'fortran_order': True, 'shape': (2, 3), }";
        let bytes = archive("a", &npy(text, &data));
        let numbers = read(&bytes).numbers("a").unwrap().unwrap();
        assert_eq!(numbers.data, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    }

    #[test]
    fn strings_of_both_kinds_are_read() {
        let unicode: Vec<u8> = "äb\0c\0\0"
            .chars()
            .flat_map(|c| u32::from(c).to_le_bytes())
            .collect();
        let text = "{'descr': '<U3', 'fortran_order': False, 'shape': (2,), }";
        let bytes = archive("a", &npy(text, &unicode));
        assert_eq!(read(&bytes).texts("a").unwrap().unwrap(), ["äb", "c"]);
        assert!(read(&bytes).numbers("a").is_err());
        let text = "{'descr': '|S4', 'fortran_order': False, 'shape': (), }";
        let bytes = archive("a", &npy(text, b"mm\0\0"));
        assert_eq!(read(&bytes).texts("a").unwrap().unwrap(), ["mm"]);
    }

    #[test]
    fn what_is_damaged_or_pickled_is_said() {
        let data = [0_u8; 16];
        let text = "{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }";
        let whole = archive("a", &npy(text, &data));
        for cut in [1, 10, 60, whole.len() - 1] {
            assert!(Archive::new(Cursor::new(&whole[..cut])).is_err());
        }
        let few = archive("a", &npy(text, &data[..9]));
        let error = read(&few).numbers("a").unwrap_err();
        assert!(error.found.contains("9 bytes"), "{error}");
        let huge = "{'descr': '<f8', 'fortran_order': False, 'shape': (200000000,), }";
        let huge = archive("a", &npy(huge, &data));
        let error = read(&huge).numbers("a").unwrap_err();
        assert!(error.found.contains("16 bytes"), "{error}");
        let objects = "{'descr': '|O', 'fortran_order': False, 'shape': (), }";
        let objects = archive("a", &npy(objects, &data));
        let error = read(&objects).numbers("a").unwrap_err();
        assert!(error.found.contains("pickled"), "{error}");
        let mut flipped = whole.clone();
        // Inside the compressed data, behind the local header.
        flipped[45] ^= 0xff;
        assert!(
            read(&flipped).numbers("a").is_err(),
            "the checksum is wrong"
        );
    }
    #[test]
    fn no_header_makes_a_small_file_fill_the_memory() {
        let zeros = vec![0; 1 << 20];
        for (descr, shape) in [
            ("<f8", "(1000000000000,)"),
            ("|u1", "(2147483647,)"),
            ("<U0", "(2000000000000,)"),
            ("|S0", "(2000000000000,)"),
            ("|S1", "(2147483647,)"),
            ("<U0", "(2,)"),
        ] {
            let text =
                format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
            let bytes = archive("a", &npy(&text, &zeros));
            let mut archive = read(&bytes);
            let error = match descr {
                "<f8" | "|u1" => archive.numbers("a").unwrap_err(),
                _ => archive.texts("a").unwrap_err(),
            };
            let is_said = error.found.contains(" MB for shape") || error.found.contains("0 bytes");
            assert!(is_said, "{descr} {shape}: {error}");
        }
        // One text that is empty is one text.
        let text = "{'descr': '<U0', 'fortran_order': False, 'shape': (), }";
        let bytes = archive("a", &npy(text, b""));
        assert_eq!(read(&bytes).texts("a").unwrap().unwrap(), [""]);
    }

    #[test]
    fn shapes_of_python_2_are_read() {
        let text = "{'descr': '<f8', 'fortran_order': False, 'shape': (1L, 3L), }";
        let data: Vec<u8> = [1.0_f64, 2.0, 3.0]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let bytes = archive("a", &npy(text, &data));
        let numbers = read(&bytes).numbers("a").unwrap().unwrap();
        assert_eq!(numbers.shape, [1, 3]);
        assert_eq!(numbers.data, [1.0, 2.0, 3.0]);
        let mut text = *br"{'a1L\'2L': (3L, 4L)}";
        assert_eq!(without_long(&mut text), 2);
        assert_eq!(text, *br"{'a1L\'2L': (3 , 4 )}");
    }

    #[test]
    fn a_header_that_cannot_be_read_is_told_in_one_short_line() {
        let long = "x".repeat(9_000);
        let record = format!("[('{long}', '<f8'), ('b', '|u1')]");
        let sides = "1, ".repeat(3_000);
        let whole = |descr: &str, shape: &str| {
            format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}")
        };
        for text in [
            whole("'<f8'", "(2, 2"),
            whole("'<f8'", "(2.5,)"),
            whole("'<f8'", &format!("({sides})")),
            whole(&format!("'{long}'"), "(2,)"),
            whole(&record, "()"),
            format!("{{'descr':\n{long}"),
            "(".repeat(9_000),
            format!("{}{}", "[".repeat(60), "]".repeat(60)),
            "{".repeat(60_000),
            String::new(),
        ] {
            let bytes = archive("a", &npy(&text, &[0; 9]));
            let said = read(&bytes).numbers("a").unwrap_err().to_string();
            assert!(said.chars().count() < 240 && !said.contains('\n'), "{said}");
        }
    }
}

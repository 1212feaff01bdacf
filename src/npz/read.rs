//! Reading: an archive's bytes go in, arrays of numbers or strings come out by their names. No file, however it is
//! made, fills the memory.

use std::io::{Read, Seek};

use npyz::npz;
use zip::result::ZipError;

use super::NpzError;
use super::error::excerpt;
use super::header::header;
use super::stored::Raw;

/// Most bytes of an array, as it is stored and as it is in memory: a few of zeros deflate to a thousandth.
const MOST: usize = 2 << 30;
/// Bytes of a string in memory at least, with what the allocator needs beside it.
const STRING: usize = size_of::<String>() + 32;

/// Most dimensions of an array, as many as NumPy's own: each costs time with every value.
const MOST_DIMENSIONS: usize = 64;

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

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Write};

    use zip::write::SimpleFileOptions;

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

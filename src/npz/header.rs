//! The header of an array: its first bytes go in, its type, order and shape come out.

use std::io::Read;

use npyz::NpyHeader;

use super::error::excerpt;

/// Most bytes of an array's header. NumPy reads no longer ones, either.
const LONGEST_HEADER: usize = 10_000;

/// Most brackets within each other in a header. Its parser's time doubles with each, and its stack grows.
const DEEPEST: usize = 8;

/// An array's header; otherwise why it cannot be read, in one line.
pub(super) fn header(file: &mut impl Read) -> Result<NpyHeader, String> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_l_of_python_2_goes_but_not_in_names() {
        let mut text = *br"{'a1L\'2L': (3L, 4L)}";
        assert_eq!(without_long(&mut text), 2);
        assert_eq!(text, *br"{'a1L\'2L': (3 , 4 )}");
    }
}

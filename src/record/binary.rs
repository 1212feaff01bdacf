//! The binary format: a magic, then frames with their lengths.

use std::io::{self, BufRead, Read};

/// How a binary record begins; a byte that says of what follows.
pub const MAGIC: &[u8; 7] = b"EDGECAP";
/// Bytes before the first frame.
pub const HEAD: usize = MAGIC.len() + 1;
/// Most bytes of a frame: 32 people take a tenth of it.
pub const MAX_FRAME: usize = 1 << 20;

/// What the next frame of a file is.
pub enum Piece {
    /// Its bytes are in the buffer.
    Frame,
    /// The file ends inside it.
    Cut,
    /// None: it would have more bytes than any frame, so many.
    TooLong(usize),
    /// There is none.
    End,
}

/// Appends a frame's length and bytes.
pub fn put(frame: &[u8], out: &mut Vec<u8>) {
    out.extend((frame.len() as u32).to_le_bytes());
    out.extend(frame);
}

/// Takes the next frame's bytes.
///
/// # Errors
/// Those of `input`; a frame that is cut off or too long is a [`Piece`].
pub fn take<R: BufRead>(input: &mut R, buffer: &mut Vec<u8>) -> io::Result<Piece> {
    buffer.clear();
    let length = match read_up_to(input, 4, buffer)? {
        0 => return Ok(Piece::End),
        4 => u32::from_le_bytes([buffer[0], buffer[1], buffer[2], buffer[3]]) as usize,
        _ => return Ok(Piece::Cut),
    };
    if length > MAX_FRAME {
        return Ok(Piece::TooLong(length));
    }
    buffer.clear();
    Ok(if read_up_to(input, length, buffer)? == length {
        Piece::Frame
    } else {
        Piece::Cut
    })
}

fn read_up_to<R: BufRead>(input: &mut R, n: usize, buffer: &mut Vec<u8>) -> io::Result<usize> {
    input.by_ref().take(n as u64).read_to_end(buffer)
}

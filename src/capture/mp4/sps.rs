//! An H.264 sequence parameter set goes in, which samples mean black and white comes out (ITU-T H.264, 7.3.2.1.1 and
//! E.1.1).

use crate::capture::yuv::Range;

/// Profiles that say how their colours are stored.
const EXTENDED_PROFILES: [u32; 13] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135];
/// The shape of pixels that is given in numbers.
const SHAPE_IN_NUMBERS: u32 = 255;

/// What a set says; `None` where it says nothing, and behind scaling matrices, which cameras do not write.
pub fn range(unit: &[u8]) -> Option<Range> {
    let mut set = Bits::of(unit.get(1..)?);
    let profile = set.number(8)?;
    // Constraints and level; which set.
    set.number(16)?;
    set.code()?;
    if EXTENDED_PROFILES.contains(&profile) {
        skip_format(&mut set)?;
    }
    skip_order(&mut set)?;
    // References and gaps among them; columns and rows.
    set.code()?;
    set.flag()?;
    set.codes(2)?;
    // Fields alone, or both kinds; inference.
    if !set.flag()? {
        set.flag()?;
    }
    set.flag()?;
    // Edges that are not shown.
    if set.flag()? {
        set.codes(4)?;
    }
    if set.flag()? { signal(&mut set) } else { None }
}

/// Passes over chroma and bits of a sample; `None` behind scaling matrices.
fn skip_format(set: &mut Bits) -> Option<()> {
    // Three planes apart.
    if set.code()? == 3 {
        set.flag()?;
    }
    set.codes(2)?;
    set.flag()?;
    (!set.flag()?).then_some(())
}

/// Passes over how pictures are numbered.
fn skip_order(set: &mut Bits) -> Option<()> {
    set.code()?;
    match set.code()? {
        0 => set.codes(1),
        1 => {
            set.flag()?;
            set.codes(2)?;
            let cycle = set.code()?;
            set.codes(cycle)
        }
        _ => Some(()),
    }
}

/// Reads the range out of what a set says about showing its pictures.
fn signal(set: &mut Bits) -> Option<Range> {
    if set.flag()? && set.number(8)? == SHAPE_IN_NUMBERS {
        set.number(32)?;
    }
    // Overscan.
    if set.flag()? {
        set.flag()?;
    }
    if !set.flag()? {
        return None;
    }
    // PAL, NTSC and others.
    set.number(3)?;
    Some(if set.flag()? {
        Range::Full
    } else {
        Range::Limited
    })
}

/// Reads bits from the highest to the lowest; `None` behind the last.
struct Bits {
    bytes: Vec<u8>,
    at: usize,
}

impl Bits {
    /// The bits of a unit, without the bytes that keep start codes out of it.
    fn of(unit: &[u8]) -> Self {
        let mut bytes = Vec::with_capacity(unit.len());
        let mut zeros = 0;
        for byte in unit {
            if zeros >= 2 && *byte == 3 {
                zeros = 0;
                continue;
            }
            zeros = if *byte == 0 { zeros + 1 } else { 0 };
            bytes.push(*byte);
        }
        Self { bytes, at: 0 }
    }

    fn flag(&mut self) -> Option<bool> {
        let byte = self.bytes.get(self.at / 8)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Some(bit == 1)
    }

    fn number(&mut self, bits: u32) -> Option<u32> {
        (0..bits).try_fold(0, |n, _| Some(n << 1 | u32::from(self.flag()?)))
    }

    /// Exp-Golomb: as many zeros as bits follow the first 1.
    fn code(&mut self) -> Option<u32> {
        let mut zeros = 0;
        while !self.flag()? {
            zeros += 1;
        }
        let rest = self.number(zeros)?;
        1_u32.checked_shl(zeros)?.checked_add(rest)?.checked_sub(1)
    }

    fn codes(&mut self, count: u32) -> Option<()> {
        (0..count).try_for_each(|_| self.code().map(|_| ()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From films of libx264: one that says nothing, and one of full range.
    const SILENT: [u8; 22] = [
        0x67, 0x42, 0xC0, 0x0A, 0xD9, 0x0B, 0xB0, 0x11, 0, 0, 3, 0, 1, 0, 0, 3, 0, 0x32, 0x0F,
        0x12, 0x26, 0x48,
    ];
    const FULL: [u8; 23] = [
        0x67, 0x64, 0, 0x0D, 0xAC, 0xD9, 0x41, 0x41, 0xFA, 0x6C, 0x80, 0, 0, 3, 0, 0x80, 0, 0,
        0x1E, 7, 0x8A, 0x14, 0xCB,
    ];

    #[test]
    fn the_range_is_what_the_set_says() {
        assert_eq!(range(&SILENT), None);
        assert_eq!(range(&FULL), Some(Range::Full));
        let mut limited = FULL;
        limited[9] ^= 1 << 2;
        assert_eq!(range(&limited), Some(Range::Limited));
    }

    #[test]
    fn a_set_cut_off_says_nothing_and_no_bytes_harm() {
        for end in 0..10 {
            assert_eq!(range(&FULL[..end]), None, "{end}");
        }
        for byte in 0..=255 {
            range(&[byte; 64]);
        }
    }
}

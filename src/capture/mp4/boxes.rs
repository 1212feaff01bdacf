//! Looks at the boxes of an MP4 file before the library reads them: it trusts their sizes and counts.
//!
//! A box of no size inside another one lets it read the same header for ever, and tables may state billions of samples.
//! So every box down to the tables must lie inside its parent, and there may not be more samples than bytes. What the
//! film does not need, and the library reads carelessly, is hidden from it.

use std::io::{self, Read, Seek, SeekFrom};

/// Boxes that hold boxes, as deep as the tables of samples.
const CONTAINERS: [[u8; 4]; 8] = [
    *b"moov", *b"trak", *b"mdia", *b"minf", *b"stbl", *b"mvex", *b"moof", *b"traf",
];
/// Titles, covers and messages.
const UNNEEDED: [[u8; 4]; 3] = [*b"meta", *b"udta", *b"emsg"];
/// What readers pass over.
const HIDDEN: [u8; 4] = *b"free";
/// What stands in a format of pictures before the boxes in it.
const PICTURE_FORMAT_BYTES: u64 = 78;
/// Size and name of a box.
const HEADER_BYTES: u64 = 8;
/// Boxes inside boxes; a film needs five.
const MAX_DEPTH: u32 = 8;
/// Samples of all tracks: three days at 240 pictures a second.
const MAX_SAMPLES: u64 = 1 << 26;

/// What a walk through the boxes has found.
#[derive(Debug, Default)]
pub struct Walk {
    /// Where the names of boxes to be hidden stand, from the start of the file, ascending.
    hidden: Vec<u64>,
    samples: u64,
    fragments: bool,
    /// Whether the file ends inside its last fragment's tables.
    is_fragment_cut: bool,
    end: u64,
    /// Width and height of the film's pixels, in any unit.
    pixel: Option<(u32, u32)>,
}

/// A box: its name, where it stands, and where its content and it end.
struct Boxed {
    name: [u8; 4],
    name_at: u64,
    content: u64,
    end: u64,
}

impl Walk {
    /// Walks through the file. Its last box may end behind the file, which is cut off then: neither we nor the library
    /// look into it, unless it is `moov`.
    ///
    /// # Errors
    /// Why these cannot be the boxes of a film, and what reading fails with.
    pub fn through(file: &mut (impl Read + Seek), file_bytes: u64) -> io::Result<Self> {
        let mut walk = Self::default();
        let mut outermost = Vec::new();
        // No size: to the end of the file.
        while walk.end.saturating_add(HEADER_BYTES) <= file_bytes && word(file, walk.end)? != 0 {
            if let Some(found) = next(file, walk.end, u64::MAX)? {
                walk.end = found.end;
                outermost.push(found);
            }
        }
        // Fragments name tracks of other kinds: these cannot be hidden then.
        walk.fragments = outermost.iter().any(|b| b.name == *b"moof");
        for found in &outermost {
            if found.end > file_bytes && found.name != *b"moov" {
                walk.is_fragment_cut = found.name == *b"moof";
                walk.hidden.push(found.name_at);
            } else {
                walk.look(file, found, file_bytes, 0)?;
            }
        }
        walk.hidden.sort_unstable();
        Ok(walk)
    }

    /// Where the last box says that it ends, bytes.
    pub fn end(&self) -> u64 {
        self.end
    }

    /// Whether the file ends inside the tables of its last fragment.
    pub fn is_fragment_cut(&self) -> bool {
        self.is_fragment_cut
    }

    /// Width and height of the film's pixels, in any unit, where it says so.
    pub fn pixel(&self) -> Option<(u32, u32)> {
        self.pixel
    }

    fn look(
        &mut self,
        file: &mut (impl Read + Seek),
        found: &Boxed,
        file_bytes: u64,
        depth: u32,
    ) -> io::Result<()> {
        if depth > MAX_DEPTH {
            return Err(damage("boxes lie inside boxes without end"));
        }
        match &found.name {
            name if UNNEEDED.contains(name) => self.hidden.push(found.name_at),
            b"trak" if !self.fragments && !shows(file, found)? => {
                self.hidden.push(found.name_at);
            }
            name if CONTAINERS.contains(name) => {
                let mut at = found.content;
                while let Some(inner) = next(file, at, found.end)? {
                    self.look(file, &inner, file_bytes, depth + 1)?;
                    at = inner.end;
                }
            }
            // What is wrong inside it the library tells.
            b"stsd" if self.pixel.is_none() => self.pixel = pixel(file, found).unwrap_or_default(),
            // Version and flags; the size of all samples, or 0; how many.
            b"stsz" => self.count(word(file, found.content + 8)?, file_bytes)?,
            b"trun" => self.count(word(file, found.content + 4)?, file_bytes)?,
            _ => {}
        }
        Ok(())
    }

    fn count(&mut self, samples: u32, file_bytes: u64) -> io::Result<()> {
        self.samples += u64::from(samples);
        if self.samples > file_bytes.min(MAX_SAMPLES) {
            return Err(damage("its tables state more samples than it can hold"));
        }
        Ok(())
    }
}

/// The box at a place inside its parent; `None` at the parent's end.
fn next(file: &mut (impl Read + Seek), at: u64, end: u64) -> io::Result<Option<Boxed>> {
    if at == end {
        return Ok(None);
    }
    let (short, name) = (word(file, at)?, word(file, at + 4)?.to_be_bytes());
    let (content, bytes) = match short {
        1 => {
            let high = u64::from(word(file, at + 8)?) << 32;
            (at + 16, high | u64::from(word(file, at + 12)?))
        }
        n => (at + 8, u64::from(n)),
    };
    let last = at.checked_add(bytes).filter(|last| *last >= content);
    match last.filter(|last| *last <= end) {
        Some(last) => Ok(Some(Boxed {
            name,
            name_at: at + 4,
            content,
            end: last,
        })),
        None => Err(damage("a box of it has a size that cannot be")),
    }
}

/// Whether a track holds pictures: what its handler says.
fn shows(file: &mut (impl Read + Seek), track: &Boxed) -> io::Result<bool> {
    let Some(media) = child(file, track, b"mdia")? else {
        return Ok(true);
    };
    match child(file, &media, b"hdlr")? {
        Some(handler) => Ok(word(file, handler.content + 8)?.to_be_bytes() == *b"vide"),
        None => Ok(true),
    }
}

/// Width and height of the pixels of H.264, from the table of a track's formats.
fn pixel(file: &mut (impl Read + Seek), formats: &Boxed) -> io::Result<Option<(u32, u32)>> {
    // Version and flags; how many.
    let first = next(file, formats.content + 8, formats.end)?;
    let Some(format) = first.filter(|f| [*b"avc1", *b"avc3"].contains(&f.name)) else {
        return Ok(None);
    };
    let inside = Boxed {
        content: format.content + PICTURE_FORMAT_BYTES,
        ..format
    };
    match child(file, &inside, b"pasp")? {
        Some(shape) => Ok(Some((
            word(file, shape.content)?,
            word(file, shape.content + 4)?,
        ))),
        None => Ok(None),
    }
}

fn child(
    file: &mut (impl Read + Seek),
    parent: &Boxed,
    name: &[u8; 4],
) -> io::Result<Option<Boxed>> {
    let mut at = parent.content;
    while let Some(found) = next(file, at, parent.end)? {
        if found.name == *name {
            return Ok(Some(found));
        }
        at = found.end;
    }
    Ok(None)
}

fn word(file: &mut (impl Read + Seek), at: u64) -> io::Result<u32> {
    let mut bytes = [0; 4];
    file.seek(SeekFrom::Start(at))?;
    file.read_exact(&mut bytes)?;
    Ok(u32::from_be_bytes(bytes))
}

fn damage(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// The file as the library gets it: some boxes have another name, and it may ask for so much only.
pub struct Guarded<R> {
    file: R,
    hidden: Vec<u64>,
    position: u64,
    /// Bytes that may be read yet; a seek costs [`SEEK`].
    left: u64,
}

/// What a seek costs: more than the bytes of most boxes, of which each is sought a few times.
const SEEK: u64 = 64;
/// Most that a file may cost, seconds of work.
const MOST: u64 = 1 << 30;

impl<R: Read + Seek> Guarded<R> {
    /// Stands at the start of the file.
    ///
    /// # Errors
    /// Of seeking.
    pub fn new(mut file: R, walk: Walk, file_bytes: u64) -> io::Result<Self> {
        file.rewind()?;
        Ok(Self {
            file,
            hidden: walk.hidden,
            position: 0,
            left: (1 << 20) + file_bytes.saturating_mul(SEEK).min(MOST),
        })
    }

    fn spend(&mut self, cost: u64) -> io::Result<()> {
        self.left = self
            .left
            .checked_sub(cost)
            .ok_or_else(|| damage("its boxes lead in a circle"))?;
        Ok(())
    }
}

impl<R: Read + Seek> Read for Guarded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.file.read(buffer)?;
        self.spend(1 + n as u64)?;
        let (from, to) = (self.position, self.position + n as u64);
        let first = self.hidden.partition_point(|at| *at + 4 <= from);
        for at in self.hidden[first..].iter().take_while(|at| **at < to) {
            for (k, letter) in HIDDEN.iter().enumerate() {
                let place = at + k as u64;
                if (from..to).contains(&place) {
                    buffer[(place - from) as usize] = *letter;
                }
            }
        }
        self.position = to;
        Ok(n)
    }
}

impl<R: Read + Seek> Seek for Guarded<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.spend(SEEK)?;
        self.position = self.file.seek(to)?;
        Ok(self.position)
    }

    fn stream_position(&mut self) -> io::Result<u64> {
        self.spend(1)?;
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn boxed(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
        let bytes = (8 + content.len() as u32).to_be_bytes();
        [&bytes[..], name, content].concat()
    }

    fn track(handler: &[u8; 4], size: u32, samples: u32) -> Vec<u8> {
        let table = [0, size, samples].map(u32::to_be_bytes).concat();
        let table = boxed(b"minf", &boxed(b"stbl", &boxed(b"stsz", &table)));
        let handler = boxed(b"hdlr", &[&[0; 8], &handler[..]].concat());
        boxed(b"trak", &boxed(b"mdia", &[handler, table].concat()))
    }

    fn walk(file: &[u8]) -> io::Result<Walk> {
        Walk::through(&mut Cursor::new(file), file.len() as u64)
    }

    fn said(file: &[u8]) -> String {
        walk(file).unwrap_err().to_string()
    }

    #[test]
    fn a_film_passes_and_what_it_does_not_need_is_hidden() {
        let title = boxed(b"udta", &boxed(b"meta", b"anything at all"));
        let tracks = [track(b"vide", 0, 12), track(b"soun", 4, u32::MAX), title];
        let film = [
            boxed(b"ftyp", b"isom\0\0\0\0"),
            boxed(b"moov", &tracks.concat()),
            boxed(b"mdat", &[7; 300]),
        ];
        let film = film.concat();
        let found = walk(&film).unwrap();
        assert_eq!((found.hidden.len(), found.samples), (2, 12));
        let mut through = Vec::new();
        let mut guarded = Guarded::new(Cursor::new(&film), found, film.len() as u64).unwrap();
        guarded.read_to_end(&mut through).unwrap();
        let changed = film.iter().zip(&through).filter(|(a, b)| a != b).count();
        assert!((1..=8).contains(&changed), "{changed} bytes");
        let names = |name: &[u8]| through.windows(4).filter(|w| *w == name).count();
        assert_eq!([names(b"free"), names(b"trak"), names(b"udta")], [2, 1, 0]);
    }

    #[test]
    fn the_shape_of_pixels_is_found_behind_the_format_and_damage_there_is_none() {
        let shape = boxed(b"pasp", &[64, 45].map(u32::to_be_bytes).concat());
        let config = boxed(b"avcC", b"sets");
        let film = |format: &[u8]| {
            let formats = [&[0; 8][..], format].concat();
            let tables = boxed(b"stbl", &boxed(b"stsd", &formats));
            let handler = boxed(b"hdlr", &[&[0; 8], &b"vide"[..]].concat());
            let media = [handler, boxed(b"minf", &tables)].concat();
            boxed(b"moov", &boxed(b"trak", &boxed(b"mdia", &media)))
        };
        let avc = |inside: &[u8]| boxed(b"avc1", &[&[0; 78][..], inside].concat());
        let found = |format: &[u8]| walk(&film(format)).unwrap().pixel();
        assert_eq!(
            found(&avc(&[config.clone(), shape.clone()].concat())),
            Some((64, 45))
        );
        assert_eq!(found(&avc(&config)), None);
        assert_eq!(found(&boxed(b"mp4a", &shape)), None);
        for damaged in [
            &b""[..],
            b"avc1",
            &boxed(b"avc1", &[0; 20]),
            &avc(&shape[..10]),
        ] {
            assert_eq!(found(damaged), None);
        }
    }

    #[test]
    fn the_last_box_may_be_cut_off_or_go_on_to_the_end() {
        let whole = [
            boxed(b"moov", &track(b"vide", 0, 3)),
            boxed(b"mdat", &[7; 300]),
        ]
        .concat();
        let found = walk(&whole[..whole.len() - 200]).unwrap();
        assert_eq!((found.end(), found.samples), (whole.len() as u64, 3));
        // Inside the name of a box.
        assert_eq!(
            walk(&[&whole[..], b"\0\0\0\x20mo"].concat()).unwrap().end(),
            whole.len() as u64
        );
        let open = [boxed(b"moov", &[]), b"\0\0\0\0mdat and so on".to_vec()].concat();
        assert_eq!(walk(&open).unwrap().end(), 8);
    }

    #[test]
    fn a_fragment_that_is_cut_off_is_hidden_and_tables_of_the_whole_film_are_not() {
        let run = [0, 2, 9, 9].map(u32::to_be_bytes).concat();
        let fragment = boxed(b"moof", &boxed(b"traf", &boxed(b"trun", &run)));
        let film = [boxed(b"moov", &track(b"vide", 0, 3)), fragment].concat();
        let whole = walk(&film).unwrap();
        assert!(!whole.is_fragment_cut() && whole.hidden.is_empty());
        for cut in 1..30 {
            let found = walk(&film[..film.len() - cut]).unwrap();
            assert!(found.is_fragment_cut(), "{cut} bytes less");
            assert_eq!((found.hidden.len(), found.samples), (1, 3));
        }
        let moov = boxed(b"moov", &track(b"vide", 0, 3));
        let error = walk(&moov[..moov.len() - 8]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }

    #[test]
    fn boxes_that_cannot_be_are_refused() {
        for bytes in [0_u32, 7, 500] {
            let inner = [&bytes.to_be_bytes(), b"tkhd", &[0; 32][..]].concat();
            let film = boxed(b"moov", &boxed(b"trak", &inner));
            assert!(said(&film).contains("a size that cannot be"), "{bytes}");
        }
        let huge = [&1_u32.to_be_bytes()[..], b"trak", &u64::MAX.to_be_bytes()];
        assert!(said(&boxed(b"moov", &huge.concat())).contains("a size that cannot be"));
        let deep = (0..20).fold(Vec::new(), |inside, _| boxed(b"moof", &inside));
        assert!(said(&deep).contains("without end"));
    }

    #[test]
    fn more_samples_than_bytes_are_refused() {
        let film = boxed(b"moov", &track(b"vide", 1, u32::MAX));
        assert!(said(&film).contains("more samples than it can hold"));
        let run = [0, u32::MAX].map(u32::to_be_bytes).concat();
        let film = boxed(b"moof", &boxed(b"traf", &boxed(b"trun", &run)));
        assert!(said(&film).contains("more samples than it can hold"));
    }

    #[test]
    fn a_reader_in_a_circle_is_stopped() {
        let film = boxed(b"moov", &[0; 64]);
        let bytes = film.len() as u64;
        let mut guarded = Guarded::new(Cursor::new(film), Walk::default(), bytes).unwrap();
        let stopped = (0..100_000).find_map(|_| guarded.seek(SeekFrom::Start(8)).err());
        assert!(stopped.unwrap().to_string().contains("in a circle"));
    }
}

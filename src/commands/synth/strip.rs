//! Frames in order, rendered batch by batch on every core, up to where their film is full.

use std::io::{self, Seek, Write};
use std::ops::Range;
use std::path::Path;

use anyhow::{Error, Result};
use rayon::prelude::*;

use crate::capture::AviWriter;
use crate::commands::exit::Failure;
use crate::counted::counted;
use crate::lab::synth::TruthFrame;

/// Frames rendered before they are written: bounds memory, keeps every core busy.
const BATCH: u64 = 32;

/// Renders frames 0 to `wanted`, each a JPEG and what is true about it, and appends them to the film, where there is
/// one, as long as it has room: what is true about those that are in it. `failed` gives another failure its words.
///
/// # Errors
/// When a frame cannot be made or written.
pub(super) fn render<W: Write + Seek>(
    wanted: u64,
    mut film: Option<&mut AviWriter<W>>,
    one: impl Fn(u64) -> Result<(Vec<u8>, TruthFrame)> + Sync,
    failed: impl Fn(io::Error) -> Failure,
) -> Result<(Vec<TruthFrame>, Room)> {
    let mut frames = Vec::with_capacity(wanted as usize);
    let mut room = Room {
        taken: 0,
        rendered: 0,
        wanted,
        full: None,
    };
    while room.full.is_none() && room.rendered < wanted {
        let batch = room.rendered..wanted.min(room.rendered + BATCH);
        room.rendered = batch.end;
        let batch: Vec<_> = batch.into_par_iter().map(&one).collect::<Result<_>>()?;
        for (picture, known) in batch {
            let append = |film: &mut &mut AviWriter<W>| film.write_jpeg(&picture);
            match film.as_mut().map_or(Ok(()), append) {
                Ok(()) => frames.push(known),
                Err(e) if e.kind() == io::ErrorKind::FileTooLarge => {
                    room.full = Some(e);
                    break;
                }
                Err(e) => return Err(failed(e).into()),
            }
        }
        room.taken = frames.len() as u64;
    }
    Ok((frames, room))
}

/// How many frames a film took, and why no more.
#[derive(Debug)]
pub(super) struct Room {
    taken: u64,
    rendered: u64,
    wanted: u64,
    full: Option<io::Error>,
}

impl Room {
    /// Frames that were rendered and found no room.
    pub(super) fn beyond(&self) -> Range<u64> {
        self.taken..self.rendered
    }

    /// Says of a film that was full, once what there is of it is whole.
    ///
    /// # Errors
    /// Where it was full.
    pub(super) fn ended(self, film: &Path) -> Result<()> {
        let Some(full) = self.full else {
            return Ok(());
        };
        let taken = counted(self.taken, "frame", "frames");
        Err(Error::from(full).context(format!(
            "{}: full after {taken} of {}, which are there with what is true about them; ask for fewer --frames, \
             smaller pictures or a lower --quality",
            film.display(),
            self.wanted
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::exit;
    use crate::lab::synth::demo;

    /// Knows how long it is, and nothing else.
    #[derive(Default)]
    struct Nowhere {
        at: u64,
        end: u64,
    }

    impl Write for Nowhere {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.at += bytes.len() as u64;
            self.end = self.end.max(self.at);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Nowhere {
        fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
            self.at = match to {
                io::SeekFrom::Start(at) => at,
                io::SeekFrom::End(by) => self.end.saturating_add_signed(by),
                io::SeekFrom::Current(by) => self.at.saturating_add_signed(by),
            };
            Ok(self.at)
        }
    }

    #[test]
    fn a_full_film_ends_with_the_frames_that_found_room() {
        const PICTURE: usize = 8 << 20;
        let known = demo::truth().frames.swap_remove(0);
        let one = |k: u64| {
            let frame = TruthFrame {
                frame: k,
                ..known.clone()
            };
            Ok((vec![0; PICTURE], frame))
        };
        let path = Path::new("long.avi");
        let film = |wanted: u64| {
            let mut film = AviWriter::new(Nowhere::default(), 64, 48, (15, 1)).unwrap();
            let failed = |e: io::Error| Failure::output(path, &e);
            let (frames, room) = render(wanted, Some(&mut film), one, failed).unwrap();
            (frames, room, film.finish().unwrap().end)
        };
        let (frames, room, bytes) = film(200);
        let numbers = frames.iter().map(|f| f.frame);
        assert!(numbers.eq(0..127), "in order, and none left out");
        assert_eq!(room.beyond(), 127..128);
        assert!(bytes > 127 * PICTURE as u64 && bytes < 1 << 30, "{bytes}");
        let said = room.ended(path).unwrap_err();
        let line = exit::told(&said);
        assert!(
            line.starts_with("long.avi: full after 127 frames of 200")
                && !line.contains("writable"),
            "{line}"
        );
        assert_eq!(exit::code(&said), exit::IO);
        let (frames, room, _) = film(40);
        assert_eq!((frames.len(), room.beyond()), (40, 40..40));
        room.ended(path).unwrap();
    }
}

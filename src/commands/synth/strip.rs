//! Frames in order, made batch by batch on every core, up to where their film or their truth is full or the user stops
//! it.

use std::io::{self, Seek, Write};
use std::ops::Range;
use std::path::Path;

use anyhow::{Error, Result};
use rayon::prelude::*;
use serde::Serialize;

use crate::capture::AviWriter;
use crate::commands::exit::Failure;
use crate::counted::counted;
use crate::lab::synth::frames::FrameWriter;
use crate::output::is_full;

/// Fewest frames made before they are written: bounds memory, keeps every core busy.
const BATCH: u64 = 32;
/// Fewest of them for each core, so that it seldom waits for the others' last ones.
const BATCH_OF_A_CORE: u64 = 8;

/// What frames are written into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// Their pictures.
    Film,
    /// What is true about them.
    Truth,
}

/// Makes frames 0 to `wanted`, each a JPEG and what is true about it, and appends them to the film, where there is one,
/// and to the truth, as long as both have room and the user has not stopped it; `taken` hears of each that is there.
/// `failed` gives another failure its words.
///
/// # Errors
/// When a frame cannot be made or written, or it was stopped before the first.
pub(super) fn render<W: Write + Seek, F: Serialize + Send>(
    wanted: u64,
    mut film: Option<&mut AviWriter<W>>,
    truth: &mut FrameWriter<impl Write>,
    one: impl Fn(u64) -> Result<(Vec<u8>, F)> + Sync,
    mut taken: impl FnMut(&F) -> Result<()>,
    is_stopped: &Stopped<'_>,
    failed: impl Fn(Part, io::Error) -> Failure,
) -> Result<Room> {
    let batch = BATCH.max(BATCH_OF_A_CORE * rayon::current_num_threads() as u64);
    let mut room = Room {
        taken: 0,
        rendered: 0,
        wanted,
        full: None,
        is_stopped: false,
    };
    let mut append = |picture: &[u8], known: &F| {
        let line = truth.line(known).map_err(|e| (Part::Truth, e))?;
        if let Some(film) = &mut film {
            film.write_jpeg(picture).map_err(|e| (Part::Film, e))?;
        }
        truth.add(&line).map_err(|e| (Part::Truth, e))
    };
    let unless_stopped = |k: u64| match is_stopped() {
        true => Ok(None),
        false => one(k).map(Some),
    };
    while room.full.is_none() && !room.is_stopped && room.rendered < wanted {
        let batch = room.rendered..wanted.min(room.rendered + batch);
        room.rendered = batch.end;
        let batch = batch.into_par_iter().map(unless_stopped);
        let batch: Vec<_> = batch.collect::<Result<_>>()?;
        for made in batch {
            let Some((picture, known)) = made else {
                room.is_stopped = true;
                break;
            };
            match append(&picture, &known) {
                Ok(()) => taken(&known)?,
                Err((part, e)) if is_full(&e) => {
                    room.full = Some((part, e));
                    break;
                }
                Err((part, e)) => return Err(failed(part, e).into()),
            }
            room.taken += 1;
        }
    }
    if room.is_stopped && room.taken == 0 {
        return Err(Failure::stopped(0).into());
    }
    Ok(room)
}

/// Whether the user wants no more frames.
pub(super) type Stopped<'a> = dyn Fn() -> bool + Sync + 'a;

/// How many frames a film and its truth took, and why no more.
#[derive(Debug)]
pub(super) struct Room {
    taken: u64,
    rendered: u64,
    wanted: u64,
    full: Option<(Part, io::Error)>,
    is_stopped: bool,
}

impl Room {
    /// Frames that are there.
    pub(super) fn taken(&self) -> u64 {
        self.taken
    }

    /// Whether the user stopped it.
    pub(super) fn is_stopped(&self) -> bool {
        self.is_stopped
    }

    /// Frames that may have been rendered and are not there.
    pub(super) fn beyond(&self) -> Range<u64> {
        self.taken..self.rendered
    }

    /// Says of a film or a truth that was full, or that the user stopped it, once what there is of both is whole.
    ///
    /// # Errors
    /// Where one was full, or it was stopped.
    pub(super) fn ended(self, film: &Path, truth: &Path) -> Result<()> {
        if self.is_stopped {
            return Err(Failure::stopped(self.taken).into());
        }
        let Some((part, full)) = self.full else {
            return Ok(());
        };
        let taken = counted(self.taken, "frame", "frames");
        let (path, less) = match part {
            Part::Film => (
                film,
                "fewer --frames, smaller pictures or a lower --quality",
            ),
            Part::Truth => (truth, "fewer --frames or --people"),
        };
        Err(Error::from(full).context(format!(
            "{}: full after {taken} of {}, which are there with what is true about them; ask for {less}",
            path.display(),
            self.wanted
        )))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;
    use crate::commands::exit;
    use crate::lab::synth::{Truth, TruthFrame, demo};

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
        let beside = Path::new("long.truth.json");
        let failed = |_: Part, e: io::Error| Failure::output(path, &e);
        // Batches are as long as on two cores.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2);
        let pool = pool.build().unwrap();
        let head = Truth {
            frames: Vec::new(),
            ..demo::truth()
        };
        let head = head.head();
        let film = |wanted: u64| {
            let mut film = AviWriter::new(Nowhere::default(), 64, 48, (15, 1)).unwrap();
            let mut truth = FrameWriter::new(Vec::new(), &head, u64::MAX).unwrap();
            let mut heard = Vec::new();
            let taken = |f: &TruthFrame| {
                heard.push(f.frame);
                Ok(())
            };
            let room = pool.install(|| {
                let film = Some(&mut film);
                render(wanted, film, &mut truth, one, taken, &|| false, failed)
            });
            let text = String::from_utf8(truth.finish().unwrap()).unwrap();
            let frames = Truth::parse(&text, "t").unwrap().frames;
            assert!(frames.iter().map(|f| f.frame).eq(heard));
            (frames, room.unwrap(), film.finish().unwrap().end)
        };
        let (frames, room, bytes) = film(200);
        let numbers = frames.iter().map(|f| f.frame);
        assert!(numbers.eq(0..127), "in order, and none left out");
        assert_eq!((room.taken(), room.beyond()), (127, 127..128));
        assert!(bytes > 127 * PICTURE as u64 && bytes < 1 << 30, "{bytes}");
        let said = room.ended(path, beside).unwrap_err();
        let line = exit::told(&said);
        assert!(
            line.starts_with("long.avi: full after 127 frames of 200")
                && !line.contains("writable"),
            "{line}"
        );
        assert_eq!(exit::code(&said), exit::IO);
        let (frames, room, _) = film(40);
        assert_eq!((frames.len(), room.beyond()), (40, 40..40));
        room.ended(path, beside).unwrap();
    }

    #[test]
    fn a_film_has_no_more_frames_than_its_truth() {
        let known = demo::truth();
        let one = |k: u64| Ok((vec![0; 64], known.frames[k as usize].clone()));
        let (path, beside) = (Path::new("a.avi"), Path::new("a.truth.json"));
        let most = known.to_text().len() as u64 / 2;
        let mut film = AviWriter::new(Nowhere::default(), 64, 48, (15, 1)).unwrap();
        let mut truth = FrameWriter::new(Vec::new(), &known.head(), most).unwrap();
        let wanted = known.frames.len() as u64;
        let failed = |_: Part, e: io::Error| Failure::output(path, &e);
        let strip = Some(&mut film);
        let room = render(
            wanted,
            strip,
            &mut truth,
            one,
            |_| Ok(()),
            &|| false,
            failed,
        )
        .unwrap();
        let taken = room.taken();
        assert!((wanted / 4..wanted).contains(&taken), "{taken} of {wanted}");
        let text = String::from_utf8(truth.finish().unwrap()).unwrap();
        let frames = Truth::parse(&text, "t").unwrap().frames;
        assert_eq!(frames, known.frames[..taken as usize]);
        // Headers, and for each picture its 64 bytes, 8 before them and 16 in the index.
        assert_eq!(film.finish().unwrap().end, 232 + 88 * taken);
        let said = room.ended(path, beside).unwrap_err();
        let line = exit::told(&said);
        let expected = format!("a.truth.json: full after {taken} frames of {wanted}");
        assert!(
            line.starts_with(&expected) && line.contains("--people"),
            "{line}"
        );
        assert_eq!(exit::code(&said), exit::IO);
    }

    #[test]
    fn what_is_there_when_it_is_stopped_is_whole() {
        let known = demo::truth();
        let (path, beside) = (Path::new("a.avi"), Path::new("a.truth.json"));
        let one = |k: u64| {
            let frame = TruthFrame {
                frame: k,
                ..known.frames[0].clone()
            };
            Ok((vec![0; 64], frame))
        };
        let failed = |_: Part, e: io::Error| Failure::output(path, &e);
        // Batches are as long as on two cores.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2);
        let pool = pool.build().unwrap();
        let film = |last: Option<u64>| {
            let is_over = AtomicBool::new(last.is_none());
            let mut film = AviWriter::new(Nowhere::default(), 64, 48, (15, 1)).unwrap();
            let mut truth = FrameWriter::new(Vec::new(), &known.head(), u64::MAX).unwrap();
            let taken = |f: &TruthFrame| {
                is_over.fetch_or(Some(f.frame) == last, Ordering::Relaxed);
                Ok(())
            };
            let is_stopped = || is_over.load(Ordering::Relaxed);
            let room = pool.install(|| {
                let film = Some(&mut film);
                render(100, film, &mut truth, one, taken, &is_stopped, failed)
            });
            let text = String::from_utf8(truth.finish().unwrap()).unwrap();
            let frames = Truth::parse(&text, "t").unwrap().frames;
            (frames, room, film.finish().unwrap().end)
        };
        let (frames, room, bytes) = film(Some(BATCH - 1));
        assert!(frames.iter().map(|f| f.frame).eq(0..BATCH));
        // Headers, and for each picture its 64 bytes, 8 before them and 16 in the index.
        assert_eq!(bytes, 232 + 88 * BATCH);
        let room = room.unwrap();
        assert_eq!((room.taken(), room.beyond()), (BATCH, BATCH..2 * BATCH));
        let said = room.ended(path, beside).unwrap_err();
        assert!(exit::told(&said).contains("stopped after 32 frames"));
        assert_eq!(exit::code(&said), exit::INTERRUPTED);
        let said = film(None).1.unwrap_err();
        assert!(exit::told(&said).contains("nothing was written"));
        assert_eq!(exit::code(&said), exit::INTERRUPTED);
        // What is done when it is stopped is whole.
        let (frames, room, _) = film(Some(99));
        assert_eq!(frames.len(), 100);
        room.unwrap().ended(path, beside).unwrap();
    }
}

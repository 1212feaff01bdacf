//! Masks of films of cameras that stand still: what differs from where nobody is, near whom the views saw.

use std::io;
use std::path::{Path, PathBuf};

use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use rayon::prelude::*;

use super::masks::{MaskFolder, expect_in_step};
use super::read::Scene;
use super::store::Store;
use crate::camera::View;
use crate::capture::{Frame, InputSpec, OpenOptions, Source, open};
use crate::commands::exit::Failure;
use crate::commands::progress;
use crate::commands::views::{names, told};
use crate::multiview::{Background, Detections, Figure, Small, UNKNOWN, mask, squares};

/// Pictures of a film from which its background is learned, at most.
const SAMPLES: usize = 31;

/// What to do about a film that is another.
const AS_SEEN: &str = "give the film that was looked at";

/// Makes the masks of every camera whose film is known, as far as they are not in the store.
///
/// # Errors
/// When a film cannot be read or is not what the view saw.
pub fn masks(
    films: &[Option<PathBuf>],
    scene: &Scene,
    store: &Store,
) -> anyhow::Result<MaskFolder> {
    let bar = progress::bar(scene.frames.len() as u64, "masks");
    let known = films.iter().flatten().count() as u64;
    bar.set_length(known * scene.frames.len() as u64);
    let each = films.par_iter().enumerate();
    each.try_for_each(|(v, film)| -> anyhow::Result<()> {
        let Some(film) = film else {
            return Ok(());
        };
        let (out, are_there) = store.masks(v)?;
        if are_there {
            bar.inc(scene.frames.len() as u64);
            return Ok(());
        }
        let view = Film {
            path: film,
            number: v,
            scene,
        };
        let background = view.background()?;
        view.each(&mut |k, frame| {
            let size = [frame.width, frame.height];
            let figures = view.figures(k);
            let small = Small::new(size, &frame.rgb);
            // Without a mask a frame is fitted by its joints.
            if let Some(differing) = background.differs(&small, &figures) {
                let owners = mask(size, &differing, &figures).owners;
                write(&out.join(format!("{k:06}.png")), size, &owners)?;
            }
            bar.inc(1);
            Ok(())
        })?;
        store.masks_are_whole(v);
        Ok(())
    })?;
    bar.finish_and_clear();
    let wanted = films.iter().map(Option::is_some).collect();
    let made = store.all_masks();
    Ok(MaskFolder::made(&made, scene, wanted, UNKNOWN))
}

/// The film of every view, as given or as its own file; of those that are not `used` no mask is asked for.
///
/// # Errors
/// When there is no film, one is not there or is given for a camera that is not used, or the views' frames are not the
/// films'.
pub fn films(
    given: &[String],
    scene: &Scene,
    used: &[bool],
) -> anyhow::Result<Vec<Option<PathBuf>>> {
    expect_in_step(scene)?;
    let mut films = scene.films.clone();
    let with_use = scene.views.iter().zip(used).filter(|(_, used)| **used);
    let wanted: Vec<View> = with_use.map(|(view, _)| view.clone()).collect();
    let wanted = names(&wanted);
    for text in given {
        let wrong = |found: &str| {
            Failure::usage(format!(
                "expected --film CAMERA=FILE with one of the cameras {wanted}, found {found}"
            ))
        };
        let (name, file) = told(text).ok_or_else(|| wrong(text))?;
        let v = scene.views.iter().position(|v| v.name == name);
        let (v, file) = (v.ok_or_else(|| wrong(name))?, PathBuf::from(file));
        if !used[v] {
            return Err(wrong(&format!("{name}, which is held out")).into());
        }
        std::fs::metadata(&file).map_err(|e| Failure::no_input(&file, &e))?;
        films[v] = Some(file);
    }
    for (film, _) in films.iter_mut().zip(used).filter(|(_, used)| !**used) {
        *film = None;
    }
    if films.iter().all(Option::is_none) {
        return Err(Failure::usage(format!(
            "expected films where there is --masks background, found records alone; give films as --view, or --film CAMERA=FILE for {wanted}"
        ))
        .into());
    }
    Ok(films)
}

/// One view's film.
struct Film<'a> {
    path: &'a Path,
    number: usize,
    scene: &'a Scene,
}

impl Film<'_> {
    fn open(&self) -> anyhow::Result<Box<dyn Source>> {
        Ok(open(
            &InputSpec::Path(self.path.to_owned()),
            &OpenOptions::default(),
        )?)
    }

    /// Hears every picture of a frame of the scene; frames of pictures that the film repeats or that cannot be read
    /// have none.
    fn each(
        &self,
        hear: &mut dyn FnMut(usize, &Frame) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let (mut source, mut frame) = (self.open()?, Frame::default());
        let numbers = &self.scene.pictures[self.number];
        let count = self.scene.frames.len();
        let mut k = 0;
        while k < count {
            match source.next_into(&mut frame) {
                Ok(true) => {
                    self.expect_size(&frame)?;
                    let is_before = |k: usize| numbers.get(k).is_some_and(|n| *n < frame.sequence);
                    while k < count && is_before(k) {
                        k += 1;
                    }
                    // Without numbers the pictures that can be read are the frames.
                    if k < count && numbers.get(k).is_none_or(|n| *n == frame.sequence) {
                        hear(k, &frame)?;
                        k += 1;
                    }
                }
                Ok(false) => return Err(self.unlike(&format!("{k} frames"), AS_SEEN)),
                Err(e) if e.is_skippable() => {}
                Err(e) => return Err(e.into()),
            }
        }
        Ok(())
    }

    fn expect_size(&self, frame: &Frame) -> anyhow::Result<()> {
        let (wanted, [w, h]) = (
            self.scene.views[self.number].size,
            [frame.width, frame.height],
        );
        if wanted == [w, h] {
            return Ok(());
        }
        let found = format!("pictures of {w}x{h} pixels");
        Err(match wanted == [h, w] {
            true => self.unlike(
                &format!("{found}, turned by 90 degrees"),
                "turn the film by ffmpeg as 'infer --rotate' turned its pictures",
            ),
            false => self.unlike(&found, AS_SEEN),
        })
    }

    fn unlike(&self, found: &str, advice: &str) -> anyhow::Error {
        let view = &self.scene.views[self.number];
        Failure::data(format!(
            "{}: expected the film of camera {} with {} frames of {}x{} pixels, found {found}; {advice}",
            self.path.display(),
            view.name,
            self.scene.frames.len(),
            view.size[0],
            view.size[1]
        ))
        .into()
    }

    /// Who was seen in a frame, in the small picture.
    fn figures(&self, frame: usize) -> Vec<Figure> {
        figures(
            &self.scene.frames[frame][self.number],
            self.scene.views[self.number].size,
        )
    }

    /// What is behind people, from pictures spread over the film.
    fn background(&self) -> anyhow::Result<Background> {
        let count = self.scene.frames.len();
        let wanted = |k: usize| {
            // As many of the first frames as of the last.
            let samples = SAMPLES.min(count);
            (k * samples) / count != ((k + 1) * samples) / count
        };
        let mut samples = Vec::new();
        self.each(&mut |k, frame| {
            if wanted(k) {
                let small = Small::new([frame.width, frame.height], &frame.rgb);
                samples.push((small, self.figures(k)));
            }
            Ok(())
        })?;
        Ok(Background::learn(&samples))
    }
}

fn figures(seen: &Detections, size: [u32; 2]) -> Vec<Figure> {
    let by = squares(size) as f64;
    let each = seen.iter().filter_map(Figure::of);
    each.map(|f| f.shrunk(by)).collect()
}

fn write(path: &Path, size: [u32; 2], owners: &[u8]) -> Result<(), Failure> {
    png(path, size, owners).map_err(|e| Failure::output(path, &e))
}

fn png(path: &Path, [width, height]: [u32; 2], owners: &[u8]) -> io::Result<()> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::NoFilter)
        .write_image(owners, width, height, image::ExtendedColorType::L8)
        .map_err(io::Error::other)?;
    std::fs::write(path, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::AviWriter;
    use crate::commands::exit::{CANNOT_CREATE, IO, USAGE, code};

    /// Of one camera, in which nobody is seen.
    fn scene(size: [u32; 2], frames: usize) -> Scene {
        Scene {
            views: vec![View {
                size,
                ..View::around(0.0)
            }],
            films: vec![None],
            are_whole: true,
            frames: vec![vec![Vec::new()]; frames],
            times: vec![0; frames],
            pictures: vec![Vec::new()],
            of_machine: false,
            rate: 30.0,
            offsets: vec![None],
            in_step: true,
            in_world: false,
            notes: Vec::new(),
        }
    }

    /// Of a picture that cannot be read `infer` writes no row, and counts it.
    #[test]
    fn frames_are_of_the_pictures_of_their_numbers() {
        const SIZE: [u32; 2] = [32, 16];
        let file = tempfile::Builder::new().suffix(".avi").tempfile().unwrap();
        let mut avi = AviWriter::new(file.as_file(), SIZE[0], SIZE[1], (30, 1)).unwrap();
        for level in [Some(40), None, Some(120), Some(200)] {
            let mut bytes = Vec::new();
            match level {
                Some(level) => image::codecs::jpeg::JpegEncoder::new(&mut bytes)
                    .write_image(
                        &[level; 3 * 32 * 16],
                        32,
                        16,
                        image::ExtendedColorType::Rgb8,
                    )
                    .unwrap(),
                None => bytes.resize(300, 0),
            }
            avi.write_jpeg(&bytes).unwrap();
        }
        avi.finish().unwrap();
        let heard = |frames: usize, numbers: &[u64]| {
            let mut scene = scene(SIZE, frames);
            scene.pictures = vec![numbers.to_vec()];
            let film = Film {
                path: file.path(),
                number: 0,
                scene: &scene,
            };
            let mut levels = Vec::new();
            let outcome = film.each(&mut |k, frame| {
                levels.push((k, frame.rgb[0]));
                Ok(())
            });
            (levels, outcome.map_err(|e| e.to_string()))
        };
        for (frames, numbers, wanted) in [
            (3, &[][..], &[(0, 40), (1, 120), (2, 200)][..]),
            (3, &[0, 2, 3], &[(0, 40), (1, 120), (2, 200)]),
            (4, &[0, 1, 2, 3], &[(0, 40), (2, 120), (3, 200)]),
            (3, &[0, 1, 2, 3], &[(0, 40), (2, 120)]),
            (2, &[2, 3], &[(0, 120), (1, 200)]),
            // The shorter of the views ends with a picture that cannot be read.
            (2, &[0, 1, 2, 3], &[(0, 40)]),
        ] {
            let (heard, outcome) = heard(frames, numbers);
            assert_eq!(outcome, Ok(()), "{numbers:?}");
            let is_near = |((k, level), (of, wanted)): (&(usize, u8), &(usize, u8))| {
                k == of && level.abs_diff(*wanted) < 3
            };
            assert_eq!(heard.len(), wanted.len(), "{numbers:?}: {heard:?}");
            assert!(
                heard.iter().zip(wanted).all(is_near),
                "{numbers:?}: {heard:?}"
            );
        }
        let short = heard(4, &[]).1.unwrap_err();
        assert!(
            short.contains("4 frames") && short.contains("found 3 frames"),
            "{short}"
        );
    }

    #[test]
    fn films_are_asked_for_of_cameras_that_count_alone() {
        let mut scene = scene([320, 240], 1);
        scene.views = ["a", "c"]
            .map(|name| View {
                name: name.to_owned(),
                ..View::around(0.0)
            })
            .to_vec();
        scene.films = vec![None; 2];
        let refused = |given: &[String]| {
            let e = films(given, &scene, &[true, false]).unwrap_err();
            assert_eq!(code(&e), USAGE, "{e}");
            e.to_string()
        };
        let held = refused(&["c=c.mp4".to_owned()]);
        assert!(held.contains("c, which is held out"), "{held}");
        let none = refused(&[]);
        assert!(none.ends_with("for a"), "{none}");
    }

    #[test]
    fn a_film_that_was_turned_before_it_was_looked_at_is_told_from_another() {
        let scene = scene([320, 240], 1);
        let film = Film {
            path: Path::new("cam01.mp4"),
            number: 0,
            scene: &scene,
        };
        let said = |width, height| {
            let picture = Frame {
                width,
                height,
                ..Frame::default()
            };
            film.expect_size(&picture).map_err(|e| e.to_string())
        };
        assert_eq!(said(320, 240), Ok(()));
        let turned = said(240, 320).unwrap_err();
        assert!(
            turned.contains("240x320") && turned.contains("'infer --rotate'"),
            "{turned}"
        );
        let other = said(640, 480).unwrap_err();
        assert!(
            other.contains("640x480") && !other.contains("turned"),
            "{other}"
        );
    }

    /// A disk that is full is told by its place, whichever write meets it.
    #[test]
    fn a_mask_that_cannot_be_written_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let inside = file.path().join("000000.png");
        let full = Path::new("/dev/full");
        for (path, side, expected) in [
            (inside.as_path(), 8, CANNOT_CREATE),
            (full, 8, IO),
            (full, 512, IO),
        ] {
            let owners: Vec<u8> = (0..side * side)
                .map(|k: u32| (k.wrapping_mul(0x9E37_79B1) >> 24) as u8)
                .collect();
            let failure = write(path, [side, side], &owners).unwrap_err();
            let line = failure.to_string();
            assert!(line.contains(&path.display().to_string()), "{line}");
            assert_eq!(code(&failure.into()), expected, "{line}");
        }
    }
}

//! Masks of films of cameras that stand still: what differs from where nobody is, near whom the views saw.

use std::io::Write;
use std::path::{Path, PathBuf};

use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use rayon::prelude::*;

use super::masks::{MaskFolder, expect_in_step};
use super::read::{Scene, names, told};
use super::store::Store;
use crate::capture::{Frame, InputSpec, OpenOptions, Source, open};
use crate::commands::exit::Failure;
use crate::commands::progress;
use crate::multiview::{Background, Detections, Figure, Small, UNKNOWN, mask, squares};

/// Pictures of a film from which its background is learned, at most.
const SAMPLES: usize = 31;

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

/// The film of every view, as given or as its own file.
///
/// # Errors
/// When there is no film, one is not there, or the views' frames are not the films'.
pub fn films(given: &[String], scene: &Scene) -> anyhow::Result<Vec<Option<PathBuf>>> {
    expect_in_step(scene)?;
    let mut films = scene.films.clone();
    for text in given {
        let wrong = |found: &str| {
            Failure::usage(format!(
                "expected --film CAMERA=FILE with one of the cameras {}, found {found}",
                names(&scene.views)
            ))
        };
        let (name, file) = told(text).ok_or_else(|| wrong(text))?;
        let v = scene.views.iter().position(|v| v.name == name);
        let (v, file) = (v.ok_or_else(|| wrong(name))?, PathBuf::from(file));
        std::fs::metadata(&file).map_err(|e| Failure::no_input(&file, &e))?;
        films[v] = Some(file);
    }
    if films.iter().all(Option::is_none) {
        return Err(Failure::usage(format!(
            "expected films where there is --masks background, found records alone; give films as --view, or --film CAMERA=FILE for {}",
            names(&scene.views)
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

    /// Hears every picture of a frame of the scene.
    fn each(
        &self,
        hear: &mut dyn FnMut(usize, &Frame) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let (mut source, mut frame) = (self.open()?, Frame::default());
        for k in 0..self.scene.frames.len() {
            if !source.next_into(&mut frame)? {
                return Err(self.unlike(format!("{k} frames")));
            }
            self.expect_size(&frame)?;
            hear(k, &frame)?;
        }
        Ok(())
    }

    fn expect_size(&self, frame: &Frame) -> anyhow::Result<()> {
        let size = [frame.width, frame.height];
        if size == self.scene.views[self.number].size {
            return Ok(());
        }
        Err(self.unlike(format!("pictures of {}x{} pixels", size[0], size[1])))
    }

    fn unlike(&self, found: String) -> anyhow::Error {
        let view = &self.scene.views[self.number];
        Failure::data(format!(
            "{}: expected the film of camera {} with {} frames of {}x{} pixels, found {found}; give the film that was looked at",
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

fn write(path: &Path, [width, height]: [u32; 2], owners: &[u8]) -> anyhow::Result<()> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::NoFilter)
        .write_image(owners, width, height, image::ExtendedColorType::L8)?;
    Ok(file.flush()?)
}

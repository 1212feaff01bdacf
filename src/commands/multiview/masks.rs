//! Masks of a folder, one picture a frame of a camera.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use super::read::Scene;
use crate::bounded;
use crate::commands::exit::Failure;
use crate::counted::counted;
use crate::multiview::{Mask, MultiviewReport};

/// Largest file of a mask, bytes.
const LARGEST: u64 = 64 << 20;

/// Refuses views whose frames are not those of their files.
///
/// # Errors
/// When views do not go frame by frame.
pub fn expect_in_step(scene: &Scene) -> anyhow::Result<()> {
    if scene.in_step {
        return Ok(());
    }
    Err(Failure::data(
        "expected the files' own frames where there are --masks, found views that do not go frame by frame, or lack frames; give --sync none if they are of one rate and started together",
    )
    .into())
}

/// The mask of a frame in a camera's folder.
fn of_frame(folder: &Path, frame: usize) -> PathBuf {
    folder.join(format!("{frame:06}.png"))
}

/// A folder with a folder of numbered masks a camera.
pub struct MaskFolder {
    /// By view.
    folders: Vec<PathBuf>,
    sizes: Vec<[u32; 2]>,
    /// By view, whether masks are to be made of it, or the user's folder has any.
    wanted: Vec<bool>,
    /// The value of pixels of which it is not known whose they are.
    unknown: Option<u8>,
    /// What was wrong with the first mask that could not be read.
    failed: Mutex<Option<Failure>>,
}

impl MaskFolder {
    /// Finds the masks of the scene's cameras.
    ///
    /// # Errors
    /// When there are none of any frame of any camera, or the views' frames are not the masks'.
    pub fn open(path: &Path, scene: &Scene) -> anyhow::Result<Self> {
        expect_in_step(scene)?;
        let views = &scene.views;
        let folders: Vec<PathBuf> = views.iter().map(|v| path.join(&v.name)).collect();
        if !folders.iter().any(|f| f.is_dir()) {
            let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
            return Err(Failure::data(format!(
                "expected a folder of masks in {} for one of the cameras {}, found none",
                path.display(),
                names.join(", ")
            ))
            .into());
        }
        let has_any =
            |folder: &PathBuf| (0..scene.frames.len()).any(|k| of_frame(folder, k).exists());
        let wanted: Vec<bool> = folders.iter().map(has_any).collect();
        if !wanted.contains(&true) {
            return Err(Failure::data(format!(
                "expected masks called like {}, one a frame, found none of {} of any camera in {}",
                of_frame(Path::new(&views[0].name), 0).display(),
                counted(scene.frames.len() as u64, "frame", "frames"),
                path.display()
            ))
            .into());
        }
        let found = Self {
            folders,
            sizes: views.iter().map(|v| v.size).collect(),
            wanted,
            unknown: None,
            failed: Mutex::new(None),
        };
        // Before minutes of work: what is wrong with one is mostly wrong with all.
        (0..views.len()).for_each(|view| drop(found.mask(0, view)));
        found.whole()?;
        Ok(found)
    }

    /// Masks that were made for the `wanted` of the scene's cameras, as many as could be, in folders that are called by
    /// the views' numbers; `unknown` is the value of pixels of which it is not known whose they are.
    pub fn made(path: &Path, scene: &Scene, wanted: Vec<bool>, unknown: u8) -> Self {
        Self {
            folders: (0..scene.views.len())
                .map(|v| path.join(v.to_string()))
                .collect(),
            sizes: scene.views.iter().map(|v| v.size).collect(),
            wanted,
            unknown: Some(unknown),
            failed: Mutex::new(None),
        }
    }

    /// The mask of a frame; none where there is no file, or it is none.
    pub fn mask(&self, frame: usize, view: usize) -> Option<Mask> {
        let path = of_frame(&self.folders[view], frame);
        if !path.exists() {
            return None;
        }
        match self.read(&path, view) {
            Ok(mask) => Some(mask),
            Err(failure) => {
                let mut failed = self.failed.lock().unwrap_or_else(|e| e.into_inner());
                failed.get_or_insert(failure);
                None
            }
        }
    }

    fn read(&self, path: &Path, view: usize) -> Result<Mask, Failure> {
        let bytes = bounded::read(path, LARGEST).map_err(|e| Failure::no_input(path, &e))?;
        let shown = path.display();
        let mut reader = image::ImageReader::new(std::io::Cursor::new(bytes));
        reader.set_format(image::ImageFormat::Png);
        let picture = reader.decode().map_err(|e| {
            Failure::data(format!(
                "expected a mask as PNG, found {shown}, which is none: {e}"
            ))
        })?;
        let image::DynamicImage::ImageLuma8(grey) = picture else {
            return Err(Failure::data(format!(
                "expected a grey mask of 8 bits a pixel, found {:?} in {shown}",
                picture.color()
            )));
        };
        let (size, [width, height]) = (grey.dimensions(), self.sizes[view]);
        if size != (width, height) {
            return Err(Failure::data(format!(
                "expected a mask of {width}x{height} pixels as the view has them, found {}x{} in {shown}",
                size.0, size.1
            )));
        }
        Ok(Mask {
            size: [width, height],
            owners: grey.into_raw(),
            unknown: self.unknown,
        })
    }

    /// What to say of cameras of which no outline counted in a fit: of all that the user's folder has none of, and of
    /// those of which some could not be made or are of nobody.
    pub fn without_use(&self, report: &MultiviewReport) -> Vec<String> {
        let each = report.views.iter().zip(&self.wanted).zip(&self.folders);
        let idle = each.filter(|((v, _), _)| v.weight > 0.0 && v.contours == Some(0));
        let said = idle.filter_map(|((view, wanted), folder)| {
            let why = match (self.unknown, wanted) {
                // Films are given of the cameras that the user wants.
                (Some(_), false) => return None,
                (Some(_), true) => format!(
                    "no mask could be made of camera {}: who is in its film stays in one place, its light changes, or 'infer' turned or mirrored its pictures",
                    view.name
                ),
                (None, false) => format!("no masks of camera {} in {}", view.name, folder.display()),
                (None, true) => format!("no mask of camera {} is of anybody whom it saw", view.name),
            };
            Some(format!("{why}; joints alone count"))
        });
        said.collect()
    }

    /// Whether every mask that was there could be read.
    ///
    /// # Errors
    /// What was wrong with the first that could not.
    pub fn whole(&self) -> anyhow::Result<()> {
        let mut failed = self.failed.lock().unwrap_or_else(|e| e.into_inner());
        failed.take().map_or(Ok(()), |f| Err(f.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::multiview::ViewReport;

    fn view(name: &str, weight: f64, contours: usize) -> ViewReport {
        ViewReport {
            name: name.into(),
            weight,
            offset_s: None,
            sights: 36,
            shown: 36,
            told: 36,
            contours: Some(contours),
            joints: 0,
            median_px: None,
            mean_px: None,
            median_percent: None,
            mean_percent: None,
            far_percent: None,
        }
    }

    /// A folder that is misspelt looks like a camera that has none.
    #[test]
    fn cameras_of_which_the_folder_has_no_masks_are_named() {
        let mut folder = MaskFolder {
            folders: ["a", "b", "c", "d"]
                .map(|name| Path::new("masks").join(name))
                .into(),
            sizes: vec![[320, 240]; 4],
            wanted: vec![true, true, false, false],
            unknown: None,
            failed: Mutex::new(None),
        };
        let report = MultiviewReport {
            frames: 36,
            views: vec![
                view("a", 1.0, 36),
                view("b", 1.0, 0),
                view("c", 1.0, 0),
                view("d", 0.0, 0),
            ],
            people: Vec::new(),
            notes: Vec::new(),
        };
        assert_eq!(
            folder.without_use(&report),
            [
                "no mask of camera b is of anybody whom it saw; joints alone count",
                "no masks of camera c in masks/c; joints alone count",
            ]
        );
        // Of films that are not given there are to be none.
        folder.unknown = Some(9);
        let said = folder.without_use(&report);
        assert!(
            matches!(&said[..], [line] if line.contains("camera b:")),
            "{said:?}"
        );
    }
}

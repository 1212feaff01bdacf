//! Calibration files of others go in, [`View`]s come out: one file a format, told apart by what is in them.
//!
//! World → camera everywhere, metres afterwards, Brown's five coefficients. What was recognised or changed on the way
//! is said in [`Calibration::notes`].

mod check;
mod colmap;
mod opencv;
mod parts;
mod pose2sim;
mod qtm;
mod storage;

use std::fs;
use std::path::{Path, PathBuf};

pub use check::check;
use check::check_lenses;
pub use colmap::read_colmap;
use opencv::{is_intri, read_intri, read_opencv_lens};
pub use opencv::{read_easymocap, read_opencv};
use pose2sim::other_scale;
pub use pose2sim::{read_pose2sim, write_doubtful, write_measured, write_pose2sim};
use qtm::read_noted;
pub use qtm::read_qtm;

use super::{CameraError, View};
use crate::bounded;

/// Parts of a pixel in which QTM counts; Pose2Sim divides distortion by them, too, when it converts.
const SUBPIXELS: f64 = 64.0;
/// How many times as large distortion may be meant, and what that is called.
const SCALES: [(f64, &str); 2] = [
    (1.0 / SUBPIXELS, "distortion divided by 64"),
    (SUBPIXELS, "distortion times 64"),
];

/// Cameras as a file describes them.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The cameras, in the file's order.
    pub views: Vec<View>,
    /// What was recognised, one line each.
    pub notes: Vec<String>,
    /// Another reading of the lenses where the file does not say which is meant, and its name: the one in which rays
    /// meet better is right.
    pub alternative: Option<(Vec<View>, &'static str)>,
}

impl Calibration {
    /// What there is to say of a file whose lenses have a second reading where nobody can tell which is meant, and they
    /// are taken as they are written.
    pub fn as_written(&self, file: &Path) -> Option<String> {
        let (_, what) = self.alternative.as_ref()?;
        Some(format!(
            "{}: lenses may be meant with the {what}; they are taken as they are written: if nobody is found, or people are where they are not, change the file ('edgecap multiview' of several views tells which reading is right)",
            file.display()
        ))
    }

    /// How many times as large distortion is in the second reading, where there is one.
    pub fn other_scale(&self) -> Option<f64> {
        let (_, what) = self.alternative.as_ref()?;
        let (scale, _) = SCALES.into_iter().find(|(_, other)| other == what)?;
        Some(scale)
    }

    /// The same with the other reading of its distortion where QTM's scale of 1/64 may have slipped in or out: `factor`
    /// is one of [`SCALES`], others have no reading.
    fn or_scaled(mut self, factor: f64) -> Self {
        let Some((_, what)) = SCALES.into_iter().find(|(scale, _)| *scale == factor) else {
            return self;
        };
        let first = |v: &View| v.distortion.radial[0].abs() * factor;
        // A lens that moves a point at r = 0.5 by less than 0.1 %, or by more than a quarter, is nobody's.
        if self
            .views
            .iter()
            .all(|v| (0.004..1.0).contains(&first(v)) || (factor < 1.0 && first(v) > 0.0))
        {
            let scaled = self.views.iter().map(|v| {
                let mut other = v.clone();
                other.distortion = v.distortion.scaled(factor);
                other
            });
            self.alternative = Some((scaled.collect(), what));
        }
        self
    }
}

/// COLMAP's files of a folder.
const COLMAP: [&str; 2] = ["cameras.txt", "images.txt"];
/// Endings of OpenCV's and EasyMocap's.
const YAML: [&str; 2] = ["yml", "yaml"];

/// What is wanted of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Want {
    /// Lenses and places.
    Places,
    /// Lenses alone: what the file says of places, if anything, is not looked at.
    Lenses,
}

/// Reads a calibration of any of the formats: a file of Pose2Sim or Anipose (`.toml`), of QTM (`.xml`, `.qca.txt`), of
/// OpenCV (`.yml`), or a folder with EasyMocap's `intri.yml` and `extri.yml`, COLMAP's `cameras.txt` and `images.txt`,
/// or one OpenCV file a camera.
///
/// # Errors
/// [`CameraError`]: what was expected, what was found.
pub fn read(path: &Path) -> Result<Calibration, CameraError> {
    of_file(path, Want::Places)
}

/// Reads the lenses of any of these files, or of files that tell nothing but lenses: OpenCV's of one camera,
/// EasyMocap's `intri.yml`. Places and directions of the views say nothing.
///
/// # Errors
/// [`CameraError`]: what was expected, what was found.
pub fn read_lenses(path: &Path) -> Result<Calibration, CameraError> {
    of_file(path, Want::Lenses)
}

fn of_file(path: &Path, want: Want) -> Result<Calibration, CameraError> {
    let name = path.display().to_string();
    let checked = |views| match want {
        Want::Places => check(&name, views),
        Want::Lenses => check_lenses(&name, views),
    };
    if path.is_dir() {
        let (intri, extri) = (path.join("intri.yml"), path.join("extri.yml"));
        if intri.exists() {
            let inner = text(&intri)?;
            return checked(match want {
                Want::Places => read_easymocap(&inner, &text(&extri)?, &name)?,
                Want::Lenses => read_intri(&inner, &name)?,
            });
        }
        let [cameras, images] = COLMAP.map(|name| path.join(name));
        if cameras.exists() {
            // Programs write it, with every point of every image.
            let images = bounded::read_text(&images, bounded::DATA)
                .map_err(|e| CameraError::read(&images, e))?;
            return checked(read_colmap(&text(&cameras)?, &images, &name)?);
        }
        return checked(read_folder(path, &name, want)?);
    }
    let content = text(path)?;
    match format(&content) {
        Format::Qtm => {
            let (views, left_out) = read_noted(&content, &name)?;
            let mut calibration = checked(views)?.or_scaled(1.0 / SUBPIXELS);
            calibration.notes.splice(0..0, left_out);
            Ok(calibration)
        }
        Format::Pose2Sim => {
            let calibration = checked(read_pose2sim(&content, &name)?)?;
            Ok(match other_scale(&content) {
                Some(scale) => calibration.or_scaled(scale),
                None => calibration,
            })
        }
        Format::OpenCv if want == Want::Lenses && is_intri(&content) => {
            checked(read_intri(&content, &name)?)
        }
        Format::OpenCv => checked(vec![one_camera(path, &content, want)?]),
        Format::OtherStorage(kind) => Err(other_storage(&name, kind)),
    }
}

/// Whether [`read`] looks at a file of this name in a folder.
pub fn is_of_folder(file: &Path) -> bool {
    let is_named = |name: &&str| file.file_name().is_some_and(|own| own == *name);
    ends(file, &YAML) || COLMAP.iter().any(is_named)
}

/// Whether a file is TOML with the camera matrix of some camera, as no `camera.toml` has one: so it is meant for a
/// calibration of Pose2Sim or Anipose, whatever is wrong with it.
pub fn has_matrix(path: &Path) -> bool {
    text(path).is_ok_and(|content| pose2sim::has_matrix(&content))
}

/// Whose calibration a text is, where that can be told without reading it.
pub fn whose(content: &str) -> Option<&'static str> {
    match format(content) {
        Format::OpenCv | Format::OtherStorage(_) => Some("OpenCV"),
        Format::Qtm => Some("QTM"),
        Format::Pose2Sim => pose2sim::has_matrix(content).then_some("Pose2Sim or Anipose"),
    }
}

fn text(path: &Path) -> Result<String, CameraError> {
    bounded::read_text(path, bounded::SETTINGS).map_err(|e| CameraError::read(path, e))
}

enum Format {
    Qtm,
    OpenCv,
    Pose2Sim,
    /// What OpenCV's `FileStorage` writes beside YAML.
    OtherStorage(&'static str),
}

fn format(text: &str) -> Format {
    let start = text.trim_start_matches('\u{feff}').trim_start();
    if start.starts_with('<') && text.contains("<opencv_storage") {
        Format::OtherStorage("XML")
    } else if start.starts_with('<') {
        Format::Qtm
    } else if start.starts_with('{') && text.contains("opencv-matrix") {
        Format::OtherStorage("JSON")
    } else if start.starts_with("%YAML") || storage::holds_matrix(text) {
        Format::OpenCv
    } else {
        Format::Pose2Sim
    }
}

fn other_storage(file: &str, kind: &str) -> CameraError {
    CameraError::Calibration {
        file: file.to_owned(),
        expected: "OpenCV's YAML (.yml)",
        found: format!("its {kind}; write it with a FileStorage whose name ends in .yml"),
    }
}

/// OpenCV's calibration of one camera, which is called like its file.
fn one_camera(path: &Path, content: &str, want: Want) -> Result<View, CameraError> {
    let stem = path
        .file_stem()
        .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let file = path.display().to_string();
    match want {
        Want::Places => read_opencv(content, &stem, &file),
        Want::Lenses => read_opencv_lens(content, &stem, &file),
    }
}

/// Whether a file's name ends in one of these.
fn ends(path: &Path, endings: &[&str]) -> bool {
    let own = path.extension().and_then(|e| e.to_str());
    own.is_some_and(|e| endings.contains(&e))
}

/// One OpenCV file a camera, by name.
fn read_folder(path: &Path, name: &str, want: Want) -> Result<Vec<View>, CameraError> {
    let entries = fs::read_dir(path).map_err(|e| CameraError::read(path, e))?;
    let mut all: Vec<_> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    all.sort();
    let files: Vec<_> = all.iter().filter(|p| ends(p, &YAML)).collect();
    if files.is_empty() {
        // OpenCV writes any of three formats, by the ending.
        for file in all.iter().filter(|p| ends(p, &["xml", "json"])) {
            if let Format::OtherStorage(kind) = format(&text(file)?) {
                return Err(other_storage(&file.display().to_string(), kind));
            }
        }
        return Err(CameraError::Calibration {
            file: name.to_owned(),
            expected: "intri.yml and extri.yml, cameras.txt and images.txt, or one OpenCV .yml a camera",
            found: "a folder without any of them".into(),
        });
    }
    let view = |file: &&PathBuf| one_camera(file, &text(file)?, want);
    files.iter().map(view).collect()
}

#[cfg(test)]
mod tests;

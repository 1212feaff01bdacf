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
use std::path::Path;

pub use check::check;
pub use colmap::read_colmap;
pub use opencv::{read_easymocap, read_opencv};
pub use pose2sim::{read_pose2sim, write_pose2sim};
pub use qtm::read_qtm;

use super::{CameraError, View};
use crate::bounded;

/// Parts of a pixel in which QTM counts; Pose2Sim divides distortion by them, too, when it converts.
const SUBPIXELS: f64 = 64.0;

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

/// Reads a calibration of any of the formats: a file of Pose2Sim or Anipose (`.toml`), of QTM (`.xml`, `.qca.txt`), of
/// OpenCV (`.yml`), or a folder with EasyMocap's `intri.yml` and `extri.yml`, COLMAP's `cameras.txt` and `images.txt`,
/// or one OpenCV file a camera.
///
/// # Errors
/// [`CameraError`]: what was expected, what was found.
pub fn read(path: &Path) -> Result<Calibration, CameraError> {
    let text = |path: &Path| {
        bounded::read_text(path, bounded::SETTINGS).map_err(|e| CameraError::read(path, e))
    };
    let name = path.display().to_string();
    if path.is_dir() {
        let (intri, extri) = (path.join("intri.yml"), path.join("extri.yml"));
        if intri.exists() {
            return check(
                &name,
                read_easymocap(&text(&intri)?, &text(&extri)?, &name)?,
            );
        }
        let (cameras, images) = (path.join("cameras.txt"), path.join("images.txt"));
        if cameras.exists() {
            let views = read_colmap(&text(&cameras)?, &text(&images)?, &name)?;
            return check(&name, views);
        }
        return check(&name, read_folder(path, &name, text)?);
    }
    let content = text(path)?;
    match format(&content) {
        Format::Qtm => with_subpixels(&name, read_qtm(&content, &name)?, 1.0 / SUBPIXELS),
        Format::Pose2Sim => with_subpixels(&name, read_pose2sim(&content, &name)?, SUBPIXELS),
        Format::OpenCv => {
            let stem = path
                .file_stem()
                .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
            check(&name, vec![read_opencv(&content, &stem, &name)?])
        }
    }
}

enum Format {
    Qtm,
    OpenCv,
    Pose2Sim,
}

fn format(text: &str) -> Format {
    let start = text.trim_start_matches('\u{feff}').trim_start();
    if start.starts_with('<') {
        Format::Qtm
    } else if start.starts_with("%YAML") || text.contains("!!opencv-matrix") {
        Format::OpenCv
    } else {
        Format::Pose2Sim
    }
}

/// One OpenCV file a camera, by name.
fn read_folder(
    path: &Path,
    name: &str,
    text: impl Fn(&Path) -> Result<String, CameraError>,
) -> Result<Vec<View>, CameraError> {
    let entries = fs::read_dir(path).map_err(|e| CameraError::read(path, e))?;
    let mut files: Vec<_> = entries
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "yml" || e == "yaml"))
        .collect();
    files.sort();
    if files.is_empty() {
        return Err(CameraError::Calibration {
            file: name.to_owned(),
            expected: "intri.yml and extri.yml, cameras.txt and images.txt, or one OpenCV .yml a camera",
            found: "a folder without any of them".into(),
        });
    }
    let view = |file: &std::path::PathBuf| {
        let stem = file
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        read_opencv(&text(file)?, &stem, &file.display().to_string())
    };
    files.iter().map(view).collect()
}

/// Checks views, and gives the other reading of their distortion where QTM's scale of 1/64 may have slipped in or out.
fn with_subpixels(name: &str, views: Vec<View>, factor: f64) -> Result<Calibration, CameraError> {
    let mut calibration = check(name, views)?;
    let first = |v: &View| v.distortion.radial[0].abs() * factor;
    // A lens that moves a point at r = 0.5 by less than 0.1 %, or by more than a quarter, is nobody's.
    if calibration
        .views
        .iter()
        .all(|v| (0.004..1.0).contains(&first(v)) || (factor < 1.0 && first(v) > 0.0))
    {
        let scaled = calibration.views.iter().map(|v| {
            let mut other = v.clone();
            other.distortion = v.distortion.scaled(factor);
            other
        });
        let what = if factor < 1.0 {
            "distortion divided by 64"
        } else {
            "distortion times 64"
        };
        calibration.alternative = Some((scaled.collect(), what));
    }
    Ok(calibration)
}

#[cfg(test)]
mod tests;

//! Cameras of a calibration: as they are called, chosen by name, and as their pictures show them.

use std::path::{Path, PathBuf};

use super::exit::Failure;
use super::say;
use crate::camera::{View, calibration};
use crate::multiview::MOST_VIEWS;

/// Cameras of a calibration, and the names under which their observations are published.
#[derive(Debug)]
pub struct Chosen {
    /// As the calibration describes them.
    pub views: Vec<View>,
    /// One a view.
    pub names: Vec<String>,
}

/// Finds the cameras in the calibration.
///
/// # Errors
/// Calibrations that cannot be read or hold one camera, cameras that are not in it, or come twice.
pub fn choose(cameras: &[String], file: &Path) -> anyhow::Result<Chosen> {
    let calibration = calibration::read(file)?;
    for note in calibration
        .notes
        .iter()
        .chain(&calibration.as_written(file))
    {
        say::err(note);
    }
    let all = calibration.views;
    if all.len() < 2 {
        return Err(Failure::data(format!(
            "{}: expected the calibration of at least two cameras, found one, {}; one camera alone is fitted by 'fit --name'",
            file.display(),
            names(&all)
        ))
        .into());
    }
    if !(2..=MOST_VIEWS).contains(&cameras.len()) {
        return Err(Failure::usage(format!(
            "--cameras: expected 2 to {MOST_VIEWS} names, such as --cameras {},{}, found {}",
            all[0].name,
            all[1].name,
            cameras.len()
        ))
        .into());
    }
    let mut chosen = Chosen {
        views: Vec::new(),
        names: Vec::new(),
    };
    for text in cameras {
        let (camera, name) = text.split_once('=').unwrap_or((text, text));
        let Some(view) = all.iter().find(|v| v.name == camera) else {
            let unknown = no_such_camera(&all, &format!("of {}", file.display()), camera);
            return Err(Failure::usage(format!(
                "--cameras {text}: {unknown}; CAMERA=NAME tells whose observations have another name"
            ))
            .into());
        };
        let twice =
            chosen.views.iter().any(|v| v.name == camera) || chosen.names.iter().any(|n| n == name);
        if twice {
            return Err(Failure::usage(format!(
                "--cameras {text}: expected every camera and every name once, found it twice"
            ))
            .into());
        }
        chosen.views.push(view.clone());
        chosen.names.push(name.to_owned());
    }
    Ok(chosen)
}

/// What the calibration calls its cameras.
pub fn names(views: &[View]) -> String {
    views
        .iter()
        .map(|v| v.name.as_str())
        .collect::<Vec<_>>()
        .join(", ")
}

/// What is said of a camera that is not among these. `place`: whose they are, such as "of Calib.toml".
pub fn no_such_camera(views: &[View], place: &str, name: &str) -> String {
    let all = names(views);
    format!("expected one of the cameras {all} {place}, found {name}")
}

/// Camera and file of `CAMERA=FILE`.
pub fn told(text: &str) -> Option<(&str, &str)> {
    let told = text.split_once('=');
    told.filter(|(name, _)| !Path::new(text).exists() && !name.contains('/'))
}

/// Camera and file: as told, or called like the file.
pub fn named(text: &str) -> (String, PathBuf) {
    match told(text) {
        Some((name, file)) => (name.to_owned(), file.into()),
        None => {
            let path = PathBuf::from(text);
            let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
            (stem.unwrap_or_default(), path)
        }
    }
}

/// The camera as its pictures show it; `source` is where they come from.
///
/// # Errors
/// Pictures of a size that it is not calibrated for.
pub fn pictured(view: &View, size: [u32; 2], source: &str) -> anyhow::Result<View> {
    view.for_pictures(size).ok_or_else(|| {
        let ([w, h], [found_w, found_h]) = (view.likely_size(), size);
        let about = if view.size == [0; 2] { "about " } else { "" };
        let turned = if view.for_pictures([found_h, found_w]).is_some() {
            ", turned by 90 degrees; turn pictures or calibration"
        } else {
            "; calibrate with pictures of this size"
        };
        Failure::data(format!(
            "{source}: expected pictures of {about}{w}x{h} pixels as camera {} is calibrated for, found {found_w}x{found_h}{turned}",
            view.name
        ))
        .into()
    })
}

//! Lenses that the user knows: files go in, cameras without a place come out.

use std::path::PathBuf;

use glam::{DMat3, DVec2, DVec3};

use crate::camera::calibration;
use crate::camera::{CameraFile, DEFAULT_FOV, View};
use crate::commands::exit::Failure;
use crate::commands::multiview::told;
use crate::commands::say;
use crate::message::Intrinsics;

/// What is known of lenses.
pub struct Lenses {
    /// For one camera, or for all.
    known: Vec<(Option<String>, Lens)>,
}

enum Lens {
    File(CameraFile),
    Calibrated(Vec<View>, PathBuf),
}

impl Lenses {
    /// Reads what `--lens` names, for these cameras.
    ///
    /// # Errors
    /// When a file cannot be read, or is for no camera.
    pub fn read(given: &[String], cameras: &[(String, PathBuf)]) -> anyhow::Result<Self> {
        let mut known = Vec::new();
        for text in given {
            let (camera, file) = match told(text) {
                Some((camera, file)) => (Some(camera), PathBuf::from(file)),
                None => (None, PathBuf::from(text)),
            };
            if let Some(camera) = camera
                && !cameras.iter().any(|(n, _)| n == camera)
            {
                return Err(Failure::usage(format!(
                    "expected one of the cameras in --lens {text}, found {camera}"
                ))
                .into());
            }
            // A file that is no camera.toml may be another program's calibration.
            let lens = match CameraFile::read(&file) {
                Ok(lens) => Lens::File(lens),
                Err(own) => match calibration::read_lenses(&file) {
                    Ok(calibration) => {
                        if let Some(note) = calibration.as_written(&file) {
                            say::err(&note);
                        }
                        Lens::Calibrated(calibration.views, file)
                    }
                    Err(_) if file.extension().is_some_and(|e| e == "toml") => {
                        return Err(own.into());
                    }
                    Err(other) => return Err(other.into()),
                },
            };
            known.push((camera.map(ToOwned::to_owned), lens));
        }
        Ok(Self { known })
    }

    /// Whether a lens was given for a camera, or for all.
    pub fn knows(&self, name: &str) -> bool {
        self.lens(name).is_some()
    }

    /// A camera's horizontal field of view, degrees; the usual one where none is known.
    pub fn fov_degrees(&self, name: &str) -> f64 {
        match self.lens(name) {
            Some(Lens::File(file)) => file.fov_degrees().into(),
            Some(Lens::Calibrated(views, _)) => {
                let own = views.iter().find(|v| v.name == name).or(views.first());
                own.map_or(DEFAULT_FOV.into(), View::fov_degrees)
            }
            None => DEFAULT_FOV.into(),
        }
    }

    /// What was said of a camera, or of all.
    fn lens(&self, name: &str) -> Option<&Lens> {
        let own = self.known.iter().find(|(n, _)| n.as_deref() == Some(name));
        let lens = own.or_else(|| self.known.iter().find(|(n, _)| n.is_none()));
        lens.map(|(_, lens)| lens)
    }

    /// The camera without a place, for pictures of `size`; the usual one where no lens was given for it.
    ///
    /// # Errors
    /// One line when one was given of other pictures, or of other cameras.
    pub fn of(&self, name: &str, size: [u32; 2]) -> Result<View, String> {
        match self.lens(name) {
            None => plain(name, size, &CameraFile::default()),
            Some(Lens::File(file)) => plain(name, size, file),
            Some(Lens::Calibrated(views, path)) => {
                let own = views.iter().find(|v| v.name == name);
                let view = match (own, &views[..]) {
                    (Some(view), _) | (None, [view]) => view,
                    _ => {
                        return Err(format!(
                            "{}: expected camera {name}, found none of this name",
                            path.display()
                        ));
                    }
                };
                let fitting = view.for_pictures(size).ok_or_else(|| {
                    let [width, height] = view.likely_size();
                    format!(
                        "{}: expected pictures of {width}x{height} pixels of camera {name}, found {}x{}",
                        path.display(),
                        size[0],
                        size[1]
                    )
                })?;
                Ok(View {
                    name: name.to_owned(),
                    rotation: DMat3::IDENTITY,
                    position: DVec3::ZERO,
                    ..fitting
                })
            }
        }
    }
}

fn plain(name: &str, size: [u32; 2], file: &CameraFile) -> Result<View, String> {
    let Intrinsics { fx, fy, cx, cy } = file.for_frame(size[0], size[1])?;
    Ok(View {
        name: name.to_owned(),
        size,
        focal: DVec2::new(fx.into(), fy.into()),
        centre: DVec2::new(cx.into(), cy.into()),
        distortion: file.distortion(),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    })
}

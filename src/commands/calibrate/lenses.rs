//! Lenses that the user knows: files go in, cameras without a place come out.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2, DVec3};

use crate::camera::calibration;
use crate::camera::{Brown, CameraFile, DEFAULT_FOV, View};
use crate::capture::Mounting;
use crate::commands::exit::Failure;
use crate::commands::say;
use crate::commands::views::told;
use crate::message::Intrinsics;

/// Lenses are one where focal lengths differ by less than this, as a share, …
const SAME_FOCAL: f32 = 1e-3;
/// … and principal points by less than this, pixels.
const SAME_CENTRE: f32 = 0.5;
/// A focal length so far from the record's, as a share, is another's.
const OTHER: f32 = 0.1;

/// What is known of lenses.
pub struct Lenses {
    /// For one camera, or for all.
    known: Vec<(Option<String>, Lens)>,
}

enum Lens {
    File(CameraFile),
    Calibrated {
        views: Vec<View>,
        path: PathBuf,
        /// How many times as large their distortion may be meant as it is written, where nobody knows.
        other_scale: Option<f64>,
    },
}

impl Lenses {
    /// Reads what `--lens` names, for these cameras.
    ///
    /// # Errors
    /// When a file cannot be read, is for no camera, lacks one that it is for, or two are for the same.
    pub fn read(given: &[String], cameras: &[(String, PathBuf)]) -> anyhow::Result<Self> {
        let mut known = Vec::new();
        for (camera, file) in of_cameras(given, cameras)? {
            // A file that is no camera.toml may be another program's calibration.
            let lens = match CameraFile::read(&file) {
                Ok(lens) => Lens::File(lens),
                Err(own) => match calibration::read_lenses(&file) {
                    Ok(calibration) => {
                        calibration.notes.iter().for_each(|note| say::err(note));
                        if let Some(note) = calibration.as_written(&file) {
                            say::err(&note);
                        }
                        Lens::Calibrated {
                            other_scale: calibration.other_scale(),
                            views: calibration.views,
                            path: file,
                        }
                    }
                    Err(_) if is_camera_toml(&file) => return Err(own.into()),
                    Err(other) => return Err(other.into()),
                },
            };
            known.push((camera.map(ToOwned::to_owned), lens));
        }
        let lenses = Self { known };
        // Before films are looked at, which takes minutes.
        for (name, _) in cameras {
            if let Some(Lens::Calibrated { views, path, .. }) = lenses.lens(name) {
                of_camera(views, name, path).map_err(Failure::data)?;
            }
        }
        Ok(lenses)
    }

    /// How many times as large the distortion of a camera's lens may be meant as its file has it, where nobody knows.
    pub fn other_scale(&self, name: &str) -> Option<f64> {
        match self.lens(name) {
            Some(Lens::Calibrated { other_scale, .. }) => *other_scale,
            Some(Lens::File(_)) | None => None,
        }
    }

    /// Whether a lens was given for a camera, or for all.
    pub fn knows(&self, name: &str) -> bool {
        self.lens(name).is_some()
    }

    /// A camera's horizontal field of view, degrees; the usual one where none is known.
    pub fn fov_degrees(&self, name: &str) -> f64 {
        match self.lens(name) {
            Some(Lens::File(file)) => file.fov_degrees().into(),
            Some(Lens::Calibrated { views, .. }) => {
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

    /// The camera without a place of a record with pictures of `size`, which is of the camera `own`: that one where no
    /// lens was given. A `camera.toml` is of pictures before they were turned upright; how they were, `own` tells.
    ///
    /// # Errors
    /// One line when the lens is of other pictures, of other cameras, or turned in a way that nothing tells.
    pub fn of_record(&self, name: &str, size: [u32; 2], own: Intrinsics) -> Result<View, String> {
        match self.lens(name) {
            None => Ok(pinhole(name, size, own)),
            Some(Lens::File(file)) => upright(name, size, file, own),
            Some(Lens::Calibrated { .. }) => self.of(name, size),
        }
    }

    /// The camera without a place, for pictures of `size`; the usual one where no lens was given for it.
    ///
    /// # Errors
    /// One line when one was given of other pictures, or of other cameras.
    pub fn of(&self, name: &str, size: [u32; 2]) -> Result<View, String> {
        match self.lens(name) {
            None => plain(name, size, &CameraFile::default()),
            Some(Lens::File(file)) => plain(name, size, file),
            Some(Lens::Calibrated { views, path, .. }) => {
                let view = of_camera(views, name, path)?;
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

/// The camera of this name in the calibration `path`, or the only one there, whatever it is called.
///
/// # Errors
/// One line when several have other names.
fn of_camera<'a>(views: &'a [View], name: &str, path: &Path) -> Result<&'a View, String> {
    let own = views.iter().find(|v| v.name == name);
    match (own, views) {
        (Some(view), _) | (None, [view]) => Ok(view),
        _ => Err(format!(
            "{}: expected camera {name}, found none of this name",
            path.display()
        )),
    }
}

/// The files of `--lens`, each with the camera that it is for, if it is for one.
///
/// # Errors
/// When a file is for none of these cameras, or two are for the same: nobody can choose between them.
fn of_cameras<'a>(
    given: &'a [String],
    cameras: &[(String, PathBuf)],
) -> Result<Vec<(Option<&'a str>, PathBuf)>, Failure> {
    let mut all: Vec<(Option<&str>, PathBuf)> = Vec::new();
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
            )));
        }
        if let Some((_, other)) = all.iter().find(|(of, _)| *of == camera) {
            let whose = camera.map_or("all cameras".to_owned(), |name| format!("camera {name}"));
            return Err(Failure::usage(format!(
                "expected one --lens for {whose}, found {} and {}; say which camera each is of by CAMERA=FILE",
                other.display(),
                file.display()
            )));
        }
        all.push((camera, file));
    }
    Ok(all)
}

/// Whether a file that nobody can read is meant for a `camera.toml`, not for a calibration.
fn is_camera_toml(file: &Path) -> bool {
    file.extension().is_some_and(|e| e == "toml") && !calibration::has_matrix(file)
}

/// A camera on its side; on which one, only a principal point off the middle tells.
const ON_SIDE: Mounting = Mounting {
    quarter_turns: 1,
    mirrored: false,
};

/// The lens of `file` for pictures that have `size` once they are turned upright.
fn turned(file: &CameraFile, how: Mounting, size: [u32; 2]) -> Result<Intrinsics, String> {
    let (width, height) = how.size(size[0], size[1]);
    let own = file.for_frame(width, height)?;
    Ok(how.intrinsics(own, width, height))
}

fn is_same(a: &Intrinsics, b: &Intrinsics) -> bool {
    let focal = [a.fx / b.fx, a.fy / b.fy];
    let centre = [a.cx - b.cx, a.cy - b.cy];
    focal.iter().all(|share| (share - 1.0).abs() < SAME_FOCAL)
        && centre.iter().all(|off| off.abs() < SAME_CENTRE)
}

/// What to say of a lens whose coefficients hold for a part of the picture only.
pub fn folded(view: &View) -> Option<String> {
    let px = view.folds_at()?;
    Some(format!(
        "camera {}: its lens shows nothing farther than {px:.0} px from the middle by its coefficients; joints beyond are left out: calibrate it with boards up to the corners",
        view.name
    ))
}

/// Whether this is the camera that is taken where nobody tells one, its picture turned upright or not.
pub fn is_usual(size: [u32; 2], own: &Intrinsics) -> bool {
    let usual = CameraFile::default();
    Mounting::all().any(|how| turned(&usual, how, size).is_ok_and(|lens| is_same(&lens, own)))
}

fn pinhole(name: &str, size: [u32; 2], intrinsics: Intrinsics) -> View {
    let Intrinsics { fx, fy, cx, cy } = intrinsics;
    View {
        name: name.to_owned(),
        size,
        focal: DVec2::new(fx.into(), fy.into()),
        centre: DVec2::new(cx.into(), cy.into()),
        distortion: Brown::default(),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
}

fn plain(name: &str, size: [u32; 2], file: &CameraFile) -> Result<View, String> {
    Ok(View {
        distortion: file.distortion(),
        ..pinhole(name, size, file.for_frame(size[0], size[1])?)
    })
}

/// The lens of `file` for pictures of `size` that were turned upright as those of the camera `own` were.
fn upright(name: &str, size: [u32; 2], file: &CameraFile, own: Intrinsics) -> Result<View, String> {
    let is_own = |file: &CameraFile, how: Mounting| {
        turned(file, how, size).is_ok_and(|lens| is_same(&lens, &own))
    };
    if let Some(how) = Mounting::all().find(|how| is_own(file, *how)) {
        return Ok(View {
            distortion: how.distortion(file.distortion()),
            ..pinhole(name, size, own)
        });
    }
    // Of another lens, or of none: how the picture was turned, only the usual one tells.
    let [as_is, on_side] = [Mounting::default(), ON_SIDE].map(|how| turned(file, how, size));
    let usual = CameraFile::default();
    let side = on_side
        .ok()
        .filter(|_| !is_own(&usual, Mounting::default()));
    let Some(on_side) = side else {
        return plain(name, size, file);
    };
    if matches!(file, CameraFile::Fov { .. }) && is_own(&usual, ON_SIDE) {
        return Ok(pinhole(name, size, on_side));
    }
    let off = |lens: &Intrinsics| (lens.fx / own.fx).ln().abs();
    if as_is.as_ref().map_or(f32::INFINITY, off) <= OTHER.max(off(&on_side)) {
        return plain(name, size, file);
    }
    let found = as_is.map_or_else(
        |_| "one that fits pictures on their side only".to_owned(),
        |lens| {
            format!(
                "{:.0} px, and {:.0} px for pictures on their side",
                lens.fx, on_side.fx
            )
        },
    );
    Err(format!(
        "camera {name}: expected --lens to be of the camera of the record, focal length {:.0} px in pictures of {}x{}, found {found}; leave it out, or record with it: infer --rotate 90 --camera FILE",
        own.fx, size[0], size[1]
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LANDSCAPE: [u32; 2] = [1280, 720];
    const PORTRAIT: [u32; 2] = [720, 1280];

    fn given(file: CameraFile) -> Lenses {
        Lenses {
            known: vec![(None, Lens::File(file))],
        }
    }

    fn fov(degrees: f32) -> CameraFile {
        CameraFile::Fov { degrees }
    }

    /// What a record says whose pictures a camera with this lens took, turned so.
    fn recorded(file: &CameraFile, quarter_turns: u8) -> Intrinsics {
        let how = Mounting {
            quarter_turns,
            mirrored: false,
        };
        let size = if quarter_turns % 2 == 1 {
            PORTRAIT
        } else {
            LANDSCAPE
        };
        turned(file, how, size).unwrap()
    }

    #[test]
    fn a_lens_is_turned_as_the_pictures_of_the_record_were() {
        // 1280 pixels across 75 degrees.
        let focal = 640.0 / 37.5_f64.to_radians().tan();
        for by in [fov(75.0), fov(60.0)] {
            for (quarters, size) in [(0, LANDSCAPE), (1, PORTRAIT), (3, PORTRAIT)] {
                let own = recorded(&by, quarters);
                let view = given(fov(75.0)).of_record("door", size, own).unwrap();
                assert!((view.focal - focal).abs().max_element() < 0.1, "{view:?}");
                assert!(view.off_middle(size.map(f64::from)) < 0.01, "{view:?}");
            }
        }
        // Portrait pictures that nobody turned.
        let upright = fov(75.0).for_frame(720, 1280).unwrap();
        let view = given(fov(75.0))
            .of_record("door", PORTRAIT, upright)
            .unwrap();
        assert!(
            (view.focal.x - focal * 720.0 / 1280.0).abs() < 0.1,
            "{view:?}"
        );

        let measured = CameraFile::Calibrated {
            intrinsics: Intrinsics {
                fx: 834.0,
                fy: 830.0,
                cx: 650.0,
                cy: 350.0,
            },
            width: 1280,
            height: 720,
            distortion: Brown {
                radial: [-0.1, 0.02, 0.0],
                tangential: [0.001, -0.002],
            },
        };
        let seen = |quarters: u8| {
            let size = if quarters % 2 == 1 {
                PORTRAIT
            } else {
                LANDSCAPE
            };
            given(measured).of_record("door", size, recorded(&measured, quarters))
        };
        let own = seen(0).unwrap();
        for (quarters, centre) in [
            (1, [369.0, 650.0]),
            (2, [629.0, 369.0]),
            (3, [350.0, 629.0]),
        ] {
            let view = seen(quarters).unwrap();
            assert!(
                (view.centre - DVec2::from(centre)).length() < 0.01,
                "{view:?}"
            );
            // What the lens moves, it moves in the turned picture as in its own.
            let (p, mut to) = (DVec2::new(0.3, -0.2), DVec2::new(0.3, -0.2));
            let mut wanted = own.distortion.distort(p);
            for _ in 0..quarters {
                (to, wanted) = (to.perp(), wanted.perp());
            }
            assert!((view.distortion.distort(to) - wanted).length() < 1e-12);
        }
    }

    #[test]
    fn a_lens_that_folds_inside_the_picture_is_told() {
        let lens = |k1: f64| View {
            name: "door".into(),
            ..View::barrel(k1)
        };
        let said = folded(&lens(-0.3)).unwrap();
        assert!(
            said.contains("door") && said.contains("farther than 42"),
            "{said}"
        );
        assert_eq!(folded(&lens(-0.05)), None);
    }

    #[test]
    fn a_lens_that_fits_only_on_its_side_is_refused_and_the_record_s_own_is_taken_without_one() {
        let own = recorded(&fov(75.0), 1);
        let other = given(fov(73.0)).of_record("door", PORTRAIT, own);
        let said = other.unwrap_err();
        assert!(
            said.contains("door") && said.contains("leave it out"),
            "{said}"
        );
        // One of another camera that does not fit better on its side is believed.
        let upright = fov(75.0).for_frame(720, 1280).unwrap();
        let view = given(fov(73.0))
            .of_record("door", PORTRAIT, upright)
            .unwrap();
        assert!((view.fov_degrees() - 73.0).abs() < 0.1);

        let none = Lenses { known: Vec::new() };
        let view = none.of_record("door", PORTRAIT, own).unwrap();
        assert_eq!(view.intrinsics(), own);
        assert!(!is_usual(PORTRAIT, &own));
        assert!(is_usual(PORTRAIT, &recorded(&fov(60.0), 1)));
        assert!(is_usual(LANDSCAPE, &recorded(&fov(60.0), 0)));
    }
}

//! OpenCV's own files, one camera each, and EasyMocap's pair of them.

use glam::{DMat3, DVec3};

use super::parts::{Parts, pinhole, rotation, vector};
use super::storage::Storage;
use crate::camera::{CameraError, View};

/// What programs call the coefficients: OpenCV's own tool first.
const DISTORTION: [&str; 15] = [
    "distortion_coefficients",
    "distortion_coeffs",
    "distortion_coefs",
    "distortion",
    "dist_coefficients",
    "dist_coeffs",
    "dist_coeff",
    "dist_coefs",
    "distCoeffs",
    "distCoeff",
    "distCoefs",
    "distCoef",
    "dist",
    "D",
    "D1",
];

/// Reads the text of one camera's calibration: `camera_matrix`, `distortion_coefficients`, `image_width`,
/// `image_height`, and world → camera as `R` or `rvec` with `T` or `tvec`. `name` is the camera's, `file` is for
/// errors.
///
/// # Errors
/// [`CameraError::Calibration`].
pub fn read_opencv(text: &str, name: &str, file: &str) -> Result<View, CameraError> {
    let storage = Storage::parse(text);
    let place = |storage: &Storage| -> Result<(DMat3, DVec3), String> {
        let lacks = |what: &str| format!("camera {name} without {what}");
        let turn = storage.numbers(&["R", "rvec", "rotation", "Rot"]);
        let shift = storage.numbers(&["T", "tvec", "translation", "t"]);
        Ok((
            rotation(
                turn.ok_or_else(|| lacks("R or rvec: where it stands in the world"))?,
                name,
            )?,
            vector(shift.ok_or_else(|| lacks("T or tvec"))?, name)?,
        ))
    };
    one(&storage, name, &place).map_err(|found| wrong(file, found))
}

/// Reads the lens of one camera's calibration, which need not tell a place.
///
/// # Errors
/// [`CameraError::Calibration`].
pub(super) fn read_opencv_lens(text: &str, name: &str, file: &str) -> Result<View, CameraError> {
    let nowhere = |_: &Storage| Ok((DMat3::IDENTITY, DVec3::ZERO));
    one(&Storage::parse(text), name, &nowhere).map_err(|found| wrong(file, found))
}

fn wrong(file: &str, found: String) -> CameraError {
    CameraError::Calibration {
        file: file.to_owned(),
        expected: "a calibration of OpenCV",
        found,
    }
}

/// Where a camera stands: world axes to camera axes, and the world's origin in these.
type Place<'a> = &'a dyn Fn(&Storage) -> Result<(DMat3, DVec3), String>;

fn one(storage: &Storage, name: &str, place: Place<'_>) -> Result<View, String> {
    let lacks = |what: &str| format!("camera {name} without {what}");
    // OpenCV's own tool says of every lens whether it is one.
    if storage
        .names()
        .any(|n| n.contains("fisheye") && storage.is_set(n))
        || ["model", "distortion_model"]
            .iter()
            .filter_map(|key| storage.words(key))
            .any(|m| ["fisheye", "equidistant"].iter().any(|f| m[0].contains(f)))
    {
        return Err(fisheye(name));
    }
    let matrix = storage.numbers(&["camera_matrix", "cameraMatrix", "K", "M", "M1"]);
    let (focal, centre) = pinhole(matrix.ok_or_else(|| lacks("camera_matrix"))?, name)?;
    let width = storage.number(&["image_width", "width"]);
    let height = storage.number(&["image_height", "height"]);
    let size = match (
        width.zip(height),
        storage.numbers(&["image_size", "imageSize", "size"]),
    ) {
        (Some((w, h)), _) => [w, h],
        (None, Some(&[w, h])) => [w, h],
        _ => return Err(lacks("image_width and image_height")),
    };
    let (rotation, translation) = place(storage)?;
    Parts {
        name,
        size,
        focal,
        centre,
        distortion: distortion(storage, name)?,
        rotation,
        translation,
    }
    .view()
}

/// The coefficients, under whichever of their names; none where a file tells of no distortion.
///
/// # Errors
/// When something that is called like distortion is not understood: without it the lens would be another.
fn distortion<'a>(storage: &'a Storage, name: &str) -> Result<&'a [f64], String> {
    if let Some(coefficients) = storage.numbers(&DISTORTION) {
        return Ok(coefficients);
    }
    let is_unknown = |n: &&str| {
        let lower = n.to_lowercase();
        let other = ["distance", "distortion_model", "distortion_type"];
        lower.starts_with("dist") && !other.iter().any(|o| lower.starts_with(o))
    };
    match storage
        .names()
        .filter(is_unknown)
        .find(|n| storage.is_set(n))
    {
        Some(unknown) => Err(format!(
            "camera {name} with {unknown}, which is not understood; call the coefficients {} and give them as numbers: k1 k2 p1 p2 k3",
            DISTORTION[0]
        )),
        None => Ok(&[]),
    }
}

/// Whether a text is EasyMocap's `intri.yml`, which holds the lenses of several cameras.
pub(super) fn is_intri(text: &str) -> bool {
    Storage::parse(text).words("names").is_some()
}

/// Reads the lenses of EasyMocap's `intri.yml`; sizes as [`read_easymocap`] has them.
///
/// # Errors
/// [`CameraError::Calibration`].
pub(super) fn read_intri(intri: &str, file: &str) -> Result<Vec<View>, CameraError> {
    let wrong = |found| CameraError::Calibration {
        file: file.to_owned(),
        expected: "EasyMocap's intri.yml",
        found,
    };
    let inner = Storage::parse(intri);
    let names = inner.words("names");
    let names = names.ok_or_else(|| wrong("no list 'names'".into()))?;
    let view = |name: &String| easymocap(&inner, name, &|| Ok((DMat3::IDENTITY, DVec3::ZERO)));
    names.iter().map(|n| view(n).map_err(wrong)).collect()
}

/// Reads the texts of EasyMocap's `intri.yml` and `extri.yml`. Most do not tell the pictures' size; then it is 0x0.
///
/// # Errors
/// [`CameraError::Calibration`].
pub fn read_easymocap(intri: &str, extri: &str, file: &str) -> Result<Vec<View>, CameraError> {
    let wrong = |found| CameraError::Calibration {
        file: file.to_owned(),
        expected: "EasyMocap's intri.yml and extri.yml",
        found,
    };
    let (inner, outer) = (Storage::parse(intri), Storage::parse(extri));
    let names = inner
        .words("names")
        .or_else(|| outer.words("names"))
        .ok_or_else(|| wrong("no list 'names'".into()))?;
    let view = |name: &String| -> Result<View, String> {
        let place = || {
            let key = |of: &str| format!("{of}_{name}");
            let lacks = |what: &str| format!("camera {name} without {what}_{name}");
            let turn = outer.numbers(&[&key("Rot"), &key("R")]);
            let shift = outer.numbers(&[&key("T")]);
            Ok((
                rotation(turn.ok_or_else(|| lacks("R"))?, name)?,
                vector(shift.ok_or_else(|| lacks("T"))?, name)?,
            ))
        };
        easymocap(&inner, name, &place)
    };
    names.iter().map(|n| view(n).map_err(wrong)).collect()
}

/// One camera of EasyMocap's.
fn easymocap(
    inner: &Storage,
    name: &str,
    place: &dyn Fn() -> Result<(DMat3, DVec3), String>,
) -> Result<View, String> {
    let key = |of: &str| format!("{of}_{name}");
    if inner.is_set(&key("xi")) || inner.is_set(&key("fisheye")) {
        return Err(fisheye(name));
    }
    let matrix = inner.numbers(&[&key("K")]);
    let matrix = matrix.ok_or_else(|| format!("camera {name} without K_{name}"))?;
    let (focal, centre) = pinhole(matrix, name)?;
    let side = |of: &str| inner.number(&[&key(of)]).filter(|s| *s > 0.0);
    let told = side("W").zip(side("H"));
    let (rotation, translation) = place()?;
    let coefficients = [key("dist"), key("D")];
    let distortion = inner.numbers(&coefficients.each_ref().map(String::as_str));
    if let Some(unknown) = coefficients.iter().find(|name| inner.is_set(name))
        && distortion.is_none()
    {
        return Err(format!(
            "camera {name} with {unknown}, which is not understood; give its coefficients as numbers: k1 k2 p1 p2 k3"
        ));
    }
    let mut view = Parts {
        name,
        size: told.map_or([1.0; 2], |(w, h)| [w, h]),
        focal,
        centre,
        distortion: distortion.unwrap_or(&[]),
        rotation,
        translation,
    }
    .view()?;
    if told.is_none() {
        view.size = [0; 2];
    }
    Ok(view)
}

fn fisheye(name: &str) -> String {
    format!(
        "camera {name} with a fisheye lens, which is not understood; undistort its pictures first"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distortion_is_read_by_its_names_and_refused_by_others() {
        let read = |distortion: &str| {
            let text = format!(
                "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
                 cols: 3\n   dt: d\n   data: [ 600., 0., 320., 0., 600., 240., 0., 0., 1. ]\n{distortion}"
            );
            read_opencv_lens(&text, "cam01", "cam01.yml").map_err(|e| e.to_string())
        };
        let matrix = |name: &str| {
            format!(
                "{name}: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.3, 0.1, 0., 0., 0. ]\n"
            )
        };
        for name in DISTORTION {
            let view = read(&matrix(name)).unwrap();
            assert_eq!(view.distortion.radial, [-0.3, 0.1, 0.0], "{name}");
        }
        for unknown in ["DistortionParameters", "dist_k"] {
            let said = read(&matrix(unknown)).unwrap_err();
            assert!(said.contains(&format!("cam01 with {unknown}")), "{said}");
            assert!(said.contains("distortion_coefficients"), "{said}");
        }
        // Rows in rows are no numbers here.
        let said = read("dist: [ [ -0.3, 0.1, 0., 0., 0. ] ]\n").unwrap_err();
        assert!(said.contains("cam01 with dist,"), "{said}");
        let said = read("distortion_model: equidistant\n").unwrap_err();
        assert!(said.contains("fisheye"), "{said}");
        for none in [
            "",
            "dist_k: 0\n",
            "distortion_model: plumb_bob\n",
            "distance: 2.5\n",
        ] {
            assert_eq!(read(none).unwrap().distortion.radial, [0.0; 3], "{none}");
        }
    }
}

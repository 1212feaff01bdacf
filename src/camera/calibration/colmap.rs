//! COLMAP's `cameras.txt` and `images.txt`: every image is a view. COLMAP knows no metre: its scale is that of the
//! files.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::parts::Parts;
use crate::camera::{CameraError, View};

struct Lens {
    size: [f64; 2],
    focal: [f64; 2],
    centre: [f64; 2],
    distortion: [f64; 8],
}

/// Reads the texts of both files; `file` is for errors. A view is called like its image, without the ending; where
/// images of several folders are called the same, like the folder.
///
/// # Errors
/// [`CameraError::Calibration`].
pub fn read_colmap(cameras: &str, images: &str, file: &str) -> Result<Vec<View>, CameraError> {
    let wrong = |found| CameraError::Calibration {
        file: file.to_owned(),
        expected: "COLMAP's cameras.txt and images.txt",
        found,
    };
    let mut lenses = HashMap::new();
    for line in cameras.lines().filter(|l| is_data(l)) {
        let (id, lens) = lens(line).map_err(wrong)?;
        lenses.insert(id, lens);
    }
    // Every image has two lines; the second, its points, may be empty.
    let lines: Vec<&str> = images
        .lines()
        .filter(|l| !l.trim_start().starts_with('#'))
        .collect();
    let views: Result<Vec<_>, _> = lines
        .chunks(2)
        .filter(|pair| is_data(pair[0]))
        .map(|pair| view(pair[0], &lenses))
        .collect();
    let views = views.map_err(wrong)?;
    if views.is_empty() {
        return Err(wrong("no image in images.txt".into()));
    }
    Ok(named(views))
}

/// Names views, which are called like their images' paths.
fn named(mut views: Vec<View>) -> Vec<View> {
    let text = |part: Option<&OsStr>| part.map(|p| p.to_string_lossy().into_owned());
    let stems: Vec<_> = views
        .iter()
        .map(|v| text(Path::new(&v.name).file_stem()).unwrap_or_else(|| v.name.clone()))
        .collect();
    let folders: Vec<_> = views
        .iter()
        .map(|v| text(Path::new(&v.name).parent().and_then(Path::file_name)))
        .collect();
    let shared: Vec<bool> = stems
        .iter()
        .map(|stem| stems.iter().filter(|s| *s == stem).count() > 1)
        .collect();
    for (((view, stem), folder), shared) in views.iter_mut().zip(stems).zip(folders).zip(shared) {
        view.name = folder.filter(|_| shared).unwrap_or(stem);
    }
    views
}

fn is_data(line: &str) -> bool {
    let line = line.trim();
    !line.is_empty() && !line.starts_with('#')
}

fn lens(line: &str) -> Result<(&str, Lens), String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [id, model, rest @ ..] = &words[..] else {
        return Err(format!("the line '{line}' in cameras.txt"));
    };
    let numbers: Option<Vec<f64>> = rest.iter().map(|w| w.parse().ok()).collect();
    let numbers = numbers.ok_or_else(|| format!("camera {id} with words among its numbers"))?;
    let (focal, centre, distortion) = match (*model, numbers.get(2..).unwrap_or(&[])) {
        ("SIMPLE_PINHOLE", &[f, x, y]) => ([f, f], [x, y], vec![]),
        ("PINHOLE", &[fx, fy, x, y]) => ([fx, fy], [x, y], vec![]),
        ("SIMPLE_RADIAL", &[f, x, y, k]) => ([f, f], [x, y], vec![k]),
        ("RADIAL", &[f, x, y, k1, k2]) => ([f, f], [x, y], vec![k1, k2]),
        ("OPENCV", &[fx, fy, x, y, k1, k2, p1, p2]) => ([fx, fy], [x, y], vec![k1, k2, p1, p2]),
        ("FULL_OPENCV", &[fx, fy, x, y, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            ([fx, fy], [x, y], vec![k1, k2, p1, p2, k3, k4, k5, k6])
        }
        (model, _) if model.contains("FISHEYE") => {
            return Err(format!(
                "camera {id} of the model {model}, a fisheye lens, which is not understood; undistort its pictures first"
            ));
        }
        (model, parameters) => {
            return Err(format!(
                "camera {id} of the model {model} with {} parameters; PINHOLE, RADIAL and OPENCV models are understood",
                parameters.len()
            ));
        }
    };
    let mut eight = [0.0; 8];
    eight[..distortion.len()].copy_from_slice(&distortion);
    let lens = Lens {
        size: [numbers[0], numbers[1]],
        focal,
        // COLMAP's picture begins at the outer corner of the first pixel.
        centre: centre.map(|c| c - 0.5),
        distortion: eight,
    };
    Ok((id, lens))
}

/// The nine words before an image's name: number, rotation, translation, camera; and the name, which may hold spaces.
fn split(line: &str) -> Option<([&str; 9], &str)> {
    let mut rest = line.trim();
    let mut words = [""; 9];
    for word in &mut words {
        let (first, after) = rest.split_once(char::is_whitespace)?;
        (*word, rest) = (first, after.trim_start());
    }
    (!rest.is_empty()).then_some((words, rest))
}

fn view(line: &str, lenses: &HashMap<&str, Lens>) -> Result<View, String> {
    let unknown = || format!("the line '{line}' in images.txt");
    let (words, name) = split(line).ok_or_else(unknown)?;
    let [_, numbers @ .., camera] = words;
    let numbers: Vec<f64> = numbers.iter().map_while(|w| w.parse().ok()).collect();
    let &[w, x, y, z, tx, ty, tz] = &numbers[..] else {
        return Err(unknown());
    };
    let lens = lenses
        .get(camera)
        .ok_or_else(|| format!("image {name} of a camera {camera} that cameras.txt has not"))?;
    let turn = DQuat::from_xyzw(x, y, z, w);
    if turn.is_nan() || (turn.length() - 1.0).abs() > 1e-3 {
        return Err(format!("image {name} with a rotation that is none"));
    }
    Parts {
        name,
        size: lens.size,
        focal: lens.focal,
        centre: lens.centre,
        distortion: &lens.distortion,
        rotation: DMat3::from_quat(turn.normalize()),
        translation: DVec3::new(tx, ty, tz),
    }
    .view()
}

//! Pose2Sim's and Anipose's `Calib.toml`: one table a camera.

use std::collections::BTreeMap;
use std::fmt::Write;

use glam::{DQuat, DVec3};
use serde::Deserialize;
use toml::{Spanned, Value};

use super::SUBPIXELS;
use super::parts::{Parts, pinhole, rotation, vector};
use crate::camera::{CameraError, View};

/// The table that is no camera.
const METADATA: &str = "metadata";
/// Its key that names who wrote the file, and this program's.
const WRITER: (&str, &str) = ("writer", "edgecap");
/// Its key for how many times as large the distortion may be meant, where nobody knows.
const OTHER_SCALE: &str = "other_scale";

#[derive(Deserialize)]
struct Camera {
    name: Option<String>,
    size: Vec<f64>,
    matrix: Vec<Vec<f64>>,
    distortions: Vec<f64>,
    rotation: Vec<f64>,
    translation: Vec<f64>,
    #[serde(default)]
    fisheye: bool,
}

/// Reads the text of a calibration; `file` is for errors. Cameras in the file's order.
///
/// # Errors
/// [`CameraError::Calibration`].
pub fn read_pose2sim(text: &str, file: &str) -> Result<Vec<View>, CameraError> {
    let wrong = |found: String| CameraError::Calibration {
        file: file.to_owned(),
        expected: "a calibration of Pose2Sim or Anipose (.toml), QTM (.qca.txt), OpenCV (.yml), EasyMocap or COLMAP (folders)",
        found,
    };
    let tables: BTreeMap<Spanned<String>, Value> =
        toml::from_str(text).map_err(|e| wrong(e.message().into()))?;
    let mut tables: Vec<_> = tables.into_iter().collect();
    tables.sort_by_key(|(key, _)| key.span().start);
    let mut views = Vec::new();
    for (key, table) in tables {
        let key = key.into_inner();
        if key == METADATA || !table.is_table() {
            continue;
        }
        let camera: Camera = table
            .try_into()
            .map_err(|e: toml::de::Error| wrong(format!("camera {key}: {}", e.message())))?;
        views.push(view(&key, &camera).map_err(wrong)?);
    }
    if views.is_empty() {
        return Err(wrong("no camera".into()));
    }
    Ok(views)
}

fn view(key: &str, camera: &Camera) -> Result<View, String> {
    let name = camera.name.as_deref().unwrap_or(key);
    if camera.fisheye {
        return Err(format!(
            "camera {name} with a fisheye lens, which is not understood; undistort its pictures first"
        ));
    }
    let [w, h] = camera.size[..] else {
        return Err(format!(
            "camera {name} with a size of {} numbers",
            camera.size.len()
        ));
    };
    let (focal, centre) = pinhole(&camera.matrix.concat(), name)?;
    Parts {
        name,
        size: [w, h],
        focal,
        centre,
        distortion: &camera.distortions,
        rotation: rotation(&camera.rotation, name)?,
        translation: vector(&camera.translation, name)?,
    }
    .view()
}

/// Whether a text has a table with a camera matrix.
pub(super) fn has_matrix(text: &str) -> bool {
    let tables: Option<toml::Table> = toml::from_str(text).ok();
    let has = |table: &Value| table.get("matrix").is_some();
    tables.is_some_and(|all| all.values().any(has))
}

/// How many times as large the distortion of a text's lenses may be meant: of another program's file as QTM counts, of
/// this one's as it says, if it says so.
pub(super) fn other_scale(text: &str) -> Option<f64> {
    let tables: Option<toml::Table> = toml::from_str(text).ok();
    let metadata = tables
        .as_ref()
        .and_then(|all| all.get(METADATA)?.as_table());
    let told = |key: &str| metadata.and_then(|table| table.get(key));
    match told(WRITER.0).and_then(Value::as_str) == Some(WRITER.1) {
        true => told(OTHER_SCALE).and_then(Value::as_float),
        false => Some(SUBPIXELS),
    }
}

/// The text of a `Calib.toml` that Pose2Sim reads. k3 is written as a fifth coefficient where it is not 0.
pub fn write_pose2sim(views: &[View]) -> String {
    let list = |numbers: &[f64]| {
        let all: Vec<String> = numbers.iter().map(|v| format!("{v:?}")).collect();
        format!("[{}]", all.join(", "))
    };
    let vector = |v: DVec3| list(&v.to_array());
    let mut text = String::new();
    for view in views {
        let [k1, k2, k3] = view.distortion.radial;
        let [p1, p2] = view.distortion.tangential;
        let five = [k1, k2, p1, p2, k3];
        let used = if k3 == 0.0 { &five[..4] } else { &five[..] };
        let name = Value::String(view.name.clone());
        let mut key = view.name.clone();
        // Such a table is taken for no camera's; the name beside it is what counts.
        while key == METADATA || (key != view.name && views.iter().any(|v| v.name == key)) {
            key.push('_');
        }
        let key = Value::String(key);
        let _ = write!(
            text,
            "[{key}]\nname = {name}\nsize = {}\nmatrix = [{}, {}, {}]\ndistortions = {}\nrotation = {}\ntranslation = {}\nfisheye = false\n\n",
            list(&view.likely_size().map(f64::from)),
            list(&[view.focal.x, 0.0, view.centre.x]),
            list(&[0.0, view.focal.y, view.centre.y]),
            list(&[0.0, 0.0, 1.0]),
            list(used),
            vector(DQuat::from_mat3(&view.rotation).to_scaled_axis()),
            vector(-(view.rotation * view.position)),
        );
    }
    let _ = write!(text, "[{METADATA}]\nadjusted = false\nerror = 0.0\n");
    text
}

/// The same of lenses that this program has measured, which it says: no scale of another program has slipped into them.
pub fn write_measured(views: &[View]) -> String {
    let (key, writer) = WRITER;
    // The metadata are the last table.
    format!("{}{key} = \"{writer}\"\n", write_pose2sim(views))
}

/// The same of lenses of which nobody knows whether their distortion is meant `scale` times as large, which it says:
/// whoever reads it has both readings.
pub fn write_doubtful(views: &[View], scale: f64) -> String {
    format!("{}{OTHER_SCALE} = {scale:?}\n", write_measured(views))
}

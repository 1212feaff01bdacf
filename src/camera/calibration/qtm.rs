//! Calibrations of Qualisys Track Manager (`.qca.txt`, XML) go in, views come out.
//!
//! Pixels are counted in 1/64, positions in millimetres; the rows of the rotation are the camera's axes in the world, x
//! right, y up, z backward. Distortion coefficients are unscaled and those of OpenCV. Cameras that QTM has not
//! calibrated stand in its files too, with numbers that mean nothing.

use glam::{DMat3, DVec3};
use roxmltree::{Document, Node};

use super::SUBPIXELS;
use super::parts::{Parts, pinhole, proper};
use crate::camera::{CameraError, View};

/// Reads the text of a calibration, leaving out cameras that it says are not calibrated; `name` is for errors.
///
/// # Errors
/// [`CameraError::Calibration`] when it is no such calibration or a number is missing.
pub fn read_qtm(text: &str, name: &str) -> Result<Vec<View>, CameraError> {
    read_noted(text, name).map(|(views, _)| views)
}

/// The same, with a line about every camera that is left out.
///
/// # Errors
/// As for [`read_qtm`].
pub(super) fn read_noted(text: &str, name: &str) -> Result<(Vec<View>, Vec<String>), CameraError> {
    let wrong = |found: String| CameraError::Calibration {
        file: name.to_owned(),
        expected: "a QTM calibration (.qca.txt)",
        found,
    };
    let document = Document::parse(text).map_err(|e| wrong(e.to_string()))?;
    let active = document
        .descendants()
        .filter(|n| n.has_tag_name("camera") && n.attribute("active") != Some("0"));
    let is_calibrated = |camera: &Node<'_, '_>| {
        let told = camera.attribute("calibrated").map(str::trim);
        !told.is_some_and(|told| told == "0" || told.eq_ignore_ascii_case("false"))
    };
    let (cameras, others): (Vec<_>, Vec<_>) = active.partition(is_calibrated);
    let views = cameras
        .into_iter()
        .map(view)
        .collect::<Result<Vec<_>, _>>()
        .map_err(wrong)?;
    if views.is_empty() {
        return Err(wrong(match others.len() {
            0 => "no active camera".into(),
            _ => "no camera that is calibrated".into(),
        }));
    }
    let left_out = others.iter().map(|camera| {
        format!(
            "{name}: camera {} is not calibrated; left out",
            serial(*camera)
        )
    });
    Ok((views, left_out.collect()))
}

fn serial<'a>(camera: Node<'a, '_>) -> &'a str {
    camera.attribute("serial").unwrap_or("?")
}

fn view(camera: Node<'_, '_>) -> Result<View, String> {
    let name = serial(camera);
    let part = |tag: &str| {
        let mut children = camera.children();
        children
            .find(|n| n.has_tag_name(tag))
            .ok_or_else(|| format!("camera {name} without <{tag}>"))
    };
    let number = |node: Node<'_, '_>, key: &str| -> Result<f64, String> {
        node.attribute(key)
            .and_then(|v| v.trim().parse().ok())
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| format!("camera {name} without the number {key}"))
    };
    // Of video that is cropped the first is the part of the sensor that its pictures show.
    let picture = part("fov_video").or_else(|_| part("fov_video_max"))?;
    let (inner, outer) = (part("intrinsic")?, part("transform")?);
    // Older files tell neither of these.
    let number_or_0 = |key: &str| match inner.has_attribute(key) {
        true => number(inner, key),
        false => Ok(0.0),
    };
    let [f, g, u, v, skew] = [
        number(inner, "focalLengthU")?,
        number(inner, "focalLengthV")?,
        number(inner, "centerPointU")?,
        number(inner, "centerPointV")?,
        number_or_0("skew")?,
    ]
    .map(|subpixels| subpixels / SUBPIXELS);
    let (focal, [u, v]) = pinhole(&[f, skew, u, 0.0, g, v, 0.0, 0.0, 1.0], name)?;
    // The principal point is counted from the sensor's corner.
    let centre = [u - number(picture, "left")?, v - number(picture, "top")?];
    let row = |k: usize| -> Result<DVec3, String> {
        Ok(DVec3::new(
            number(outer, &format!("r{k}1"))?,
            number(outer, &format!("r{k}2"))?,
            number(outer, &format!("r{k}3"))?,
        ))
    };
    let rotation = DMat3::from_cols(row(1)?, -row(2)?, -row(3)?).transpose();
    let rotation = proper(rotation, name)?;
    if let Some(turned) = camera.attribute("viewrotation").filter(|v| v.trim() != "0") {
        return Err(format!(
            "camera {name} turned by viewrotation=\"{turned}\": its numbers are those of portrait pictures; export the calibration with views not turned"
        ));
    }
    let pixels = |first: &str, last: &str| -> Result<f64, String> {
        Ok(number(picture, last)? - number(picture, first)? + 1.0)
    };
    let millimetres = DVec3::new(
        number(outer, "x")?,
        number(outer, "y")?,
        number(outer, "z")?,
    );
    Parts {
        name,
        size: [pixels("left", "right")?, pixels("top", "bottom")?],
        focal,
        centre,
        distortion: &[
            number(inner, "radialDistortion1")?,
            number(inner, "radialDistortion2")?,
            number(inner, "tangentalDistortion1")?,
            number(inner, "tangentalDistortion2")?,
            number_or_0("radialDistortion3")?,
        ],
        rotation,
        translation: -(rotation * millimetres) * 1e-3,
    }
    .view()
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    const ONE: &str = r#"<?xml version='1.0' encoding='ASCII'?><calibration><cameras>
        <camera active="1" serial="cam01" viewrotation="0">
        <fov_video_max bottom="1919" left="0" right="1087" top="0"/>
        <transform r11="0" r12="1" r13="0" r21="0" r22="0" r23="1" r31="1" r32="0" r33="0" x="3000" y="0" z="1500"/>
        <intrinsic centerPointU="34816" centerPointV="61440" focalLengthU="107520" focalLengthV="107520"
          radialDistortion1="0" radialDistortion2="0" tangentalDistortion1="0" tangentalDistortion2="0"/>
        </camera></cameras></calibration>"#;

    #[test]
    fn pictures_that_no_camera_takes_are_refused() {
        let wide = ONE.replace("right=\"1087\"", "right=\"214748364879\"");
        let e = read_qtm(&wide, "one").unwrap_err().to_string();
        assert!(
            e.contains("cam01 with pictures of 214748364880x1920"),
            "{e}"
        );
        let e = read_qtm(
            &ONE.replace("focalLengthU=\"107520\"", "focalLengthU=\"-1\""),
            "one",
        );
        assert!(e.unwrap_err().to_string().contains("focal lengths"));
    }

    #[test]
    fn a_camera_looks_at_what_is_in_front_of_it() {
        let [view] = &read_qtm(ONE, "one").unwrap()[..] else {
            panic!("one camera");
        };
        assert_eq!((view.name.as_str(), view.size), ("cam01", [1088, 1920]));
        // Three metres along the world's x, 1.5 m up, looking back along x; the world's z is up, its y to the right.
        let middle = view.project(DVec3::new(0.0, 0.0, 1.5)).unwrap();
        assert!((middle - DVec2::new(544.0, 960.0)).length() < 1e-9);
        let beside = view.project(DVec3::new(0.0, 0.3, 1.8)).unwrap();
        assert!((beside - DVec2::new(544.0 + 168.0, 960.0 - 168.0)).length() < 1e-9);
        assert!(view.project(DVec3::new(4.0, 0.0, 1.5)).is_none());
    }

    #[test]
    fn pictures_of_a_part_of_the_sensor_have_its_size_and_their_own_centre() {
        let read = |text: &str| read_qtm(text, "one").unwrap().remove(0);
        let cropped = ONE.replace(
            "<transform",
            "<fov_video left=\"100\" top=\"400\" right=\"899\" bottom=\"1599\"/><transform",
        );
        let (whole, part) = (read(ONE), read(&cropped));
        assert_eq!(part.size, [800, 1200]);
        let place = DVec3::new(0.0, 0.3, 1.8);
        let moved = whole.project(place).unwrap() - part.project(place).unwrap();
        assert!(
            (moved - DVec2::new(100.0, 400.0)).length() < 1e-9,
            "{moved}"
        );
        let same = "<fov_video bottom=\"1919\" left=\"0\" right=\"1087\" top=\"0\"/><transform";
        assert_eq!(read(&ONE.replace("<transform", same)), whole);
    }

    #[test]
    fn a_third_radial_coefficient_is_read_and_a_skewed_lens_refused() {
        let with = |more: &str| {
            let text = ONE.replace("radialDistortion1=\"0\"", more);
            read_qtm(&text, "one").map_err(|e| e.to_string())
        };
        let three = "radialDistortion1=\"-0.2\" radialDistortion3=\"0.03\" skew=\"0.000\"";
        let views = with(three).unwrap();
        assert_eq!(views[0].distortion.radial, [-0.2, 0.0, 0.03]);
        // 0.2 % of the focal length; a tenth of that is rounding.
        let said = with("radialDistortion1=\"0\" skew=\"215\"").unwrap_err();
        assert!(said.contains("cam01 with a skewed"), "{said}");
        assert!(with("radialDistortion1=\"0\" skew=\"21\"").is_ok());
        let said = with("radialDistortion1=\"0\" radialDistortion3=\"much\"").unwrap_err();
        assert!(said.contains("radialDistortion3"), "{said}");
    }

    #[test]
    fn cameras_that_are_not_calibrated_are_left_out() {
        let mark = |text: &str, told: &str| {
            text.replace("serial=", &format!("calibrated=\"{told}\" serial="))
        };
        let raw = "<camera active=\"1\" calibrated=\"false\" serial=\"cam02\"/></cameras>";
        let two = mark(ONE, "true").replace("</cameras>", raw);
        let (views, notes) = read_noted(&two, "one").unwrap();
        assert_eq!(views, read_qtm(ONE, "one").unwrap());
        assert!(
            notes.len() == 1 && notes[0].contains("cam02 is not calibrated"),
            "{notes:?}"
        );
        let e = read_qtm(&mark(ONE, "false"), "one").unwrap_err();
        assert!(
            e.to_string().contains("no camera that is calibrated"),
            "{e}"
        );
    }

    #[test]
    fn mistakes_are_named() {
        for (text, expected) in [
            ("no xml", "a QTM calibration"),
            ("<calibration/>", "no active camera"),
            (
                &ONE.replace("focalLengthU", "focalLength"),
                "cam01 without the number focalLengthU",
            ),
            (
                &ONE.replace("<transform", "<transfer"),
                "cam01 without <transform>",
            ),
            (&ONE.replace("r12=\"1\"", "r12=\"2\""), "rotation"),
        ] {
            let error = read_qtm(text, "c.qca.txt").unwrap_err().to_string();
            assert!(
                error.contains("c.qca.txt") && error.contains(expected),
                "{error}"
            );
        }
    }
}

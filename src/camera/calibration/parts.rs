//! What every format comes down to: numbers of one camera go in, a view comes out.

use glam::{DMat3, DVec2, DVec3};

use crate::camera::{Brown, View};

/// How far a rotation's rows may be from orthonormal: files round to few digits.
const ROUNDING: f64 = 2e-3;

/// One camera as files describe it.
pub(super) struct Parts<'a> {
    pub name: &'a str,
    /// Pixels across and down.
    pub size: [f64; 2],
    /// Focal lengths.
    pub focal: [f64; 2],
    /// Principal point, centres of pixels on integers.
    pub centre: [f64; 2],
    /// `k1 k2 p1 p2 k3`, or the first of them; more only where they are 0.
    pub distortion: &'a [f64],
    /// World axes to camera axes.
    pub rotation: DMat3,
    /// The world's origin in camera axes.
    pub translation: DVec3,
}

impl Parts<'_> {
    /// The view.
    ///
    /// # Errors
    /// What is wrong with the camera.
    pub fn view(&self) -> Result<View, String> {
        let name = self.name;
        let [w, h] = self.size;
        let numbers = [self.size, self.focal, self.centre].concat();
        let all = numbers.iter().chain(self.distortion);
        if all.clone().any(|v| !v.is_finite())
            || !self.rotation.is_finite()
            || !self.translation.is_finite()
        {
            return Err(format!("camera {name} with a number that is not finite"));
        }
        if !(1.0..=65_536.0).contains(&w) || !(1.0..=65_536.0).contains(&h) {
            return Err(format!("camera {name} with pictures of {w}x{h} pixels"));
        }
        if self.focal.iter().any(|f| *f <= 0.0) {
            return Err(format!(
                "camera {name} with focal lengths {} and {}",
                self.focal[0], self.focal[1]
            ));
        }
        let mut five = [0.0; 5];
        for (k, value) in self.distortion.iter().enumerate() {
            match five.get_mut(k) {
                Some(slot) => *slot = *value,
                None if *value == 0.0 => (),
                None => {
                    return Err(format!(
                        "camera {name} with {} distortion coefficients; Brown's k1 k2 p1 p2 k3 are understood, calibrate with these",
                        self.distortion.len()
                    ));
                }
            }
        }
        let [k1, k2, p1, p2, k3] = five;
        Ok(View {
            name: name.to_owned(),
            size: [w.round() as u32, h.round() as u32],
            focal: DVec2::from(self.focal),
            centre: DVec2::from(self.centre),
            distortion: Brown {
                radial: [k1, k2, k3],
                tangential: [p1, p2],
            },
            rotation: proper(self.rotation, name)?,
            position: -(self.rotation.transpose() * self.translation),
        })
    }
}

/// A rotation; a mirror is told apart from a matrix that is neither.
///
/// # Errors
/// When it is none.
pub(super) fn proper(rotation: DMat3, name: &str) -> Result<DMat3, String> {
    let off = rotation * rotation.transpose() - DMat3::IDENTITY;
    // False for NaN as well.
    if !off.to_cols_array().iter().all(|v| v.abs() < ROUNDING) {
        return Err(format!("camera {name} with a rotation that is none"));
    }
    if rotation.determinant() < 0.0 {
        return Err(format!(
            "camera {name} mirrored: its rotation has determinant -1; calibrate again without flipping pictures or axes"
        ));
    }
    Ok(rotation)
}

/// Focal lengths and principal point of a camera matrix, row by row.
///
/// # Errors
/// When it is no pinhole with square axes.
pub(super) fn pinhole(matrix: &[f64], name: &str) -> Result<([f64; 2], [f64; 2]), String> {
    let &[fx, skew, cx, _, fy, cy, _, _, _] = matrix else {
        return Err(format!(
            "camera {name} with a camera matrix of {} numbers",
            matrix.len()
        ));
    };
    if skew.abs() > 1e-3 * fx.abs() {
        return Err(format!("camera {name} with a skewed camera matrix"));
    }
    Ok(([fx, fy], [cx, cy]))
}

/// A rotation given as a vector (axis times angle) or as a matrix, row by row.
///
/// # Errors
/// For other counts of numbers.
pub(super) fn rotation(numbers: &[f64], name: &str) -> Result<DMat3, String> {
    match *numbers {
        [x, y, z] => {
            let vector = DVec3::new(x, y, z);
            // Angles beyond a few turns are no angles; huge ones would lose all digits.
            if vector.is_nan() || vector.length() > 100.0 {
                return Err(format!("camera {name} with a rotation that is none"));
            }
            Ok(DMat3::from_quat(glam::DQuat::from_scaled_axis(vector)))
        }
        [a, b, c, d, e, f, g, h, i] => {
            Ok(DMat3::from_cols_array(&[a, b, c, d, e, f, g, h, i]).transpose())
        }
        _ => Err(format!(
            "camera {name} with a rotation of {} numbers instead of 3 or 9",
            numbers.len()
        )),
    }
}

/// Three numbers.
///
/// # Errors
/// For other counts.
pub(super) fn vector(numbers: &[f64], name: &str) -> Result<DVec3, String> {
    match *numbers {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(format!(
            "camera {name} with a translation of {} numbers",
            numbers.len()
        )),
    }
}

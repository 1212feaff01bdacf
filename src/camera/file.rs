//! `camera.toml`: what a user knows about the lens goes in, the camera of each frame comes out.

use std::path::Path;

use edgecap_client::message::Intrinsics;
use serde::{Deserialize, Serialize};

use super::{Brown, CameraError, calibration};
use crate::bounded;

/// Horizontal field of view of an ordinary webcam, degrees.
pub const DEFAULT_FOV: f32 = 60.0;
/// How much the aspect of a frame may differ from the calibrated one: rounding of sizes, not a crop.
const ASPECT_TOLERANCE: f32 = 0.02;

/// The lens of a camera, independent of the size of its pictures.
///
/// Either `fov_degrees = 70.0` (horizontal field of view), or a calibration: `fx`, `fy`, `cx`, `cy` in pixels of a
/// picture of `width` × `height`, centres of pixels on integers, and distortion `k1`, `k2`, `p1`, `p2`, `k3` as in
/// OpenCV, 0 where not given.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Raw", into = "Raw")]
pub enum CameraFile {
    /// Square pixels, principal point in the middle.
    Fov {
        /// Horizontal field of view, degrees.
        degrees: f32,
    },
    /// Measured at one size of picture.
    Calibrated {
        /// In pixels of that size.
        intrinsics: Intrinsics,
        /// Width of that size.
        width: u32,
        /// Height of that size.
        height: u32,
        /// What the lens does to the pinhole's picture.
        distortion: Brown,
    },
}

impl Default for CameraFile {
    fn default() -> Self {
        Self::Fov {
            degrees: DEFAULT_FOV,
        }
    }
}

/// The file as it is written.
#[derive(Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    fov_degrees: Option<f32>,
    fx: Option<f32>,
    fy: Option<f32>,
    cx: Option<f32>,
    cy: Option<f32>,
    width: Option<u32>,
    height: Option<u32>,
    k1: Option<f64>,
    k2: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    k3: Option<f64>,
}

impl CameraFile {
    /// Reads a file.
    ///
    /// # Errors
    /// [`CameraError::Read`] when it cannot be read, [`CameraError::Settings`] when its contents make no camera.
    pub fn read(path: &Path) -> Result<Self, CameraError> {
        let text =
            bounded::read_text(path, bounded::SETTINGS).map_err(|e| CameraError::read(path, e))?;
        Self::parse(&text).map_err(|reason| CameraError::Settings {
            file: path.display().to_string(),
            reason: match calibration::whose(&text) {
                Some(other) => format!(
                    "expected the lens alone (TOML), found a calibration of {other}; write fx, fy, cx, cy, width, \
                     height, all in pixels, and k1, k2, p1, p2, k3 into a file of their own, a line each, as in \
                     fx = 900.5"
                ),
                None => reason,
            },
        })
    }

    /// Reads the file's text.
    ///
    /// # Errors
    /// One line: what is missing, unknown or impossible.
    pub fn parse(text: &str) -> Result<Self, String> {
        let raw: Raw = toml::from_str(text).map_err(|e| {
            let place = e.span().map_or(String::new(), |s| {
                format!(
                    "line {}: ",
                    1 + text[..s.start.min(text.len())].matches('\n').count()
                )
            });
            format!("{place}{}", e.message())
        })?;
        raw.try_into()
    }

    /// What the lens does to the pinhole's picture, at any size.
    pub fn distortion(&self) -> Brown {
        match *self {
            Self::Fov { .. } => Brown::default(),
            Self::Calibrated { distortion, .. } => distortion,
        }
    }

    /// Horizontal field of view, degrees.
    pub fn fov_degrees(&self) -> f32 {
        match *self {
            Self::Fov { degrees } => degrees,
            Self::Calibrated {
                intrinsics, width, ..
            } => 2.0 * (0.5 * width as f32 / intrinsics.fx).atan().to_degrees(),
        }
    }

    /// The camera of pictures of `width` × `height`.
    ///
    /// # Errors
    /// One line when the calibration is for pictures of another shape: a crop, whose place nobody has told.
    pub fn for_frame(&self, width: u32, height: u32) -> Result<Intrinsics, String> {
        match *self {
            Self::Fov { degrees } => Ok(Intrinsics::from_horizontal_fov(width, height, degrees)),
            Self::Calibrated {
                intrinsics: i,
                width: w,
                height: h,
                ..
            } => {
                let (sx, sy) = (width as f32 / w as f32, height as f32 / h as f32);
                if (sx / sy - 1.0).abs() > ASPECT_TOLERANCE {
                    return Err(format!(
                        "the camera is calibrated for {w}x{h} pictures, these have {width}x{height}, another shape; calibrate at this size or give fov_degrees"
                    ));
                }
                // Edges scale about the picture's edge; centres of pixels lie half a pixel inside.
                Ok(Intrinsics {
                    fx: i.fx * sx,
                    fy: i.fy * sy,
                    cx: (i.cx + 0.5) * sx - 0.5,
                    cy: (i.cy + 0.5) * sy - 0.5,
                })
            }
        }
    }
}

impl TryFrom<Raw> for CameraFile {
    type Error = String;

    fn try_from(raw: Raw) -> Result<Self, String> {
        match raw {
            Raw {
                fov_degrees: Some(degrees),
                fx: None,
                fy: None,
                cx: None,
                cy: None,
                width: None,
                height: None,
                k1: None,
                k2: None,
                p1: None,
                p2: None,
                k3: None,
            } => {
                if !(1.0..=179.0).contains(&degrees) {
                    return Err(format!(
                        "expected a horizontal field of view of 1 to 179 degrees, found {degrees}"
                    ));
                }
                Ok(Self::Fov { degrees })
            }
            Raw {
                fov_degrees: None,
                fx: Some(fx),
                fy,
                cx: Some(cx),
                cy: Some(cy),
                width: Some(width),
                height: Some(height),
                k1,
                k2,
                p1,
                p2,
                k3,
            } => {
                let [k1, k2, p1, p2, k3] = [k1, k2, p1, p2, k3].map(Option::unwrap_or_default);
                if ![k1, k2, p1, p2, k3].iter().all(|k| k.is_finite()) {
                    return Err("expected finite k1, k2, p1, p2, k3".into());
                }
                let fy = fy.unwrap_or(fx);
                let lengths = [fx, fy].iter().all(|f| f.is_finite() && *f > 0.0);
                let inside = (0.0..width as f32).contains(&cx) && (0.0..height as f32).contains(&cy);
                if !lengths || !inside {
                    return Err(format!(
                        "expected focal lengths above 0 and a principal point inside {width}x{height}, found fx {fx}, fy {fy}, cx {cx}, cy {cy}"
                    ));
                }
                Ok(Self::Calibrated {
                    intrinsics: Intrinsics { fx, fy, cx, cy },
                    width,
                    height,
                    distortion: Brown {
                        radial: [k1, k2, k3],
                        tangential: [p1, p2],
                    },
                })
            }
            _ => Err(
                "expected either fov_degrees alone, or fx, cx, cy, width, height (and fy where pixels are not square, k1, k2, p1, p2, k3 where the lens distorts)".into(),
            ),
        }
    }
}

impl From<CameraFile> for Raw {
    fn from(lens: CameraFile) -> Self {
        match lens {
            CameraFile::Fov { degrees } => Self {
                fov_degrees: Some(degrees),
                ..Self::default()
            },
            CameraFile::Calibrated {
                intrinsics: i,
                width,
                height,
                distortion,
            } => {
                // What is 0 is not written, as before there was distortion.
                let [k1, k2, k3] = distortion.radial.map(|k| Some(k).filter(|k| *k != 0.0));
                let [p1, p2] = distortion.tangential.map(|p| Some(p).filter(|p| *p != 0.0));
                Self {
                    fov_degrees: None,
                    fx: Some(i.fx),
                    fy: Some(i.fy),
                    cx: Some(i.cx),
                    cy: Some(i.cy),
                    width: Some(width),
                    height: Some(height),
                    k1,
                    k2,
                    p1,
                    p2,
                    k3,
                }
            }
        }
    }
}

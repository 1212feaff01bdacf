//! Exact truth about a synthetic clip or set of stills, as one JSON file: `truth.json`.
//!
//! Frames of reference: camera space is x right, y down, z forward, metres; pixels have their centres on integers.
//! Joint orders are [`JOINT_NAMES`](crate::joints::JOINT_NAMES); the first 14 are the evidence joints. Lengths are
//! rounded to 0.1 mm, pixels to 0.1; `joints2d` is the projection of the rounded `joints3d`. In accelerations
//! computed from them the rounding is some 0.1 m/s² at 30 frames per second, and 6 m/s² at 240.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::frames::FrameWriter;
use crate::joints::BODY_JOINTS;

/// Value of [`Truth::format`].
pub const FORMAT: &str = "edgecap-truth";
/// Value of [`Truth::version`] that this build writes and reads.
pub const VERSION: u32 = 1;

/// Joint outside the picture.
pub const ABSENT: u8 = 0;
/// Joint under visible skin or cloth.
pub const VISIBLE: u8 = 1;
/// Joint hidden by another part of the same body.
pub const SELF_OCCLUDED: u8 = 2;
/// Joint hidden by another person or a thing.
pub const OCCLUDED: u8 = 3;

/// What went wrong with a truth file.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// It could not be read or written.
    #[error("cannot access truth file {path}: {source}; check the path and its permissions")]
    Io {
        /// The file.
        path: String,
        /// The cause.
        source: std::io::Error,
    },
    /// It is no JSON of this layout.
    #[error(
        "expected an {FORMAT} file, but {path} does not parse: {source}; write it again with `edgecap synth`"
    )]
    Parse {
        /// The file.
        path: String,
        /// The cause.
        source: serde_json::Error,
    },
    /// It is another format or version.
    #[error(
        "expected {FORMAT} version {VERSION}, found {format} version {version}; write it again with this edgecap's `synth`"
    )]
    Version {
        /// Found format.
        format: String,
        /// Found version.
        version: u32,
    },
}

/// Truth about all frames of one clip or set of stills.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`].
    pub version: u32,
    /// Seed it was made from.
    pub seed: u64,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Frames per second; 0 for stills, whose frames have nothing to do with each other.
    pub fps: f32,
    /// The clip, by its file's name; absent for stills.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip: Option<String>,
    /// The frames in order.
    pub frames: Vec<TruthFrame>,
}

/// Pinhole camera of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TruthCamera {
    /// Horizontal focal length, pixels.
    pub fx: f32,
    /// Vertical focal length, pixels.
    pub fy: f32,
    /// Principal point, u.
    pub cx: f32,
    /// Principal point, v.
    pub cy: f32,
    /// The floor in camera space: unit normal pointing up, then the offset `d` of `n · p + d = 0`, metres.
    pub floor: [f32; 4],
}

/// One frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthFrame {
    /// Number of the frame, from 0.
    pub frame: u64,
    /// Time since the first frame, nanoseconds; 0 for stills.
    pub time_ns: u64,
    /// Picture file beside the truth file; absent for clips.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// The camera.
    pub camera: TruthCamera,
    /// Everybody whose body reaches into the picture, also those who are hidden there: see `visibility` and `pixels`.
    pub people: Vec<TruthPerson>,
}

/// One person in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthPerson {
    /// Identity, from 1; constant over a clip, unrelated between stills.
    pub id: u32,
    /// Crown to floor when upright, metres, without hair and hat.
    pub stature: f32,
    /// Body joints in camera space, metres.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
    /// Their pixels; meaningless for joints behind the camera (z ≤ 0).
    pub joints2d: [[f32; 2]; BODY_JOINTS],
    /// 0 outside the picture, 1 visible, 2 hidden by the own body, 3 hidden by another person or a thing.
    pub visibility: [u8; BODY_JOINTS],
    /// Box of the whole body in pixels, hidden parts and parts outside the picture included: u0, v0, u1, v1. Absent
    /// when part of the body is behind the camera.
    #[serde(rename = "box", default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[f32; 4]>,
    /// Area of the picture that shows this person, pixels; 0: wholly hidden.
    pub pixels: f32,
}

impl Truth {
    /// Reads a truth file.
    pub fn load(path: &Path) -> Result<Self, TruthError> {
        let shown = || path.display().to_string();
        let text = crate::bounded::read_text(path, crate::bounded::DATA).map_err(|source| {
            TruthError::Io {
                path: shown(),
                source,
            }
        })?;
        Self::parse(&text, &shown())
    }

    /// Parses the text of a truth file; `name` is for messages.
    pub fn parse(text: &str, name: &str) -> Result<Self, TruthError> {
        let truth: Self = serde_json::from_str(text).map_err(|source| TruthError::Parse {
            path: name.to_owned(),
            source,
        })?;
        if truth.format != FORMAT || truth.version != VERSION {
            return Err(TruthError::Version {
                format: truth.format,
                version: truth.version,
            });
        }
        Ok(truth)
    }

    /// The file's text up to its first frame.
    pub fn head(&self) -> String {
        let clip = match &self.clip {
            Some(clip) => format!("\"clip\":{},", serde_json::json!(clip)),
            None => String::new(),
        };
        format!(
            "{{\"format\":\"{}\",\"version\":{},\"seed\":{},\"width\":{},\"height\":{},\"fps\":{},{clip}\"frames\":[",
            self.format, self.version, self.seed, self.width, self.height, self.fps
        )
    }

    /// The file's text: one frame a line.
    pub fn to_text(&self) -> String {
        let write = || {
            let mut out = FrameWriter::new(Vec::new(), &self.head(), u64::MAX)?;
            for frame in &self.frames {
                let line = out.line(frame)?;
                out.add(&line)?;
            }
            out.finish()
        };
        let bytes = write().expect("numbers and strings always serialise, and memory takes them");
        String::from_utf8(bytes).expect("JSON is text")
    }
}

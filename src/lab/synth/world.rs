//! Exact truth about people whom several cameras see, in the axes of their calibration, as one JSON file: `world.json`.
//!
//! World axes: z up, the floor at z = 0, metres. What every view shows is in a [`Truth`](super::Truth) of its own.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::truth::TruthError;
use crate::joints::BODY_JOINTS;

/// Value of [`WorldTruth::format`].
pub const FORMAT: &str = "edgecap-world";
/// Value of [`WorldTruth::version`] that this build writes and reads.
pub const VERSION: u32 = 1;

/// Where everybody is in every frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorldTruth {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`].
    pub version: u32,
    /// Seed it was made from.
    pub seed: u64,
    /// Frames per second.
    pub fps: f32,
    /// The frames in order.
    pub frames: Vec<WorldFrame>,
}

/// One frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorldFrame {
    /// Number of the frame, from 0.
    pub frame: u64,
    /// Time since the first frame, nanoseconds.
    pub time_ns: u64,
    /// Everybody, whether a camera sees them or not.
    pub people: Vec<WorldPerson>,
}

/// One person in one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorldPerson {
    /// Identity, from 1, as in the truth about the views.
    pub id: u32,
    /// Crown to floor when upright, metres, without hair and hat.
    pub stature: f32,
    /// Body joints in world axes, metres.
    pub joints3d: [[f32; 3]; BODY_JOINTS],
}

impl WorldTruth {
    /// The file's text up to its first frame.
    pub fn head(&self) -> String {
        format!(
            "{{\"format\":\"{}\",\"version\":{},\"seed\":{},\"fps\":{},\"frames\":[",
            self.format, self.version, self.seed, self.fps
        )
    }

    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be read or is another format or version.
    pub fn load(path: &Path) -> Result<Self, TruthError> {
        let shown = || path.display().to_string();
        let text = crate::bounded::read_text(path, crate::bounded::DATA).map_err(|source| {
            TruthError::Io {
                path: shown(),
                source,
            }
        })?;
        let truth: Self = serde_json::from_str(&text).map_err(|source| TruthError::Parse {
            path: shown(),
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
}

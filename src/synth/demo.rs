//! The bundled clip: a few seconds of synthetic people, with the exact truth about them.

use super::truth::Truth;
use crate::capture::CameraFile;

/// The clip: Motion-JPEG in an AVI container.
pub const CLIP: &[u8] = include_bytes!("../../models/demo/demo.avi");

const TRUTH: &[u8] = include_bytes!("../../models/demo/truth.json");

/// What is true about every frame of [`CLIP`].
///
/// # Panics
/// If the bundled file is damaged, which the tests rule out.
pub fn truth() -> Truth {
    serde_json::from_slice(TRUTH).expect("the bundled truth is intact")
}

/// The camera of [`CLIP`].
pub fn camera() -> CameraFile {
    let truth = truth();
    let c = truth.frames[0].camera;
    CameraFile::Calibrated {
        intrinsics: crate::message::Intrinsics {
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
        },
        width: truth.width,
        height: truth.height,
    }
}

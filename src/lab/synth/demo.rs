//! What is true about the bundled clip.

use super::truth::Truth;

const TRUTH: &[u8] = include_bytes!("../../../models/demo/truth.json");

/// What is true about every frame of [`crate::capture::demo::CLIP`].
///
/// # Panics
/// If the bundled file is damaged, which the tests rule out.
pub fn truth() -> Truth {
    serde_json::from_slice(TRUTH).expect("the bundled truth is intact")
}

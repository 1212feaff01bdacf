//! The bundled clip: a few seconds of synthetic people.

use crate::camera::CameraFile;

/// The clip: Motion-JPEG in an AVI container.
pub const CLIP: &[u8] = include_bytes!("../../models/demo/demo.avi");

const CAMERA: &str = include_str!("../../models/demo/camera.toml");

/// The camera of [`CLIP`].
///
/// # Panics
/// If the bundled file is damaged, which the tests rule out.
pub fn camera() -> CameraFile {
    CameraFile::parse(CAMERA).expect("the bundled camera file is intact")
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_camera_reads() {
        super::camera();
    }
}

//! What a user may wish of a camera.

use super::controls::ControlSetting;

/// Wishes about an input; a source that cannot fulfil one goes on without it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenOptions {
    /// Width and height asked of a camera, pixels.
    pub size: Option<(u32, u32)>,
    /// Pictures per second asked of a camera, or at which a folder's photos or a raw film were taken.
    pub fps: Option<f64>,
    /// What to set on a camera, in this order.
    pub controls: Vec<ControlSetting>,
}

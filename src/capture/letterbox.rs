//! Where the original picture lies in the network's input.

/// Uniform scale and offset that fit a picture into the network's input: `input = original * scale + offset`, for
/// coordinates whose pixel centres are integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Letterbox {
    /// Input pixels per original pixel.
    pub scale: f32,
    /// Offset along u, input pixels.
    pub offset_u: f32,
    /// Offset along v, input pixels.
    pub offset_v: f32,
}

impl Letterbox {
    /// Input pixel → original pixel.
    pub fn to_original(&self, u: f32, v: f32) -> [f32; 2] {
        [
            (u - self.offset_u) / self.scale,
            (v - self.offset_v) / self.scale,
        ]
    }
}

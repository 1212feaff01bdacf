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
    /// The largest scale at which a `src_w` × `src_h` picture fits into `dst_w` × `dst_h` pixels, centred.
    ///
    /// # Panics
    /// When a side is 0.
    pub fn fit(src_w: u32, src_h: u32, dst_w: u32, dst_h: u32) -> Self {
        assert!(
            src_w > 0 && src_h > 0 && dst_w > 0 && dst_h > 0,
            "expected sides above 0, found {src_w}x{src_h} into {dst_w}x{dst_h}"
        );
        let [sw, sh, dw, dh] = [src_w, src_h, dst_w, dst_h].map(f64::from);
        let scale = (dw / sw).min(dh / sh);
        // Edges scale about the edge of the picture; pixel centres lie half a pixel inside.
        let offset = |src: f64, dst: f64| 0.5 * (dst - src * scale) + 0.5 * scale - 0.5;
        Self {
            scale: scale as f32,
            offset_u: offset(sw, dw) as f32,
            offset_v: offset(sh, dh) as f32,
        }
    }

    /// Original pixel → input pixel.
    pub fn to_input(&self, u: f32, v: f32) -> [f32; 2] {
        [
            u * self.scale + self.offset_u,
            v * self.scale + self.offset_v,
        ]
    }

    /// Input pixel → original pixel.
    pub fn to_original(&self, u: f32, v: f32) -> [f32; 2] {
        [
            (u - self.offset_u) / self.scale,
            (v - self.offset_v) / self.scale,
        ]
    }
}

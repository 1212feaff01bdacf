//! What Stage I puts out.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS, LIMBS};

/// Channels of the 2D head: heatmaps, then (x, y) of every part affinity field.
pub const HEAD2D_CHANNELS: usize = EVIDENCE_JOINTS + 2 * LIMBS;
/// Channels of the 3D head: (x, y, z) of every bone's encoding.
pub const HEAD3D_CHANNELS: usize = 3 * BODY_JOINTS;

/// Stage I's output maps, row-major [height, width, channels], at 1/8 of the network input.
///
/// Cell (row r, column c) is centred on input pixel (8c + 3.5, 8r + 3.5), pixel centres on integers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Maps {
    /// Cells across.
    pub width: usize,
    /// Cells down.
    pub height: usize,
    /// `[height, width, 40]`: 14 heatmaps (peak 1), then 13 × (x, y) unit vectors from child to parent.
    pub head2d: Vec<f32>,
    /// `[height, width, 63]`: joint minus its parent, metres at canonical stature, view-aligned (XNect §4.1.2); read at
    /// the evidence joints where the bone meets.
    pub head3d: Vec<f32>,
}

impl Maps {
    /// Input pixels per cell.
    pub const STRIDE: usize = 8;
    /// Most pixels of an input's side.
    pub const MOST_SIDE: usize = 8192;

    /// What an input's sides are multiples of: the least common multiple of a cell's pixels and of each of these.
    pub fn step(multiples: &[usize]) -> usize {
        multiples.iter().fold(Self::STRIDE, |step, &multiple| {
            let mut common = (1..=multiple).map(|k| k * step);
            let common = common.find(|n| n.is_multiple_of(multiple));
            common.unwrap_or(step)
        })
    }

    /// Zeroed maps.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            head2d: vec![0.0; width * height * HEAD2D_CHANNELS],
            head3d: vec![0.0; width * height * HEAD3D_CHANNELS],
        }
    }
}

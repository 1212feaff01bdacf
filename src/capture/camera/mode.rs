//! Which of a camera's many formats, sizes and rates to ask for.

use super::decode::PixelFormat;

/// One combination that a camera offers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// What the bytes are.
    pub format: PixelFormat,
    /// V4L2's four letters for it.
    pub fourcc: [u8; 4],
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Most pictures per second at this size; 0 when the camera does not say.
    pub fps: f64,
}

/// Rates within this factor count as equal: 29.97 is as good as 30.
const SAME_RATE: f64 = 0.95;

/// How far from the closest size a mode may lie to be chosen for its rate: 640 × 480 for 1280 × 720, but no stamp.
const NEAR: f64 = 3.5;

/// The mode closest to the wish: of sizes near it those that reach the rate, or come closest to it; of these the
/// closest size (rather larger than smaller); of these the format that is cheapest to decode. `None` without modes.
pub fn choose_mode(modes: &[Mode], size: (u32, u32), fps: f64) -> Option<Mode> {
    let size_distance = |m: &Mode| {
        let step = |have: u32, want: u32| {
            let (have, want) = (f64::from(have.max(1)), f64::from(want.max(1)));
            // Too small loses detail for good, too large costs a little time.
            let ratio = (have / want).log2();
            if ratio < 0.0 { -2.0 * ratio } else { ratio }
        };
        step(m.width, size.0) + step(m.height, size.1)
    };
    let closest = modes
        .iter()
        .map(size_distance)
        .fold(f64::INFINITY, f64::min);
    let reach = |m: &Mode| {
        // A camera that does not say is taken at its word to be fast enough.
        let fps_known = if m.fps > 0.0 { m.fps } else { fps };
        (fps_known / fps.max(1e-3)).min(1.0)
    };
    let near: Vec<&Mode> = modes
        .iter()
        .filter(|m| size_distance(m) <= closest + NEAR)
        .collect();
    let best_rate = near.iter().map(|m| reach(m)).fold(0.0, f64::max);
    near.into_iter()
        .filter(|m| reach(m) >= SAME_RATE * best_rate)
        .min_by(|a, b| {
            size_distance(a)
                .total_cmp(&size_distance(b))
                .then(a.format.cost().cmp(&b.format.cost()))
        })
        .copied()
}

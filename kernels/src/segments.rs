//! How many products may be summed in i16: the proof, made from the actual weights when they are packed.

use crate::packed::{Packed, Panels};

/// Packed weights with the lengths of their i16 segments: for every panel and tap, how its `depth` groups are cut.
///
/// `vpmaddubsw` sums two products in i16 with saturation, further groups are added in i16. With activations in
/// 0..=`input_max`, a lane's sum lies between `input_max · Σ min(w, 0)` and `input_max · Σ max(w, 0)` over the
/// segment's weights. A segment ends before either bound leaves i16, so that neither saturation nor wrap-around can
/// happen.
///
/// Weights and lengths are made together and never change: every tap's lengths are at least 1 and add up to the depth.
#[derive(Debug, Clone)]
pub(crate) struct SegmentedPacked {
    packed: Packed,
    lengths: Vec<u8>,
    /// First length of every panel.
    panels: Vec<usize>,
}

impl SegmentedPacked {
    /// Cuts every panel, or `None` when a single group could leave i16.
    pub fn new(packed: Packed, input_max: u8) -> Option<Self> {
        let (mut lengths, mut panels) = (Vec::new(), Vec::new());
        for group in 0..packed.groups() {
            for (b, block) in packed.blocks().iter().enumerate() {
                for (p, phase) in packed.phases().iter().enumerate() {
                    let panel = packed.panel(group, b, p);
                    debug_assert_eq!(panel, panels.len());
                    panels.push(lengths.len());
                    let weights = packed.weights(panel);
                    let step = block.count * packed.lanes() * 4;
                    for tap in 0..phase.taps.len() {
                        let tap_bytes = packed.depth() * step;
                        cut(
                            &weights[tap * tap_bytes..][..tap_bytes],
                            step,
                            i32::from(input_max),
                            &mut lengths,
                        )?;
                    }
                }
            }
        }
        Some(Self {
            packed,
            lengths,
            panels,
        })
    }

    /// The weights alone.
    pub fn into_packed(self) -> Packed {
        self.packed
    }

    /// Mean length of the segments, in 32-bit groups of input channels; 0 without any.
    pub fn mean_length(&self) -> f64 {
        let groups: usize = self.lengths.iter().map(|&length| usize::from(length)).sum();
        groups as f64 / self.lengths.len().max(1) as f64
    }
}

// SAFETY: `new` cuts every panel's taps in turn, and what it cuts never changes: `cut` ends a segment at 1 group or
// more, and every group of a tap lies in one.
unsafe impl Panels for SegmentedPacked {
    fn packed(&self) -> &Packed {
        &self.packed
    }

    fn segments(&self, panel: usize) -> &[u8] {
        &self.lengths[self.panels[panel]..]
    }
}

/// Cuts one tap's groups of `step` bytes greedily.
fn cut(weights: &[u8], step: usize, input_max: i32, lengths: &mut Vec<u8>) -> Option<()> {
    let mut bounds = vec![(0i32, 0i32); step / 2];
    let mut length = 0u8;
    for group in weights.chunks_exact(step) {
        let fits = extend(&mut bounds, group, input_max);
        if fits && length < u8::MAX {
            length += 1;
            continue;
        }
        if length == 0 {
            return None;
        }
        lengths.push(length);
        bounds.fill((0, 0));
        if !extend(&mut bounds, group, input_max) {
            return None;
        }
        length = 1;
    }
    if length > 0 {
        lengths.push(length);
    }
    Some(())
}

/// Adds a group to every i16 lane's (least, greatest) sum; whether all stay within i16.
fn extend(bounds: &mut [(i32, i32)], group: &[u8], input_max: i32) -> bool {
    let mut fits = true;
    for (bound, pair) in bounds.iter_mut().zip(group.chunks_exact(2)) {
        for &byte in pair {
            let most = i32::from(byte as i8) * input_max;
            bound.0 += most.min(0);
            bound.1 += most.max(0);
        }
        fits &= bound.0 >= i32::from(i16::MIN) && bound.1 <= i32::from(i16::MAX);
    }
    fits
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lengths(weights: &[i8], step: usize, input_max: i32) -> Option<Vec<u8>> {
        let bytes: Vec<u8> = weights.iter().map(|&w| w as u8).collect();
        let mut lengths = Vec::new();
        cut(&bytes, step, input_max, &mut lengths).map(|()| lengths)
    }

    #[test]
    fn segments_end_before_i16_does() {
        // One lane pair per group of 4: 129 + 129 = 258 = floor(32767 / 127); one more does not fit.
        assert_eq!(
            lengths(&[64, 65, 0, 0, 64, 65, 0, 0], 4, 127),
            Some(vec![2])
        );
        assert_eq!(
            lengths(&[64, 65, 0, 0, 65, 65, 0, 0], 4, 127),
            Some(vec![1, 1])
        );
        // Signs do not cancel: the activations behind the negative weights may be 0.
        assert_eq!(
            lengths(&[127, -127, 0, 0, 127, -127, 0, 0, 127, 0, 0, 0], 4, 127),
            Some(vec![2, 1])
        );
        // −258 · 127 = −32766 fits, −259 · 127 does not.
        assert_eq!(
            lengths(&[-127, -127, 0, 0, -4, 0, 0, 0], 4, 127),
            Some(vec![2])
        );
        assert_eq!(
            lengths(&[-127, -127, 0, 0, -5, 0, 0, 0], 4, 127),
            Some(vec![1, 1])
        );
        // 8-bit activations: one pair alone can leave i16.
        assert_eq!(lengths(&[127, 127, 0, 0], 4, 255), None);
        assert_eq!(lengths(&[], 4, 127), Some(vec![]));
    }
}

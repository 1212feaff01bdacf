//! How many products may be summed in i16: the proof, made from the actual weights when they are packed.

use crate::packed::{Packed, Panels, Segments};

/// Packed weights with their i16 segments: for every panel and tap, how its `depth` groups are cut.
///
/// `vpmaddubsw` sums two products in i16 with saturation, further groups are added modulo 2¹⁶. With activations in
/// 0..=`input_max`, a lane's true sum lies between `input_max · Σ min(w, 0)` and `input_max · Σ max(w, 0)` over the
/// segment's weights. No pair saturates, and a segment ends before these bounds lie more than 2¹⁶ − 1 apart. So there
/// is a number that moves both into i16, the lane's offset: with it added, the sum modulo 2¹⁶ is the true one. What all
/// offsets add is taken off the accumulators' initial values.
///
/// Weights, lengths and offsets are made together and never change: every tap's lengths are at least 1 and add up to
/// the depth, and each has an offset for every pair of weights of a group.
#[derive(Debug, Clone)]
pub(crate) struct SegmentedPacked {
    packed: Packed,
    cut: Cut,
    /// First length and first offset of every panel.
    panels: Vec<(usize, usize)>,
    /// What all offsets add to every padded output channel, for each phase in turn; modulo 2³².
    added: Vec<i32>,
}

impl SegmentedPacked {
    /// Cuts every panel, or `None` when a single pair of products could leave i16.
    pub fn new(packed: Packed, input_max: u8) -> Option<Self> {
        let (mut cut, mut panels) = (Cut::default(), Vec::new());
        let padded = packed.padded();
        let mut added = vec![0i32; packed.phases().len() * padded];
        for group in 0..packed.groups() {
            for (b, block) in packed.blocks().iter().enumerate() {
                for (p, phase) in packed.phases().iter().enumerate() {
                    let panel = packed.panel(group, b, p);
                    debug_assert_eq!(panel, panels.len());
                    let first = cut.offsets.len();
                    panels.push((cut.lengths.len(), first));
                    let weights = packed.weights(panel);
                    let lanes = block.count * packed.lanes();
                    let tap_bytes = packed.depth() * lanes * 4;
                    for tap in 0..phase.taps.len() {
                        let weights = &weights[tap * tap_bytes..][..tap_bytes];
                        cut.tap(weights, lanes * 4, i32::from(input_max))?;
                    }
                    let lane = (group * packed.vectors() + block.first) * packed.lanes();
                    let added = &mut added[p * padded + lane..][..lanes];
                    for segment in cut.offsets[first..].chunks_exact(2 * lanes) {
                        for (sum, pair) in added.iter_mut().zip(segment.chunks_exact(2)) {
                            *sum = sum.wrapping_add(i32::from(pair[0]) + i32::from(pair[1]));
                        }
                    }
                }
            }
        }
        Some(Self {
            packed,
            cut,
            panels,
            added,
        })
    }

    /// Makes initial values, one for each padded output channel or as many for each phase in turn, those of
    /// accumulators to which offsets are added: as many for each phase.
    pub fn take_off_offsets(&self, initial: &mut Vec<i32>) {
        if initial.len() == self.packed.padded() {
            *initial = initial.repeat(self.packed.phases().len());
        }
        assert_eq!(initial.len(), self.added.len(), "initial values");
        for (value, &added) in initial.iter_mut().zip(&self.added) {
            *value = value.wrapping_sub(added);
        }
    }
}

// SAFETY: `new` cuts every panel's taps in turn, and what it cuts never changes: `Cut::tap` ends a segment at 1 group
// or more, every group of a tap lies in one, and `Cut::end` adds an offset for each pair of weights with every length.
unsafe impl Panels for SegmentedPacked {
    fn packed(&self) -> &Packed {
        &self.packed
    }

    fn segments(&self, panel: usize) -> Segments<'_> {
        let (length, offset) = self.panels[panel];
        Segments {
            lengths: &self.cut.lengths[length..],
            offsets: &self.cut.offsets[offset..],
        }
    }
}

/// The least and the greatest sum of an i16 lane.
type Bounds = (i32, i32);

/// Segments one after the other.
#[derive(Debug, Clone, Default)]
struct Cut {
    /// 32-bit groups of every segment.
    lengths: Vec<u8>,
    /// For every segment the offset of each pair of weights in a group.
    offsets: Vec<i16>,
}

impl Cut {
    /// Cuts one tap's groups of `step` bytes greedily; `None` when a pair of products could leave i16.
    fn tap(&mut self, weights: &[u8], step: usize, input_max: i32) -> Option<()> {
        let mut sums: Vec<Bounds> = vec![(0, 0); step / 2];
        let mut length = 0u8;
        for group in weights.chunks_exact(step) {
            let pairs: Vec<Bounds> = group
                .chunks_exact(2)
                .map(|pair| bounds(pair, input_max))
                .collect();
            let is_i16 = |&(least, most): &Bounds| {
                least >= i32::from(i16::MIN) && most <= i32::from(i16::MAX)
            };
            if !pairs.iter().all(is_i16) {
                return None;
            }
            let fits = |(sum, pair): (&Bounds, &Bounds)| {
                sum.1 + pair.1 - sum.0 - pair.0 <= i32::from(u16::MAX)
            };
            if length == u8::MAX || !sums.iter().zip(&pairs).all(fits) {
                self.end(length, &sums);
                sums.fill((0, 0));
                length = 0;
            }
            for (sum, pair) in sums.iter_mut().zip(&pairs) {
                *sum = (sum.0 + pair.0, sum.1 + pair.1);
            }
            length += 1;
        }
        if length > 0 {
            self.end(length, &sums);
        }
        Some(())
    }

    /// Ends a segment with these sums: each is moved into i16, by as little as that takes.
    fn end(&mut self, length: u8, sums: &[Bounds]) {
        self.lengths.push(length);
        self.offsets.extend(sums.iter().map(|(least, most)| {
            0.clamp(i32::from(i16::MIN) - least, i32::from(i16::MAX) - most) as i16
        }));
    }
}

/// What weights times activations up to `input_max` can come to.
fn bounds(weights: &[u8], input_max: i32) -> Bounds {
    let of = |byte: &u8| i32::from(*byte as i8) * input_max;
    let least = weights.iter().map(|w| of(w).min(0)).sum();
    let most = weights.iter().map(|w| of(w).max(0)).sum();
    (least, most)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths and offsets of groups of `step` bytes.
    fn cut(weights: &[i8], step: usize, input_max: i32) -> Option<(Vec<u8>, Vec<i16>)> {
        let bytes: Vec<u8> = weights.iter().map(|&w| w as u8).collect();
        let mut cut = Cut::default();
        cut.tap(&bytes, step, input_max)?;
        Some((cut.lengths, cut.offsets))
    }

    fn lengths(weights: &[i8], step: usize, input_max: i32) -> Option<Vec<u8>> {
        cut(weights, step, input_max).map(|(lengths, _)| lengths)
    }

    #[test]
    fn segments_end_before_sums_take_more_than_16_bits() {
        // One lane pair per group of 4: 4 · 129 = 516 = floor(65535 / 127); one more does not fit.
        let group = [64, 65, 0, 0];
        assert_eq!(lengths(&group.repeat(4), 4, 127), Some(vec![4]));
        let one_more = [&group.repeat(3)[..], &[65, 65, 0, 0]].concat();
        assert_eq!(lengths(&one_more, 4, 127), Some(vec![3, 1]));
        // Signs do not cancel: the activations behind either may be 0.
        let mixed = [
            127, -127, 0, 0, 127, -127, 0, 0, 8, 0, 0, 0, 1, 0, 0, 0, 127, 0, 0, 0,
        ];
        assert_eq!(lengths(&mixed, 4, 127), Some(vec![3, 2]));
        // 8-bit activations: one pair alone can leave i16, however short the segment.
        assert_eq!(lengths(&[127, 127, 0, 0], 4, 255), None);
        assert_eq!(lengths(&[127, -127, 0, 0], 4, 255), Some(vec![1]));
        assert_eq!(lengths(&[], 4, 127), Some(vec![]));
        assert_eq!(lengths(&[0; 4 * 300], 4, 127), Some(vec![255, 45]));
    }

    #[test]
    fn offsets_move_whatever_a_segment_can_sum_to_into_i16() {
        let mut state = 1u32;
        let mut weight = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8 as i8
        };
        for step in [4, 8, 64] {
            let weights: Vec<i8> = (0..step * 40).map(|_| weight()).collect();
            let (lengths, offsets) = cut(&weights, step, 127).unwrap();
            assert_eq!(offsets.len(), lengths.len() * step / 2);
            let mut groups = weights.chunks_exact(step);
            for (&length, offsets) in lengths.iter().zip(offsets.chunks_exact(step / 2)) {
                let segment: Vec<&[i8]> = groups.by_ref().take(length.into()).collect();
                for (pair, &offset) in offsets.iter().enumerate() {
                    let pairs = || segment.iter().flat_map(|g| &g[2 * pair..2 * pair + 2]);
                    let least: i32 = pairs().map(|&w| 127 * i32::from(w).min(0)).sum();
                    let most: i32 = pairs().map(|&w| 127 * i32::from(w).max(0)).sum();
                    assert!(i16::try_from(least + i32::from(offset)).is_ok());
                    assert!(i16::try_from(most + i32::from(offset)).is_ok());
                }
            }
            assert!(groups.next().is_none());
        }
    }

    #[test]
    fn what_fits_as_it_is_has_no_offset() {
        let (lengths, offsets) = cut(&[100, 100, -100, -100, 50, 8, 0, 0], 4, 127).unwrap();
        assert_eq!((lengths, offsets), (vec![2], vec![0, 0]));
        // 259 · 127 = 32767 + 126.
        let (lengths, offsets) = cut(&[127, 127, 0, 0, 5, 0, -1, 0], 4, 127).unwrap();
        assert_eq!((lengths, offsets), (vec![2], vec![-126, 0]));
    }
}

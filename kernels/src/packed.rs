//! Weights in the order the kernels read them.
//!
//! Output channels of a group are cut into vectors of LANES, vectors into blocks of at most MAX_NV, and every (group, block,
//! phase) is one panel: `[tap][depth group][vector][lane][PACK]`, read front to back by every tile. Lanes beyond the last
//! output channel hold zeros.

use crate::ConvShape;
use crate::phase::{Phase, Tap};
use crate::scratch::Scratch;
use crate::simd::{Dot, Simd};

/// Most taps of a phase: 7 × 7.
pub(crate) const MAX_TAPS: usize = 49;

/// Packed weights.
#[derive(Debug, Clone)]
pub(crate) struct Packed {
    pub phases: Vec<Phase>,
    pub groups: usize,
    /// Output channels per group.
    pub outs: usize,
    /// 32-bit groups of input channels per tap.
    pub depth: usize,
    pub lanes: usize,
    pub blocks: Vec<Block>,
    panels: Vec<usize>,
    data: Scratch,
}

/// Consecutive vectors of output channels that one tile computes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block {
    /// First vector.
    pub first: usize,
    /// Vectors: 1..=MAX_NV.
    pub count: usize,
}

/// Numbers a panel is made of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grain {
    pub lanes: usize,
    pub max_nv: usize,
    pub pack: usize,
}

impl Grain {
    /// What `D` reads.
    pub fn of<D: Dot>() -> Self {
        Self {
            lanes: D::S::LANES,
            max_nv: D::MAX_NV,
            pack: D::PACK,
        }
    }
}

impl Packed {
    /// Packs a convolution, or `None` where the direct kernels cannot run it: input channels of a group that do not fill
    /// 32-bit groups, or too many taps.
    ///
    /// `weight(oc, ic, tap)` gives a number's little-endian bytes, 4 / PACK of them; `ic` counts within the group.
    pub fn new<const BYTES: usize>(
        shape: &ConvShape,
        grain: Grain,
        weight: impl Fn(usize, usize, &Tap) -> [u8; BYTES],
    ) -> Option<Self> {
        assert_eq!(BYTES * grain.pack, 4, "a group is 32 bits");
        let channels = shape.in_channels / shape.groups;
        let phases = Phase::of(shape);
        if !channels.is_multiple_of(grain.pack)
            || phases.iter().any(|phase| phase.taps.len() > MAX_TAPS)
        {
            return None;
        }
        let outs = shape.out_channels / shape.groups;
        let depth = channels / grain.pack;
        let blocks = blocks(outs.div_ceil(grain.lanes), grain.max_nv);
        let taps: usize = phases.iter().map(|phase| phase.taps.len()).sum();
        let vectors: usize = blocks.iter().map(|block| block.count).sum();
        let mut data = Scratch::new(shape.groups * vectors * taps * depth * grain.lanes * 4);
        let bytes = data.as_mut_bytes();
        let mut panels = Vec::new();
        let mut at = 0;
        for group in 0..shape.groups {
            for block in &blocks {
                for phase in &phases {
                    panels.push(at);
                    for tap in &phase.taps {
                        for group_of_ic in 0..depth {
                            for lane in 0..block.count * grain.lanes {
                                let out = block.first * grain.lanes + lane;
                                for i in 0..grain.pack {
                                    if out < outs {
                                        let ic = group_of_ic * grain.pack + i;
                                        bytes[at..at + BYTES].copy_from_slice(&weight(
                                            group * outs + out,
                                            ic,
                                            tap,
                                        ));
                                    }
                                    at += BYTES;
                                }
                            }
                        }
                    }
                }
            }
        }
        Some(Self {
            phases,
            groups: shape.groups,
            outs,
            depth,
            lanes: grain.lanes,
            blocks,
            panels,
            data,
        })
    }

    /// Vectors of output channels per group.
    pub fn vectors(&self) -> usize {
        self.outs.div_ceil(self.lanes)
    }

    /// Number of the panel of (group, block, phase).
    pub fn panel(&self, group: usize, block: usize, phase: usize) -> usize {
        (group * self.blocks.len() + block) * self.phases.len() + phase
    }

    /// Panel `panel`, in bytes.
    pub fn weights(&self, panel: usize) -> &[u8] {
        let bytes = self.data.as_bytes();
        let end = self.panels.get(panel + 1).copied();
        &bytes[self.panels[panel]..end.unwrap_or(bytes.len())]
    }

    /// One value per output channel, in the order of lanes, padded with zeros to whole vectors.
    pub fn per_channel<T: Copy + Default>(&self, values: &[T]) -> Vec<T> {
        let padded = self.vectors() * self.lanes;
        let mut all = vec![T::default(); self.groups * padded];
        for group in 0..self.groups {
            all[group * padded..][..self.outs]
                .copy_from_slice(&values[group * self.outs..][..self.outs]);
        }
        all
    }
}

/// `vectors` in blocks as even as they get.
fn blocks(vectors: usize, max: usize) -> Vec<Block> {
    let count = vectors.div_ceil(max);
    (0..count)
        .map(|i| {
            let first = vectors * i / count;
            Block {
                first,
                count: vectors * (i + 1) / count - first,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_hold_every_weight_once_in_reading_order() {
        let shape = ConvShape {
            in_channels: 8,
            out_channels: 10,
            groups: 2,
            kernel: 1,
            stride: 1,
            padding: 0,
            transposed: false,
        };
        let grain = Grain {
            lanes: 4,
            max_nv: 3,
            pack: 4,
        };
        let packed = Packed::new(&shape, grain, |oc, ic, _| [(oc * 4 + ic) as u8]).unwrap();
        // 5 outputs are 2 vectors; the second has one lane in use.
        let panel = packed.weights(packed.panel(1, 0, 0));
        let expected: Vec<u8> = (20..40).chain([0; 12]).collect();
        assert_eq!(panel, expected);
        assert_eq!(
            packed.per_channel(&(0..10).collect::<Vec<i32>>()),
            [0, 1, 2, 3, 4, 0, 0, 0, 5, 6, 7, 8, 9, 0, 0, 0]
        );
    }
}

//! Weights in the order the kernels read them.
//!
//! Output channels of a group are cut into vectors of LANES, vectors into blocks of at most MAX_NV, and every (group,
//! block, phase) is one panel: `[tap][depth group][vector][lane][PACK]`, read front to back by every tile. Where a
//! kernel takes several depth groups together, those of a lane are side by side; where it takes numbers apart, a vector
//! is `[PACK][lane]`. Lanes beyond the last output channel hold zeros, and so do depth groups that a chunk shares with
//! the one before it.

use crate::ConvShape;
use crate::phase::{Phase, Tap};
use crate::simd::{Dot, Simd};
use crate::slab::Piece;

/// Most taps of a phase: 7 × 7.
pub(crate) const MAX_TAPS: usize = 49;

/// Packed weights. Made by [`Packed::new`] only; what kernels rely on is that panel (group, block, phase) holds
/// `taps · chunks.count · chunks.size · block.count · lanes` groups of 4 bytes, and blocks are 1 to [`MAX_BLOCK`]
/// vectors that cover `outs`. Where chunks are not limited there is one, of `depth`.
#[derive(Debug, Clone)]
pub(crate) struct Packed {
    phases: Vec<Phase>,
    groups: usize,
    outs: usize,
    depth: usize,
    #[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
    chunks: Chunks,
    blocking: Blocking,
    blocks: Vec<Block>,
    panels: Vec<usize>,
    data: Piece,
}

/// What a direct kernel reads: packed weights, and where a tap's sums have to leave i16.
///
/// # Safety
/// Kernels rely on it: `packed` gives the same weights always, and `segments` of a panel begin with each of its taps'
/// in turn, their lengths at least 1, those of a tap adding up to the depth, each with 2 · LANES offsets for every
/// vector of the panel; or there are none, and no kernel that sums in segments takes the type.
pub(crate) unsafe trait Panels {
    /// The weights.
    fn packed(&self) -> &Packed;

    /// The i16 segments of a panel, tap after tap. What lies behind them is other panels'.
    fn segments(&self, panel: usize) -> Segments<'_>;
}

/// How a panel's products are summed in i16; empty where they are not.
#[derive(Clone, Copy, Default)]
#[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
pub(crate) struct Segments<'a> {
    /// 32-bit groups of every segment; those of a tap add up to the depth.
    pub lengths: &'a [u8],
    /// What is added to a segment's sums before they are read as signed numbers: for every segment 2 · LANES numbers of
    /// each of the panel's vectors.
    pub offsets: &'a [i16],
}

// SAFETY: no segments; `Segmented` takes `SegmentedPacked` only.
unsafe impl Panels for Packed {
    fn packed(&self) -> &Packed {
        self
    }

    fn segments(&self, _panel: usize) -> Segments<'_> {
        Segments::default()
    }
}

/// Consecutive vectors of output channels that one tile computes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block {
    /// First vector.
    pub first: usize,
    /// Vectors: 1 to MAX_NV.
    pub count: usize,
}

/// How a kernel wants its panels cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Blocking {
    /// Output channels in a vector.
    pub lanes: usize,
    /// Most vectors in a block, 1 to [`MAX_BLOCK`].
    pub max_nv: usize,
    /// Numbers in a 32-bit group of input channels.
    pub pack: usize,
    /// 32-bit groups of a lane that lie side by side.
    pub together: usize,
    /// Whether a vector holds every lane's first number, then every lane's second, and so on.
    pub apart: bool,
    /// Most 32-bit groups of a tap that the kernel takes at once; [`usize::MAX`] where it takes any number.
    pub chunk: usize,
}

/// The 32-bit groups of a tap in chunks of one size, as even as they get. The last chunk ends where the depth does, so
/// that nothing behind it is read; groups that it shares with the chunk before have weight 0 in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Chunks {
    /// Chunks of a tap.
    pub count: usize,
    /// 32-bit groups in every chunk; at most the depth.
    pub size: usize,
}

impl Chunks {
    /// `depth` groups in chunks of at most `most`.
    pub fn of(depth: usize, most: usize) -> Self {
        let count = depth.div_ceil(most);
        Self {
            count,
            size: depth.div_ceil(count.max(1)),
        }
    }

    /// First group of a chunk; `first + size <= depth`.
    pub fn first(&self, chunk: usize, depth: usize) -> usize {
        (chunk * self.size).min(depth - self.size)
    }
}

/// Most vectors in a block: kernels are compiled for 1, 2 and 3.
pub(crate) const MAX_BLOCK: usize = 3;

impl Blocking {
    /// What `D` reads.
    pub const fn of<D: Dot>() -> Self {
        const { assert!(D::MAX_NV >= 1 && D::MAX_NV <= MAX_BLOCK) };
        Self {
            lanes: D::S::LANES,
            max_nv: D::MAX_NV,
            pack: D::PACK,
            together: D::TOGETHER,
            apart: D::APART,
            chunk: usize::MAX,
        }
    }
}

/// What a number in a vector of weights is for.
struct Number {
    /// Output channel, counted from the vector's first.
    lane: usize,
    /// 32-bit group of those taken together.
    group: usize,
    /// Number of that group.
    of_group: usize,
}

impl Blocking {
    /// The numbers of a vector, for all groups that are taken together, in the order in which they lie.
    fn numbers(self) -> Vec<Number> {
        let mut numbers: Vec<Number> = (0..self.lanes)
            .flat_map(|lane| (0..self.together).map(move |group| (lane, group)))
            .flat_map(|(lane, group)| {
                (0..self.pack).map(move |of_group| Number {
                    lane,
                    group,
                    of_group,
                })
            })
            .collect();
        if self.apart {
            numbers.sort_by_key(|number| number.of_group);
        }
        numbers
    }
}

impl Packed {
    /// Packs a convolution, or `None` where the direct kernels cannot run it: input channels of a group that do not
    /// fill 32-bit groups, as many as the kernel takes together, or too many taps.
    ///
    /// `weight(oc, ic, tap)` gives a number's little-endian bytes, 4 / PACK of them; `ic` counts within the group.
    pub fn new<const BYTES: usize>(
        shape: &ConvShape,
        blocking: Blocking,
        weight: impl Fn(usize, usize, &Tap) -> [u8; BYTES],
    ) -> Option<Self> {
        assert_eq!(BYTES * blocking.pack, 4, "a group is 32 bits");
        let channels = shape.group_in();
        let phases = Phase::of(shape);
        if !channels.is_multiple_of(blocking.pack * blocking.together)
            || phases.iter().any(|phase| phase.taps.len() > MAX_TAPS)
        {
            return None;
        }
        let outs = shape.group_out();
        let depth = channels / blocking.pack;
        let chunks = Chunks::of(depth, blocking.chunk);
        assert!(
            chunks.size.is_multiple_of(blocking.together),
            "chunks of whole steps"
        );
        // (Group of input channels, whether an earlier chunk has it.)
        let order: Vec<(usize, bool)> = (0..chunks.count)
            .flat_map(|c| {
                (chunks.first(c, depth)..)
                    .take(chunks.size)
                    .map(move |g| (g, g < c * chunks.size))
            })
            .collect();
        let blocks = blocks(outs.div_ceil(blocking.lanes), blocking.max_nv);
        let taps: usize = phases.iter().map(|phase| phase.taps.len()).sum();
        let vectors: usize = blocks.iter().map(|block| block.count).sum();
        let mut data =
            Piece::new(shape.groups() * vectors * taps * order.len() * blocking.lanes * 4);
        let bytes = data.as_mut_bytes();
        let numbers = blocking.numbers();
        let mut panels = Vec::new();
        let mut at = 0;
        for group in 0..shape.groups() {
            for block in &blocks {
                for phase in &phases {
                    panels.push(at);
                    for tap in &phase.taps {
                        for step in order.chunks(blocking.together) {
                            for vector in block.first..block.first + block.count {
                                for number in &numbers {
                                    let out = vector * blocking.lanes + number.lane;
                                    let (of_step, seen) = step[number.group];
                                    if out < outs && !seen {
                                        let ic = of_step * blocking.pack + number.of_group;
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
            groups: shape.groups(),
            outs,
            depth,
            chunks,
            blocking,
            blocks,
            panels,
            data,
        })
    }

    /// Phases of the convolution, each a dimension of the panels.
    pub fn phases(&self) -> &[Phase] {
        &self.phases
    }

    /// Groups of the convolution.
    pub fn groups(&self) -> usize {
        self.groups
    }

    /// Output channels per group.
    pub fn outs(&self) -> usize {
        self.outs
    }

    /// 32-bit groups of input channels per tap.
    pub fn depth(&self) -> usize {
        self.depth
    }

    /// How the 32-bit groups of a tap are cut.
    #[cfg(target_arch = "x86_64")]
    pub fn chunks(&self) -> Chunks {
        self.chunks
    }

    /// How the panels are cut.
    pub fn blocking(&self) -> Blocking {
        self.blocking
    }

    /// Output channels in a vector.
    pub fn lanes(&self) -> usize {
        self.blocking.lanes
    }

    /// Blocks of vectors that cover the outputs of a group.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Vectors of output channels per group.
    pub fn vectors(&self) -> usize {
        self.outs.div_ceil(self.lanes())
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

    /// Padded lanes of all groups.
    pub fn padded(&self) -> usize {
        self.groups * self.vectors() * self.lanes()
    }

    /// One value per output channel, or as many for each phase in turn, in the order of lanes, padded with zeros to
    /// whole vectors.
    pub fn per_channel<T: Copy + Default>(&self, values: &[T]) -> Vec<T> {
        let padded = self.vectors() * self.lanes();
        let mut all = vec![T::default(); values.len() / self.outs * padded];
        for (to, from) in all
            .chunks_exact_mut(padded)
            .zip(values.chunks_exact(self.outs))
        {
            to[..self.outs].copy_from_slice(from);
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
    use crate::ConvDims;

    #[test]
    fn panels_hold_every_weight_once_in_reading_order() {
        let shape = ConvShape::new(ConvDims {
            in_channels: 8,
            out_channels: 10,
            groups: 2,
            ..ConvDims::default()
        })
        .unwrap();
        let blocking = Blocking {
            lanes: 4,
            max_nv: 3,
            pack: 4,
            together: 1,
            apart: false,
            chunk: usize::MAX,
        };
        let packed = Packed::new(&shape, blocking, |oc, ic, _| [(oc * 4 + ic) as u8]).unwrap();
        // 5 outputs are 2 vectors; the second has one lane in use.
        let panel = packed.weights(packed.panel(1, 0, 0));
        let expected: Vec<u8> = (20..40).chain([0; 12]).collect();
        assert_eq!(panel, expected);
        assert_eq!(
            packed.per_channel(&(0..10).collect::<Vec<i32>>()),
            [0, 1, 2, 3, 4, 0, 0, 0, 5, 6, 7, 8, 9, 0, 0, 0]
        );
        let of_phases = packed.per_channel(&(0..20).collect::<Vec<i32>>());
        assert_eq!(of_phases.len(), 2 * packed.padded());
        assert_eq!(of_phases[24..], [15, 16, 17, 18, 19, 0, 0, 0]);
    }

    #[test]
    fn groups_that_a_kernel_takes_together_lie_side_by_side_in_a_lane() {
        let dims = |in_channels| ConvDims {
            in_channels,
            out_channels: 3,
            ..ConvDims::default()
        };
        let blocking = Blocking {
            lanes: 2,
            max_nv: 2,
            pack: 4,
            together: 2,
            apart: false,
            chunk: usize::MAX,
        };
        let pack = |channels: usize| {
            let shape = ConvShape::new(dims(channels)).unwrap();
            Packed::new(&shape, blocking, |oc, ic, _| [(oc * channels + ic) as u8])
        };
        let packed = pack(16).unwrap();
        let eight = |from: u8| from..from + 8;
        let expected: Vec<u8> = [0, 16, 32]
            .into_iter()
            .flat_map(eight)
            .chain([0; 8])
            .chain([8, 24, 40].into_iter().flat_map(eight))
            .chain([0; 8])
            .collect();
        assert_eq!(packed.weights(0), expected);
        assert!(pack(12).is_none(), "three groups are no pairs");
    }

    #[test]
    fn numbers_of_a_lane_lie_apart_where_a_kernel_wants_them_so() {
        let shape = ConvShape::new(ConvDims {
            in_channels: 2,
            out_channels: 4,
            ..ConvDims::default()
        })
        .unwrap();
        let blocking = Blocking {
            lanes: 2,
            max_nv: 1,
            pack: 2,
            together: 1,
            apart: true,
            chunk: usize::MAX,
        };
        let packed = Packed::new(&shape, blocking, |oc, ic, _| {
            (10 * oc as u16 + ic as u16).to_le_bytes()
        });
        let packed = packed.unwrap();
        let numbers = |panel| {
            let pairs = packed.weights(panel)[..8].chunks(2); // the buffer ends with whole lines
            pairs.map(|b| u16::from_le_bytes([b[0], b[1]])).collect()
        };
        let all: [Vec<u16>; 2] = [0, 1].map(numbers);
        assert_eq!(all, [[0, 10, 1, 11], [20, 30, 21, 31]]);
    }

    #[test]
    fn chunks_hold_every_group_once_and_end_with_the_depth() {
        for depth in 1..80 {
            let chunks = Chunks::of(depth, 16);
            assert!(chunks.size <= 16 && chunks.count == depth.div_ceil(16));
            let mut seen = 0;
            for chunk in 0..chunks.count {
                let first = chunks.first(chunk, depth);
                assert!(first <= seen && seen < first + chunks.size);
                seen = first + chunks.size;
            }
            assert_eq!(seen, depth);
        }
        // 17 groups are 2 chunks of 9: the second begins with the last group of the first, there with weight 0.
        let dims = ConvDims {
            in_channels: 17 * 4,
            ..ConvDims::default()
        };
        let blocking = Blocking {
            lanes: 1,
            max_nv: 1,
            pack: 4,
            together: 1,
            apart: false,
            chunk: 16,
        };
        let weight = |_, ic: usize, _: &Tap| [ic as u8 + 1];
        let packed = Packed::new(&ConvShape::new(dims).unwrap(), blocking, weight).unwrap();
        let expected: Vec<u8> = (1..37).chain([0; 4]).chain(37..69).collect();
        assert_eq!(packed.weights(0)[..expected.len()], expected);
    }
}

//! Direct convolution: no im2row, the halo stands in for the borders.
//!
//! A tile is MR consecutive output pixels of a row × NV vectors of output channels, all in registers. Per 32-bit group of
//! input channels it loads NV weight vectors and one broadcast group per pixel. Panels are the outer loop: a panel stays in
//! the first two cache levels while the rows stream past it.

use std::marker::PhantomData;

use crate::packed::{MAX_TAPS, Packed};
use crate::phase::Phase;
use crate::segments::Segments;
#[cfg(target_arch = "x86_64")]
use crate::simd::SegmentedDot;
use crate::simd::{Dot, Simd};
use crate::{Layout, Part};

/// A direct convolution over concrete tensors.
pub(crate) struct Job<'a> {
    pub packed: &'a Packed,
    /// Where the tier sums in i16 segments.
    pub segments: Option<&'a Segments>,
    /// Accumulators' initial values, 4 bytes per padded output channel.
    pub bias: *const u8,
    /// Pixel (0, 0), channel 0.
    pub input: *const u8,
    /// Bytes from a row to the next.
    pub row_bytes: isize,
    /// Bytes from a pixel to the next.
    pub pixel_bytes: isize,
    pub out_layout: &'a Layout,
    pub part: &'a Part,
}

impl<'a> Job<'a> {
    /// # Safety
    /// `input` is the start of the buffer that `layout` was checked for.
    pub unsafe fn new<T>(
        packed: &'a Packed,
        segments: Option<&'a Segments>,
        bias: &'a [impl Copy],
        input: *const T,
        in_layout: &Layout,
        out_layout: &'a Layout,
        part: &'a Part,
    ) -> Self {
        let size = size_of::<T>();
        debug_assert_eq!(bias.len(), packed.groups * packed.vectors() * packed.lanes);
        Self {
            packed,
            segments,
            bias: bias.as_ptr().cast(),
            // SAFETY: the origin lies in the buffer.
            input: unsafe { input.add(in_layout.origin) }.cast(),
            row_bytes: (in_layout.row_stride * size) as isize,
            pixel_bytes: (in_layout.pixel_stride * size) as isize,
            out_layout,
            part,
        }
    }
}

/// Where finished accumulators go.
///
/// # Safety
/// `write` may be called where the features of `S` are on, for output elements that the caller owns.
pub(crate) unsafe trait Write<S: Simd, Acc> {
    /// Stores M pixels' vectors to `place`.
    unsafe fn write<const M: usize>(&self, acc: [Acc; M], place: Place);
}

/// Where M vectors go.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// Padded index of the first lane.
    pub lane: usize,
    /// Output channel of that lane.
    pub channel: usize,
    /// Lanes that are output channels.
    pub n: usize,
    /// Output row.
    pub y: usize,
    /// Output column of the first pixel.
    pub x: usize,
    /// Columns from a pixel to the next.
    pub step: usize,
}

/// A way to sum a tile.
///
/// # Safety
/// As for [`Dot`]; `tile.x` and its taps, and the panel, are readable.
pub(crate) unsafe trait Chain {
    type D: Dot;

    /// Adds `Σ taps Σ depth x · w` to a tile's accumulators.
    unsafe fn sum<const MR: usize, const NV: usize>(
        acc: [[<Self::D as Dot>::Acc; NV]; MR],
        tile: &Tile,
    ) -> [[<Self::D as Dot>::Acc; NV]; MR];
}

/// What a tile reads.
#[derive(Clone, Copy)]
pub(crate) struct Tile<'a> {
    /// First pixel, tap offset (0, 0).
    pub x: *const u8,
    /// Bytes from a pixel of the tile to the next.
    pub x_step: usize,
    /// Byte offset of every tap.
    pub taps: &'a [isize],
    /// 32-bit groups per tap.
    pub depth: usize,
    pub weights: *const u8,
    /// i16 segments of the panel; empty for [`Plain`].
    #[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
    pub segments: &'a [u8],
}

type Acc<C> = <<C as Chain>::D as Dot>::Acc;
type Vectors<C> = <<C as Chain>::D as Dot>::S;

/// Sums with [`Dot::dot`].
pub(crate) struct Plain<D>(PhantomData<D>);

// SAFETY: reads weights front to back, 4 · LANES · NV bytes per group, and 4 bytes per pixel and group.
unsafe impl<D: Dot> Chain for Plain<D> {
    type D = D;

    #[inline(always)]
    unsafe fn sum<const MR: usize, const NV: usize>(
        mut acc: [[D::Acc; NV]; MR],
        tile: &Tile,
    ) -> [[D::Acc; NV]; MR] {
        let vector = 4 * D::S::LANES;
        let mut w = tile.weights;
        for &tap in tile.taps {
            // SAFETY: groups of this tap lie within the input's halo (checked layouts), panels hold taps · depth · NV vectors.
            unsafe {
                let mut x = tile.x.offset(tap);
                for _ in 0..tile.depth {
                    let mut weights = [D::weights(w); NV];
                    for n in 1..NV {
                        weights[n] = D::weights(w.add(n * vector));
                    }
                    for m in 0..MR {
                        let value = D::splat(x.add(m * tile.x_step));
                        for n in 0..NV {
                            acc[m][n] = D::dot(acc[m][n], value, weights[n]);
                        }
                    }
                    x = x.add(4);
                    w = w.add(NV * vector);
                }
            }
        }
        acc
    }
}

/// Sums in i16 segments. Other architectures have widening products that need none.
#[cfg(target_arch = "x86_64")]
pub(crate) struct Segmented<D>(PhantomData<D>);

#[cfg(target_arch = "x86_64")]
// SAFETY: as for Plain; a tap's segment lengths add up to the depth.
unsafe impl<D: SegmentedDot> Chain for Segmented<D> {
    type D = D;

    #[inline(always)]
    unsafe fn sum<const MR: usize, const NV: usize>(
        mut acc: [[D::Acc; NV]; MR],
        tile: &Tile,
    ) -> [[D::Acc; NV]; MR] {
        let vector = 4 * D::S::LANES;
        let mut w = tile.weights;
        let mut lengths = tile.segments.iter();
        for &tap in tile.taps {
            // SAFETY: groups of this tap lie within the input's halo (checked layouts), panels hold taps · depth · NV vectors.
            unsafe {
                let mut x = tile.x.offset(tap);
                let end = x.add(tile.depth * 4);
                while x != end {
                    let length = usize::from(*lengths.next().unwrap_unchecked());
                    let mut weights = [D::weights(w); NV];
                    for n in 1..NV {
                        weights[n] = D::weights(w.add(n * vector));
                    }
                    let mut sum = [[weights[0]; NV]; MR];
                    for m in 0..MR {
                        let value = D::splat(x.add(m * tile.x_step));
                        for n in 0..NV {
                            sum[m][n] = D::first(value, weights[n]);
                        }
                    }
                    x = x.add(4);
                    w = w.add(NV * vector);
                    for _ in 1..length {
                        for n in 0..NV {
                            weights[n] = D::weights(w.add(n * vector));
                        }
                        for m in 0..MR {
                            let value = D::splat(x.add(m * tile.x_step));
                            for n in 0..NV {
                                sum[m][n] = D::more(sum[m][n], value, weights[n]);
                            }
                        }
                        x = x.add(4);
                        w = w.add(NV * vector);
                    }
                    for m in 0..MR {
                        for n in 0..NV {
                            acc[m][n] = D::spill(acc[m][n], sum[m][n]);
                        }
                    }
                }
            }
        }
        acc
    }
}

/// A row of tiles' constants.
struct Strip<'a, 'b, C: Chain, W> {
    job: &'b Job<'a>,
    writer: &'b W,
    phase: &'b Phase,
    tile: Tile<'b>,
    /// Accumulators' initial values of the block.
    bias: *const u8,
    /// Padded index of the block's first lane.
    lane: usize,
    /// Output channel of that lane.
    channel: usize,
    /// Output channels in the block.
    outs: usize,
    chain: PhantomData<C>,
}

/// Runs a job.
///
/// # Safety
/// The features of the chain are on; the contract of `QConv::run_part` holds for the job's tensors and the writer's.
#[inline(always)]
pub(crate) unsafe fn run<C: Chain, W: Write<Vectors<C>, Acc<C>>>(job: &Job, writer: &W) {
    let packed = job.packed;
    let lanes = Vectors::<C>::LANES;
    let mut taps = [0isize; MAX_TAPS];
    for group in job.part.groups.clone() {
        for (b, block) in packed.blocks.iter().enumerate() {
            for (p, phase) in packed.phases.iter().enumerate() {
                for (offset, tap) in taps.iter_mut().zip(&phase.taps) {
                    *offset = tap.dy * job.row_bytes + tap.dx * job.pixel_bytes;
                }
                let panel = packed.panel(group, b, p);
                let lane = (group * packed.vectors() + block.first) * lanes;
                let first = block.first * lanes;
                // SAFETY: the group's first input channel and the block's first lane lie in their arrays.
                unsafe {
                    let strip = Strip::<C, W> {
                        job,
                        writer,
                        phase,
                        tile: Tile {
                            x: job.input.add(group * packed.depth * 4),
                            x_step: phase.in_step * job.pixel_bytes as usize,
                            taps: &taps[..phase.taps.len()],
                            depth: packed.depth,
                            weights: packed.weights(panel).as_ptr(),
                            segments: job.segments.map_or(&[], |s| s.of(panel)),
                        },
                        bias: job.bias.add(lane * 4),
                        lane,
                        channel: group * packed.outs + first,
                        outs: (packed.outs - first).min(block.count * lanes),
                        chain: PhantomData,
                    };
                    match block.count {
                        1 => strip.rows::<1>(),
                        2 => strip.rows::<2>(),
                        3 => strip.rows::<3>(),
                        _ => unreachable!("blocks have at most 3 vectors"),
                    }
                }
            }
        }
    }
}

impl<C: Chain, W: Write<Vectors<C>, Acc<C>>> Strip<'_, '_, C, W> {
    #[inline(always)]
    unsafe fn rows<const NV: usize>(&self) {
        let phase = self.phase;
        let columns =
            (self.job.out_layout.width + phase.out_step - 1 - phase.first_column) / phase.out_step;
        for oy in self.job.part.rows.clone() {
            if oy % phase.out_step != phase.first_row {
                continue;
            }
            let mut column = 0;
            // SAFETY: column + MR <= columns for every tile.
            unsafe {
                if C::D::MAX_MR == 8 {
                    while column + 8 <= columns {
                        self.tile::<8, NV>(oy, column);
                        column += 8;
                    }
                }
                while column + 4 <= columns {
                    self.tile::<4, NV>(oy, column);
                    column += 4;
                }
                if column + 2 <= columns {
                    self.tile::<2, NV>(oy, column);
                    column += 2;
                }
                if column < columns {
                    self.tile::<1, NV>(oy, column);
                }
            }
        }
    }

    #[inline(always)]
    unsafe fn tile<const MR: usize, const NV: usize>(&self, oy: usize, first: usize) {
        let (job, phase) = (self.job, self.phase);
        let lanes = Vectors::<C>::LANES;
        let y = (oy / phase.out_step * phase.in_step) as isize;
        // SAFETY: the tile's pixels lie in the output, so their taps lie in the input with its halo; the writer owns them.
        unsafe {
            let x = self
                .tile
                .x
                .offset(y * job.row_bytes)
                .add(first * self.tile.x_step);
            let mut acc = [[C::D::load_acc(self.bias); NV]; MR];
            for n in 1..NV {
                let bias = C::D::load_acc(self.bias.add(n * lanes * 4));
                for pixel in &mut acc {
                    pixel[n] = bias;
                }
            }
            let acc = C::sum(acc, &Tile { x, ..self.tile });
            for n in 0..NV {
                let mut column = [acc[0][n]; MR];
                for m in 1..MR {
                    column[m] = acc[m][n];
                }
                self.writer.write(
                    column,
                    Place {
                        lane: self.lane + n * lanes,
                        channel: self.channel + n * lanes,
                        n: (self.outs - n * lanes).min(lanes),
                        y: oy,
                        x: first * phase.out_step + phase.first_column,
                        step: phase.out_step,
                    },
                );
            }
        }
    }
}

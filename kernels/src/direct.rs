//! Direct convolution: no im2row, the halo stands in for the borders.
//!
//! A tile is MR consecutive output pixels of a row × NV vectors of output channels, all in registers. Per 32-bit group
//! of input channels it loads NV weight vectors and one broadcast group per pixel. Within a band of rows panels are the
//! outer loop: a panel stays in the first cache levels while the rows stream past it, the band in the second.

#[cfg(target_arch = "x86_64")]
pub(crate) mod tiles;

use std::marker::PhantomData;
use std::ops::Range;

use crate::arch::prefetch;
use crate::packed::{Blocking, MAX_TAPS, Packed, Panels, Segments};
use crate::phase::Phase;
#[cfg(target_arch = "x86_64")]
use crate::segments::SegmentedPacked;
#[cfg(target_arch = "x86_64")]
use crate::simd::SegmentedDot;
use crate::simd::{Dot, Simd};
use crate::{Layout, Part};

/// Bytes of a cache line.
pub(crate) const LINE: usize = 64;

/// A direct convolution over concrete tensors.
pub(crate) struct Job<'a, P> {
    panels: &'a P,
    /// Accumulators' initial values, 4 bytes per padded output channel.
    bias: *const u8,
    /// Bytes from a phase's initial values to the next one's; 0 where all have the same.
    phase_bytes: usize,
    /// Pixel (0, 0), channel 0.
    input: *const u8,
    /// Bytes from a row to the next.
    row_bytes: isize,
    /// Bytes from a pixel to the next.
    pixel_bytes: isize,
    /// Bytes of a number.
    size: usize,
    out_layout: &'a Layout,
    part: &'a Part,
}

impl<'a, P: Panels> Job<'a, P> {
    /// `bias` holds 4 bytes per padded output channel, or as many for each phase in turn.
    ///
    /// # Safety
    /// `input` is the start of the buffer that `layout` was checked for.
    pub unsafe fn new<T, A: Copy>(
        panels: &'a P,
        bias: &'a [A],
        input: *const T,
        in_layout: &Layout,
        out_layout: &'a Layout,
        part: &'a Part,
    ) -> Self {
        let size = size_of::<T>();
        const { assert!(size_of::<A>() == 4, "an accumulator is 32 bits") };
        let packed = panels.packed();
        let lanes = packed.padded();
        let of_each_phase = bias.len() == lanes * packed.phases().len();
        assert!(bias.len() == lanes || of_each_phase, "initial values");
        Self {
            panels,
            bias: bias.as_ptr().cast(),
            phase_bytes: if of_each_phase { lanes * 4 } else { 0 },
            // SAFETY: origin < buffer_len <= the buffer's length (checked layout).
            input: unsafe { input.add(in_layout.origin()) }.cast(),
            // A layout's strides are at most isize::MAX / 8 elements, and elements at most 4 bytes.
            row_bytes: (in_layout.row_stride() * size) as isize,
            pixel_bytes: (in_layout.pixel_stride() * size) as isize,
            size,
            out_layout,
            part,
        }
    }

    /// The initial values of a phase from padded output channel `lane` on.
    ///
    /// # Safety
    /// `phase` is one of the panels', and `lane <= padded()`.
    #[inline(always)]
    unsafe fn bias(&self, phase: usize, lane: usize) -> *const u8 {
        // SAFETY: `new` asserted padded() values of 4 bytes, as many for each phase where phase_bytes is not 0: with
        // phase < phases and lane <= padded() (caller) phase · phase_bytes + 4 · lane <= 4 · bias.len().
        unsafe { self.bias.add(phase * self.phase_bytes + lane * 4) }
    }

    /// The part's groups, each in bands of rows that touch about `bytes` of its input and output (whose numbers are
    /// taken for as large as the input's): all panels go through a band before the next comes, and find it in a cache.
    /// At least one row of every phase.
    fn bands(&self, bytes: usize) -> impl Iterator<Item = (usize, Range<usize>)> {
        let packed = self.panels.packed();
        let steps = packed.phases().first();
        let (in_step, out_step) = steps.map_or((1, 1), |phase| (phase.in_step, phase.out_step));
        let inputs = packed.depth() * 4 * in_step * in_step;
        let pixel = inputs + packed.outs() * self.size * out_step * out_step;
        let columns = self.out_layout.width().div_ceil(out_step);
        let band = (bytes / columns.saturating_mul(pixel)).max(1) * out_step;
        let rows = self.part.rows.clone();
        self.part.groups.clone().flat_map(move |group| {
            let end = rows.end;
            let bands = rows.clone().step_by(band);
            bands.map(move |first| (group, first..end.min(first + band)))
        })
    }
}

/// Where finished accumulators go.
///
/// # Safety
/// `write` may be called where the features of `S` are on, for output elements that the caller owns.
pub(crate) unsafe trait Write<S: Simd, Acc> {
    /// Stores M pixels' vectors to `place`.
    ///
    /// # Safety
    /// The features of `S` are on. In the output `place.y < height`, `place.x + (M - 1) · place.step < width` and
    /// `place.channel + place.n <= channels`, with `place.n <= LANES`; `place.lane + LANES` is at most the number of
    /// padded lanes, of which each has a scale or bias. Nobody else has these elements.
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
    /// What it reads.
    type Panels: Panels;

    /// Adds `Σ taps Σ depth x · w` to a tile's accumulators.
    ///
    /// # Safety
    /// The features of `D` are on. At every tap MR pixels, `tile.x_step` apart, have `4 · tile.depth` readable bytes;
    /// `tile.weights` are `taps · depth · NV` vectors, packed for `D`; the lengths of a tap's segments, where this
    /// chain takes segments, add up to the depth.
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
    pub segments: Segments<'a>,
}

type Acc<C> = <<C as Chain>::D as Dot>::Acc;
type Vectors<C> = <<C as Chain>::D as Dot>::S;

/// As many lines as a step of [`Plain::products`] reads.
pub(crate) const ALL: usize = usize::MAX;

/// Sums with [`Dot::dot`].
pub(crate) struct Plain<D>(PhantomData<D>);

// SAFETY: reads weights front to back, 4 · LANES · NV bytes per group, and 4 bytes per pixel and group.
unsafe impl<D: Dot> Chain for Plain<D> {
    type D = D;
    type Panels = Packed;

    /// # Safety
    /// As [`Chain::sum`].
    #[inline(always)]
    unsafe fn sum<const MR: usize, const NV: usize>(
        acc: [[D::Acc; NV]; MR],
        tile: &Tile,
    ) -> [[D::Acc; NV]; MR] {
        // SAFETY: the caller's contract.
        unsafe { Self::products::<MR, NV, 0>(acc, tile, 0) }
    }
}

impl<D: Dot> Plain<D> {
    /// [`Chain::sum`]. Every step calls the next AHEAD lines into the caches, from `ahead` bytes behind the first
    /// weights on; at most as many as it reads.
    ///
    /// # Safety
    /// As [`Chain::sum`].
    #[inline(always)]
    pub unsafe fn products<const MR: usize, const NV: usize, const AHEAD: usize>(
        mut acc: [[D::Acc; NV]; MR],
        tile: &Tile,
        ahead: usize,
    ) -> [[D::Acc; NV]; MR] {
        let vector = 4 * D::S::LANES;
        let mut w = tile.weights;
        let mut next = w.wrapping_add(ahead);
        let lines = AHEAD.min((NV * vector).div_ceil(LINE));
        let called = (lines * LINE).min(NV * vector);
        for &tap in tile.taps {
            // SAFETY: the tile's pixels at this tap have 4 · depth readable bytes each (caller); the panel holds
            // taps · depth · NV vectors (`Packed`), of which every step reads the next NV.
            unsafe {
                let mut x = tile.x.offset(tap);
                for _ in 0..tile.depth {
                    let mut weights = [D::weights(w); NV];
                    for n in 1..NV {
                        weights[n] = D::weights(w.add(n * vector));
                    }
                    for n in 0..lines {
                        prefetch(next.wrapping_add(n * LINE));
                    }
                    next = next.wrapping_add(called);
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
// SAFETY: as for Plain; a tap's segment lengths add up to the depth, and each has its offsets (`Panels`).
unsafe impl<D: SegmentedDot> Chain for Segmented<D> {
    type D = D;
    type Panels = SegmentedPacked;

    /// # Safety
    /// As [`Chain::sum`].
    #[inline(always)]
    unsafe fn sum<const MR: usize, const NV: usize>(
        mut acc: [[D::Acc; NV]; MR],
        tile: &Tile,
    ) -> [[D::Acc; NV]; MR] {
        let vector = 4 * D::S::LANES;
        let mut w = tile.weights;
        let mut lengths = tile.segments.lengths.iter();
        let mut offsets: *const u8 = tile.segments.offsets.as_ptr().cast();
        for &tap in tile.taps {
            // SAFETY: the tile's pixels at this tap have 4 · depth readable bytes each (caller); the panel holds
            // taps · depth · NV vectors (`Packed`), of which every step reads the next NV. With each length of the
            // panel come offsets of 2 · LANES · NV numbers of 2 bytes, which are NV vectors (`Panels`).
            unsafe {
                let mut x = tile.x.offset(tap);
                let end = x.add(tile.depth * 4);
                while x != end {
                    // There is one as long as groups are left; without it nothing more is read.
                    let Some(&length) = lengths.next() else {
                        break;
                    };
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
                    for n in 0..NV {
                        let offset = D::weights(offsets.add(n * vector));
                        for m in 0..MR {
                            acc[m][n] = D::spill(acc[m][n], sum[m][n], offset);
                        }
                    }
                    offsets = offsets.add(NV * vector);
                }
            }
        }
        acc
    }
}

/// A row of tiles' constants.
struct Strip<'a, 'b, C: Chain, W> {
    job: &'b Job<'a, C::Panels>,
    writer: &'b W,
    phase: &'b Phase,
    /// Output rows.
    rows: Range<usize>,
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

/// Bytes of a band ([`Job::bands`]): half of the smallest second-level cache of CPUs with AVX2. Without bands 64 → 256
/// channels at 128 × 80 with a residual take 1.5 times as long with `avx512vnni`, 1.6 times with `avx2`.
const BAND_BYTES: usize = 128 << 10;

/// Runs a job.
///
/// # Safety
/// The features of the chain are on; the contract of `QConv::run_part` holds for the job's tensors and the writer's.
#[inline(always)]
pub(crate) unsafe fn run<C: Chain, W: Write<Vectors<C>, Acc<C>>>(job: &Job<C::Panels>, writer: &W) {
    let packed = job.panels.packed();
    assert_eq!(
        packed.blocking(),
        Blocking::of::<C::D>(),
        "packed for another kernel"
    );
    let lanes = Vectors::<C>::LANES;
    let mut taps = [0isize; MAX_TAPS];
    for (group, rows) in job.bands(BAND_BYTES) {
        for (b, block) in packed.blocks().iter().enumerate() {
            for (p, phase) in packed.phases().iter().enumerate() {
                for (offset, tap) in taps.iter_mut().zip(&phase.taps) {
                    *offset = tap.dy * job.row_bytes + tap.dx * job.pixel_bytes;
                }
                let panel = packed.panel(group, b, p);
                let lane = (group * packed.vectors() + block.first) * lanes;
                let first = block.first * lanes;
                // SAFETY: group < groups (the part lies within the shape's, caller), so that 4 · group · depth <
                // in_channels · 4 / pack bytes of a pixel, and lane + count · lanes <= padded(), of which each phase
                // has an initial value (asserted in `Job::new`).
                unsafe {
                    let strip = Strip::<C, W> {
                        job,
                        writer,
                        phase,
                        rows: rows.clone(),
                        tile: Tile {
                            x: job.input.add(group * packed.depth() * 4),
                            x_step: phase.in_step * job.pixel_bytes as usize,
                            taps: &taps[..phase.taps.len()],
                            depth: packed.depth(),
                            weights: packed.weights(panel).as_ptr(),
                            segments: job.panels.segments(panel),
                        },
                        bias: job.bias(p, lane),
                        lane,
                        channel: group * packed.outs() + first,
                        outs: (packed.outs() - first).min(block.count * lanes),
                        chain: PhantomData,
                    };
                    match block.count {
                        1 => strip.rows::<1>(),
                        2 if C::D::MAX_NV >= 2 => strip.rows::<2>(),
                        3 if C::D::MAX_NV >= 3 => strip.rows::<3>(),
                        count => unreachable!("a block of {count} vectors"),
                    }
                }
            }
        }
    }
}

impl<C: Chain, W: Write<Vectors<C>, Acc<C>>> Strip<'_, '_, C, W> {
    /// All rows of the strip.
    ///
    /// # Safety
    /// As [`run`], which the strip was cut from: the tier's features are on, and the part's rows lie in the output.
    #[inline(always)]
    unsafe fn rows<const NV: usize>(&self) {
        let phase = self.phase;
        let columns = (self.job.out_layout.width() + phase.out_step - 1 - phase.first_column)
            / phase.out_step;
        for oy in self.rows.clone() {
            if oy % phase.out_step != phase.first_row {
                continue;
            }
            // Once a row: a division takes longer than many products.
            let iy = (oy / phase.out_step * phase.in_step) as isize;
            let mut column = 0;
            // SAFETY: oy is an output row (the part lies within them, caller), iy the input row of its tap (0, 0), and
            // column + MR <= columns for every tile.
            unsafe {
                let row = self.tile.x.offset(iy * self.job.row_bytes);
                if C::D::MAX_MR == 8 {
                    while column + 8 <= columns {
                        self.tile::<8, NV>(row, oy, column);
                        column += 8;
                    }
                }
                if C::D::MAX_MR == 6 {
                    while column + 6 <= columns {
                        self.tile::<6, NV>(row, oy, column);
                        column += 6;
                    }
                }
                while column + 4 <= columns {
                    self.tile::<4, NV>(row, oy, column);
                    column += 4;
                }
                if column + 2 <= columns {
                    self.tile::<2, NV>(row, oy, column);
                    column += 2;
                }
                if column < columns {
                    self.tile::<1, NV>(row, oy, column);
                }
            }
        }
    }

    /// MR pixels of row `oy` from the strip's column `first`.
    ///
    /// # Safety
    /// As [`rows`](Self::rows); `oy` is an output row, `row` its first pixel's tap (0, 0), and `first + MR` is at most
    /// the strip's columns.
    #[inline(always)]
    unsafe fn tile<const MR: usize, const NV: usize>(
        &self,
        row: *const u8,
        oy: usize,
        first: usize,
    ) {
        // SAFETY: output pixels (oy, (first + m) · out_step + first_column), m < MR, lie in the output (caller). Their
        // taps lie in -halo..height + halo rows and -halo..width + halo columns of the input, halo being
        // `ConvShape::input_halo`, which `check` proved readable. Initial values: NV · lanes from the block's first
        // (see `run`).
        unsafe {
            let x = row.add(first * self.tile.x_step);
            let mut acc = [[C::D::load_acc(self.bias); NV]; MR];
            for n in 1..NV {
                let bias = C::D::load_acc(self.bias.add(n * Vectors::<C>::LANES * 4));
                for pixel in &mut acc {
                    pixel[n] = bias;
                }
            }
            let acc = C::sum(acc, &Tile { x, ..self.tile });
            // Written out: of a loop the compiler makes one that reads accumulators from the stack.
            self.write::<MR, NV>(acc, 0, oy, first);
            if NV > 1 {
                self.write::<MR, NV>(acc, 1, oy, first);
            }
            if NV > 2 {
                self.write::<MR, NV>(acc, 2, oy, first);
            }
        }
    }

    /// Vector `n` of a tile's pixels.
    ///
    /// # Safety
    /// As [`tile`](Self::tile), and n < NV.
    #[inline(always)]
    unsafe fn write<const MR: usize, const NV: usize>(
        &self,
        acc: [[Acc<C>; NV]; MR],
        n: usize,
        oy: usize,
        first: usize,
    ) {
        let lanes = Vectors::<C>::LANES;
        let mut column = [acc[0][n]; MR];
        for m in 1..MR {
            column[m] = acc[m][n];
        }
        let place = Place {
            lane: self.lane + n * lanes,
            channel: self.channel + n * lanes,
            n: (self.outs - n * lanes).min(lanes),
            y: oy,
            x: first * self.phase.out_step + self.phase.first_column,
            step: self.phase.out_step,
        };
        // SAFETY: MR pixels of an output row from `x` on, and lanes that are the block's (caller).
        unsafe { self.writer.write(column, place) };
    }
}

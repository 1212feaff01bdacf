//! Direct convolution by matrix tiles: a tile of inputs is 16 consecutive output pixels of a row × 64 channels, loaded
//! from the tensor as it lies, once per tap.
//!
//! Two tiles of pixels × two of output channels are summed together (four × one where one is left). Rows that 16 does
//! not divide end with a tile that overlaps the one before it, whose pixels are summed twice and written once; narrower
//! rows are tiles of fewer rows.

use std::arch::x86_64::__m512i;
use std::ops::Range;

use super::{Job, Place, Write};
use crate::ConvShape;
use crate::arch::x86_64::amx::{LANES, ROWS, SUMS, Sums, Tiles};
use crate::arch::x86_64::avx512::Avx512;
use crate::packed::{Blocking, Chunks, MAX_TAPS, Packed};
use crate::phase::Phase;
use crate::simd::Simd;

/// How the panels are cut: a row of weights is one vector of AVX-512.
pub(crate) const BLOCKING: Blocking = Blocking {
    lanes: LANES,
    max_nv: 2,
    pack: 4,
    together: 1,
    apart: false,
    chunk: ROWS,
};

/// Most products of tiles per tile of sums, chunks × taps.
const MAX_STEPS: usize = 1024;

/// Least 32-bit groups of input channels for which tiles were faster than vectors, with one tap: 1.15 times with 6 (24
/// channels), the same with 5.
const LEAST_DEPTH: usize = 6;

/// The same for several taps, whose products are more beside the epilogue: 1.3 to 1.6 times with 3, the same with 2.
const LEAST_DEPTH_OF_TAPS: usize = 3;

/// Whether tiles are faster than vectors for `shape`, and can run it. Stems and narrow groups stay with vectors.
pub(crate) fn pay(shape: &ConvShape) -> bool {
    let depth = shape.group_in() / BLOCKING.pack;
    let taps = shape.kernel() * shape.kernel();
    let least = if taps > 1 {
        LEAST_DEPTH_OF_TAPS
    } else {
        LEAST_DEPTH
    };
    depth >= least && taps <= MAX_TAPS && taps * Chunks::of(depth, ROWS).count <= MAX_STEPS
}

/// Runs a job.
///
/// # Safety
/// The features of AVX-512 are on, and tiles are granted; the contract of `QConv::run_part` holds for the job's tensors
/// and the writer's.
#[inline(always)]
pub(crate) unsafe fn run<W: Write<Avx512, __m512i>>(job: &Job<Packed>, writer: &W) {
    let packed = job.panels;
    assert_eq!(packed.blocking(), BLOCKING, "packed for another kernel");
    let chunks = packed.chunks();
    let mut offsets = [0isize; MAX_STEPS];
    // SAFETY: tiles are granted (caller); nothing below uses them by another way.
    let mut tiles = unsafe { Tiles::new(ROWS, chunks.size) };
    for (group, rows) in job.bands(BAND_BYTES) {
        for (b, block) in packed.blocks().iter().enumerate() {
            for (p, phase) in packed.phases().iter().enumerate() {
                let strip = Strip::new(job, phase, &rows);
                if strip.count() == 0 {
                    continue;
                }
                let steps = phase.taps.len() * chunks.count;
                assert!(steps > 0, "every phase has a tap");
                for (i, offset) in offsets[..steps].iter_mut().enumerate() {
                    let tap = &phase.taps[i / chunks.count];
                    let first = chunks.first(i % chunks.count, packed.depth());
                    *offset =
                        tap.dy * job.row_bytes + tap.dx * job.pixel_bytes + 4 * first as isize;
                }
                let lane = (group * packed.vectors() + block.first) * LANES;
                let first = block.first * LANES;
                // SAFETY: group < groups (the part lies within the shape's, caller), so that 4 · group · depth <
                // in_channels bytes of a pixel, and lane + count · LANES <= padded(), of which each phase has initial
                // values (asserted in `Job::new`).
                unsafe {
                    tiles.resize(strip.pixels, chunks.size);
                    let panel = Panel {
                        strip,
                        tiles: &tiles,
                        writer,
                        input: job.input.add(group * packed.depth() * 4),
                        offsets: &offsets[..steps],
                        weights: packed.weights(packed.panel(group, b, p)).as_ptr(),
                        bias: job.bias(p, lane).cast(),
                        lane,
                        channel: group * packed.outs() + first,
                        outs: (packed.outs() - first).min(block.count * LANES),
                    };
                    match block.count {
                        1 => panel.run::<1, 4>(),
                        2 => panel.run::<2, 2>(),
                        count => unreachable!("a block of {count} vectors"),
                    }
                }
            }
        }
    }
}

/// Bytes of a band ([`Job::bands`]): a quarter of the second-level cache of CPUs that have tiles. Without bands
/// 192 → 128 channels at 128 × 80 take 1.6 times as long.
const BAND_BYTES: usize = 512 << 10;

/// The tiles of a phase's output pixels in some rows, one row after the other.
#[derive(Clone, Copy)]
struct Strip<'a> {
    phase: &'a Phase,
    row_bytes: isize,
    /// Bytes from a pixel of a tile to the next.
    stride: usize,
    /// First output row, and how many.
    first_row: usize,
    rows: usize,
    /// Columns of the phase.
    columns: usize,
    /// Pixels in a tile.
    pixels: usize,
    /// Tiles in a row.
    per_row: usize,
}

/// One tile of output pixels.
#[derive(Clone, Copy)]
struct Run {
    /// Output row.
    y: usize,
    /// Column of the phase.
    column: usize,
    /// Pixels that the tile before it has written.
    skip: usize,
}

impl<'a> Strip<'a> {
    fn new(job: &Job<Packed>, phase: &'a Phase, rows: &Range<usize>) -> Self {
        let step = phase.out_step;
        // The first of the rows that is the phase's.
        let first_row = rows.start + (phase.first_row + step - rows.start % step) % step;
        let columns = (job.out_layout.width() + step - 1 - phase.first_column) / step;
        Self {
            phase,
            row_bytes: job.row_bytes,
            stride: phase.in_step * job.pixel_bytes as usize,
            first_row,
            rows: rows.end.saturating_sub(first_row).div_ceil(step),
            columns,
            pixels: columns.min(ROWS),
            per_row: columns.div_ceil(ROWS),
        }
    }

    /// Tiles.
    fn count(&self) -> usize {
        self.rows * self.per_row
    }

    /// Tile `i`, `i < count`: `column + pixels <= columns`.
    fn run(&self, i: usize) -> Run {
        let (row, tile) = (i / self.per_row, i % self.per_row);
        let column = (tile * ROWS).min(self.columns - self.pixels);
        Run {
            y: self.first_row + row * self.phase.out_step,
            column,
            skip: tile * ROWS - column,
        }
    }

    /// Bytes from the input's first pixel to a tile's, tap offset (0, 0).
    fn offset(&self, run: &Run) -> isize {
        let y = run.y / self.phase.out_step * self.phase.in_step;
        y as isize * self.row_bytes + (run.column * self.stride) as isize
    }
}

/// One block of output channels and one phase.
struct Panel<'a, W> {
    strip: Strip<'a>,
    tiles: &'a Tiles,
    writer: &'a W,
    /// Pixel (0, 0), first channel of the group.
    input: *const u8,
    /// Bytes to every tap's every chunk.
    offsets: &'a [isize],
    weights: *const u8,
    /// Sums' initial values of the block.
    bias: *const i32,
    /// Padded index of the block's first lane.
    lane: usize,
    /// Output channel of that lane.
    channel: usize,
    /// Output channels in the block.
    outs: usize,
}

impl<W: Write<Avx512, __m512i>> Panel<'_, W> {
    /// All tiles, RUNS at a time, for NV vectors of output channels.
    ///
    /// # Safety
    /// As [`run`], which the panel was cut from: the features are on, and the part's rows lie in the output.
    #[inline(always)]
    unsafe fn run<const NV: usize, const RUNS: usize>(&self) {
        const { assert!(NV * RUNS == SUMS) };
        let count = self.strip.count();
        let mut sums = Sums([[[0; LANES]; ROWS]; SUMS]);
        for first in (0..count).step_by(RUNS) {
            // Behind the last tile it is summed again, and not written.
            let runs: [Run; RUNS] =
                std::array::from_fn(|i| self.strip.run((first + i).min(count - 1)));
            // SAFETY: a run's pixels are output pixels of the part: y is one of its rows, and column + pixels <=
            // columns. Their taps lie in -halo..height + halo rows and -halo..width + halo columns of the input, halo
            // being `ConvShape::input_halo`, which `check` proved readable; of each pixel a step reads `size` groups
            // from `first`, and first + size <= depth (`Chunks`). The panel holds steps · size · NV vectors (`Packed`).
            unsafe {
                let inputs = runs.map(|run| self.input.offset(self.strip.offset(&run)));
                self.sum::<NV, RUNS>(inputs, &mut sums);
                for (i, run) in runs.iter().enumerate().take(count - first) {
                    for n in 0..NV {
                        self.write(&sums.0[i * NV + n], run, n);
                    }
                }
            }
        }
    }

    /// Sums of RUNS tiles from `inputs`.
    ///
    /// # Safety
    /// As [`Tiles::two_by_two`] and [`Tiles::four_by_one`] want `inputs` and the panel.
    #[inline(always)]
    unsafe fn sum<const NV: usize, const RUNS: usize>(
        &self,
        inputs: [*const u8; RUNS],
        sums: &mut Sums,
    ) {
        let (stride, offsets) = (self.strip.stride, self.offsets);
        // SAFETY: the caller's contract.
        unsafe {
            if RUNS == 2 {
                let inputs = [inputs[0], inputs[1]];
                self.tiles
                    .two_by_two(inputs, stride, offsets, self.weights, sums);
            } else {
                let inputs = std::array::from_fn(|i| inputs[i]);
                self.tiles
                    .four_by_one(inputs, stride, offsets, self.weights, sums);
            }
        }
    }

    /// Hands the pixels of `run` that nobody has written to the writer, for vector `n` of the block.
    ///
    /// # Safety
    /// The features are on; `run` is one of the strip's.
    #[inline(always)]
    unsafe fn write(&self, sums: &[[i32; LANES]; ROWS], run: &Run, n: usize) {
        let pixels = self.strip.pixels;
        let mut m = run.skip;
        // SAFETY: m + M <= pixels for every piece, so that the pixels are output pixels that this part owns.
        unsafe {
            while m + 8 <= pixels {
                self.piece::<8>(sums, run, n, m);
                m += 8;
            }
            if m + 4 <= pixels {
                self.piece::<4>(sums, run, n, m);
                m += 4;
            }
            while m < pixels {
                self.piece::<1>(sums, run, n, m);
                m += 1;
            }
        }
    }

    /// M pixels from pixel `m` of `run`.
    ///
    /// # Safety
    /// As [`write`](Self::write); `m + M <= pixels`.
    #[inline(always)]
    unsafe fn piece<const M: usize>(
        &self,
        sums: &[[i32; LANES]; ROWS],
        run: &Run,
        n: usize,
        m: usize,
    ) {
        let phase = self.strip.phase;
        let place = Place {
            lane: self.lane + n * LANES,
            channel: self.channel + n * LANES,
            n: (self.outs - n * LANES).min(LANES),
            y: run.y,
            x: (run.column + m) * phase.out_step + phase.first_column,
            step: phase.out_step,
        };
        // SAFETY: the features are on; a row of sums is one vector; the writer's pixels are ours (caller).
        unsafe {
            let bias = Avx512::load_i(self.bias.add(n * LANES));
            let mut acc = [bias; M];
            for i in 0..M {
                acc[i] = Avx512::add_i(bias, Avx512::load_i(sums[m + i].as_ptr()));
            }
            self.writer.write(acc, place);
        }
    }
}

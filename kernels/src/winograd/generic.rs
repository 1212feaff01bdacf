//! Winograd on vectors.
//!
//! Tiles are taken in chunks that fit the second-level cache: transform the inputs of a chunk (vectors of channels),
//! then for every block of output channels multiply point by point (a tile of MR Winograd tiles × NV vectors, the same
//! core as the direct kernels') and transform the outputs (vectors of output channels) straight into the writer.

mod input;
mod output;

use super::{BIAS_POINT, OUT, POINTS};
use crate::direct::{ALL, LINE, Plain, Tile, Write};
use crate::packed::Packed;
use crate::simd::{Dot, Simd};
use crate::{Layout, Part};

/// How a point's sums lose the bits that its weights have more: in every lane of a vector, since the compiler makes two
/// instructions of a shift that it knows to be the same in all of them.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Shift {
    /// What sums begin with: half a unit of the shift.
    start: [i32; MOST_LANES],
    /// By how much they are shifted to the right.
    bits: [i32; MOST_LANES],
}

/// Most 32-bit lanes of a vector.
const MOST_LANES: usize = 16;

impl Shift {
    /// By `bits`, less than 32.
    pub fn new(bits: u32) -> Self {
        Self {
            start: [(1 << bits) >> 1; MOST_LANES],
            bits: [bits as i32; MOST_LANES],
        }
    }
}

/// A Winograd convolution over concrete tensors.
pub(crate) struct Job<'a> {
    /// 36 taps: the points.
    pub packed: &'a Packed,
    /// Where the bias point's sums begin; padded, one per lane.
    pub bias: *const i32,
    pub shifts: &'a [Shift; POINTS],
    /// Channels of a group, even.
    pub channels: usize,
    pub input: *const u8,
    pub in_layout: &'a Layout,
    pub padding: usize,
    /// As many zeros as a group has channels.
    pub zeros: *const u8,
    pub out_layout: &'a Layout,
    pub part: &'a Part,
    pub plan: Plan,
    /// `plan.bytes()`, aligned to a vector.
    pub scratch: *mut u8,
}

/// How scratch memory is divided.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plan {
    /// Winograd tiles per chunk, a multiple of MR.
    tiles: usize,
    /// i16 from a tile's transformed input to the next tile's.
    row: usize,
    /// i16 from a point's first tile to the next point's.
    point: usize,
    /// Bytes of the products of one chunk.
    products: usize,
}

/// i32 from a point's products of MR tiles and `nv` vectors to the next point's. A line is left free behind every
/// point, or all points of a tile would fall into a few sets of the cache.
#[inline(always)]
const fn products_point<D: Dot>(nv: usize) -> usize {
    D::MAX_MR * nv * D::S::LANES + LINE / 4
}

/// Bytes that transformed inputs and products of a chunk may take: a part of a common second-level cache.
const CHUNK_BYTES: usize = 320 << 10;

/// Most tiles of a chunk, up to a multiple of MR.
const MOST_TILES: usize = 40;

/// Products of a group's channels from which on chunks take [`LARGE_CHUNK_BYTES`]. Weights take 72 bytes for each,
/// which hardly fits a second-level cache (1.8 MB at 192 → 128): they come from further away for every chunk anew,
/// which takes longer than to read a chunk's inputs from there.
const MANY_WEIGHTS: usize = 1 << 14;

/// Enough for [`MOST_TILES`] of 512 channels.
const LARGE_CHUNK_BYTES: usize = 2 << 20;

impl Plan {
    /// For groups of `channels` channels and `outs` outputs, with `D`.
    pub fn new<D: Dot>(channels: usize, outs: usize) -> Self {
        // Whole cache lines, so that stores of vectors do not cross them.
        let row = channels.next_multiple_of(32);
        let per_tile = POINTS * (2 * row + 4 * D::S::LANES * D::MAX_NV);
        let most = MOST_TILES.next_multiple_of(D::MAX_MR);
        let bytes = if channels * outs < MANY_WEIGHTS {
            CHUNK_BYTES
        } else {
            LARGE_CHUNK_BYTES
        };
        let tiles = bytes / per_tile + D::MAX_MR / 2;
        let tiles = (tiles / D::MAX_MR * D::MAX_MR).clamp(D::MAX_MR, most);
        Self {
            tiles,
            row,
            point: tiles * row + LINE / 2,
            products: tiles / D::MAX_MR * POINTS * products_point::<D>(D::MAX_NV) * 4,
        }
    }

    /// Scratch bytes needed.
    pub fn bytes(&self) -> usize {
        self.products + 2 * POINTS * self.point
    }
}

/// Runs a job.
///
/// # Safety
/// The features of `D` are on; the contract of `QConv::run_part` holds for the job's tensors and the writer's; `plan`
/// was made for `D` and these channels.
#[inline(always)]
pub(crate) unsafe fn run<D, W>(job: &Job, writer: &W)
where
    D: Dot<Acc = <<D as Dot>::S as Simd>::I>,
    W: Write<D::S, <D::S as Simd>::I>,
{
    const { assert!(matches!(D::MAX_MR, 4 | 6 | 8), "`Chunk::run` has these") };
    let rows = &job.part.rows;
    if rows.is_empty() {
        return;
    }
    let across = job.out_layout.width().div_ceil(OUT);
    let first = rows.start / OUT * across;
    let last = rows.end.div_ceil(OUT) * across;
    for group in job.part.groups.clone() {
        let mut start = first;
        while start < last {
            let count = job.plan.tiles.min(last - start);
            // SAFETY: count <= plan.tiles; blocks hold 1..=3 vectors.
            unsafe {
                let tiles = Tiles {
                    start,
                    count,
                    across,
                };
                input::transform_inputs::<D::S>(job, group, tiles);
                for b in 0..job.packed.blocks().len() {
                    let chunk = Chunk {
                        job,
                        writer,
                        group,
                        block: b,
                        tiles,
                    };
                    match job.packed.blocks()[b].count {
                        1 => chunk.run::<D, 1>(),
                        2 if D::MAX_NV >= 2 => chunk.run::<D, 2>(),
                        3 if D::MAX_NV >= 3 => chunk.run::<D, 3>(),
                        count => unreachable!("a block of {count} vectors"),
                    }
                }
            }
            start += count;
        }
    }
}

/// The tiles of a chunk, row after row.
#[derive(Clone, Copy)]
struct Tiles {
    /// Number of the first.
    start: usize,
    count: usize,
    /// Tiles in a row.
    across: usize,
}

impl Tiles {
    /// Row and column of every tile.
    #[inline(always)]
    fn places(self) -> impl Iterator<Item = (usize, usize)> {
        let (mut ty, mut tx) = (self.start / self.across, self.start % self.across);
        (0..self.count).map(move |_| {
            let place = (ty, tx);
            tx += 1;
            if tx == self.across {
                (ty, tx) = (ty + 1, 0);
            }
            place
        })
    }
}

impl Job<'_> {
    /// Transformed input of a point and tile of the chunk.
    ///
    /// # Safety
    /// `point < 36`, `tile < plan.tiles`.
    #[inline(always)]
    unsafe fn v(&self, point: usize, tile: usize) -> *mut i16 {
        // SAFETY: the region behind the products holds 36 · tiles rows.
        unsafe {
            self.scratch
                .add(self.plan.products)
                .cast::<i16>()
                .add(point * self.plan.point + tile * self.plan.row)
        }
    }
}

/// A chunk of tiles and a block of output channels.
struct Chunk<'a, 'b, W> {
    job: &'b Job<'a>,
    writer: &'b W,
    group: usize,
    block: usize,
    tiles: Tiles,
}

impl<W> Chunk<'_, '_, W> {
    /// # Safety
    /// As [`run`].
    #[inline(always)]
    unsafe fn run<D, const NV: usize>(&self)
    where
        D: Dot<Acc = <<D as Dot>::S as Simd>::I>,
        W: Write<D::S, <D::S as Simd>::I>,
    {
        // SAFETY: the caller's contract; MR is MAX_MR.
        unsafe {
            match D::MAX_MR {
                8 => self.multiply::<D, 8, NV>(),
                6 => self.multiply::<D, 6, NV>(),
                _ => self.multiply::<D, 4, NV>(),
            }
            self.transform_outputs::<D, NV>();
        }
    }

    /// Products of the chunk: `[tile / MR][point][tile % MR][vector][lane]`, with a free line behind every point.
    ///
    /// # Safety
    /// As [`run`]; MR is `D::MAX_MR`.
    #[inline(always)]
    unsafe fn multiply<D, const MR: usize, const NV: usize>(&self)
    where
        D: Dot<Acc = <<D as Dot>::S as Simd>::I>,
    {
        let job = self.job;
        let (lanes, packed) = (D::S::LANES, job.packed);
        let panel = packed.weights(packed.panel(self.group, self.block, 0));
        let point_bytes = packed.depth() * NV * lanes * 4;
        let lane = (self.group * packed.vectors() + packed.blocks()[self.block].first) * lanes;
        // The next point's weights are called while this one's are multiplied: one line a step with each of the first
        // tiles, where there are as many tiles as a step reads lines, else all with the first.
        let step_lines = (NV * lanes * 4).div_ceil(LINE);
        let spread = self.tiles.count >= step_lines * MR;
        for point in 0..POINTS {
            let weights = &panel[point * point_bytes..(point + 1) * point_bytes];
            let bias = (point == BIAS_POINT).then(|| {
                // SAFETY: lane + NV · lanes <= the padded number of output channels, of which each has a bias.
                unsafe { job.bias.add(lane) }
            });
            let mut first = 0;
            while first < self.tiles.count {
                // SAFETY: first + MR <= plan.tiles, as both are multiples of MR; V and the products hold that many
                // tiles.
                unsafe {
                    if !spread && first == 0 {
                        self.multiply_tile::<D, MR, NV, ALL>(point, first, weights, bias);
                    } else if spread && first / MR < step_lines {
                        self.multiply_tile::<D, MR, NV, 1>(point, first, weights, bias);
                    } else if MR > 4 && self.tiles.count - first <= 4 {
                        self.multiply_tile::<D, 4, NV, 0>(point, first, weights, bias);
                    } else {
                        self.multiply_tile::<D, MR, NV, 0>(point, first, weights, bias);
                    }
                }
                first += MR;
            }
        }
    }

    /// Products of M tiles from tile `first`, a multiple of MR, at one point. Of what lies behind `weights`, the next
    /// point's or the next block's, every step calls AHEAD lines into the caches: of those that a step there reads, the
    /// ones from the number of this tile among those of its size.
    ///
    /// # Safety
    /// As [`run`]; M is at most MR; `weights` are the point's; at `bias` are NV vectors.
    #[inline(always)]
    unsafe fn multiply_tile<D, const M: usize, const NV: usize, const AHEAD: usize>(
        &self,
        point: usize,
        first: usize,
        weights: &[u8],
        bias: Option<*const i32>,
    ) where
        D: Dot<Acc = <<D as Dot>::S as Simd>::I>,
    {
        let job = self.job;
        let lanes = D::S::LANES;
        let shift = &job.shifts[point];
        const { assert!(D::S::LANES <= MOST_LANES) };
        // SAFETY: V and the products hold tiles first..first + M, a vector has at most MOST_LANES lanes, the panel
        // holds depth · NV vectors for the point (caller).
        unsafe {
            let mut acc = [[D::load_acc(shift.start.as_ptr().cast()); NV]; M];
            if let Some(bias) = bias {
                for n in 0..NV {
                    let bias = D::load_acc(bias.add(n * lanes).cast());
                    for row in &mut acc {
                        row[n] = bias;
                    }
                }
            }
            let tile = Tile {
                x: job.v(point, first).cast(),
                x_step: job.plan.row * 2,
                taps: &[0],
                depth: job.packed.depth(),
                weights: weights.as_ptr(),
                segments: &[],
            };
            let ahead = weights.len() + first / D::MAX_MR * LINE;
            let acc = Plain::<D>::products::<M, NV, AHEAD>(acc, &tile, ahead);
            let to = job
                .scratch
                .cast::<i32>()
                .add((first / D::MAX_MR * POINTS + point) * products_point::<D>(NV));
            let bits = D::S::load_i(shift.bits.as_ptr());
            for m in 0..M {
                for n in 0..NV {
                    let product = D::S::shr_i(acc[m][n], bits);
                    D::S::store_i(product, to.add((m * NV + n) * lanes));
                }
            }
        }
    }
}

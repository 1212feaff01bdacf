//! Winograd on vectors.
//!
//! Tiles are taken in chunks that fit the second-level cache: transform the inputs of a chunk (vectors of channels),
//! then for every block of output channels multiply point by point (a tile of MR Winograd tiles × NV vectors, the same
//! core as the direct kernels') and transform the outputs (vectors of output channels) straight into the writer.

mod float;
mod input;
mod int8;
mod kind;
mod output;
mod plan;
mod prepared;

pub(crate) use float::Floats;
pub(crate) use int8::{Integers, Shift, Sums};
pub(crate) use kind::{Kind, Vectors};
pub(crate) use plan::Plan;
pub(crate) use prepared::Prepared;

use super::int8::BIAS_POINT;
use super::{OUT, POINTS};
use crate::direct::{ALL, LINE, Plain, Tile, Write};
use crate::packed::{Blocking, Packed, Segments};
use crate::simd::{Dot, Simd};
use crate::{Layout, Part};
use plan::products_point;

/// A Winograd convolution over concrete tensors.
pub(crate) struct Job<'a, K: Kind> {
    /// 36 taps: the points.
    packed: &'a Packed,
    /// What sums begin with, and what is done to them.
    sums: K::Sums<'a>,
    /// Channels of a group.
    channels: usize,
    input: *const K::Input,
    in_layout: &'a Layout,
    padding: usize,
    /// As many zeros as a group has channels.
    zeros: *const K::Input,
    out_layout: &'a Layout,
    part: &'a Part,
    plan: Plan,
    /// `plan.bytes()`, aligned to a vector.
    scratch: *mut u8,
}

/// Runs a job.
///
/// # Safety
/// The features of `D` are on; the contract of `QConv::run_part` holds for the job's tensors and the writer's; `plan`
/// was made for `K`, `D` and these channels.
#[inline(always)]
pub(crate) unsafe fn run<K, D, W>(job: &Job<K>, writer: &W)
where
    K: Vectors<D>,
    D: Dot,
    W: Write<D::S, D::Acc>,
{
    const { assert!(matches!(D::MAX_MR, 4 | 6 | 8), "`Chunk::run` has these") };
    const { assert!(size_of::<K::Value>() * D::PACK == 4 && size_of::<K::Sum>() == 4) };
    assert_eq!(
        job.packed.blocking(),
        Blocking::of::<D>(),
        "packed for another kernel"
    );
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
                input::transform_inputs::<K, D>(job, group, tiles);
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

impl<K: Kind> Job<'_, K> {
    /// Transformed input of a point and tile of the chunk.
    ///
    /// # Safety
    /// `point < 36`, `tile < plan.tiles`.
    #[inline(always)]
    unsafe fn v(&self, point: usize, tile: usize) -> *mut K::Value {
        // SAFETY: point < 36 and tile < plan.tiles (caller), so that products + point · plan.point + (tile + 1) · row
        // <= plan.bytes() <= scratch.len() (`Prepared::job` asserts it).
        unsafe {
            self.scratch
                .add(self.plan.products + point * self.plan.point + tile * self.plan.row)
                .cast()
        }
    }
}

/// A chunk of tiles and a block of output channels.
struct Chunk<'a, 'b, K: Kind, W> {
    job: &'b Job<'a, K>,
    writer: &'b W,
    group: usize,
    block: usize,
    tiles: Tiles,
}

impl<K: Kind, W> Chunk<'_, '_, K, W> {
    /// # Safety
    /// As [`run`].
    #[inline(always)]
    unsafe fn run<D, const NV: usize>(&self)
    where
        K: Vectors<D>,
        D: Dot,
        W: Write<D::S, D::Acc>,
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
        K: Vectors<D>,
        D: Dot,
    {
        let job = self.job;
        let (lanes, packed) = (D::S::LANES, job.packed);
        let panel = packed.weights(packed.panel(self.group, self.block, 0));
        let point_bytes = packed.depth() * NV * lanes * 4;
        let lane = (self.group * packed.vectors() + packed.blocks()[self.block].first) * lanes;
        // The next point's weights are called while this one's are multiplied, in the order in which they lie: that is
        // what caches expect. One line a step with each of the first tiles, where there are as many tiles as a step
        // reads lines, else all with the first.
        let step_lines = (NV * lanes * 4).div_ceil(LINE);
        let spread = self.tiles.count >= step_lines * MR;
        for point in 0..POINTS {
            let weights = &panel[point * point_bytes..(point + 1) * point_bytes];
            let bias = K::bias(&job.sums).filter(|_| point == BIAS_POINT);
            // SAFETY: lane + NV · lanes <= the padded number of output channels, of which each has a bias.
            let bias = bias.map(|bias| unsafe { bias.add(lane) });
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
    /// point's or the next block's, every step calls the next AHEAD lines into the caches, beginning where the MR tiles
    /// before these have ended.
    ///
    /// # Safety
    /// As [`run`]; M is at most MR; `weights` are the point's; at `bias` are NV vectors.
    #[inline(always)]
    unsafe fn multiply_tile<D, const M: usize, const NV: usize, const AHEAD: usize>(
        &self,
        point: usize,
        first: usize,
        weights: &[u8],
        bias: Option<*const K::Sum>,
    ) where
        K: Vectors<D>,
        D: Dot,
    {
        let job = self.job;
        let lanes = D::S::LANES;
        // SAFETY: V and the products hold tiles first..first + M, the panel holds depth · NV vectors for the point
        // (caller).
        unsafe {
            let mut acc = [[K::start(&job.sums, point); NV]; M];
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
                x_step: job.plan.row,
                taps: &[0],
                depth: job.packed.depth(),
                weights: weights.as_ptr(),
                segments: Segments::default(),
            };
            let called = first / D::MAX_MR * job.packed.depth() * LINE;
            let ahead = weights.len() + called;
            let acc = Plain::<D>::products::<M, NV, AHEAD>(acc, &tile, ahead);
            let to = job
                .scratch
                .cast::<K::Sum>()
                .add((first / D::MAX_MR * POINTS + point) * products_point::<D>(NV));
            let end = K::end(&job.sums, point);
            for m in 0..M {
                for n in 0..NV {
                    K::store_sum(acc[m][n], end, to.add((m * NV + n) * lanes));
                }
            }
        }
    }
}

//! Winograd on vectors.
//!
//! Tiles are taken in chunks that fit the second-level cache: transform the inputs of a chunk (vectors of channels),
//! then for every block of output channels multiply point by point (a tile of MR Winograd tiles × NV vectors, the same
//! core as the direct kernels') and transform the outputs (vectors of output channels) straight into the writer.

use super::{BIAS_POINT, IN, OUT, POINTS};
use crate::direct::{LINE, Place, Plain, Tile, Write};
use crate::packed::Packed;
use crate::simd::{Dot, Simd};
use crate::{Layout, Part};

/// A Winograd convolution over concrete tensors.
pub(crate) struct Job<'a> {
    /// 36 taps: the points.
    pub packed: &'a Packed,
    /// Where the bias point's sums begin; padded, one per lane.
    pub bias: *const i32,
    pub shift: &'a [u32; POINTS],
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

impl Plan {
    /// For groups of `channels` channels, with `D`.
    pub fn new<D: Dot>(channels: usize) -> Self {
        // Whole cache lines, so that stores of vectors do not cross them.
        let row = channels.next_multiple_of(32);
        let per_tile = POINTS * (2 * row + 4 * D::S::LANES * D::MAX_NV);
        let tiles = (CHUNK_BYTES / per_tile / D::MAX_MR * D::MAX_MR).clamp(D::MAX_MR, 40);
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
    const {
        assert!(
            D::MAX_MR == 4 || D::MAX_MR == 8,
            "`Chunk::run` has these tiles"
        )
    };
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
                for i in 0..count {
                    let (ty, tx) = ((start + i) / across, (start + i) % across);
                    transform_input::<D::S>(job, group, i, ty, tx);
                }
                for b in 0..job.packed.blocks().len() {
                    let chunk = Chunk {
                        job,
                        writer,
                        group,
                        block: b,
                        start,
                        count,
                        across,
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

/// `Bᵀ` on six vectors.
///
/// # Safety
/// The features of `S` are on.
#[inline(always)]
unsafe fn b_transform<S: Simd>(d: [S::H; IN]) -> [S::H; IN] {
    // SAFETY: no memory is touched.
    unsafe {
        let a = S::sub_h(d[4], S::shl_h::<2>(d[2]));
        let b = S::sub_h(d[3], S::shl_h::<2>(d[1]));
        let c = S::sub_h(d[4], d[2]);
        let difference = S::sub_h(d[3], d[1]);
        let e = S::add_h(difference, difference);
        let f = S::add_h(S::shl_h::<2>(S::sub_h(d[0], d[2])), c);
        let g = S::sub_h(S::sub_h(d[5], d[3]), S::shl_h::<2>(difference));
        [
            f,
            S::add_h(a, b),
            S::sub_h(a, b),
            S::add_h(c, e),
            S::sub_h(c, e),
            g,
        ]
    }
}

/// Transforms the input of tile (ty, tx) into place `tile` of the chunk.
///
/// # Safety
/// As [`run`]; `tile < plan.tiles`.
#[inline(always)]
unsafe fn transform_input<S: Simd>(job: &Job, group: usize, tile: usize, ty: usize, tx: usize) {
    let layout = job.in_layout;
    let (y, x) = (ty * OUT, tx * OUT);
    let padding = job.padding as isize;
    let first = group * job.channels;
    // SAFETY: pixels at most `padding` outside the input are checked to be readable; `zeros` holds a group's channels.
    unsafe {
        if y + IN <= layout.height() + 2 * job.padding && x + IN <= layout.width() + 2 * job.padding
        {
            let corner = layout.index(y as isize - padding, x as isize - padding) + first;
            let corner = job.input.add(corner);
            let (row, pixel) = (layout.row_stride(), layout.pixel_stride());
            transform_pixels::<S>(job, tile, |y, x| corner.add(y * row + x * pixel));
        } else {
            transform_pixels::<S>(job, tile, |i, j| {
                let (y, x) = ((y + i) as isize - padding, (x + j) as isize - padding);
                if y < layout.height() as isize + padding && x < layout.width() as isize + padding {
                    job.input.add(layout.index(y, x) + first)
                } else {
                    job.zeros
                }
            });
        }
    }
}

/// Transforms 6 × 6 pixels into place `tile` of the chunk; `pixel(y, x)` points to a group's channels.
///
/// # Safety
/// As [`run`]; `tile < plan.tiles`; every pixel has `channels` readable bytes.
#[inline(always)]
unsafe fn transform_pixels<S: Simd>(
    job: &Job,
    tile: usize,
    pixel: impl Fn(usize, usize) -> *const u8,
) {
    let wide = 2 * S::LANES;
    // SAFETY: every vector ends with or before the last channel, and rows of V hold at least `from + wide`.
    unsafe {
        if job.channels < wide {
            transform_vector::<S>(job, tile, 0, |y, x| S::load_u8_h(pixel(y, x), job.channels));
            return;
        }
        let mut first = 0;
        while first < job.channels {
            // The last vector begins early enough to end with the last channel; what it computes twice is the same.
            let from = first.min(job.channels - wide);
            transform_vector::<S>(job, tile, from, |y, x| {
                S::load_u8_h(pixel(y, x).add(from), wide)
            });
            first += wide;
        }
    }
}

/// Transforms channels `from..from + 2 · LANES` of 6 × 6 pixels.
///
/// # Safety
/// As [`run`]; `tile < plan.tiles`; a row of V holds `from + 2 · LANES` channels.
#[inline(always)]
unsafe fn transform_vector<S: Simd>(
    job: &Job,
    tile: usize,
    from: usize,
    load: impl Fn(usize, usize) -> S::H,
) {
    let point = job.plan.point;
    // SAFETY: the caller's contract.
    unsafe {
        let mut half = [[S::zero_h(); IN]; IN];
        for x in 0..IN {
            let mut column = [S::zero_h(); IN];
            for y in 0..IN {
                column[y] = load(y, x);
            }
            let column = b_transform::<S>(column);
            for y in 0..IN {
                half[y][x] = column[y];
            }
        }
        let mut to = job.v(0, tile).add(from);
        for row in half {
            for value in b_transform::<S>(row) {
                S::store_h(value, to);
                to = to.wrapping_add(point);
            }
        }
    }
}

/// A chunk of tiles and a block of output channels.
struct Chunk<'a, 'b, W> {
    job: &'b Job<'a>,
    writer: &'b W,
    group: usize,
    block: usize,
    /// Number of the first tile.
    start: usize,
    count: usize,
    across: usize,
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
        // SAFETY: MAX_MR is 8 or 4.
        unsafe {
            if D::MAX_MR == 8 {
                self.multiply::<D, 8, NV>();
            } else {
                self.multiply::<D, 4, NV>();
            }
            for i in 0..self.count {
                for n in 0..NV {
                    self.transform_output::<D, NV>(i, n);
                }
            }
        }
    }

    /// Products of the chunk: `[tile / MR][point][tile % MR][vector][lane]`, with a free line behind every point.
    ///
    /// # Safety
    /// As [`run`].
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
        for point in 0..POINTS {
            let shift = job.shift[point];
            let start = [(1i32 << shift) >> 1; 16];
            let weights = &panel[point * point_bytes..(point + 1) * point_bytes];
            let mut first = 0;
            while first < self.count {
                // SAFETY: first + MR <= plan.tiles, as both are multiples of MR; V and the products hold that many
                // tiles.
                unsafe {
                    let mut acc = [[D::load_acc(start.as_ptr().cast()); NV]; MR];
                    if point == BIAS_POINT {
                        for n in 0..NV {
                            let bias = D::load_acc(job.bias.add(lane + n * lanes).cast());
                            for row in &mut acc {
                                row[n] = bias;
                            }
                        }
                    }
                    let tile = Tile {
                        x: job.v(point, first).cast(),
                        x_step: job.plan.row * 2,
                        taps: &[0],
                        depth: packed.depth(),
                        weights: weights.as_ptr(),
                        segments: &[],
                    };
                    // The next point's weights, or the next block's, come from memory while these are multiplied.
                    let acc = if first == 0 {
                        Plain::<D>::products::<MR, NV, true>(acc, &tile, point_bytes)
                    } else {
                        Plain::<D>::products::<MR, NV, false>(acc, &tile, 0)
                    };
                    let to = job
                        .scratch
                        .cast::<i32>()
                        .add((first / MR * POINTS + point) * products_point::<D>(NV));
                    for m in 0..MR {
                        for n in 0..NV {
                            let product = D::S::shr_i(acc[m][n], shift);
                            D::S::store_i(product, to.add((m * NV + n) * lanes));
                        }
                    }
                }
                first += MR;
            }
        }
    }

    /// `Aᵀ M A` of tile `i`, vector `n`, to the writer.
    ///
    /// # Safety
    /// As [`run`]; `i < count`.
    #[inline(always)]
    unsafe fn transform_output<D, const NV: usize>(&self, i: usize, n: usize)
    where
        D: Dot,
        W: Write<D::S, <D::S as Simd>::I>,
    {
        let job = self.job;
        let (lanes, packed, mr) = (D::S::LANES, job.packed, D::MAX_MR);
        let vector = packed.blocks()[self.block].first + n;
        let outs = (packed.outs() - vector * lanes).min(lanes);
        let (ty, tx) = (
            (self.start + i) / self.across,
            (self.start + i) % self.across,
        );
        // SAFETY: the products of tile i were written by `multiply`; pixels are clipped to the part and the output.
        unsafe {
            let point = products_point::<D>(NV);
            let from = job
                .scratch
                .cast::<i32>()
                .add(i / mr * POINTS * point + ((i % mr) * NV + n) * lanes);
            let mut half = [[D::S::load_i(from); IN]; OUT];
            for x in 0..IN {
                let mut column = [half[0][0]; IN];
                for y in 0..IN {
                    column[y] = D::S::load_i(from.add((y * IN + x) * point));
                }
                let column = a_transform::<D::S>(column);
                for y in 0..OUT {
                    half[y][x] = column[y];
                }
            }
            for y in 0..OUT {
                let oy = ty * OUT + y;
                if !job.part.rows.contains(&oy) {
                    continue;
                }
                let row = a_transform::<D::S>(half[y]);
                let place = Place {
                    lane: (self.group * packed.vectors() + vector) * lanes,
                    channel: self.group * packed.outs() + vector * lanes,
                    n: outs,
                    y: oy,
                    x: tx * OUT,
                    step: 1,
                };
                let columns = job.out_layout.width() - tx * OUT;
                if columns >= OUT {
                    self.writer.write(row, place);
                } else {
                    for x in 0..columns {
                        let x_of = place.x + x;
                        self.writer.write([row[x]], Place { x: x_of, ..place });
                    }
                }
            }
        }
    }
}

/// `Aᵀ` on six vectors.
///
/// # Safety
/// The features of `S` are on.
#[inline(always)]
unsafe fn a_transform<S: Simd>(m: [S::I; IN]) -> [S::I; OUT] {
    // SAFETY: no memory is touched.
    unsafe {
        let (s, d) = (S::add_i(m[1], m[2]), S::sub_i(m[1], m[2]));
        let (s2, d2) = (S::add_i(m[3], m[4]), S::sub_i(m[3], m[4]));
        [
            S::add_i(S::add_i(m[0], s), s2),
            S::add_i(d, S::add_i(d2, d2)),
            S::add_i(s, S::shl_i::<2>(s2)),
            S::add_i(S::add_i(d, S::shl_i::<3>(d2)), m[5]),
        ]
    }
}

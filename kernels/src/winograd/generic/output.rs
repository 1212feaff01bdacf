//! `Y = Aᵀ M A`: vectors of output channels, straight into the writer.

use super::super::{IN, OUT, POINTS};
use super::{Chunk, Kind, Vectors, products_point};
use crate::direct::{Place, Write};
use crate::simd::{Dot, Simd};

impl<K: Kind, W> Chunk<'_, '_, K, W> {
    /// `Aᵀ M A` of the chunk's tiles to the writer.
    ///
    /// # Safety
    /// As [`run`]; the chunk was multiplied.
    #[inline(always)]
    pub(super) unsafe fn transform_outputs<D, const NV: usize>(&self)
    where
        K: Vectors<D>,
        D: Dot,
        W: Write<D::S, D::Acc>,
    {
        let job = self.job;
        let (lanes, packed) = (D::S::LANES, job.packed);
        let rows = &job.part.rows;
        let width = job.out_layout.width();
        let (vectors, outs) = (packed.vectors(), packed.outs());
        let first = packed.blocks()[self.block].first;
        for (i, (ty, tx)) in self.tiles.places().enumerate() {
            let (y, x) = (ty * OUT, tx * OUT);
            let whole = rows.start <= y && y + OUT <= rows.end && x + OUT <= width;
            for n in 0..NV {
                let vector = first + n;
                let place = Place {
                    lane: (self.group * vectors + vector) * lanes,
                    channel: self.group * outs + vector * lanes,
                    n: (outs - vector * lanes).min(lanes),
                    y,
                    x,
                    step: 1,
                };
                // SAFETY: i < count <= plan.tiles and n < NV: `multiply` wrote these products. `put` clips rows to the
                // part and columns to the width.
                unsafe { self.transform_output::<D, NV>(i, n, place, whole) };
            }
        }
    }

    /// `Aᵀ M A` of tile `i`, vector `n`, row by row to the writer. Rows are summed up as they come: that takes 16
    /// vectors, keeping all of `M A` would take 24.
    ///
    /// # Safety
    /// As [`run`]; the tile was multiplied, and `n < NV`; `place` is its first pixel's, and where it is `whole` all its
    /// pixels lie in the part and the output.
    #[inline(always)]
    unsafe fn transform_output<D, const NV: usize>(
        &self,
        i: usize,
        n: usize,
        place: Place,
        whole: bool,
    ) where
        K: Vectors<D>,
        D: Dot,
        W: Write<D::S, D::Acc>,
    {
        let point = products_point::<D>(NV);
        let (tiles, tile) = (i / D::MAX_MR, i % D::MAX_MR);
        // SAFETY: i < plan.tiles and n < NV (caller), so that the tile's 36 points lie within plan.products
        // (`Plan::new`).
        unsafe {
            let from = self.job.scratch.cast::<K::Sum>();
            let from = from.add(tiles * POINTS * point + (tile * NV + n) * D::S::LANES);
            let (s, d) = sum_and_difference::<K, D>(
                product_row::<K, D>(from, point, 1),
                product_row::<K, D>(from, point, 2),
            );
            let (s2, d2) = sum_and_difference::<K, D>(
                product_row::<K, D>(from, point, 3),
                product_row::<K, D>(from, point, 4),
            );
            let mut row = product_row::<K, D>(from, point, 0);
            for x in 0..OUT {
                row[x] = K::a0(row[x], s[x], s2[x]);
            }
            self.put::<D>(row, place, 0, whole);
            for x in 0..OUT {
                row[x] = K::a1(d[x], d2[x]);
            }
            self.put::<D>(row, place, 1, whole);
            for x in 0..OUT {
                row[x] = K::a2(s[x], s2[x]);
            }
            self.put::<D>(row, place, 2, whole);
            let mut row = product_row::<K, D>(from, point, 5);
            for x in 0..OUT {
                row[x] = K::a3(d[x], d2[x], row[x]);
            }
            self.put::<D>(row, place, 3, whole);
        }
    }

    /// Hands row `y` of a tile to the writer.
    ///
    /// # Safety
    /// As [`transform_output`](Self::transform_output).
    #[inline(always)]
    unsafe fn put<D>(&self, row: [D::Acc; OUT], place: Place, y: usize, whole: bool)
    where
        K: Vectors<D>,
        D: Dot,
        W: Write<D::S, D::Acc>,
    {
        let place = Place {
            y: place.y + y,
            ..place
        };
        // SAFETY: place.y is a row of the part, and x + 3 < width where the tile is whole (caller), else x is clipped
        // to the width; the writer's lanes and channels are `transform_outputs`': vector < vectors.
        unsafe {
            if whole {
                self.writer.write(row, place);
            } else if self.job.part.rows.contains(&place.y) {
                let columns = OUT.min(self.job.out_layout.width() - place.x);
                for x in 0..columns {
                    let x_of = place.x + x;
                    self.writer.write([row[x]], Place { x: x_of, ..place });
                }
            }
        }
    }
}

/// Row `y` of a tile's products, times `A`.
///
/// # Safety
/// The features of `D` are on; 36 points lie at `from`, `point` numbers apart; `y < 6`.
#[inline(always)]
unsafe fn product_row<K: Vectors<D>, D: Dot>(
    from: *const K::Sum,
    point: usize,
    y: usize,
) -> [D::Acc; OUT] {
    // SAFETY: the caller's contract.
    unsafe {
        let mut m = [D::load_acc(from.add(y * IN * point).cast()); IN];
        for x in 1..IN {
            m[x] = D::load_acc(from.add((y * IN + x) * point).cast());
        }
        let (s, d) = (K::add(m[1], m[2]), K::sub(m[1], m[2]));
        let (s2, d2) = (K::add(m[3], m[4]), K::sub(m[3], m[4]));
        [
            K::a0(m[0], s, s2),
            K::a1(d, d2),
            K::a2(s, s2),
            K::a3(d, d2, m[5]),
        ]
    }
}

/// Sums and differences by element.
///
/// # Safety
/// The features of `D` are on.
#[inline(always)]
unsafe fn sum_and_difference<K: Vectors<D>, D: Dot>(
    a: [D::Acc; OUT],
    b: [D::Acc; OUT],
) -> ([D::Acc; OUT], [D::Acc; OUT]) {
    let (mut sum, mut difference) = (a, a);
    for x in 0..OUT {
        // SAFETY: the features of `D` are on (caller); no memory is touched.
        unsafe {
            sum[x] = K::add(a[x], b[x]);
            difference[x] = K::sub(a[x], b[x]);
        }
    }
    (sum, difference)
}

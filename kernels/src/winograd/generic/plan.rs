//! How scratch memory is divided.

use super::super::POINTS;
use super::Kind;
use crate::direct::LINE;
use crate::simd::{Dot, Simd};

/// How scratch memory is divided.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plan {
    /// Winograd tiles per chunk, a multiple of MR.
    pub(super) tiles: usize,
    /// Bytes from a tile's transformed input to the next tile's.
    pub(super) row: usize,
    /// Bytes from a point's first tile to the next point's.
    pub(super) point: usize,
    /// Bytes of the products of one chunk.
    pub(super) products: usize,
}

/// Sums from a point's products of MR tiles and `nv` vectors to the next point's. A line is left free behind every
/// point, or all points of a tile would fall into a few sets of the cache.
#[inline(always)]
pub(super) const fn products_point<D: Dot>(nv: usize) -> usize {
    D::MAX_MR * nv * D::S::LANES + LINE / 4
}

/// Bytes that transformed inputs and products of a chunk may take: a part of a common second-level cache.
const CHUNK_BYTES: usize = 320 << 10;

/// Most tiles of a chunk, up to a multiple of MR.
const MOST_TILES: usize = 40;

/// Bytes of a group's weights from which on chunks take [`LARGE_CHUNK_BYTES`]. They hardly fit a second-level cache and
/// come from further away for every chunk anew, which takes longer than to read a chunk's inputs from there.
const MANY_WEIGHTS: usize = 72 << 14;

/// Enough for [`MOST_TILES`] of 512 channels of i16.
const LARGE_CHUNK_BYTES: usize = 2 << 20;

impl Plan {
    /// For groups of `channels` channels and `outs` outputs, with `D`.
    pub fn new<K: Kind, D: Dot>(channels: usize, outs: usize) -> Self {
        let size = size_of::<K::Value>();
        // Whole cache lines, so that stores of vectors do not cross them.
        let row = (channels * size).next_multiple_of(LINE);
        let per_tile = POINTS * (row + 4 * D::S::LANES * D::MAX_NV);
        let most = MOST_TILES.next_multiple_of(D::MAX_MR);
        let bytes = if channels * outs < MANY_WEIGHTS / (POINTS * size) {
            CHUNK_BYTES
        } else {
            LARGE_CHUNK_BYTES
        };
        let tiles = bytes / per_tile + D::MAX_MR / 2;
        let tiles = (tiles / D::MAX_MR * D::MAX_MR).clamp(D::MAX_MR, most);
        Self {
            tiles,
            row,
            point: tiles * row + LINE,
            products: tiles / D::MAX_MR * POINTS * products_point::<D>(D::MAX_NV) * 4,
        }
    }

    /// Scratch bytes needed.
    pub fn bytes(&self) -> usize {
        self.products + POINTS * self.point
    }
}

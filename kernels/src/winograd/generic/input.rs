//! `V = Bᵀ d B`: vectors of channels.

use super::super::{IN, OUT};
use super::{Job, Tiles, Vectors};
use crate::direct::LINE;
use crate::simd::Dot;

/// Transforms the inputs of a chunk.
///
/// # Safety
/// As [`run`]; there are at most `plan.tiles` tiles.
#[inline(always)]
pub(super) unsafe fn transform_inputs<K: Vectors<D>, D: Dot>(
    job: &Job<K>,
    group: usize,
    tiles: Tiles,
) {
    let layout = job.in_layout;
    let (height, width) = (layout.height() as isize, layout.width() as isize);
    let padding = job.padding as isize;
    let first = group * job.channels;
    for (i, (ty, tx)) in tiles.places().enumerate() {
        let (y, x) = ((ty * OUT) as isize - padding, (tx * OUT) as isize - padding);
        // SAFETY: -padding <= y and y + 5 < height + padding, x likewise, or what is further out is `zeros`, which
        // holds a group's channels; padding <= halo (`check`), and first + channels <= those of a pixel, as group <
        // groups.
        unsafe {
            if y + IN as isize <= height + padding && x + IN as isize <= width + padding {
                let corner = job.input.add(layout.index(y, x) + first);
                let (row, pixel) = (layout.row_stride(), layout.pixel_stride());
                transform_pixels::<K, D>(job, i, |y, x| corner.add(y * row + x * pixel));
            } else {
                transform_pixels::<K, D>(job, i, |i, j| {
                    let (y, x) = (y + i as isize, x + j as isize);
                    if y < height + padding && x < width + padding {
                        job.input.add(layout.index(y, x) + first)
                    } else {
                        job.zeros
                    }
                });
            }
        }
    }
}

/// Transforms 6 × 6 pixels into place `tile` of the chunk; `pixel(y, x)` points to a group's channels.
///
/// # Safety
/// As [`run`]; `tile < plan.tiles`; every pixel has `channels` readable numbers.
#[inline(always)]
unsafe fn transform_pixels<K: Vectors<D>, D: Dot>(
    job: &Job<K>,
    tile: usize,
    pixel: impl Fn(usize, usize) -> *const K::Input,
) {
    let wide = K::WIDTH;
    let mut first = 0;
    const { assert!(LINE.is_multiple_of(K::WIDTH * size_of::<K::Value>())) };
    // SAFETY: first + n <= channels for the n that are loaded (`wide`, or `rest`). A row of V is a multiple of LINE of
    // at least channels · size bytes, and WIDTH · size divides LINE (asserted): with first < channels, a multiple of
    // WIDTH, first + WIDTH values lie in it.
    unsafe {
        while first + wide <= job.channels {
            transform_vector::<K, D>(job, tile, first, |y, x| {
                K::load(pixel(y, x).add(first), wide)
            });
            first += wide;
        }
        let rest = job.channels - first;
        if rest > 0 {
            transform_vector::<K, D>(job, tile, first, |y, x| {
                K::load(pixel(y, x).add(first), rest)
            });
        }
    }
}

/// Transforms channels `from..from + WIDTH` of 6 × 6 pixels.
///
/// # Safety
/// As [`run`]; `tile < plan.tiles`; a row of V holds `from + WIDTH` channels.
#[inline(always)]
unsafe fn transform_vector<K: Vectors<D>, D: Dot>(
    job: &Job<K>,
    tile: usize,
    from: usize,
    load: impl Fn(usize, usize) -> K::V,
) {
    let point = job.plan.point;
    // SAFETY: the caller's contract.
    unsafe {
        let mut half = [[K::zero(); IN]; IN];
        for x in 0..IN {
            let mut column = [K::zero(); IN];
            for y in 0..IN {
                column[y] = load(y, x);
            }
            let column = K::b_transform(column);
            for y in 0..IN {
                half[y][x] = column[y];
            }
        }
        let mut to = job.v(0, tile).add(from);
        for row in half {
            for value in K::b_transform(row) {
                K::store(value, to);
                to = to.wrapping_byte_add(point);
            }
        }
    }
}

//! `V = Bᵀ d B`: vectors of channels.

use super::super::{IN, OUT};
use super::{Job, Tiles};
use crate::simd::Simd;

/// Transforms the inputs of a chunk.
///
/// # Safety
/// As [`run`]; there are at most `plan.tiles` tiles.
#[inline(always)]
pub(super) unsafe fn transform_inputs<S: Simd>(job: &Job, group: usize, tiles: Tiles) {
    let layout = job.in_layout;
    let (height, width) = (layout.height() as isize, layout.width() as isize);
    let padding = job.padding as isize;
    let first = group * job.channels;
    for (i, (ty, tx)) in tiles.places().enumerate() {
        let (y, x) = ((ty * OUT) as isize - padding, (tx * OUT) as isize - padding);
        // SAFETY: pixels at most `padding` outside the input are checked to be readable, and a group's channels lie
        // within each; `zeros` holds a group's channels.
        unsafe {
            if y + IN as isize <= height + padding && x + IN as isize <= width + padding {
                let corner = job.input.add(layout.index(y, x) + first);
                let (row, pixel) = (layout.row_stride(), layout.pixel_stride());
                transform_pixels::<S>(job, i, |y, x| corner.add(y * row + x * pixel));
            } else {
                transform_pixels::<S>(job, i, |i, j| {
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
/// As [`run`]; `tile < plan.tiles`; every pixel has `channels` readable bytes.
#[inline(always)]
unsafe fn transform_pixels<S: Simd>(
    job: &Job,
    tile: usize,
    pixel: impl Fn(usize, usize) -> *const u8,
) {
    let wide = 2 * S::LANES;
    let mut first = 0;
    // SAFETY: vectors end with or before the last channel. Rows of V are whole cache lines of at least `channels`
    // numbers, which hold a whole vector wherever one begins.
    unsafe {
        while first + wide <= job.channels {
            transform_vector::<S>(job, tile, first, |y, x| {
                S::load_u8_h(pixel(y, x).add(first), wide)
            });
            first += wide;
        }
        let rest = job.channels - first;
        if rest > 0 {
            transform_vector::<S>(job, tile, first, |y, x| {
                S::load_u8_h(pixel(y, x).add(first), rest)
            });
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

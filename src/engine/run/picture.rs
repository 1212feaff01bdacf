//! The picture's way into its buffer: RGB bytes as they are for int8, x / 255 - 0.5 for f32.

use super::step::{Memory, Tensor};

/// The bytes of every pixel of a row and one more; after the last pixel, 0.
fn fours(row: &[u8]) -> impl Iterator<Item = [u8; 4]> + '_ {
    let last = row.last_chunk::<3>().map(|&[r, g, b]| [r, g, b, 0]);
    let all = row.windows(4).step_by(3).map(|w| [w[0], w[1], w[2], w[3]]);
    all.chain(last)
}

/// Writes `rgb`, row-major `[height, width, 3]`, into the input tensor of an engine.
///
/// # Safety
/// `to` is a tensor of `height` × `width` pixels, of at least 3 channels, within the memory's arena, and nobody else touches it
/// meanwhile.
pub(super) unsafe fn store(rgb: &[u8], to: &Tensor, memory: &Memory) {
    let l = &to.layout;
    for (y, row) in rgb.chunks_exact(3 * l.width).take(l.height).enumerate() {
        let first = to.base + l.origin + y * l.row_stride;
        let len = (l.width - 1) * l.pixel_stride + l.channels;
        match memory {
            Memory::Int8(arena) => {
                // SAFETY: row y < height of the tensor: its pixels' elements lie within the arena (caller).
                let to = unsafe { std::slice::from_raw_parts_mut(arena.as_ptr().add(first), len) };
                if l.pixel_stride == 3 {
                    to.copy_from_slice(row);
                } else if l.pixel_stride == 4 {
                    // Four bytes at a time: the fourth is the next pixel's red, which weight 0 meets.
                    for (to, from) in to.as_chunks_mut::<4>().0.iter_mut().zip(fours(row)) {
                        *to = from;
                    }
                } else {
                    for (to, from) in to.chunks_mut(l.pixel_stride).zip(row.as_chunks::<3>().0) {
                        to[..3].copy_from_slice(from);
                    }
                }
            }
            Memory::Float(arena) => {
                // SAFETY: as above.
                let to = unsafe { std::slice::from_raw_parts_mut(arena.as_ptr().add(first), len) };
                for (to, from) in to.chunks_mut(l.pixel_stride).zip(row.as_chunks::<3>().0) {
                    for (to, &x) in to.iter_mut().zip(from) {
                        *to = f32::from(x) / 255.0 - 0.5;
                    }
                }
            }
        }
    }
}

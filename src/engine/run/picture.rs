//! The picture's way into its buffer: RGB bytes as they are for int8, x / 255 - 0.5 for f32.

use super::step::{Memory, Tensor};

/// A row of pixels of 3 bytes to pixels of 4. Four bytes at a time: the fourth is the next pixel's red, which weight 0
/// meets.
fn store_fours(row: &[u8], to: &mut [u8]) {
    let pixels = to.as_chunks_mut::<4>().0;
    let Some((last, all)) = pixels.split_last_mut() else {
        return;
    };
    for (to, i) in all.iter_mut().zip((0..).step_by(3)) {
        to.copy_from_slice(&row[i..i + 4]);
    }
    let end = 3 * all.len();
    last[..3].copy_from_slice(&row[end..end + 3]);
}

/// Writes `rgb`, row-major `[height, width, 3]`, into the input tensor of an engine.
///
/// # Safety
/// `to` is a tensor of `height` × `width` pixels, of at least 3 channels, within the memory's arena, and nobody else
/// touches it meanwhile.
pub(super) unsafe fn store(rgb: &[u8], to: &Tensor, memory: &Memory) {
    let l = &to.layout;
    for (y, row) in rgb.chunks_exact(3 * l.width()).take(l.height()).enumerate() {
        let first = to.base + l.origin() + y * l.row_stride();
        let len = (l.width() - 1) * l.pixel_stride() + l.channels();
        match memory {
            Memory::Int8(arena) => {
                // SAFETY: row y < height of the tensor: its pixels' elements lie within the arena (caller).
                let to = unsafe { std::slice::from_raw_parts_mut(arena.as_ptr().add(first), len) };
                if l.pixel_stride() == 3 {
                    to.copy_from_slice(row);
                } else if l.pixel_stride() == 4 && l.channels() == 4 {
                    store_fours(row, to);
                } else {
                    for (to, from) in to.chunks_mut(l.pixel_stride()).zip(row.as_chunks::<3>().0) {
                        to[..3].copy_from_slice(from);
                    }
                }
            }
            Memory::Float(arena) => {
                // SAFETY: as above.
                let to = unsafe { std::slice::from_raw_parts_mut(arena.as_ptr().add(first), len) };
                for (to, from) in to.chunks_mut(l.pixel_stride()).zip(row.as_chunks::<3>().0) {
                    for (to, &x) in to.iter_mut().zip(from) {
                        *to = f32::from(x) / 255.0 - 0.5;
                    }
                }
            }
        }
    }
}

//! One piece of memory that holds every buffer of a network, for all frames.

use std::cell::UnsafeCell;
use std::marker::PhantomData;

/// A cache line.
#[repr(C, align(64))]
struct Line(UnsafeCell<[u8; 64]>);

/// `len` elements of `T`, zeroed, aligned to a cache line, shared between threads that promise to keep out of each
/// other's way.
pub(super) struct Arena<T> {
    lines: Box<[Line]>,
    len: usize,
    elements: PhantomData<T>,
}

/// Element types for which all-zero bytes are a value.
///
/// # Safety
/// All-zero bytes are a value of the type, and its alignment is at most a cache line's.
pub(super) unsafe trait Plain: Copy + Send + Sync + 'static {}
// SAFETY: zero bytes are 0, of alignment 1.
unsafe impl Plain for u8 {}
// SAFETY: zero bytes are 0.0, of alignment 4.
unsafe impl Plain for f32 {}

// SAFETY: lines are `UnsafeCell`s, touched through raw pointers only, or by who has the arena alone; no two threads
// share an element that one of them writes (`Plan::prove`, `Part`; `Team::run`'s caller).
unsafe impl<T: Plain> Sync for Arena<T> {}

impl<T: Plain> Arena<T> {
    /// Zeroed memory.
    ///
    /// # Panics
    /// Where so many elements are more than an address space has.
    pub fn new(len: usize) -> Self {
        let bytes = len.checked_mul(size_of::<T>()).unwrap_or_else(|| {
            panic!("expected an arena that fits the address space, found {len} elements")
        });
        let lines = bytes.div_ceil(64);
        Self {
            lines: (0..lines).map(|_| Line(UnsafeCell::new([0; 64]))).collect(),
            len,
            elements: PhantomData,
        }
    }

    /// Elements.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The first element.
    pub fn as_ptr(&self) -> *mut T {
        // Interior mutability of the whole slice: a pointer from the slice, not from its first element.
        self.lines.as_ptr().cast::<T>().cast_mut()
    }

    /// All elements.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        // SAFETY: `&mut self` excludes every other user; the lines hold at least `len` elements, and all-zero bytes are
        // a `T`.
        unsafe { std::slice::from_raw_parts_mut(self.as_ptr(), self.len) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "fits the address space")]
    fn an_arena_of_more_bytes_than_can_be_counted_is_refused() {
        Arena::<f32>::new(usize::MAX);
    }
}

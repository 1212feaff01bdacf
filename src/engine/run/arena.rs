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
pub(super) trait Plain: Copy + Send + Sync + 'static {}
impl Plain for u8 {}
impl Plain for f32 {}

// SAFETY: an arena is plain memory; all access goes through raw pointers whose users keep to the plan's proof (see
// `Step::run`).
unsafe impl<T: Plain> Sync for Arena<T> {}

impl<T: Plain> Arena<T> {
    /// Zeroed memory.
    pub fn new(len: usize) -> Self {
        let lines = (len * size_of::<T>()).div_ceil(64);
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

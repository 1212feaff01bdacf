//! Memory for weights, in large pages where the system has them.
//!
//! A network reads some 30 MB of weights once a frame. In pages of 4 KiB these are 7,000 addresses, more than a CPU
//! keeps, and looking them up takes time. Weights of one layer are too few for pages of 2 MiB, so that layers share
//! them.

use std::alloc::{Layout, handle_alloc_error};
use std::ptr::NonNull;
use std::sync::{Arc, Mutex, Weak};

/// Bytes of a large page.
const PAGE: usize = 2 << 20;
/// Least bytes of a slab.
const SLAB: usize = 4 * PAGE;
/// What pieces begin at a multiple of: a cache line.
const ALIGN: usize = 64;

/// Zeroed bytes of its own, aligned to a cache line, beside others of its kind.
pub(crate) struct Piece {
    slab: Arc<Slab>,
    first: usize,
    len: usize,
}

/// The slab that the next piece may lie in, and how much of it is taken.
static LATEST: Mutex<(Weak<Slab>, usize)> = Mutex::new((Weak::new(), 0));

impl Piece {
    pub fn new(len: usize) -> Self {
        // Who panicked left both as they were.
        let mut latest = LATEST.lock().unwrap_or_else(|e| e.into_inner());
        let slab = latest.0.upgrade().filter(|s| s.len - latest.1 >= len);
        let slab = slab.unwrap_or_else(|| {
            let slab = Arc::new(Slab::new(len.max(SLAB)));
            *latest = (Arc::downgrade(&slab), 0);
            slab
        });
        let first = latest.1;
        // A slab's length is a multiple of ALIGN, so that this stays within it.
        latest.1 = (first + len).next_multiple_of(ALIGN);
        Self { slab, first, len }
    }

    pub fn as_bytes(&self) -> &[u8] {
        // SAFETY: first + len <= slab.len, all of it initialised with zeros; bytes are handed out once in a slab's life
        // (`new`, under the lock), so that only this piece's `&mut` writes there.
        unsafe { std::slice::from_raw_parts(self.start(), self.len) }
    }

    pub fn as_mut_bytes(&mut self) -> &mut [u8] {
        // SAFETY: as in `as_bytes`; `&mut self` keeps every other user out.
        unsafe { std::slice::from_raw_parts_mut(self.start(), self.len) }
    }

    fn start(&self) -> *mut u8 {
        // SAFETY: first <= slab.len (`new`).
        unsafe { self.slab.start.as_ptr().add(self.first) }
    }
}

impl Clone for Piece {
    fn clone(&self) -> Self {
        let mut other = Self::new(self.len);
        other.as_mut_bytes().copy_from_slice(self.as_bytes());
        other
    }
}

impl std::fmt::Debug for Piece {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} bytes", self.len)
    }
}

/// Zeroed memory that begins at a large page.
struct Slab {
    start: NonNull<u8>,
    /// A multiple of [`PAGE`].
    len: usize,
}

// SAFETY: plain memory. Pieces' ranges are disjoint (`Piece::new`, under the lock), and only a piece's `&mut` writes to
// its range.
unsafe impl Send for Slab {}
// SAFETY: as above.
unsafe impl Sync for Slab {}

impl Slab {
    /// Room for `bytes`.
    fn new(bytes: usize) -> Self {
        let len = bytes.checked_next_multiple_of(PAGE);
        let layout = len.and_then(|len| Layout::from_size_align(len, PAGE).ok());
        let Some(layout) = layout else {
            panic!("expected less than {} bytes, found {bytes}", isize::MAX);
        };
        let len = layout.size();
        let Some(start) = mapped(len) else {
            handle_alloc_error(layout)
        };
        Self { start, len }
    }
}

impl Drop for Slab {
    fn drop(&mut self) {
        unmap(self.start, self.len);
    }
}

/// `len` zeroed bytes at a multiple of [`PAGE`]; `len` is one, too.
#[cfg(all(target_os = "linux", not(miri)))]
fn mapped(len: usize) -> Option<NonNull<u8>> {
    let whole = len.checked_add(PAGE)?;
    let (read, private) = (
        libc::PROT_READ | libc::PROT_WRITE,
        libc::MAP_PRIVATE | libc::MAP_ANONYMOUS,
    );
    // SAFETY: new memory at a place of the system's choice, which nobody has.
    let map = unsafe { libc::mmap(std::ptr::null_mut(), whole, read, private, -1, 0) };
    if map == libc::MAP_FAILED {
        return None;
    }
    let before = map.cast::<u8>().align_offset(PAGE);
    // SAFETY: before < PAGE (`align_offset`), so that before + len < whole; what lies in the map before and behind
    // those `len` bytes is whole small pages and nobody's. The advice changes no contents.
    unsafe {
        let start = map.cast::<u8>().add(before);
        if before > 0 {
            libc::munmap(map, before);
        }
        libc::munmap(start.add(len).cast(), PAGE - before);
        // A system without large pages refuses; small ones do as well, only slower.
        libc::madvise(start.cast(), len, libc::MADV_HUGEPAGE);
        NonNull::new(start)
    }
}

#[cfg(all(target_os = "linux", not(miri)))]
fn unmap(start: NonNull<u8>, len: usize) {
    // SAFETY: `len` bytes that `mapped` gave from `start`; their only owner is being dropped.
    unsafe { libc::munmap(start.as_ptr().cast(), len) };
}

#[cfg(not(all(target_os = "linux", not(miri))))]
fn mapped(len: usize) -> Option<NonNull<u8>> {
    let layout = Layout::from_size_align(len, PAGE).ok()?;
    // SAFETY: a slab has at least a page.
    NonNull::new(unsafe { std::alloc::alloc_zeroed(layout) })
}

#[cfg(not(all(target_os = "linux", not(miri))))]
fn unmap(start: NonNull<u8>, len: usize) {
    if let Ok(layout) = Layout::from_size_align(len, PAGE) {
        // SAFETY: `mapped` gave `start` for this layout; its only owner is being dropped.
        unsafe { std::alloc::dealloc(start.as_ptr(), layout) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_zeroed_aligned_and_each_ones_own() {
        let taken: Vec<Piece> = std::thread::scope(|scope| {
            let take = |seed: usize| {
                (0..10).map(move |i| {
                    let mut piece = Piece::new((seed * 1237 + i * 311) % 700);
                    assert!(piece.as_bytes().iter().all(|b| *b == 0));
                    piece.as_mut_bytes().fill((seed * 10 + i) as u8);
                    piece
                })
            };
            let threads: Vec<_> = (0..4)
                .map(|seed| scope.spawn(move || take(seed).collect::<Vec<_>>()))
                .collect();
            threads
                .into_iter()
                .flat_map(|t| t.join().unwrap())
                .collect()
        });
        for (i, piece) in taken.iter().enumerate() {
            assert!(piece.as_bytes().as_ptr().addr().is_multiple_of(ALIGN));
            assert!(piece.as_bytes().iter().all(|b| *b == i as u8), "{i}");
            assert_eq!(piece.clone().as_bytes(), piece.as_bytes());
        }
    }

    #[test]
    #[should_panic(expected = "expected less than")]
    fn a_piece_of_more_bytes_than_there_are_addresses_is_refused() {
        Piece::new(usize::MAX);
    }

    #[test]
    fn a_slab_begins_at_a_large_page_and_ends_with_its_last_piece() {
        let larger_than_any_rest = Piece::new(SLAB + 1);
        let slab = Arc::downgrade(&larger_than_any_rest.slab);
        assert_eq!(slab.upgrade().unwrap().len, 5 * PAGE);
        assert!(larger_than_any_rest.start().addr().is_multiple_of(PAGE));
        let copy = larger_than_any_rest.clone();
        drop(larger_than_any_rest);
        drop(copy);
        // Another test may have put a piece into what was left of it.
        for _ in 0..1000 {
            if slab.upgrade().is_none() {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        panic!("it is still there");
    }
}

//! Buffers that end where the readable memory does: one element too far is a fault.

use std::ops::{Deref, DerefMut};

/// A copy of a slice whose last element is the last of a page; behind it, and before its first page, nothing can be
/// touched.
///
/// Under Miri, which watches every access itself, and on other systems than Linux a plain vector.
pub struct Guarded<T: Copy + 'static> {
    #[cfg(all(target_os = "linux", not(miri)))]
    data: &'static mut [T],
    #[cfg(all(target_os = "linux", not(miri)))]
    mapping: (*mut libc::c_void, usize),
    #[cfg(not(all(target_os = "linux", not(miri))))]
    data: Vec<T>,
}

#[cfg(all(target_os = "linux", not(miri)))]
impl<T: Copy> Guarded<T> {
    pub fn new(values: &[T]) -> Self {
        assert!(!values.is_empty() && 4096 % align_of::<T>() == 0);
        // SAFETY: asks for a constant.
        let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) } as usize;
        let bytes = size_of_val(values);
        let inner = bytes.next_multiple_of(page);
        let whole = inner + 2 * page;
        // SAFETY: a new anonymous mapping; its pages but the first and the last are made readable and writable. `bytes`
        // before their end is aligned as T is, since pages are and `bytes` is a multiple of T's size.
        let (start, data) = unsafe {
            let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
            let start = libc::mmap(std::ptr::null_mut(), whole, libc::PROT_NONE, flags, -1, 0);
            assert_ne!(start, libc::MAP_FAILED, "memory for a test");
            let status = libc::mprotect(
                start.byte_add(page),
                inner,
                libc::PROT_READ | libc::PROT_WRITE,
            );
            assert_eq!(status, 0, "memory for a test");
            let first: *mut T = start.byte_add(page + inner - bytes).cast();
            first.copy_from_nonoverlapping(values.as_ptr(), values.len());
            (start, std::slice::from_raw_parts_mut(first, values.len()))
        };
        Self {
            data,
            mapping: (start, whole),
        }
    }
}

#[cfg(all(target_os = "linux", not(miri)))]
impl<T: Copy> Drop for Guarded<T> {
    fn drop(&mut self) {
        // SAFETY: the mapping made above, which nobody borrows any more.
        unsafe { libc::munmap(self.mapping.0, self.mapping.1) };
    }
}

#[cfg(not(all(target_os = "linux", not(miri))))]
impl<T: Copy> Guarded<T> {
    pub fn new(values: &[T]) -> Self {
        Self {
            data: values.to_vec(),
        }
    }
}

impl<T: Copy> Deref for Guarded<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.data[..]
    }
}

impl<T: Copy> DerefMut for Guarded<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.data[..]
    }
}

#[cfg(all(target_os = "linux", not(miri)))]
#[test]
fn the_page_behind_the_last_element_is_not_there() {
    let guarded = Guarded::new(&[7u8; 5000]);
    let end = guarded.as_ptr_range().end;
    assert_eq!(end as usize % 4096, 0);
    // The kernel reads the byte for us and says that it cannot. SAFETY: a pipe's write end would take bytes from `end`,
    // which the system call checks itself; both ends are closed.
    unsafe {
        let mut ends = [0; 2];
        assert_eq!(libc::pipe(ends.as_mut_ptr()), 0);
        assert_eq!(libc::write(ends[1], end.sub(1).cast(), 1), 1);
        assert_eq!(libc::write(ends[1], end.cast(), 1), -1);
        for end in ends {
            libc::close(end);
        }
    }
}

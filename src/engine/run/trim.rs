//! Memory of engines that are gone goes back to the system.

/// Gives back what the allocator keeps of freed memory, so that the process is as large as what lives in it. Does
/// nothing where the C library has no such call.
pub fn trim_memory() {
    #[cfg(target_env = "gnu")]
    // SAFETY: takes no pointers and touches free memory alone; glibc locks each arena meanwhile.
    unsafe {
        libc::malloc_trim(0);
    }
}

//! Binding threads to cores.

/// Binds the calling thread to the `index`-th core the process may use, if there is one; otherwise leaves it free.
pub(super) fn to_core(index: usize) {
    // SAFETY: `cpu_set_t` is plain memory that all-zero bytes make an empty set; both calls get its true size and a pointer
    // that is valid for it; thread 0 is the calling one. CPU_ISSET and CPU_SET get indices below CPU_SETSIZE.
    unsafe {
        let mut allowed: libc::cpu_set_t = std::mem::zeroed();
        let size = size_of::<libc::cpu_set_t>();
        if libc::sched_getaffinity(0, size, &mut allowed) != 0 {
            return;
        }
        let cores = 0..libc::CPU_SETSIZE as usize;
        let Some(core) = cores.filter(|&c| libc::CPU_ISSET(c, &allowed)).nth(index) else {
            return;
        };
        let mut one: libc::cpu_set_t = std::mem::zeroed();
        libc::CPU_SET(core, &mut one);
        libc::sched_setaffinity(0, size, &one);
    }
}

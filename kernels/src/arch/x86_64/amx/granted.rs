//! Whether this process may use tiles. Having them is not enough: the system must save them, and Linux wants to be
//! asked once per process, because every thread that uses them costs it 8 KiB more.

use std::arch::is_x86_feature_detected as has;
use std::arch::x86_64::{__cpuid_count, _xgetbv};
use std::sync::OnceLock;

/// Whether the CPU has tiles and their int8 products, and the system has granted them to this process. Asks once.
pub(crate) fn is_granted() -> bool {
    static GRANTED: OnceLock<bool> = OnceLock::new();
    // Miri runs no assembly.
    *GRANTED.get_or_init(|| !cfg!(miri) && cpu_has_tiles() && system_saves_tiles() && ask())
}

/// `edx` of leaf 7: AMX-TILE and AMX-INT8.
const TILE_AND_INT8: u32 = 1 << 24 | 1 << 25;

/// Whether the CPU has them, in palette 1 with 8 registers of 16 rows × 64 bytes as all have so far.
fn cpu_has_tiles() -> bool {
    // `cpuid` is safe on newer compilers.
    #[allow(unused_unsafe)]
    // SAFETY: every x86-64 CPU has the instruction; leaves that it lacks are not asked for.
    let leaf = |leaf, part| unsafe { __cpuid_count(leaf, part) };
    let most = leaf(0, 0).eax;
    if most < 0x1d || leaf(7, 0).edx & TILE_AND_INT8 != TILE_AND_INT8 || leaf(0x1d, 0).eax < 1 {
        return false;
    }
    let palette = leaf(0x1d, 1);
    let (row_bytes, registers, rows) = (
        palette.ebx & 0xffff,
        palette.ebx >> 16,
        palette.ecx & 0xffff,
    );
    (row_bytes, registers, rows) == (64, 8, 16)
}

/// Whether the system has switched on the states of tiles: their configuration (bit 17) and their data (bit 18).
fn system_saves_tiles() -> bool {
    const STATES: u64 = 1 << 17 | 1 << 18;
    // SAFETY: the system has switched `xgetbv` on, which is what the check of `xsave` looks at.
    has!("xsave") && unsafe { _xgetbv(0) } & STATES == STATES
}

/// Asks Linux for the tiles' data; once granted, all threads of the process have them.
#[cfg(all(target_os = "linux", target_pointer_width = "64"))]
fn ask() -> bool {
    const ARCH_PRCTL: i64 = 158;
    const ARCH_REQ_XCOMP_PERM: u64 = 0x1023;
    const TILE_DATA: u64 = 18;
    let status: i64;
    // SAFETY: a system call that reads and writes no memory of ours; the registers that it overwrites are named. A
    // Linux that does not know the request, or does not grant it, returns an error.
    unsafe {
        std::arch::asm!(
            "syscall",
            inlateout("rax") ARCH_PRCTL => status,
            in("rdi") ARCH_REQ_XCOMP_PERM,
            in("rsi") TILE_DATA,
            lateout("rcx") _,
            lateout("r11") _,
            options(nostack)
        );
    }
    status == 0
}

/// How other systems grant them was never tried.
#[cfg(not(all(target_os = "linux", target_pointer_width = "64")))]
fn ask() -> bool {
    false
}

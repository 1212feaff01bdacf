//! A child that cannot outlive its supervisor, however early, and in whatever state, that one dies, and that has
//! nothing open of what its supervisor has.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::Command;

use rustix::process::{Pid, Signal, getpid, getppid, set_parent_process_death_signal};

/// Makes the kernel kill what `command` starts when this process dies. SIGKILL, because a child that is stopped hears
/// no other. The child has its three standard streams and nothing else: sockets of shared memory do not close
/// themselves.
pub fn tie(command: &mut Command) {
    let supervisor = getpid();
    let before_exec = move || {
        set_parent_process_death_signal(Some(Signal::KILL))?;
        close_others_on_exec();
        // It may have died before the kernel knew.
        if getppid() == Some(supervisor) {
            Ok(())
        } else {
            Err(io::Error::from_raw_os_error(
                rustix::io::Errno::SRCH.raw_os_error(),
            ))
        }
    };
    // SAFETY: between fork and exec only calls that are safe in a signal handler may be made: these three are single
    // system calls (prctl, close_range, getppid), and an error of a bare errno allocates nothing.
    unsafe { command.pre_exec(before_exec) };
}

/// Closes all but the standard streams when the process becomes another program.
fn close_others_on_exec() {
    let (first, last) = (3_u32, u32::MAX);
    let flags = libc::CLOSE_RANGE_CLOEXEC;
    // SAFETY: it marks descriptors, first <= last, and touches no memory. Before Linux 5.11 it fails and they stay
    // open, as before.
    let _ = unsafe { libc::syscall(libc::SYS_close_range, first, last, flags) };
}

/// Whether `pid` is still this process's parent.
pub fn is_parent(pid: i32) -> bool {
    getppid().map(Pid::as_raw_pid) == Some(pid)
}

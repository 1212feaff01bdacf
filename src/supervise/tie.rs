//! A child that cannot outlive its supervisor, however early, and in whatever state, that one dies.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::Command;

use rustix::process::{Pid, Signal, getpid, getppid, set_parent_process_death_signal};

/// Makes the kernel kill what `command` starts when this process dies. SIGKILL, because a child that is stopped hears no other.
pub fn tie(command: &mut Command) {
    let supervisor = getpid();
    let before_exec = move || {
        set_parent_process_death_signal(Some(Signal::KILL))?;
        // It may have died before the kernel knew.
        if getppid() == Some(supervisor) {
            Ok(())
        } else {
            Err(io::Error::from_raw_os_error(
                rustix::io::Errno::SRCH.raw_os_error(),
            ))
        }
    };
    // SAFETY: between fork and exec only calls that are safe in a signal handler may be made: these two are single system calls
    // (prctl, getppid), and an error of a bare errno allocates nothing.
    unsafe { command.pre_exec(before_exec) };
}

/// Whether `pid` is still this process's parent.
pub fn is_parent(pid: i32) -> bool {
    getppid().map(Pid::as_raw_pid) == Some(pid)
}

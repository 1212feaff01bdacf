//! A child that cannot outlive its supervisor, however early, and in whatever state, that one dies, and that has
//! nothing open of what its supervisor has.

use std::fs;
use std::io;
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::sync::LazyLock;

use rustix::fs::Mode;
use rustix::process::{Pid, Signal, getpid, getppid, set_parent_process_death_signal, umask};

/// The permissions that this process keeps back, as it was started.
static KEPT_BACK: LazyLock<Option<Mode>> = LazyLock::new(|| {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let mode = status.lines().find_map(|l| l.strip_prefix("Umask:"))?;
    Mode::from_bits(u32::from_str_radix(mode.trim(), 8).ok()?)
});

/// Reads what permissions this process keeps back, to be called before it has other threads: while one of them binds a
/// socket of iceoryx2 all but 0600 are kept back, and a child that is started then would never make a folder that can
/// be entered.
pub fn remember_permissions() {
    LazyLock::force(&KEPT_BACK);
}

/// Of the permissions `most` of a file those that this process was started to give, and not what a thread keeps back
/// at this moment.
pub fn permissions(most: u32) -> u32 {
    most & !KEPT_BACK.map_or(0o022, |mode| mode.bits())
}

/// Makes the kernel kill what `command` starts when this process dies. SIGKILL, because a child that is stopped hears
/// no other. The child has its three standard streams and nothing else: sockets of shared memory do not close
/// themselves. It keeps the permissions back that [`remember_permissions`] found.
pub fn tie(command: &mut Command) {
    let (supervisor, kept_back) = (getpid(), *KEPT_BACK);
    let before_exec = move || {
        set_parent_process_death_signal(Some(Signal::KILL))?;
        close_others_on_exec();
        if let Some(mode) = kept_back {
            umask(mode);
        }
        // It may have died before the kernel knew.
        if getppid() == Some(supervisor) {
            Ok(())
        } else {
            Err(io::Error::from_raw_os_error(
                rustix::io::Errno::SRCH.raw_os_error(),
            ))
        }
    };
    // SAFETY: between fork and exec only calls that are safe in a signal handler may be made: these four are single
    // system calls (prctl, close_range, umask, getppid), and an error of a bare errno allocates nothing.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_child_makes_files_as_this_process_was_started_to() {
        remember_permissions();
        let kept_back = KEPT_BACK.expect("the kernel tells");
        let mut command = Command::new("sh");
        command.args(["-c", "umask"]);
        // SAFETY: a single system call, which fails never; it stands in for a thread that binds a socket at the fork.
        unsafe {
            command.pre_exec(|| {
                umask(Mode::from_bits_retain(0o177));
                Ok(())
            })
        };
        tie(&mut command);
        let out = command.output().unwrap();
        let said = String::from_utf8(out.stdout).unwrap();
        let found = u32::from_str_radix(said.trim(), 8).unwrap();
        assert_eq!(found, kept_back.bits());
    }
}

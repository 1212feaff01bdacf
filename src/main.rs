//! The `edgecap` command.

use std::sync::Arc;

use signal_hook::consts::SIGXFSZ;

fn main() -> std::process::ExitCode {
    // Past the size that the system allows a file (RLIMIT_FSIZE), to write is to fail, not to be killed. Where this is
    // refused nothing is worse than before.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
    edgecap::commands::main().into()
}

//! The `edgecap` command.

fn main() -> std::process::ExitCode {
    edgecap::commands::main().into()
}

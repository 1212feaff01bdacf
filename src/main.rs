//! The `edgecap` command.

fn main() {}

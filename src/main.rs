//! The `edgecap` command.

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(version, about)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Render synthetic people with exact truth.
    Synth(edgecap::commands::synth::SynthArgs),
}

fn main() -> anyhow::Result<()> {
    match Cli::parse().verb {
        Verb::Synth(args) => edgecap::commands::synth::synth(args),
    }
}

//! dev
use clap::Parser;
#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    a: edgecap::commands::model::ModelArgs,
}
fn main() -> anyhow::Result<()> {
    edgecap::commands::model::model(Cli::parse().a)
}

//! `edgecap export`: a record of bodies as a file of another program.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;

use super::exit::Failure;
use super::say;
use crate::export::{Format, Take, encode};
use crate::output;

/// Options of `edgecap export`.
#[derive(Debug, clap::Args)]
pub struct ExportArgs {
    /// A record of bodies, of 'run --record' or 'run --jsonl'; '-' for standard input
    #[arg(value_name = "RECORD")]
    input: PathBuf,
    /// The file to write: .bvh, .glb (glTF 2.0), .trc, .csv, .npz, or .svg with curves; .bvh and .trc hold one person each, so
    /// several get NAME.ID.bvh
    #[arg(long, value_name = "FILE")]
    to: PathBuf,
    /// This person only
    #[arg(long, value_name = "ID")]
    person: Option<u32>,
}

/// Options of `edgecap plot`.
#[derive(Debug, clap::Args)]
pub struct PlotArgs {
    /// A record of bodies, of 'run --record' or 'run --jsonl'; '-' for standard input
    #[arg(value_name = "RECORD")]
    input: PathBuf,
    /// The SVG to write
    #[arg(long, value_name = "FILE", default_value = "edgecap-out/plot.svg")]
    to: PathBuf,
    /// This person only
    #[arg(long, value_name = "ID")]
    person: Option<u32>,
}

/// Draws heights and angles of a record over time.
///
/// # Errors
/// As [`export`].
pub fn plot(args: PlotArgs) -> anyhow::Result<()> {
    if Format::of(&args.to)? != Format::Svg {
        let message = format!(
            "{}: expected a name that ends in .svg; 'edgecap export' writes other files",
            args.to.display()
        );
        return Err(Failure::usage(message).into());
    }
    export(ExportArgs {
        input: args.input,
        to: args.to,
        person: args.person,
    })
}

/// Reads a whole record and writes it in the format of the file's extension.
///
/// # Errors
/// Exit code 64 for an unknown extension, 65 for a record without bodies, without the person, or damaged, 66 where it cannot be
/// opened, 73 where the file cannot be written.
pub fn export(args: ExportArgs) -> anyhow::Result<()> {
    let format = Format::of(&args.to)?;
    let name = args.input.display().to_string();
    let input: Box<dyn BufRead> = match name.as_str() {
        "-" => Box::new(std::io::stdin().lock()),
        _ => {
            let file = File::open(&args.input).map_err(|e| Failure::no_input(&args.input, &e))?;
            Box::new(BufReader::new(file))
        }
    };
    let mut take = Take::read(input, &name)?;
    if take.was_cut {
        tracing::warn!("{name}: cut off inside a frame; the frames before it are exported");
    }
    if let Some(id) = args.person {
        take.only(id, &name)?;
    }
    for (path, bytes) in encode(&take, format, &args.to)? {
        output::write(&path, &bytes).map_err(|e| Failure::output(&path, &e))?;
        say::out(&format!("→ {}", path.display()));
    }
    Ok(())
}

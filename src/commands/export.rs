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
    /// The file to write: .bvh, .glb (glTF 2.0), .trc, .csv or .npz; .bvh and .trc hold one person each, so several get NAME.ID.bvh
    #[arg(long, value_name = "FILE")]
    to: PathBuf,
    /// This person only
    #[arg(long, value_name = "ID")]
    person: Option<u32>,
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

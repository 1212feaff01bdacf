//! `edgecap export`: a record of bodies as a file of another program.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

use super::apart::Apart;
use super::exit::Failure;
use super::say;
use crate::export::{ExportError, Exported, Format, Take, encode};
use crate::message::BodyFrame;
use crate::output::AtomicFile;
use crate::record::{BodiesRow, Format as RecordFormat, Kind};
use crate::sink::{RecordSink, Sinks};

/// Options of `edgecap export`.
#[derive(Debug, clap::Args)]
pub struct ExportArgs {
    /// A record of bodies, of 'run --record' or 'run --jsonl'; '-' for standard input
    #[arg(value_name = "RECORD")]
    input: PathBuf,
    /// The file to write: .bvh, .glb (glTF 2.0), .trc, .csv, .npz, or .svg with curves; .bvh and .trc hold one person
    /// each, so several get NAME.ID.bvh
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
    if !matches!(Format::of(&args.to), Ok(Format::Svg)) {
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
/// Exit code 64 for an unknown extension, 65 for a record without bodies, without the person, or damaged, 66 where it
/// cannot be opened, 73 where the file cannot be written.
pub fn export(args: ExportArgs) -> anyhow::Result<()> {
    let format = Format::of(&args.to)?;
    Apart::default()
        .reads("RECORD", &args.input)
        .writes("--to", &args.to)
        .check()?;
    let name = args.input.display().to_string();
    let input: Box<dyn BufRead> = match name.as_str() {
        "-" => Box::new(std::io::stdin().lock()),
        _ => open(&args.input)?,
    };
    let take = Take::read_of(input, &name, args.person)?;
    if take.was_cut {
        tracing::warn!("{name}: cut off inside a frame; the frames before it are exported");
    }
    for line in write(&take, format, &args.to, false)? {
        say::out(&line);
    }
    Ok(())
}

fn open(path: &Path) -> anyhow::Result<Box<dyn BufRead>> {
    let open = || File::open(path).map_err(|e| Failure::no_input(path, &e));
    // A pipe can be read once.
    if path.is_file() && Kind::of(&mut BufReader::new(open()?)) == Some(Kind::Observations) {
        let message = format!(
            "{}: expected bodies, found observations; 'edgecap fit --input … --record FILE' makes bodies of them",
            path.display()
        );
        return Err(Failure::data(message).into());
    }
    Ok(Box::new(BufReader::new(open()?)))
}

/// Writes a take's files; what there is now, a line each. Those of a take that broke off do not replace longer ones.
fn write(take: &Take, format: Format, to: &Path, is_broken: bool) -> anyhow::Result<Vec<String>> {
    let mut lines = Vec::new();
    for Exported { path, bytes, late } in encode(take, format, to)? {
        let written = write_file(&path, &bytes, is_broken);
        let beside = written.map_err(|e| Failure::output(&path, &e))?;
        let path = beside.unwrap_or(path);
        let late = late.map_or(String::new(), |seconds| {
            format!(" (begins {seconds:.3} s after the first of all)")
        });
        lines.push(format!("→ {}{late}", path.display()));
    }
    Ok(lines)
}

/// Writes a whole file; the name that it got in place of its own, if it did.
fn write_file(path: &Path, bytes: &[u8], is_broken: bool) -> io::Result<Option<PathBuf>> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    if is_broken {
        file.break_off();
    }
    file.finish_beside()
}

/// Files of other programs that a verb writes besides its own results.
#[derive(Debug, Clone, Default)]
pub struct Exports(Vec<(Format, PathBuf)>);

impl Exports {
    /// Of the names that the user gave.
    ///
    /// # Errors
    /// Exit code 64 for an unknown extension, 73 where nothing can be written.
    pub fn new(to: &[PathBuf]) -> anyhow::Result<Self> {
        let named = to.iter().map(|to| Ok((Format::of(to)?, to.clone())));
        let named = named.collect::<Result<Vec<_>, ExportError>>()?;
        for (_, path) in &named {
            // Leaves nothing; what cannot be written should be known before hours of work.
            AtomicFile::create(path).map_err(|e| Failure::output(path, &e))?;
        }
        Ok(Self(named))
    }

    /// Writes all of them; what there is now, a line each.
    ///
    /// # Errors
    /// As [`export`].
    pub fn write(&self, take: &Take) -> anyhow::Result<Vec<String>> {
        self.write_take(take, false)
    }

    fn write_take(&self, take: &Take, is_broken: bool) -> anyhow::Result<Vec<String>> {
        let mut lines = Vec::new();
        for (format, to) in &self.0 {
            lines.extend(write(take, *format, to, is_broken)?);
        }
        Ok(lines)
    }

    /// Starts to keep what is to be exported, if anything is.
    ///
    /// # Errors
    /// If there is no place for it.
    pub fn keep(self, sinks: &mut Sinks<BodyFrame>) -> anyhow::Result<Option<Kept>> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let file = tempfile::NamedTempFile::new()?;
        let record = RecordSink::<BodiesRow>::create(file.path(), RecordFormat::Binary)?;
        sinks.push(record.untold());
        Ok(Some(Kept {
            exports: self,
            path: file.into_temp_path(),
        }))
    }
}

/// A record of a run for as long as that runs, and what becomes of it.
#[derive(Debug)]
pub struct Kept {
    exports: Exports,
    path: tempfile::TempPath,
}

impl Kept {
    /// Writes all files, once the sinks have finished; `source` is what was run. Where the run broke off, what there is
    /// does not replace more.
    ///
    /// # Errors
    /// As [`export`].
    pub fn write(self, source: &str, is_broken: bool) -> anyhow::Result<Vec<String>> {
        let take = Take::read(open(&self.path)?, source)?;
        self.exports.write_take(&take, is_broken)
    }
}

//! `edgecap export`: a record of bodies as a file of another program.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use tempfile::NamedTempFile;

use super::apart::Apart;
use super::exit::{Failure, told};
use super::result::OUT;
use super::say;
use crate::counted::counted;
use crate::export::{ExportError, Exported, Format, Take, encode, plot_title};
use crate::message::BodyFrame;
use crate::output::{self, AtomicFile};
use crate::record::{self, BodiesRow, Format as RecordFormat, Kind};
use crate::sink::{Packet, RecordSink, Sink, SinkError, Sinks};

/// For more files of one take the disk is not waited for one after the other: of a week's visitors that takes minutes.
const MOST_WAITED_FOR: usize = 20;

/// The name of standard input.
const STDIN: &str = "-";
/// More than the name of a record takes.
const HEAD_BYTES: u64 = 64 << 10;

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
    /// The SVG to write [default: edgecap-out/RECORD.plot.svg]
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
    /// This person only
    #[arg(long, value_name = "ID")]
    person: Option<u32>,
}

/// Draws heights and angles of a record over time.
///
/// # Errors
/// As [`export`].
pub fn plot(args: PlotArgs) -> anyhow::Result<()> {
    let to = args
        .to
        .unwrap_or_else(|| drawing(Path::new(OUT), &args.input));
    if !matches!(Format::of(&to), Ok(Format::Svg)) {
        let message = format!(
            "{}: expected a name that ends in .svg; 'edgecap export' writes other files",
            to.display()
        );
        return Err(Failure::usage(message).into());
    }
    export(ExportArgs {
        input: args.input,
        to,
        person: args.person,
    })
}

/// Where the drawing of a record goes: called like it, with a number where that of another record is called so. What
/// comes on standard input has no name of its own.
fn drawing(folder: &Path, record: &Path) -> PathBuf {
    if record == Path::new(STDIN) {
        return folder.join("plot.svg");
    }
    let name = record.file_stem().unwrap_or_default().display();
    let title = plot_title(&record.display().to_string());
    let mut number = 1;
    loop {
        let path = folder.join(match number {
            1 => format!("{name}.plot.svg"),
            n => format!("{name}-{n}.plot.svg"),
        });
        if head(&path).is_none_or(|head| head.contains(&title)) {
            return path;
        }
        number += 1;
    }
}

/// The first bytes of a file, in which a drawing says what it is of; `None` where there is nothing.
fn head(drawing: &Path) -> Option<String> {
    let mut head = Vec::new();
    let file = File::open(drawing).ok()?;
    file.take(HEAD_BYTES).read_to_end(&mut head).ok()?;
    Some(String::from_utf8_lossy(&head).into_owned())
}

/// Reads a whole record and writes it in the format of the file's extension.
///
/// # Errors
/// Exit code 64 for an unknown extension, 65 for a record without bodies, without the person, or damaged, 66 where it
/// cannot be opened, 73 where the file cannot be written, 74 where the disk is full.
pub fn export(args: ExportArgs) -> anyhow::Result<()> {
    let format = Format::of(&args.to)?;
    Apart::default()
        .reads("RECORD", &args.input)
        .writes("--to", &args.to)
        .check()?;
    let name = args.input.display().to_string();
    let input: Box<dyn BufRead> = match name.as_str() {
        STDIN => Box::new(std::io::stdin().lock()),
        _ => open(&args.input)?,
    };
    let take = Take::read_of(input, &name, args.person)?;
    if take.was_cut {
        tracing::warn!("{name}: cut off inside a frame; the frames before it are exported");
    }
    let (lines, written) = write(&take, format, &args.to, false);
    for line in lines {
        say::out(&line);
    }
    written
}

fn open(path: &Path) -> anyhow::Result<Box<dyn BufRead>> {
    let open = || record::open(path).map_err(|e| Failure::no_input(path, &e));
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

/// What there is now, a line each, and how it ended: with the first failure, after which others are written all the
/// same. What else failed is said on standard error.
type Written = (Vec<String>, anyhow::Result<()>);

/// Writes a take's files. Those of a take that broke off do not replace longer ones.
fn write(take: &Take, format: Format, to: &Path, is_broken: bool) -> Written {
    let files = match encode(take, format, to) {
        Ok(files) => files,
        Err(e) => return (Vec::new(), Err(e.into())),
    };
    let is_waited_for = files.len() <= MOST_WAITED_FOR;
    let (mut lines, mut first, mut more) = (Vec::new(), Ok(()), 0_u32);
    for file in files {
        let beside = match write_file(&file, is_waited_for, is_broken) {
            Ok(beside) => beside,
            Err(e) => {
                let failure = Failure::output(&file.path, &e);
                match first {
                    Ok(()) => first = Err(failure.into()),
                    // Of each that lies elsewhere its place must be known; all others are as the first.
                    Err(_) if output::kept_at(&e).is_some() => say::err(&failure.to_string()),
                    Err(_) => more += 1,
                }
                continue;
            }
        };
        let path = beside.unwrap_or(file.path);
        let late = file.late.map_or(String::new(), |seconds| {
            format!(" (begins {seconds:.3} s after the first of all)")
        });
        lines.push(format!("→ {}{late}", path.display()));
    }
    if more > 0 {
        let files = counted(more, "more file", "more files");
        say::err(&format!("{}: {files} could not be written", to.display()));
    }
    (lines, first)
}

/// Writes a whole file, and has it on the disk first where that `is_waited_for`; the name that it got in place of its
/// own, if it did.
fn write_file(
    exported: &Exported<'_>,
    is_waited_for: bool,
    is_broken: bool,
) -> io::Result<Option<PathBuf>> {
    let mut file = AtomicFile::create(&exported.path)?;
    if !is_waited_for {
        file = file.passing();
    }
    match file.can_seek() {
        true => exported.write_into(&mut file)?,
        false => exported.write(&mut file)?,
    }
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
            // What cannot be written should be known before hours of work.
            output::try_place(path).map_err(|e| Failure::output(path, &e))?;
        }
        Ok(Self(named))
    }

    /// That what was to be exported could not be kept: the user knows the files, not what lies beside them.
    fn unkept(&self, why: &SinkError) -> Failure {
        let to = self.0.first().map_or(Path::new(""), |(_, to)| to);
        match why {
            SinkError::Create { cause, .. }
            | SinkError::Write { cause, .. }
            | SinkError::Lost { cause, .. } => Failure::output(to, cause),
            other => Failure::output(to, &io::Error::other(other.to_string())),
        }
    }

    /// Writes all of them; errors are as those of [`export`].
    pub fn write(&self, take: &Take) -> Written {
        self.write_take(take, false)
    }

    fn write_take(&self, take: &Take, is_broken: bool) -> Written {
        let (mut lines, mut first) = (Vec::new(), Ok(()));
        for (format, to) in &self.0 {
            let (more, written) = write(take, *format, to, is_broken);
            lines.extend(more);
            match written {
                Err(e) if first.is_err() => say::err(&told(&e)),
                written => first = first.and(written),
            }
        }
        (lines, first)
    }

    /// Starts to keep what is to be exported, if anything is, where nobody else may read it, beside the first of the
    /// files; what killed processes left of the same is cleared away.
    ///
    /// # Errors
    /// If there is no place for it.
    pub fn keep(self, sinks: &mut Sinks<BodyFrame>) -> anyhow::Result<Option<Kept>> {
        let Some((_, to)) = self.0.first() else {
            return Ok(None);
        };
        // What takes its name is private, too.
        let file = output::private_beside(to).map_err(|e| Failure::output(to, &e))?;
        output::sweep(file.path());
        let record = RecordSink::<BodiesRow>::create(file.path(), RecordFormat::Binary)?;
        let failed = Arc::default();
        sinks.push(KeptRecord {
            record: Some(record.untold()),
            failed: Arc::clone(&failed),
        });
        Ok(Some(Kept {
            exports: self,
            file,
            failed,
        }))
    }
}

/// Why there is no record of a run to be exported.
type Failed = Arc<OnceLock<SinkError>>;

/// The record of a run that is to be exported. Where it fails, the other results go on.
struct KeptRecord {
    /// `None` once it has failed: what it took of the disk is free again.
    record: Option<RecordSink<BodiesRow>>,
    failed: Failed,
}

impl Sink<BodyFrame> for KeptRecord {
    fn take(&mut self, packet: &Packet<'_, BodyFrame>) -> Result<(), SinkError> {
        if let Some(record) = &mut self.record
            && let Err(e) = record.take(packet)
        {
            self.failed.get_or_init(|| e);
            self.record = None;
        }
        Ok(())
    }

    fn break_off(&mut self) {
        if let Some(record) = &mut self.record {
            record.break_off();
        }
    }

    fn finish(self: Box<Self>) -> Result<Option<String>, SinkError> {
        if let Some(record) = self.record
            && let Err(e) = Box::new(record).finish()
        {
            self.failed.get_or_init(|| e);
        }
        Ok(None)
    }
}

/// A record of a run for as long as that runs, and what becomes of it.
#[derive(Debug)]
pub struct Kept {
    exports: Exports,
    file: NamedTempFile,
    failed: Failed,
}

impl Kept {
    /// Writes all files, once the sinks have finished; `source` is what was run. Where the run broke off, what there is
    /// does not replace more. Errors are as those of [`export`], or why nothing could be kept to be exported.
    pub fn write(self, source: &str, is_broken: bool) -> Written {
        if let Some(why) = self.failed.get() {
            return (Vec::new(), Err(self.exports.unkept(why).into()));
        }
        let read = open(self.file.path()).and_then(|input| Ok(Take::read(input, source)?));
        match read {
            Ok(take) => self.exports.write_take(&take, is_broken),
            Err(e) => (Vec::new(), Err(e)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::MetadataExt;
    use std::time::{Duration, SystemTime};

    use super::*;
    use crate::commands::exit;
    use crate::record::Row;

    /// Somebody in frames at these times, seconds.
    fn take(times: &[u64]) -> Take {
        let mut lines = Vec::new();
        for (sequence, seconds) in (0..).zip(times) {
            let mut message = BodyFrame {
                sequence,
                pose_ns: seconds * 1_000_000_000,
                count: 1,
                ..BodyFrame::default()
            };
            message.bodies[0].id = 1;
            serde_json::to_writer(&mut lines, &BodiesRow::new(&message, "")).unwrap();
            lines.push(b'\n');
        }
        Take::read(&lines[..], "take").unwrap()
    }

    #[test]
    fn what_one_format_cannot_hold_the_others_do() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "").unwrap();
        // More even steps than there is room for.
        let take = take(&[0, 1, 2, 1_000_000_000]);
        let named = ["a.glb", "file/b.csv", "c.svg"].map(at);
        let all = named.map(|path| (Format::of(&path).unwrap(), path));
        let (lines, written) = Exports(all.into()).write(&take);
        assert_eq!(lines, [format!("→ {}", at("c.svg").display())]);
        assert!(at("c.svg").exists());
        let e = written.unwrap_err();
        assert_eq!(exit::code(&e), exit::DATA, "the first: {e}");
        assert!(e.to_string().contains("4 GiB of numbers"), "{e}");
    }

    #[test]
    fn every_record_has_a_drawing_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let drawn = |record: &str| {
            let to = drawing(folder.path(), Path::new(record));
            let mut take = take(&[0, 1, 2]);
            take.name = record.to_owned();
            write(&take, Format::Svg, &to, false).1.unwrap();
            to.file_name().unwrap().to_str().unwrap().to_owned()
        };
        let names = ["hall.record", "a & b/hall.record", "walk.jsonl", "-"].map(drawn);
        let expected = ["hall", "hall-2", "walk"].map(|name| format!("{name}.plot.svg"));
        assert_eq!(names[..3], expected);
        assert_eq!(names[3], "plot.svg");
        let again = drawn("a & b/hall.record");
        assert_eq!(again, "hall-2.plot.svg", "it is replaced");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 4);
    }

    #[test]
    fn a_place_is_tried_without_a_trace_and_a_pipe_gets_the_whole_file() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        Exports::new(&[at("new/folder/a.glb")]).unwrap();
        assert!(!at("new").exists());
        let pipe = at("pipe.csv");
        rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, 0o600.into()).unwrap();
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read_to_string(pipe).unwrap()
        });
        let exports = Exports::new(&[pipe]).unwrap();
        let (lines, written) = exports.write(&take(&[0, 1, 2]));
        written.unwrap();
        assert_eq!(lines.len(), 1);
        let read = reader.join().unwrap();
        assert_eq!(read.lines().count(), 1 + 3 * crate::joints::BODY_JOINTS);
    }

    #[test]
    fn what_a_run_keeps_to_export_is_nobody_elses_and_what_was_left_of_it_goes() {
        let folder = tempfile::tempdir().unwrap();
        let left = tempfile::Builder::new()
            .prefix(".edgecap-")
            .suffix(".part")
            .tempfile_in(folder.path())
            .unwrap();
        let long_ago = SystemTime::now() - Duration::from_secs(2 * 24 * 60 * 60);
        left.as_file().set_modified(long_ago).unwrap();
        let left = left.into_temp_path();
        let mut sinks = Sinks::default();
        let exports = Exports(vec![(Format::Csv, folder.path().join("a.csv"))]);
        let kept = exports.keep(&mut sinks).unwrap().unwrap();
        assert!(!left.exists());
        sinks.finish().1.unwrap();
        let path = kept.file.path().to_owned();
        assert_eq!(
            path.parent(),
            Some(folder.path()),
            "on the disk of the result"
        );
        assert_eq!(fs::metadata(path).unwrap().mode() & 0o777, 0o600);
        drop(kept);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_run_whose_exports_cannot_be_kept_goes_on_without_them() {
        let folder = tempfile::tempdir().unwrap();
        let to = folder.path().join("a.csv");
        let file = output::private_beside(&to).unwrap();
        let failed = Failed::default();
        let full = RecordSink::create(Path::new("/dev/full"), RecordFormat::Binary).unwrap();
        let mut sinks = Sinks::default();
        sinks.push(KeptRecord {
            record: Some(full),
            failed: Arc::clone(&failed),
        });
        let message = BodyFrame::default();
        for _ in 0..3 {
            let packet = Packet {
                message: &message,
                source: "",
                picture: None,
            };
            sinks.take(&packet).unwrap();
        }
        sinks.finish().1.unwrap();
        let kept = Kept {
            exports: Exports(vec![(Format::Csv, to.clone())]),
            file,
            failed,
        };
        let (lines, written) = kept.write("film", false);
        assert!(lines.is_empty() && !to.exists());
        let e = written.unwrap_err();
        assert_eq!(exit::code(&e), exit::IO, "{e}");
        assert!(e.to_string().contains("a.csv: the disk is full"), "{e}");
    }
}

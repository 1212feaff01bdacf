//! `edgecap eval`: predictions and ground truth in, a table and JSON out.

use std::fmt::Display;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::builder::RangedU64ValueParser;
use serde::Serialize;

use super::apart::Apart;
use super::exit::Failure;
use super::progress;
use super::say;
use crate::joints::EVIDENCE_JOINTS;
use crate::lab::eval::{
    EvalError, EvalOptions, Format, JointOrder, JointSet, Predictions, ReadOptions, Report,
    TruthSet, Units, evaluate, quiet,
};
use crate::lab::humaneva::{self, HumanEva, HumanEvaError, HumanEvaOptions};
use crate::lab::multiview::{TablesOptions, tables};
use crate::output::{self, AtomicFile, is_stdout};

/// Frames of every synthetic person.
const SYNTHETIC_FRAMES: u64 = 60;
/// What is measured without truth of the user's, so that nothing about it can be said.
const WITHOUT_TRUTH: [&str; 3] = ["no_people", "multiview", "humaneva"];

/// Options of `edgecap eval`.
#[derive(Debug, Clone, clap::Args)]
pub struct EvalArgs {
    /// Predictions: a record of 'infer', 'fit' or 'run', by --jsonl or --record
    #[arg(
        long,
        value_name = "FILE",
        required_unless_present_any = ["multiview", "humaneva"],
        num_args = 1..
    )]
    pub predictions: Vec<PathBuf>,
    /// Ground truth; several files of one kind count as one set
    #[arg(
        long,
        value_name = "FILE",
        num_args = 1..,
        required_unless_present_any = ["no_people", "multiview", "humaneva"]
    )]
    pub truth: Vec<PathBuf>,
    /// How the truth is written
    #[arg(long, value_enum, default_value = "auto", conflicts_with_all = WITHOUT_TRUTH)]
    pub format: Format,
    /// Part of a truth that has parts, such as 'test' or a sequence
    #[arg(long, value_name = "NAME", conflicts_with_all = WITHOUT_TRUTH)]
    pub split: Option<String>,
    /// Order of a NumPy archive's joints; default: what the archive says
    #[arg(long, value_enum, value_name = "ORDER", conflicts_with_all = WITHOUT_TRUTH)]
    pub joint_order: Option<JointOrder>,
    /// Unit of a NumPy archive's 3D joints; default: what the archive says, or metres
    #[arg(long, value_enum, conflicts_with_all = WITHOUT_TRUTH)]
    pub units: Option<Units>,
    /// There is nobody in any of the pictures: everybody predicted is wrong
    #[arg(long, conflicts_with = "truth")]
    pub no_people: bool,
    /// Points that count in OKS
    #[arg(long, value_enum, default_value = "shared", conflicts_with_all = WITHOUT_TRUTH)]
    pub joints: JointSet,
    /// Fewest labelled joints, of up to 14, of a person who is missed when not found
    #[arg(
        long,
        value_name = "N",
        default_value_t = 8,
        conflicts_with_all = WITHOUT_TRUTH,
        value_parser = RangedU64ValueParser::<usize>::new().range(0..=EVIDENCE_JOINTS as u64)
    )]
    pub min_joints: usize,
    /// Least height of such a person's box, in pixels of the network's 512x320 input
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = 0.0,
        conflicts_with_all = WITHOUT_TRUTH,
        value_parser = parse_height
    )]
    pub min_height: f64,
    /// Nothing is read: bodies from one to four views of synthetic people are fitted and measured, minutes long
    #[arg(long, conflicts_with_all = ["predictions", "truth", "no_people"])]
    pub multiview: bool,
    /// With --multiview: how many people, each with a motion of their own, figures are the mean of
    #[arg(long, value_name = "N", default_value_t = 5, requires = "multiview", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
    /// With --multiview: frames of each [default: 60]; with --humaneva: of every piece at most [default: all]
    #[arg(
        long,
        value_name = "N",
        conflicts_with_all = ["predictions", "truth", "no_people"],
        value_parser = clap::value_parser!(u64).range(10..=10_000)
    )]
    pub frames: Option<u64>,
    /// Bodies from one to three views of HumanEva-I's people are fitted and measured: a folder with humaneva1_gt.npz
    /// and humaneva1_alphapose_aligned.npz, minutes long
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["predictions", "truth", "no_people", "multiview"])]
    pub humaneva: Option<PathBuf>,
    /// Write every figure as JSON; '-' for standard output, in place of the table
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

fn parse_height(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(pixels) if pixels.is_finite() && pixels >= 0.0 => Ok(pixels),
        _ => Err(format!("'{text}': expected pixels, 0 or more")),
    }
}

/// Measures and prints.
///
/// # Errors
/// When a file cannot be read, is not what it should be, or no prediction belongs to the truth.
pub fn eval(args: EvalArgs) -> anyhow::Result<()> {
    let inputs = args.predictions.iter().map(|p| ("--predictions", p));
    let inputs = inputs.chain(args.truth.iter().map(|p| ("--truth", p)));
    let apart = inputs.fold(Apart::default(), |apart, (option, path)| {
        apart.reads(option, path)
    });
    let apart = args.humaneva.iter().fold(apart, |apart, folder| {
        let files = humaneva::FILES.map(|name| folder.join(name));
        let apart = apart.reads("--humaneva", folder);
        files
            .iter()
            .fold(apart, |apart, file| apart.reads("--humaneva", file))
    });
    apart.may_write("--json", args.json.as_deref()).check()?;
    let figures = Figures::open(args.json.as_deref())?;
    if args.multiview {
        let options = TablesOptions {
            seeds: args.seeds,
            frames: args.frames.unwrap_or(SYNTHETIC_FRAMES),
        };
        let tables = told(|heard| tables(options, heard));
        return figures.show(&tables);
    }
    if let Some(folder) = &args.humaneva {
        let data = HumanEva::read(folder).map_err(no_humaneva)?;
        let most = args.frames.map_or(usize::MAX, |n| n as usize);
        let options = HumanEvaOptions::of_frames(most);
        let tables = told(|heard| humaneva::tables(&data, options, heard));
        return figures.show(&tables.map_err(no_humaneva)?);
    }
    let mut predictions = Predictions::default();
    for path in &args.predictions {
        let more = Predictions::read(path).map_err(coded)?;
        predictions
            .append(more, &path.display().to_string())
            .map_err(coded)?;
    }
    let report = if args.no_people {
        Report {
            quiet: Some(quiet(&predictions).map_err(coded)?),
            ..Report::default()
        }
    } else {
        let mut truth = TruthSet::default();
        let reading = ReadOptions {
            format: args.format,
            split: args.split,
            joint_order: args.joint_order,
            units: args.units,
        };
        for path in &args.truth {
            let more = TruthSet::read(path, &reading).map_err(coded)?;
            truth
                .append(more, &path.display().to_string())
                .map_err(coded)?;
        }
        let options = EvalOptions {
            joints: args.joints,
            min_joints: args.min_joints,
            min_height: args.min_height,
        };
        evaluate(&predictions, &truth, &options).map_err(coded)?
    };
    figures.show(&report)
}

/// Shows how far fits have come while they are made.
fn told<T>(fits: impl FnOnce(&(dyn Fn(u64, u64) + Sync)) -> T) -> T {
    let bar = progress::bar(1, "fits");
    let done = fits(&|done, of| {
        bar.set_length(of);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    done
}

/// Where figures go that minutes of work end with.
pub(super) struct Place<'a> {
    path: &'a Path,
    /// A pipe, a device or a descriptor; `None` for a file.
    open: Option<AtomicFile>,
}

impl<'a> Place<'a> {
    /// Tries it before work that could not be kept. A file is not begun: whoever stops the work would leave it. What is
    /// none stays open, so that whoever reads from a pipe waits for the figures.
    ///
    /// # Errors
    /// As [`AtomicFile::create`].
    pub(super) fn open(path: &'a Path) -> Result<Self, Failure> {
        let file = AtomicFile::create(path).map_err(|e| Failure::output(path, &e))?;
        let open = (!file.can_seek()).then_some(file);
        Ok(Self { path, open })
    }

    /// Writes the figures, a text without its last line's end.
    ///
    /// # Errors
    /// As [`output::write()`].
    pub(super) fn write(self, text: &str) -> Result<(), Failure> {
        let text = format!("{text}\n");
        let written = match self.open {
            Some(mut open) => open.write_all(text.as_bytes()).and_then(|()| open.finish()),
            None => output::write(self.path, text.as_bytes()),
        };
        written.map_err(|e| Failure::output(self.path, &e))
    }
}

/// Where figures go: the table always, but where JSON takes its place.
enum Figures<'a> {
    Table,
    Json,
    Both(Place<'a>),
}

impl<'a> Figures<'a> {
    /// As [`Place::open`].
    fn open(json: Option<&'a Path>) -> anyhow::Result<Self> {
        Ok(match json {
            None => Self::Table,
            Some(path) if is_stdout(path) => Self::Json,
            Some(path) => Self::Both(Place::open(path)?),
        })
    }

    /// Prints the table and writes the figures as JSON where that is wanted: each also where the other fails.
    fn show(self, report: &(impl Serialize + Display)) -> anyhow::Result<()> {
        let text = serde_json::to_string_pretty(report)?;
        if let Self::Json = self {
            return say::whole(&text);
        }
        let printed = say::whole(&report.to_string());
        if let Self::Both(place) = self {
            place.write(&text)?;
        }
        printed
    }
}

/// Gives an error of HumanEva's archives its exit code.
fn no_humaneva(error: HumanEvaError) -> anyhow::Error {
    match error {
        HumanEvaError::Read { path, source } => Failure::no_input(&path, &source).into(),
        other => Failure::data(other.to_string()).into(),
    }
}

/// Gives an error of the measures its exit code.
fn coded(error: EvalError) -> anyhow::Error {
    match error {
        EvalError::Read { path, source } => Failure::no_input(&path, &source).into(),
        other => Failure::data(other.to_string()).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::exit;

    #[test]
    fn whoever_stops_the_measuring_leaves_no_begun_figures() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("figures.json");
        let left = || std::fs::read_dir(folder.path()).unwrap().count();
        let figures = Figures::open(Some(&path)).unwrap();
        assert_eq!(left(), 0);
        figures.show(&"nothing measured").unwrap();
        assert_eq!(
            std::fs::read_to_string(&path).unwrap(),
            "\"nothing measured\"\n"
        );
        assert_eq!(left(), 1);
    }

    #[test]
    fn a_pipe_without_a_reader_is_told_before_the_measuring() {
        use rustix::fs::{CWD, mkfifoat};
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        mkfifoat(CWD, &pipe, 0o600.into()).unwrap();
        let said = Figures::open(Some(&pipe)).err().unwrap();
        assert_eq!(exit::code(&said), exit::CANNOT_CREATE);
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || std::fs::read_to_string(pipe).unwrap()
        });
        let figures = Figures::open(Some(&pipe)).unwrap();
        figures.show(&"nothing measured").unwrap();
        assert_eq!(reader.join().unwrap(), "\"nothing measured\"\n");
        assert!(std::fs::metadata(&pipe).unwrap().file_type().is_fifo());
        // No such descriptor is open.
        assert!(Figures::open(Some(Path::new("/dev/fd/987654"))).is_err());
    }
}

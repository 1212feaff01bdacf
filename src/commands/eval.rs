//! `edgecap eval`: predictions and ground truth in, a table and JSON out.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::apart::Apart;
use super::exit::Failure;
use super::progress;
use super::say;
use crate::lab::eval::{
    EvalError, EvalOptions, Format, JointOrder, JointSet, Predictions, ReadOptions, Report,
    TruthSet, Units, evaluate, quiet,
};
use crate::lab::humaneva::{self, HumanEva, HumanEvaError, HumanEvaOptions};
use crate::lab::multiview::{TablesOptions, tables};
use crate::output;

/// Frames of every synthetic person.
const SYNTHETIC_FRAMES: u64 = 60;

/// Options of `edgecap eval`.
#[derive(Debug, Clone, clap::Args)]
pub struct EvalArgs {
    /// Predictions: the JSON lines that `infer --jsonl` or `run --jsonl` wrote
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
    #[arg(long, value_enum, default_value = "auto")]
    pub format: Format,
    /// Part of a truth that has parts, such as 'test' or a sequence
    #[arg(long, value_name = "NAME")]
    pub split: Option<String>,
    /// Order of a NumPy archive's joints; default: what the archive says
    #[arg(long, value_enum, value_name = "ORDER")]
    pub joint_order: Option<JointOrder>,
    /// Unit of a NumPy archive's 3D joints; default: what the archive says, or metres
    #[arg(long, value_enum)]
    pub units: Option<Units>,
    /// There is nobody in any of the pictures: everybody predicted is wrong
    #[arg(long, conflicts_with = "truth")]
    pub no_people: bool,
    /// Points that count in OKS
    #[arg(long, value_enum, default_value = "shared")]
    pub joints: JointSet,
    /// Fewest labelled joints of a person who is missed when not found
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub min_joints: usize,
    /// Least height of such a person, in pixels of the network's 512x320 input
    #[arg(long, value_name = "PIXELS", default_value_t = 0.0)]
    pub min_height: f64,
    /// Nothing is read: bodies from one to four views of synthetic people are fitted and measured, minutes long
    #[arg(long, conflicts_with_all = ["predictions", "truth", "no_people"])]
    pub multiview: bool,
    /// With --multiview: how many people, each with a motion of their own, figures are the mean of
    #[arg(long, value_name = "N", default_value_t = 5, requires = "multiview", value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
    /// With --multiview: frames of each [default: 60]; with --humaneva: of every piece at most [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(10..=10_000))]
    pub frames: Option<u64>,
    /// Bodies from one to three views of HumanEva-I's people are fitted and measured: a folder with humaneva1_gt.npz
    /// and humaneva1_alphapose_aligned.npz, minutes long
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["predictions", "truth", "no_people", "multiview"])]
    pub humaneva: Option<PathBuf>,
    /// Write every figure as JSON; '-' for standard output, in place of the table
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Measures and prints.
///
/// # Errors
/// When a file cannot be read, is not what it should be, or no prediction belongs to the truth.
pub fn eval(args: EvalArgs) -> anyhow::Result<()> {
    if args.multiview {
        let options = TablesOptions {
            seeds: args.seeds,
            frames: args.frames.unwrap_or(SYNTHETIC_FRAMES),
        };
        let tables = told(|heard| tables(options, heard));
        return show(&tables, args.json.as_deref());
    }
    if let Some(folder) = &args.humaneva {
        let data = HumanEva::read(folder).map_err(no_humaneva)?;
        let options = HumanEvaOptions {
            most: args.frames.map_or(usize::MAX, |n| n as usize),
            ..HumanEvaOptions::default()
        };
        let tables = told(|heard| humaneva::tables(&data, options, heard));
        return show(&tables.map_err(no_humaneva)?, args.json.as_deref());
    }
    let reads = args.predictions.iter().map(|p| ("--predictions", p));
    let reads = reads.chain(args.truth.iter().map(|p| ("--truth", p)));
    reads
        .fold(Apart::default(), |apart, (option, path)| {
            apart.reads(option, path)
        })
        .may_write("--json", args.json.as_deref())
        .check()?;
    let mut predictions = Predictions::default();
    for path in &args.predictions {
        predictions.append(Predictions::read(path).map_err(coded)?);
    }
    let report = if args.no_people {
        Report {
            quiet: Some(quiet(&predictions)),
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
    show(&report, args.json.as_deref())
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

/// Prints the table, and writes the figures as JSON where that is wanted.
fn show(report: &(impl Serialize + Display), json: Option<&Path>) -> anyhow::Result<()> {
    if let Some(path) = json {
        let mut text = serde_json::to_string_pretty(report)?;
        text.push('\n');
        if path.as_os_str() == "-" {
            say::out(text.trim_end());
            return Ok(());
        }
        output::write(path, text.as_bytes()).map_err(|e| Failure::output(path, &e))?;
    }
    say::out(report.to_string().trim_end());
    Ok(())
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

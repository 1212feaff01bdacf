//! `edgecap bench`: the speed certificate of this machine.

use std::path::{Path, PathBuf};
use std::time::Duration;

use indicatif::ProgressBar;

use super::apart::Apart;
use super::eval::Place;
use super::model::opened;
use super::pipeline::usual;
use super::say;
use crate::engine::{Model, ModelError, Network, NetworkError};
use crate::lab::bench::{BenchOptions, Subject, SubjectError, certify};
use crate::schedule::size::parse_size;

/// Options of `edgecap bench`.
#[derive(Debug, clap::Args)]
pub struct BenchArgs {
    /// Model file for the pose network; the shipped one when not given
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Networks to measure; those without trained weights run with random ones
    #[arg(
        long,
        value_name = "NAME,…",
        value_delimiter = ',',
        default_value = "selecsls,resnet50"
    )]
    networks: Vec<String>,
    /// Network input size, multiples of 16 [default: 512x320, or what all networks take next to it]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<(usize, usize)>,
    /// Numbers of threads to measure with; 1 and all cores when not given
    #[arg(
        long,
        value_name = "N,…",
        value_delimiter = ',',
        value_parser = clap::value_parser!(u16).range(1..=256)
    )]
    threads: Vec<u16>,
    /// Seconds for each network, precision and number of threads
    #[arg(long, value_name = "S", default_value_t = 3.0, value_parser = parse_seconds)]
    seconds: f64,
    /// Time of every layer too
    #[arg(long)]
    layers: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Write the JSON to this file too
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(s) if (0.0..=3600.0).contains(&s) => Ok(s),
        _ => Err(format!("'{text}': expected seconds from 0 to 3600")),
    }
}

/// Measures and prints.
///
/// # Errors
/// When a model cannot be read, a network is unknown, or nothing can be printed.
pub fn bench(args: BenchArgs) -> anyhow::Result<()> {
    Apart::default()
        .may_read("--model", args.model.as_deref())
        .may_write("--save", args.save.as_deref())
        .check()?;
    let saved = args.save.as_deref().map(Place::open).transpose()?;
    let spinner = ProgressBar::new_spinner();
    spinner.enable_steady_tick(Duration::from_millis(500));
    spinner.set_message("weights");
    let trained = trained(args.model.as_deref())?;
    let mut names = args.networks.clone();
    if let Some(given) = trained.as_ref().filter(|_| args.model.is_some())
        && !names.iter().any(|n| n == given.name())
    {
        names.insert(0, given.name().to_owned());
    }
    let size = match args.size {
        Some(size) => size,
        None => usual_size(&names, trained.as_ref())?,
    };
    let mut subjects = Vec::new();
    for name in &names {
        subjects.push(match trained.as_ref().filter(|t| t.name() == name) {
            Some(trained) => trained.clone(),
            None => Subject::random(name, size).map_err(cause)?,
        });
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut threads: Vec<usize> = args.threads.iter().map(|&t| t.into()).collect();
    if threads.is_empty() {
        threads = vec![1, cores];
    }
    threads.sort_unstable();
    threads.dedup();
    let options = BenchOptions {
        size,
        threads,
        time: Duration::from_secs_f64(args.seconds),
        layers: args.layers,
    };
    // A ticking spinner would wake a core now and then while another is measured.
    spinner.disable_steady_tick();
    let certificate = certify(&subjects, &options, |next| {
        spinner.set_message(next.to_owned());
        spinner.tick();
    })?;
    spinner.finish_and_clear();
    let text = match args.json {
        true => serde_json::to_string_pretty(&certificate)?,
        false => certificate.to_string(),
    };
    let told = say::whole(&text);
    if let Some(place) = saved {
        place.write(&serde_json::to_string_pretty(&certificate)?)?;
    }
    told
}

/// The input nearest to the usual one that all these networks take.
fn usual_size(names: &[String], trained: Option<&Subject>) -> Result<(usize, usize), NetworkError> {
    let multiple = |name: &String| match trained.filter(|t| t.name() == name) {
        Some(trained) => Ok(trained.model.network().input().multiple),
        None => Network::shipped(name).map(|network| network.input().multiple),
    };
    let multiples = names.iter().map(multiple).collect::<Result<Vec<_>, _>>()?;
    let usual = usual(&multiples);
    Ok((usual.width, usual.height))
}

/// What is wrong with a network, which has an exit code of its own.
fn cause(error: SubjectError) -> anyhow::Error {
    match error {
        SubjectError::Network(e) => e.into(),
        SubjectError::Model(e) => e.into(),
        SubjectError::Engine(e) => e.into(),
    }
}

/// The given or shipped model; `None` in a build without weights.
fn trained(path: Option<&Path>) -> anyhow::Result<Option<Subject>> {
    if let Some(path) = path {
        let (model, digest) = opened(path)?;
        let origin = path.display().to_string();
        return Ok(Some(Subject::trained(model, &origin, &digest)));
    }
    match Model::shipped() {
        Ok(model) => Ok(Some(Subject::trained(
            model,
            "shipped",
            &Model::shipped_digest()?,
        ))),
        Err(ModelError::NotShipped) => Ok(None),
        Err(e) => Err(e.into()),
    }
}

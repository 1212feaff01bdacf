//! `edgecap model`: weights in and out of model files, and single pictures through them.

mod import;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::{Args, Subcommand, ValueEnum};

use super::apart::Apart;
use super::exit::Failure;
use super::pipeline::{association, usual};
use super::{picture, say};
use crate::config::Mistake;
use crate::engine::model::{Contract, Stage2Contract, Weights};
use crate::engine::{
    Engine, EngineOptions, HEAD2D_CHANNELS, Isa, Maps, Model, Network, NetworkError, Precision,
};
use crate::joints::EVIDENCE_JOINTS;
use crate::npz;
use crate::output::AtomicFile;

/// Arguments of `edgecap model`.
#[derive(Debug, Args)]
// One line, as of any other verb that lacks something.
#[command(arg_required_else_help = false)]
pub struct ModelArgs {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Turn PyTorch weights (safetensors) into a model file: batch norm folded, int8
    Import(import::Import),
    /// Print what the metadata of weights must say to be imported, as JSON to fill in
    Contract {
        /// Network: selecsls, selecsls42, selecsls60, selecsls84, resnet50, or a .toml file
        #[arg(long, default_value = "selecsls")]
        arch: String,
        /// Of weights of Stage II instead
        #[arg(long)]
        stage2: bool,
    },
    /// Say what a model file holds
    Info {
        /// Model file; without it, the weights of this program
        model: Option<PathBuf>,
    },
    /// Check a model file: digest, names, shapes, ranges; then run it once
    Verify {
        /// Model file; without it, the weights of this program
        model: Option<PathBuf>,
    },
    /// Run one picture and write the maps as .npz: heatmaps [14,h,w], pafs [26,h,w], encodings [63,h,w]
    Run(RunOne),
}

#[derive(Debug, Args)]
struct RunOne {
    /// Model file, or safetensors (then give --arch)
    model: PathBuf,
    /// Picture, JPEG or PNG
    #[arg(long)]
    image: PathBuf,
    /// File to write
    #[arg(long)]
    npz: PathBuf,
    /// Arithmetic
    #[arg(long, value_enum, default_value = "int8")]
    precision: PrecisionArg,
    /// Network of safetensors
    #[arg(long, default_value = "selecsls")]
    arch: String,
    /// Network input, pixels across [default: 512, or what the network takes next to it]
    #[arg(long)]
    width: Option<usize>,
    /// Network input, pixels down [default: 320, or what the network takes next to it]
    #[arg(long)]
    height: Option<usize>,
    /// Threads
    #[arg(
        long,
        default_value_t = EngineOptions::default().threads as u16,
        value_parser = clap::value_parser!(u16).range(1..=256)
    )]
    threads: u16,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PrecisionArg {
    Int8,
    F32,
}

/// Runs `edgecap model`.
///
/// # Errors
/// Models, weights and pictures that cannot be read or do not go together, and outputs that cannot be written.
pub fn model(args: ModelArgs) -> Result<()> {
    match args.verb {
        Verb::Import(a) => import::import(&a),
        Verb::Contract { arch, stage2 } => contract(&arch, stage2),
        Verb::Info { model } => info(model.as_deref()),
        Verb::Verify { model } => verify(model.as_deref()),
        Verb::Run(a) => run(&a),
    }
}

/// A given model and the digest of its file, which is read once: it may be a pipe. The digest in the header is of what
/// the file holds without it.
///
/// # Errors
/// Exit code 66 where it cannot be read, 65 where it is none.
pub(super) fn opened(path: &Path) -> Result<(Model, String)> {
    let bytes = read(path)?;
    let model = Model::from_bytes(&bytes).with_context(|| path.display().to_string())?;
    Ok((model, blake3::hash(&bytes).to_hex().to_string()))
}

/// The same, or the shipped model with the digest that `--version` and the file beside it tell.
fn open(path: Option<&Path>) -> Result<(Model, String)> {
    match path {
        Some(path) => opened(path),
        None => Ok((Model::shipped()?, Model::shipped_digest()?)),
    }
}

/// The file that describes a network, where `--arch` names one.
fn described(arch: &str) -> Option<&Path> {
    arch.ends_with(".toml").then(|| Path::new(arch))
}

fn network(arch: &str) -> Result<Network> {
    let Some(path) = described(arch) else {
        return Ok(Network::shipped(arch)?);
    };
    let text = text(path)?;
    match Network::parse(&text) {
        // With its place, as in settings, but it is none of those.
        Err(NetworkError::Syntax(e)) => {
            Err(Failure::data(Mistake::refused(arch, &text, &e).to_string()).into())
        }
        parsed => parsed.with_context(|| arch.to_owned()),
    }
}

fn read(path: &Path) -> Result<Vec<u8>> {
    let read = crate::bounded::read(path, crate::bounded::DATA);
    Ok(read.map_err(|e| Failure::no_input(path, &e))?)
}

fn text(path: &Path) -> Result<String> {
    let not_text = |e| Failure::data(format!("{}: expected text, found {e}", path.display()));
    Ok(String::from_utf8(read(path)?).map_err(not_text)?)
}

fn contract(arch: &str, is_stage2: bool) -> Result<()> {
    let (text, yours) = match is_stage2 {
        true => (
            serde_json::to_string_pretty(&Stage2Contract::template())?,
            "step, images, quantised, trained_on and batchnorm_eps are yours to tell; so is report, which you may leave out",
        ),
        false => (
            serde_json::to_string_pretty(&Contract::template(&network(arch)?))?,
            "step, images, quantised, trained_on, batchnorm_eps, reference_size, outputs, bones_at and encodings_trained are yours to tell",
        ),
    };
    say::whole(&text)?;
    say::err(&format!(
        "{yours}; what else differs in your network, this version cannot run (docs/weights.md)"
    ));
    Ok(())
}

fn info(path: Option<&Path>) -> Result<()> {
    use std::fmt::Write;
    let (model, file) = &open(path)?;
    let (network, contract) = (model.network(), model.contract());
    let graph = network.graph();
    let [w, h] = contract.input.reference_size;
    let mut out = String::new();
    writeln!(out, "network      {}: {}", network.name(), network.about())?;
    writeln!(
        out,
        "size         {:.2} M parameters, {:.2} GMAC at {w}x{h}",
        graph.parameters() as f64 / 1e6,
        graph.macs(h, w) as f64 / 1e9
    )?;
    let numerics = match model.weights() {
        Weights::Int8 { .. } => "int8 weights per channel, 7-bit activations",
        Weights::Float(_) => "f32",
    };
    writeln!(out, "numerics     {numerics}")?;
    writeln!(out, "calibration  {}", model.calibration())?;
    writeln!(
        out,
        "training     {} steps, {} pictures; {}",
        contract.common.step, contract.common.images, contract.common.trained_on
    )?;
    writeln!(
        out,
        "3D head      {}",
        if model.encodings_trained() {
            "trained"
        } else {
            "not trained"
        }
    )?;
    let stage2 = match model.stage2() {
        Some(s) => format!(
            "{} layers, {} steps of training",
            s.layers.len(),
            s.contract.common.step
        ),
        None => "none".into(),
    };
    writeln!(out, "stage II     {stage2}")?;
    let association = match model.association() {
        Some(_) => "its own settings",
        None => "the program's settings",
    };
    writeln!(out, "association  {association}")?;
    for line in model.history() {
        writeln!(out, "history      {line}")?;
    }
    writeln!(out, "blake3       {file} (the file)")?;
    if let Some(digest) = model.digest() {
        writeln!(
            out,
            "blake3       {digest} (its contents, as its header says)"
        )?;
    }
    say::whole(&out)
}

fn verify(path: Option<&Path>) -> Result<()> {
    let (model, file) = &open(path)?;
    // Opening it has checked digest, names, shapes and ranges.
    let engine = tried(model)?;
    association(model)?;
    let slow = without_vectors(&engine);
    if !slow.is_empty() {
        say::err(&format!(
            "without vector kernels, so many times slower: {}; expected input channels per group in multiples of 4 and kernels up to 7x7",
            slow.join(", ")
        ));
    }
    let contents = model.digest().unwrap_or("(no digest)");
    say::whole(&format!("ok {contents} (contents), {file} (file)"))
}

/// The engine of a rounded model, which has taken it and given numbers.
fn tried(model: &Model) -> Result<Engine> {
    let step = Maps::step(&[model.network().input().multiple]);
    let [width, height] = [128_usize, 96].map(|side| side.next_multiple_of(step));
    let options = EngineOptions {
        width,
        height,
        ..EngineOptions::default()
    };
    let mut engine = Engine::new(model, options)?;
    let ramp = (0..3 * width * height)
        .map(|i| (i * 37 % 256) as u8)
        .collect::<Vec<_>>();
    let maps = engine.run(&ramp);
    let mut values = maps.head2d.iter().chain(&maps.head3d);
    if !values.all(|x| x.is_finite()) {
        let why = "the network gives numbers that are not finite: import the weights again";
        return Err(Failure::data(why).into());
    }
    Ok(engine)
}

/// Layers that have no kernel but the scalar one, on a machine that has others.
fn without_vectors(engine: &Engine) -> Vec<String> {
    if engine.isa() == Isa::Scalar {
        return Vec::new();
    }
    let layers = engine.profile().into_iter();
    layers
        .filter(|layer| layer.shape.is_some() && layer.kernel.ends_with("__scalar"))
        .map(|layer| layer.name)
        .collect()
}

fn run(a: &RunOne) -> Result<()> {
    Apart::default()
        .reads("MODEL", &a.model)
        .reads("--image", &a.image)
        .may_read("--arch", described(&a.arch))
        .writes("--npz", &a.npz)
        .check()?;
    // Before work that could not be kept.
    let unwritten = |e: io::Error| Failure::output(&a.npz, &e);
    let mut file = AtomicFile::create(&a.npz).map_err(unwritten)?;
    let model = Model::open_any(&a.model, network(&a.arch)?)
        .with_context(|| a.model.display().to_string())?;
    let precision = match a.precision {
        PrecisionArg::Int8 => Precision::Int8,
        PrecisionArg::F32 => Precision::F32,
    };
    if matches!(precision, Precision::F32) && model.is_quantised() {
        say::err(&format!(
            "note: {} holds int8 weights; f32 runs what they stand for, not the trained floats",
            a.model.display()
        ));
    }
    let model = match precision {
        // Safetensors with ranges in their contract can run in int8 at once.
        Precision::Int8 => model.quantise(None)?,
        Precision::F32 => model,
    };
    let usual = usual(&[model.network().input().multiple]);
    let (width, height) = (
        a.width.unwrap_or(usual.width),
        a.height.unwrap_or(usual.height),
    );
    let options = EngineOptions {
        width,
        height,
        threads: a.threads.into(),
        precision,
        ..usual
    };
    let mut engine = Engine::new(&model, options)?;
    let picture = picture::letterboxed(&picture::upright(&a.image)?, (width, height));
    let bytes = archive(engine.run(&picture));
    let written = bytes.and_then(|bytes| file.write_all(&bytes));
    written.and_then(|()| file.finish()).map_err(unwritten)?;
    Ok(())
}

/// Channel-first copies of the maps.
fn archive(maps: &Maps) -> io::Result<Vec<u8>> {
    let (h, w) = (maps.height, maps.width);
    let planes = |map: &[f32], channels: std::ops::Range<usize>| -> Vec<f32> {
        let stride = map.len() / (h * w);
        let plane = |c| (0..h * w).map(move |i| map[i * stride + c]);
        channels.flat_map(plane).collect()
    };
    let heatmaps = planes(&maps.head2d, 0..EVIDENCE_JOINTS);
    let pafs = planes(&maps.head2d, EVIDENCE_JOINTS..HEAD2D_CHANNELS);
    let encodings = planes(&maps.head3d, 0..maps.head3d.len() / (h * w));
    let array = |name, data: &[f32]| (name, [data.len() / (h * w), h, w]);
    let all = [
        (array("heatmaps", &heatmaps), &heatmaps),
        (array("pafs", &pafs), &pafs),
        (array("encodings", &encodings), &encodings),
    ];
    let arrays = all.each_ref().map(|((name, shape), data)| npz::Array {
        name,
        shape,
        data: npz::Values::F32(data),
    });
    npz::write(&arrays)
}

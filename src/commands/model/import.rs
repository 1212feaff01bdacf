//! `edgecap model import`: other people's weights, checked, calibrated and rounded.

use std::cell::Cell;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;

use super::{described, network, read, text, tried};
use crate::capture::PhotoSource;
use crate::commands::apart::Apart;
use crate::commands::exit::{Failure, told};
use crate::commands::{picture, say};
use crate::config::Mistake;
use crate::counted::counted;
use crate::detect::AssociationConfig;
use crate::engine::model::{Calibration, Observed, RangeChoice};
use crate::engine::{CalibrationOptions, Maps, Model, ModelError};
use crate::output;

/// Pictures that ways of choosing ranges are tried on.
const TRIAL_PICTURES: usize = 12;

#[derive(Debug, Args)]
pub struct Import {
    /// Weights of Stage I, safetensors with a contract in their metadata; or a model file, which keeps its Stage I bit
    /// for bit and takes another Stage II or other settings of the association
    weights: PathBuf,
    /// Weights of Stage II, to go into the same file
    #[arg(long)]
    stage2: Option<PathBuf>,
    /// When peaks make people, fitted to these weights, to go into the same file; in the form of
    /// models/association.toml, whose numbers hold where there are none
    #[arg(long, value_name = "FILE")]
    association: Option<PathBuf>,
    /// Network: selecsls, selecsls42, selecsls60, selecsls84, resnet50, or a .toml file
    #[arg(long, default_value = "selecsls")]
    arch: String,
    /// Folder of pictures to find activation ranges with, each scaled to cover width x height and cropped; without it
    /// the weights' contract must have them
    #[arg(long)]
    calibrate: Option<PathBuf>,
    /// At most this many pictures, evenly over the folder
    #[arg(
        long,
        default_value_t = 64,
        requires = "calibrate",
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    pictures: u32,
    /// How ranges are chosen: max, mse or percentile:SHARE
    #[arg(long, default_value_t = CalibrationOptions::default().choice, requires = "calibrate")]
    range: RangeChoice,
    /// 0: one range for all channels of a layer; 1: a range of its own for each
    #[arg(
        long,
        default_value_t = CalibrationOptions::default().own_ranges,
        requires = "calibrate",
        value_parser = share
    )]
    own_ranges: f32,
    /// Leave biases as they are instead of correcting the mean error of rounded weights
    #[arg(long, requires = "calibrate")]
    no_bias_correction: bool,
    /// Try ways of choosing ranges and take the one nearest to f32 on some of the pictures, whatever the three options
    /// above say
    #[arg(long, requires = "calibrate")]
    try_ranges: bool,
    /// Width that pictures are calibrated at; without it about their own, since enlarged pictures give other
    /// activations
    #[arg(long, requires = "calibrate")]
    width: Option<usize>,
    /// Height that pictures are calibrated at; without it about their own
    #[arg(long, requires = "calibrate")]
    height: Option<usize>,
    /// Write nothing; list everything that keeps these weights from being imported
    #[arg(long)]
    check: bool,
    /// Model file to write
    #[arg(short, long, required_unless_present = "check")]
    output: Option<PathBuf>,
}

impl Import {
    /// Says something, where the model itself does not go.
    fn say(&self, line: &str) {
        match self.output.as_deref().is_some_and(output::is_stdout) {
            true => say::err(line),
            false => say::out(line),
        }
    }
}

/// A share of a whole, from the command line.
fn share(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err(format!("expected a number from 0 to 1, found '{text}'")),
    }
}

/// Runs `edgecap model import`.
///
/// # Errors
/// Weights that cannot be read or do not fit the network, and an output that cannot be written.
pub fn import(a: &Import) -> Result<()> {
    Apart::default()
        .reads("WEIGHTS", &a.weights)
        .may_read("--stage2", a.stage2.as_deref())
        .may_read("--association", a.association.as_deref())
        .may_read("--arch", described(&a.arch))
        .may_read("--calibrate", a.calibrate.as_deref())
        .may_write("--output", a.output.as_deref())
        .check()?;
    let place =
        |output: &PathBuf| output::try_place(output).map_err(|e| Failure::output(output, &e));
    let place = a.output.as_ref().map_or(Ok(()), place);
    let Some(output) = a.output.as_ref().filter(|_| !a.check) else {
        return check(a, place);
    };
    // Before work that could not be kept.
    place?;
    let name = || a.weights.display().to_string();
    let mut model = Model::from_any(&read(&a.weights)?, network(&a.arch)?).with_context(name)?;
    if model.is_quantised() {
        refuse_rounded(a)?;
    }
    if let Some(path) = &a.stage2 {
        model = model
            .with_stage2(&read(path)?)
            .with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &a.association {
        model = model.with_association(association(path)?);
    }
    let model = match &a.calibrate {
        None => model.quantise(None)?,
        Some(folder) => calibrated(a, model, folder)?,
    };
    // What no engine runs is of no use to anybody.
    tried(&model).with_context(|| format!("{} cannot be run", a.weights.display()))?;
    model.save(output).map_err(|e| match e {
        ModelError::Io { source, .. } => Failure::output(output, &source).into(),
        e => anyhow::Error::from(e),
    })?;
    a.say(&format!(
        "{} written: {}",
        output.display(),
        model.calibration()
    ));
    a.say(&format!(
        "blake3 of the file {}",
        blake3::hash(&model.to_bytes()?)
    ));
    Ok(())
}

/// Photos of a folder, and the width and height that they are to be calibrated at.
fn sized(a: &Import, model: &Model, folder: &Path) -> Result<(Vec<PathBuf>, (usize, usize))> {
    let files = pictures(folder, a.pictures as usize)?;
    // They are decoded here for their sizes, and twice later for their pixels: all at once they would fill the memory.
    let sizes = files.iter().map(|path| {
        let picture = picture::upright(path)?;
        Ok((picture.width, picture.height))
    });
    let (widths, heights): (Vec<u32>, Vec<u32>) =
        sizes.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    let reference = model.contract().input.reference_size;
    let step = Maps::step(&[model.network().input().multiple]);
    let side = |sides, most| usual_side(sides, most, step);
    let size = (
        a.width.unwrap_or_else(|| side(widths, reference[0])),
        a.height.unwrap_or_else(|| side(heights, reference[1])),
    );
    Ok((files, size))
}

/// Whether weights could be calibrated on the photos of a folder, without doing it.
fn check_calibration(a: &Import, model: Option<&Model>, folder: &Path) -> Result<()> {
    let Some(model) = model else {
        return pictures(folder, a.pictures as usize).map(drop);
    };
    let (_, size) = sized(a, model, folder)?;
    Ok(Calibration::engine(model, size).map(drop)?)
}

/// The model, rounded by what it does on pictures of a folder.
fn calibrated(a: &Import, model: Model, folder: &Path) -> Result<Model> {
    let (files, size) = sized(a, &model, folder)?;
    let options = CalibrationOptions {
        size,
        own_ranges: a.own_ranges,
        correct_bias: !a.no_bias_correction,
        choice: a.range,
    };
    let lost = Cell::new(None);
    // Scaled when they are asked for: by then the size is known to suit the network.
    let inputs = files.iter().map_while(|path| match picture::upright(path) {
        Ok(picture) => Some(picture::covering(&picture, size)),
        Err(e) => {
            lost.set(Some(e));
            None
        }
    });
    let seen = Calibration::observe(&model, inputs, options);
    if let Some(e) = lost.take() {
        return Err(e.into());
    }
    let mut calibration = seen?;
    if a.try_ranges {
        select(a, &mut calibration, &model, &files, size)?;
    }
    Ok(model.quantise(Some(&calibration))?)
}

/// What asks for another Stage I, or for nothing, of a model file.
fn refuse_rounded(a: &Import) -> Result<()> {
    let name = a.weights.display();
    if a.calibrate.is_some() {
        let why = format!(
            "expected float weights to calibrate, found {name}, whose weights are rounded: leave out --calibrate and \
             --try-ranges, or give the weights that it was made of"
        );
        return Err(Failure::usage(why).into());
    }
    if a.stage2.is_none() && a.association.is_none() {
        let why = format!(
            "expected --stage2 or --association to change {name}, found neither: its weights are rounded already"
        );
        return Err(Failure::usage(why).into());
    }
    Ok(())
}

/// Settings of the association, whole and in bounds.
fn association(path: &Path) -> Result<String> {
    let text = text(path)?;
    match AssociationConfig::parse(&text) {
        Ok(_) => Ok(text),
        Err(e) => Err(Mistake::refused(&path.display().to_string(), &text, &e).into()),
    }
}

/// Lists everything that keeps weights from being imported, what keeps the model from its `place` as well.
fn check(a: &Import, place: Result<(), Failure>) -> Result<()> {
    let network = network(&a.arch)?;
    let name = || a.weights.display().to_string();
    let bytes = read(&a.weights)?;
    let mut wrong = Vec::new();
    let mut model = None;
    let is_whole = Model::is_model_file(&bytes).with_context(name)?;
    if is_whole {
        model = Some(Model::from_bytes(&bytes).with_context(name)?);
        refuse_rounded(a)?;
    } else {
        let found = Model::mismatches(&bytes, &network).with_context(name)?;
        let arch = format!("--arch {}", a.arch);
        wrong.extend(listed(&a.weights, network.name(), &arch, &found));
        if found.is_empty() {
            model = Some(Model::from_safetensors(&bytes, network.clone()).with_context(name)?);
        }
    }
    let calibration = a
        .calibrate
        .as_ref()
        .map(|folder| check_calibration(a, model.as_ref(), folder));
    let has_ranges = model
        .as_ref()
        .is_some_and(|m| m.clone().quantise(None).is_ok());
    let runs = model.map(|model| {
        let ranges = (!has_ranges).then(|| some_ranges(&model));
        tried(&model.quantise(ranges.as_ref())?).map(drop)
    });
    let runs = runs.transpose();
    let runs = runs.with_context(|| format!("{} cannot be run", a.weights.display()));
    if let Some(path) = &a.stage2 {
        let found = Model::stage2_mismatches(&read(path)?);
        let found = found.with_context(|| path.display().to_string())?;
        wrong.extend(listed(path, "Stage II", "--stage2", &found));
    }
    let association = a.association.as_ref().map(|path| association(path));
    let errors = [
        runs.err(),
        association.transpose().err(),
        calibration.transpose().err(),
        place.err().map(Into::into),
    ];
    let mut errors: Vec<_> = errors.into_iter().flatten().collect();
    // With the exit code that an import would have.
    if wrong.is_empty() && errors.len() == 1 {
        return Err(errors.remove(0));
    }
    wrong.extend(errors.iter().map(told));
    if !wrong.is_empty() {
        return Err(Failure::data(wrong.join("; ")).into());
    }
    if is_whole {
        say::out(&format!(
            "{} can be changed so; its Stage I stays bit for bit",
            a.weights.display()
        ));
        return Ok(());
    }
    let ranges = match (&a.calibrate, has_ranges) {
        (Some(folder), _) => {
            let folder = folder.display();
            format!("activation ranges can be found on the pictures of {folder}")
        }
        (None, true) => "activation ranges are in its metadata".to_owned(),
        (None, false) => "activation ranges must be found on pictures (--calibrate DIR)".to_owned(),
    };
    say::out(&format!(
        "{} can be imported as {}; {ranges}",
        a.weights.display(),
        network.name()
    ));
    Ok(())
}

/// Ranges as of activations up to 1, for an engine that shows no more than whether it can be built.
fn some_ranges(model: &Model) -> Calibration {
    let values = model.network().graph().values.iter();
    let observed = values.map(|value| {
        let mut observed = Observed::new(value.channels);
        observed.add(&vec![1.0; value.channels]);
        observed
    });
    Calibration {
        observed: observed.collect(),
        choice: RangeChoice::Max,
        own_ranges: 0.0,
        correct_bias: false,
        pictures: 1,
        left_out: 0,
    }
}

/// Lists what keeps a file of weights from being imported: what to say of all of it, `None` where there is nothing.
/// `kind` is what `model contract` is to be asked for.
fn listed(path: &Path, whose: &str, kind: &str, found: &[ModelError]) -> Option<String> {
    let path = path.display();
    for e in found {
        say::out(&format!("{path}: {e}"));
    }
    let count = counted(found.len() as u64, "mismatch", "mismatches");
    (!found.is_empty()).then(|| {
        format!(
            "{path}: expected weights of {whose}, found {count}, listed above; `edgecap model contract {kind}` prints \
             what their metadata must say"
        )
    })
}

/// The median of pictures' sides in multiples of `step`, at most `most` or, where that is none, the next one.
fn usual_side(mut sides: Vec<u32>, most: usize, step: usize) -> usize {
    sides.sort_unstable();
    let median = sides.get(sides.len() / 2).map_or(most, |&s| s as usize);
    median.min(most).next_multiple_of(step)
}

/// Settles how ranges are chosen by trial on some of the pictures, whole.
fn select(
    a: &Import,
    calibration: &mut Calibration,
    model: &Model,
    files: &[PathBuf],
    size: (usize, usize),
) -> Result<()> {
    let some = files.iter().step_by(files.len().div_ceil(TRIAL_PICTURES));
    let inputs = some.map(|path| Ok(picture::letterboxed(&picture::upright(path)?, size)));
    let inputs = inputs.collect::<Result<Vec<_>>>()?;
    let trials = calibration.select(model, &inputs, size)?;
    a.say("error    range               own  bias corrected");
    for t in trials {
        let choice = t.choice.to_string();
        a.say(&format!(
            "{:.4}   {choice:18}  {:.2}  {}",
            t.error, t.own_ranges, t.correct_bias
        ));
    }
    Ok(())
}

/// At most `most` photos of a folder, evenly spaced in the order in which an input has them.
fn pictures(folder: &Path, most: usize) -> Result<Vec<PathBuf>> {
    if folder.is_file() {
        let words = "expected a folder, found a file";
        let cause = io::Error::new(ErrorKind::NotADirectory, words);
        return Err(Failure::no_input(folder, &cause).into());
    }
    let photos = PhotoSource::folder(folder, None)?;
    let files = photos.files();
    let n = most.min(files.len());
    Ok((0..n).map(|i| files[i * files.len() / n].clone()).collect())
}

//! The stages of `infer`, joined: a frame goes in, observations come out.

use std::path::Path;
use std::time::Instant;

use anyhow::Context;
use edgecap_client::message::{Intrinsics, StageTimes};

use super::exit::Failure;
use crate::capture::{Crop, Frame, Letterbox, Resizer};
use crate::config::Mistake;
use crate::detect::{AssociationConfig, Associator};
use crate::engine::{Engine, EngineOptions, FlipTest, Isa, Maps, Model, Network, Precision};
use crate::follow::Found;
use crate::lift::{Encodings, FrameObservations, Lifter};

/// What to say where no vector kernels run.
pub(super) const SCALAR_ONLY: &str = "only scalar kernels are left, a picture takes seconds: expected a CPU with SSE4.1 or newer (or ARM), or EDGECAP_ISA unset";

/// What to run, and how.
#[derive(Debug, Clone)]
pub struct PipelineOptions<'a> {
    /// Model file, or PyTorch weights of SelecSLS in safetensors, which run in f32; `None` for the shipped one.
    pub model: Option<&'a Path>,
    /// Weights of Stage II (safetensors) in place of the model's own.
    pub stage2: Option<&'a Path>,
    /// Network input width, pixels.
    pub width: usize,
    /// Network input height, pixels.
    pub height: usize,
    /// Nobody has asked for this very input: the nearest that the network takes will do.
    pub nearest: bool,
    /// Threads for the network.
    pub threads: usize,
    /// Whether the network sees every picture's mirror image, too.
    pub flip_test: bool,
}

/// The input nearest to a `size`, pixels across and down, whose sides are multiples of all of these, and whose maps
/// have whole cells.
pub(super) fn nearest(size: (usize, usize), multiples: &[usize]) -> (usize, usize) {
    let step = Maps::step(multiples);
    let side = |n: usize| ((n + step / 2) / step).max(1) * step;
    (side(size.0), side(size.1))
}

/// Letterbox, Stage I, association and Stage II, with their buffers.
pub struct Pipeline {
    engine: Engine,
    /// What sides of the network's input are multiples of.
    multiple: usize,
    flip_test: Option<FlipTest>,
    associator: Associator,
    lifter: Lifter,
    /// For the whole input, of which the engine may take a part.
    resizer: Resizer,
    /// What the engine takes.
    input: Vec<u8>,
    /// Of the last frame: where it lies in what the engine takes, and how long its stages took.
    letterbox: Letterbox,
    times: StageTimes,
}

impl Pipeline {
    /// Loads the model and plans the network.
    ///
    /// # Errors
    /// If the model cannot be read or does not fit the stages.
    pub fn new(options: &PipelineOptions) -> anyhow::Result<Self> {
        let model = open(options.model, options.stage2)?;
        let precision = precision(&model);
        let multiple = model.network().input().multiple;
        let asked = (options.width, options.height);
        let (width, height) = match options.nearest {
            true => nearest(asked, &[multiple]),
            false => asked,
        };
        let engine = Engine::new(
            &model,
            EngineOptions {
                width,
                height,
                threads: options.threads,
                precision,
                ..EngineOptions::default()
            },
        )?;
        let (started, wanted) = (engine.threads(), options.threads.max(1));
        if started < wanted {
            tracing::warn!(
                "{started} of {wanted} threads could be started: raise TasksMax= of the service, or set fewer threads"
            );
        }
        let isa = engine.isa();
        if isa == Isa::Scalar {
            tracing::warn!("{SCALAR_ONLY}");
        }
        tracing::info!(
            isa = isa.name(),
            ?precision,
            // Without --size inputs follow the pictures' shape: this one may never be used.
            width = (!options.nearest).then_some(width),
            height = (!options.nearest).then_some(height),
            threads = options.threads,
            "stages built"
        );
        let resizer = Resizer::new(width as u32, height as u32);
        Ok(Self {
            associator: Associator::new(association(&model)?),
            lifter: lifter(&model, isa)?,
            input: vec![0; resizer.output_bytes()],
            resizer,
            engine,
            multiple,
            flip_test: options.flip_test.then(FlipTest::default),
            letterbox: Letterbox::fit(1, 1, 1, 1),
            times: StageTimes::default(),
        })
    }

    /// The stages for another network input, or the nearest to it that the network takes, which share packed weights
    /// and threads with these.
    ///
    /// # Errors
    /// If the network does not take this size.
    pub fn resized(&self, width: usize, height: usize) -> anyhow::Result<Self> {
        let (width, height) = nearest((width, height), &[self.multiple]);
        let resizer = Resizer::new(width as u32, height as u32);
        self.sharing((width, height), resizer)
    }

    /// The stages for crops of this input, so many pixels across and down, which share packed weights and threads with
    /// these.
    ///
    /// # Errors
    /// If the network does not take this size.
    pub fn for_crops(&self, width: usize, height: usize) -> anyhow::Result<Self> {
        self.sharing((width, height), self.resizer.clone())
    }

    /// The stages for an engine of this size, pixels across and down.
    fn sharing(&self, (width, height): (usize, usize), resizer: Resizer) -> anyhow::Result<Self> {
        Ok(Self {
            engine: self.engine.resized(width, height)?,
            multiple: self.multiple,
            flip_test: self.flip_test.as_ref().map(|_| FlipTest::default()),
            associator: self.associator.clone(),
            lifter: self.lifter.clone(),
            input: vec![0; 3 * width * height],
            resizer,
            letterbox: self.letterbox,
            times: StageTimes::default(),
        })
    }

    /// The whole input, pixels across and down, also where these stages are for crops of it.
    pub fn size(&self) -> (usize, usize) {
        let whole = self.resizer.whole();
        (whole.width, whole.height)
    }

    /// What sides of inputs, and places of crops of them, are multiples of.
    pub fn step(&self) -> usize {
        Maps::step(&[self.multiple])
    }

    /// Everyone in the frame.
    ///
    /// # Errors
    /// If a kernel refuses its tensors, which would be a fault of this program.
    ///
    /// # Panics
    /// When these stages are for crops.
    pub fn process(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
    ) -> anyhow::Result<FrameObservations<'_>> {
        let whole = self.resizer.whole();
        self.process_crop(frame, intrinsics, whole)
    }

    /// Everyone in a part of the frame: `crop` of the whole input, of the size that these stages are for.
    ///
    /// # Errors
    /// As [`process`](Self::process).
    ///
    /// # Panics
    /// When the crop is of another size or not within the input.
    pub fn process_crop(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
        crop: Crop,
    ) -> anyhow::Result<FrameObservations<'_>> {
        let start = Instant::now();
        let letterbox = self.resizer.run_crop(frame, crop, &mut self.input);
        let letterboxed = Instant::now();
        let maps = match &mut self.flip_test {
            Some(both) => both.run(&mut self.engine, &self.input),
            None => self.engine.run(&self.input),
        };
        let inferred = Instant::now();
        let detections = self.associator.associate(maps);
        let associated = Instant::now();
        self.lifter
            .lift(detections, frame, &letterbox, intrinsics)?;
        let lifted = Instant::now();
        self.letterbox = letterbox;
        let us = |a: Instant, b: Instant| (b - a).as_micros() as u32;
        self.times = StageTimes {
            preprocess_us: us(start, letterboxed),
            stage1_us: us(letterboxed, inferred),
            association_us: us(inferred, associated),
            stage2_us: us(associated, lifted),
        };
        Ok(self.seen())
    }

    /// From now on so many threads share a frame, in all pipelines that share them.
    pub fn use_threads(&self, threads: usize) {
        self.engine.use_threads(threads);
    }

    /// Least probability, with these weights, of somebody whom one of two looks shows alone.
    pub fn lone_score(&self) -> f32 {
        self.associator.config().lone_score
    }

    /// Most people that are reported with these weights.
    pub fn max_people(&self) -> usize {
        self.associator.config().max_people
    }

    /// Everyone in the last frame before lifting.
    pub fn found(&self) -> Found<'_> {
        Found {
            people: self.associator.found(),
            letterbox: self.letterbox,
            without_neck: self.associator.without_neck(),
        }
    }

    /// Stage II.
    pub fn lifter(&self) -> &Lifter {
        &self.lifter
    }

    /// Everyone in the last frame.
    pub fn seen(&self) -> FrameObservations<'_> {
        FrameObservations {
            people: self.lifter.lifted(),
            without_neck: self.associator.without_neck(),
            times: self.times,
        }
    }
}

/// Reads a model and weights that are named as the stages would.
///
/// # Errors
/// If they cannot be read or do not fit the stages.
pub fn expect_model(model: Option<&Path>, stage2: Option<&Path>) -> anyhow::Result<()> {
    if model.is_none() && stage2.is_none() {
        return Ok(());
    }
    let model = open(model, stage2)?;
    association(&model)?;
    lifter(&model, Isa::Scalar)?;
    let options = EngineOptions {
        precision: precision(&model),
        ..usual(&[model.network().input().multiple])
    };
    Engine::new(&model, options)?;
    Ok(())
}

/// The engine's usual options, at the nearest input to the usual one whose sides are multiples of all of these.
pub(super) fn usual(multiples: &[usize]) -> EngineOptions {
    let options = EngineOptions::default();
    let (width, height) = nearest((options.width, options.height), multiples);
    EngineOptions {
        width,
        height,
        ..options
    }
}

fn precision(model: &Model) -> Precision {
    match model.is_quantised() {
        true => Precision::Int8,
        false => Precision::F32,
    }
}

fn open(model: Option<&Path>, stage2: Option<&Path>) -> anyhow::Result<Model> {
    let named = |path: &Path| format!("model {}", path.display());
    let model = match model {
        Some(path) => {
            Model::open_any(path, Network::shipped("selecsls")?).with_context(|| named(path))?
        }
        None => Model::shipped()?,
    };
    match stage2 {
        Some(path) => {
            let bytes = crate::bounded::read(path, crate::bounded::DATA)
                .map_err(|e| Failure::no_input(path, &e))?;
            model
                .with_stage2(&bytes)
                .with_context(|| format!("Stage II weights {}", path.display()))
        }
        None => Ok(model),
    }
}

/// The settings of the association that are fitted to this model.
///
/// # Errors
/// When those in its file are none.
pub(super) fn association(model: &Model) -> Result<AssociationConfig, Failure> {
    AssociationConfig::of(model).map_err(|e| {
        let text = model.association().unwrap_or_default();
        let mistake = Mistake::refused("the model's settings of the association", text, &e);
        Failure::data(format!("{mistake}; import the model again"))
    })
}

fn lifter(model: &Model, isa: Isa) -> anyhow::Result<Lifter> {
    let stage2 = model.stage2().ok_or_else(|| {
        Failure::data("the model has no Stage II: give --stage2 FILE.safetensors")
    })?;
    let encodings = if model.encodings_trained() {
        Encodings::Read
    } else {
        Encodings::Zero
    };
    Ok(Lifter::new(&stage2.layers, encodings, isa)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_the_nearest_that_the_network_takes() {
        assert_eq!(nearest((512, 320), &[16]), (512, 320));
        assert_eq!(nearest((384, 240), &[32]), (384, 256));
        assert_eq!(nearest((512, 320), &[48]), (528, 336));
        // Maps are an eighth as large.
        assert_eq!(nearest((512, 320), &[12]), (504, 312));
        assert_eq!(nearest((256, 160), &[512]), (512, 512));
        assert_eq!(nearest((512, 320), &[16, 24]), (528, 336));
    }
}

//! The stages of `infer`, joined: a frame goes in, observations come out.

use std::path::Path;
use std::time::Instant;

use edgecap_client::message::{Intrinsics, Observation, StageTimes};

use crate::capture::{Frame, Letterbox};
use crate::detect::{AssociationConfig, Associator};
use crate::engine::{Engine, EngineOptions, Model, Precision};
use crate::lift::Lifter;

/// What to run, and how.
#[derive(Debug, Clone)]
pub struct PipelineOptions<'a> {
    /// Model file; `None` for the shipped one.
    pub model: Option<&'a Path>,
    /// Network input width, pixels.
    pub width: usize,
    /// Network input height, pixels.
    pub height: usize,
    /// Threads for the network.
    pub threads: usize,
}

/// Letterbox, Stage I, association and Stage II, with their buffers.
#[derive(Debug)]
pub struct Pipeline {
    engine: Engine,
    associator: Associator,
    lifter: Lifter,
    input: Vec<u8>,
    width: usize,
    height: usize,
}

/// Everyone seen in a frame.
#[derive(Debug)]
pub struct Seen<'a> {
    /// The people, by falling score.
    pub people: &'a [Observation],
    /// People left out because their neck was not found.
    pub without_neck: u32,
    /// Time spent per stage.
    pub times: StageTimes,
}

impl Pipeline {
    /// Loads the model and plans the network.
    ///
    /// # Errors
    /// If the model cannot be read or does not fit the stages.
    pub fn new(options: &PipelineOptions) -> anyhow::Result<Self> {
        let model = match options.model {
            Some(path) => Model::open(path)?,
            None => Model::shipped()?,
        };
        let engine = Engine::new(
            &model,
            EngineOptions {
                width: options.width,
                height: options.height,
                threads: options.threads,
                precision: Precision::Int8,
                ..EngineOptions::default()
            },
        )?;
        let lifter = Lifter::from_model(&model)?;
        Ok(Self {
            engine,
            associator: Associator::new(AssociationConfig::default()),
            lifter,
            input: vec![0; 3 * options.width * options.height],
            width: options.width,
            height: options.height,
        })
    }

    /// Instruction set, threads and input size, for the log.
    pub fn describe(&self) -> String {
        self.engine.describe()
    }

    /// Everyone in the frame.
    ///
    /// # Errors
    /// If the frame's buffer does not match its size.
    pub fn process(&mut self, frame: &Frame, intrinsics: &Intrinsics) -> anyhow::Result<Seen<'_>> {
        let start = Instant::now();
        let letterbox = Letterbox::fit(frame.width as usize, frame.height as usize, self.width, self.height);
        letterbox.resize(frame, &mut self.input, self.width, self.height);
        let letterboxed = Instant::now();
        let maps = self.engine.run(&self.input)?;
        let inferred = Instant::now();
        let detections = self.associator.associate(maps);
        let associated = Instant::now();
        let people = self.lifter.lift(detections, frame, &letterbox, intrinsics);
        let lifted = Instant::now();
        let us = |a: Instant, b: Instant| (b - a).as_micros() as u32;
        Ok(Seen {
            people,
            without_neck: self.associator.without_neck(),
            times: StageTimes {
                preprocess_us: us(start, letterboxed),
                stage1_us: us(letterboxed, inferred),
                association_us: us(inferred, associated),
                stage2_us: us(associated, lifted),
            },
        })
    }
}

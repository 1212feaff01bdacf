//! Several looks at every picture, at sizes that fit its shape, joined.

use edgecap_client::message::{Intrinsics, Observation, StageTimes};

use super::engine_args::EngineArgs;
use super::inputs::fitted;
use crate::capture::Frame;
use crate::commands::pipeline::{FrameObservations, Pipeline};
use crate::detect::joined;

/// Shapes of pictures whose stages are kept: each has its buffers.
const SHAPES: usize = 4;

/// The stages for every look, by the shape of the picture.
pub struct Looks {
    /// Of a landscape picture; has the weights and threads that the others share.
    first: Pipeline,
    lone_score: f32,
    max_people: usize,
    /// The stages of each look by the sizes of their inputs; those used last at the end.
    built: Vec<Shape>,
    people: Vec<Observation>,
}

struct Shape {
    sizes: Vec<(usize, usize)>,
    stages: Vec<Pipeline>,
}

impl Looks {
    /// Loads the model.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn new(engine: &EngineArgs) -> anyhow::Result<Self> {
        let first = engine.build_near(fitted((16, 10), 0.5))?;
        Ok(Self {
            lone_score: first.lone_score(),
            max_people: first.max_people(),
            first,
            built: Vec::new(),
            people: Vec::new(),
        })
    }

    /// From now on so many threads share a picture.
    pub fn use_threads(&self, threads: usize) {
        self.first.use_threads(threads);
    }

    /// Everyone in the frame, by looks with inputs of these `sizes` (pixels across and down), one or two.
    ///
    /// # Errors
    /// As [`Pipeline::process`].
    pub fn process(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
        sizes: Vec<(usize, usize)>,
    ) -> anyhow::Result<FrameObservations<'_>> {
        let shape = shape(&mut self.built, &self.first, sizes)?;
        let mut times = StageTimes::default();
        let mut without_neck = 0;
        for stages in &mut shape.stages {
            let seen = stages.process(frame, intrinsics)?;
            times = sum(times, seen.times);
            without_neck = without_neck.max(seen.without_neck);
        }
        match &shape.stages[..] {
            [one] => {
                self.people.clear();
                self.people.extend_from_slice(one.seen().people);
            }
            [small, large, ..] => {
                let looks = [small.seen().people, large.seen().people];
                joined(looks, self.lone_score, self.max_people, &mut self.people);
            }
            [] => self.people.clear(),
        }
        Ok(FrameObservations {
            people: &self.people,
            without_neck,
            times,
        })
    }
}

/// The times of two looks at one picture.
pub fn sum(a: StageTimes, b: StageTimes) -> StageTimes {
    StageTimes {
        preprocess_us: a.preprocess_us + b.preprocess_us,
        stage1_us: a.stage1_us + b.stage1_us,
        association_us: a.association_us + b.association_us,
        stage2_us: a.stage2_us + b.stage2_us,
    }
}

/// The stages for inputs of these sizes: those there are, or new ones in place of those not used for longest.
fn shape<'a>(
    built: &'a mut Vec<Shape>,
    first: &Pipeline,
    sizes: Vec<(usize, usize)>,
) -> anyhow::Result<&'a mut Shape> {
    let shape = match built.iter().position(|s| s.sizes == sizes) {
        Some(k) => built.remove(k),
        None => {
            if built.len() == SHAPES {
                built.remove(0);
            }
            let stages = sizes.iter().map(|&(w, h)| first.resized(w, h));
            Shape {
                stages: stages.collect::<Result<_, _>>()?,
                sizes,
            }
        }
    };
    built.push(shape);
    Ok(built.last_mut().expect("one was pushed"))
}

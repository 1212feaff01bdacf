//! Several looks at every picture, at sizes that fit its shape and turned for those who lie in it, joined.

use edgecap_client::message::{Intrinsics, Observation, StageTimes};

use super::engine_args::EngineArgs;
use super::shapes::Shapes;
use super::turned::Turned;
use crate::capture::Frame;
use crate::commands::pipeline::Pipeline;
use crate::detect::joined;
use crate::lift::FrameObservations;

/// The stages for every look, by the shape of the picture.
pub struct Looks {
    shapes: Shapes,
    turned: Turned,
    /// What the last picture showed and took: [`FrameObservations`].
    people: Vec<Observation>,
    without_neck: u32,
    times: StageTimes,
    /// Whether the last picture was looked at on its side, too.
    has_turned: bool,
    /// The larger input of the last looks, pixels across and down; zeros before the first.
    input: (usize, usize),
}

impl Looks {
    /// Loads the model, for a `film` (or camera), whose pictures follow each other, or for photos.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn new(engine: &EngineArgs, film: bool) -> anyhow::Result<Self> {
        Ok(Self {
            shapes: Shapes::new(engine)?,
            turned: Turned::new(film),
            people: Vec::new(),
            without_neck: 0,
            times: StageTimes::default(),
            has_turned: false,
            input: (0, 0),
        })
    }

    /// From now on so many threads share a picture.
    pub fn use_threads(&self, threads: usize) {
        self.shapes.any().use_threads(threads);
    }

    /// The network's input of the last looks, of two the larger, pixels across and down; zeros before the first.
    pub fn input(&self) -> (usize, usize) {
        self.input
    }

    /// Whether the last picture was looked at on its side, too, which takes longer than others.
    pub fn has_turned(&self) -> bool {
        self.has_turned
    }

    /// Looks for everyone in the frame, by `count` looks, one or two, with the first of inputs of these `sizes`
    /// (pixels across and down): the others stay ready for the next frames. After two looks the picture is turned for
    /// those who lie in it, and where nobody was found; that of a film when that is worth it.
    ///
    /// # Errors
    /// As [`Pipeline::process`].
    pub fn process(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
        sizes: Vec<(usize, usize)>,
        count: usize,
    ) -> anyhow::Result<()> {
        let any = self.shapes.any();
        let (lone_score, max_people) = (any.lone_score(), any.max_people());
        let stages = self.shapes.of(sizes)?;
        let count = count.min(stages.len());
        let stages = &mut stages[..count];
        self.input = stages.iter().map(Pipeline::size).max().unwrap_or_default();
        self.has_turned = false;
        let mut times = StageTimes::default();
        let mut without_neck = 0;
        for look in stages.iter_mut() {
            let seen = look.process(frame, intrinsics)?;
            times = sum(times, seen.times);
            without_neck = without_neck.max(seen.without_neck);
        }
        match stages {
            [one] => {
                self.people.clear();
                self.people.extend_from_slice(one.seen().people);
            }
            [small, large, ..] => {
                let looks = [small.seen().people, large.seen().people];
                joined(looks, lone_score, max_people, &mut self.people);
                let (people, shapes) = (&mut self.people, &mut self.shapes);
                let turned = self.turned.join(frame, intrinsics, shapes, people)?;
                self.has_turned = turned.has_looked;
                times = sum(times, turned.times);
            }
            [] => self.people.clear(),
        }
        (self.without_neck, self.times) = (without_neck, times);
        Ok(())
    }

    /// Whom the last looks showed, and what all of them took.
    pub fn seen(&self) -> FrameObservations<'_> {
        FrameObservations {
            people: &self.people,
            without_neck: self.without_neck,
            times: self.times,
        }
    }

    /// For how many shapes there are stages.
    #[cfg(test)]
    pub fn shapes(&self) -> usize {
        self.shapes.count()
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

//! The stages at every size that pictures ask for.

use std::time::Instant;

use edgecap_client::message::{Intrinsics, Observation};

use super::crew::Crew;
use super::engine_args::EngineArgs;
use super::inputs::{Inputs, inputs_of, turned};
use super::looks::Looks;
use super::speed::Speed;
use super::zoom::{INPUTS, Zoom, stature};
use crate::camera::monotonic_ns;
use crate::capture::Frame;
use crate::commands::pipeline::{FrameObservations, Pipeline};

/// The stages for every input that pictures may ask for. All share one set of packed weights and one team of threads.
pub struct Pipelines {
    stages: Stages,
    speed: Speed,
    crew: Crew,
}

enum Stages {
    Fixed(Box<Pipeline>),
    Looks(Box<Looks>, [&'static [f32]; 2]),
    Following(Box<Following>),
}

/// The input that follows the people in view.
struct Following {
    /// By orientation (upright second: people in an upright picture would be small in an input that lies), of each of
    /// [`INPUTS`].
    built: [Vec<Pipeline>; 2],
    /// The largest of [`INPUTS`] that is wanted.
    largest: usize,
    zoom: Zoom,
    /// How tall people are by the present input and by another, pixels of the largest one.
    here: Vec<f32>,
    elsewhere: Vec<f32>,
}

impl Following {
    fn new(engine: &EngineArgs, largest: usize) -> anyhow::Result<Self> {
        let first = engine.build_near(INPUTS[0])?;
        let rest = INPUTS[1..].iter().map(|&(w, h)| first.resized(w, h));
        let rest: Vec<_> = rest.collect::<Result<_, _>>()?;
        let upright = INPUTS.iter().map(|&(w, h)| first.resized(h, w));
        let upright = upright.collect::<Result<_, _>>()?;
        let landscape = std::iter::once(first).chain(rest).collect();
        Ok(Self {
            built: [landscape, upright],
            largest,
            zoom: Zoom::default(),
            here: Vec::new(),
            elsewhere: Vec::new(),
        })
    }
}

impl Pipelines {
    /// Builds them. The input of a `film` follows the people in view unless something else is asked for; where pictures
    /// may take only `target` seconds each, no such input is larger than the machine has time for.
    ///
    /// # Errors
    /// As [`Pipeline::new`] and [`EngineArgs::inputs`].
    pub fn new(engine: &EngineArgs, film: bool, target: Option<f32>) -> anyhow::Result<Self> {
        let stages = match engine.inputs(film)? {
            Inputs::Fixed(size) => Stages::Fixed(Box::new(engine.build(size)?)),
            Inputs::Following(largest) => {
                Stages::Following(Box::new(Following::new(engine, largest)?))
            }
            Inputs::Looks(shares) => Stages::Looks(Box::new(Looks::new(engine)?), shares),
        };
        Ok(Self {
            stages,
            speed: Speed::new(target),
            crew: Crew::new(engine.most_threads(), !film || engine.threads.is_some()),
        })
    }

    /// Everyone in the frame.
    ///
    /// # Errors
    /// As [`Pipeline::process`].
    pub fn process(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
    ) -> anyhow::Result<FrameObservations<'_>> {
        let Self {
            stages,
            speed,
            crew,
        } = self;
        let threads = crew.threads();
        let took = |crew: &mut Crew, now, level, us| {
            if let Some(change) = crew.took(now, level, seconds(us)) {
                tracing::info!("{}", change.line());
            }
        };
        let following = match stages {
            Stages::Fixed(one) => {
                one.use_threads(threads);
                let seen = one.process(frame, intrinsics)?;
                took(crew, monotonic_ns(), 0, seen.times.stage1_us);
                return Ok(seen);
            }
            Stages::Looks(looks, shares) => {
                looks.use_threads(threads);
                let sizes = inputs_of(size_of(frame), *shares);
                let seen = looks.process(frame, intrinsics, sizes)?;
                took(crew, monotonic_ns(), 0, seen.times.stage1_us);
                return Ok(seen);
            }
            Stages::Following(following) => following,
        };
        let Following {
            built,
            largest,
            zoom,
            here,
            elsewhere,
        } = &mut **following;
        let upright = frame.height > frame.width;
        let built = &mut built[usize::from(upright)];
        built[0].use_threads(threads);
        let heights = heights_in(frame, upright);
        let other = zoom.look_elsewhere(frame.time_ns);
        if let Some(level) = other {
            heights(built[level].process(frame, intrinsics)?.people, elsewhere);
        }
        zoom.limit(speed.limit().max(*largest));
        let level = zoom.level();
        let start = Instant::now();
        let seen = built[level].process(frame, intrinsics)?;
        let now = monotonic_ns();
        if !crew.is_trying() {
            let whole = start.elapsed().as_secs_f32();
            if let Some(slower) = speed.took(now, level, whole) {
                tracing::warn!("{}", slower.line());
            }
        }
        took(crew, now, level, seen.times.stage1_us);
        heights(seen.people, here);
        zoom.seen(frame.time_ns, here, other.map(|_| &elsewhere[..]));
        if zoom.level() != level {
            tracing::debug!(?here, ?elsewhere, input = ?INPUTS[zoom.level()], "another input");
        }
        Ok(seen)
    }

    /// Looks whether anybody is in the frame: with the smallest input, and if that shows nobody and `large`, with the
    /// largest.
    ///
    /// # Errors
    /// As [`Pipeline::process`].
    pub fn look(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
        large: bool,
    ) -> anyhow::Result<FrameObservations<'_>> {
        let upright = frame.height > frame.width;
        let following = match &mut self.stages {
            Stages::Fixed(one) => return one.process(frame, intrinsics),
            Stages::Looks(looks, shares) => {
                let mut sizes = inputs_of(size_of(frame), *shares);
                if !large {
                    sizes.truncate(1);
                }
                return looks.process(frame, intrinsics, sizes);
            }
            Stages::Following(following) => following,
        };
        let Following {
            built,
            largest,
            zoom,
            elsewhere,
            ..
        } = &mut **following;
        let built = &mut built[usize::from(upright)];
        let smallest = built.len() - 1;
        let people = built[smallest].process(frame, intrinsics)?.people;
        if people.is_empty() && large && *largest < smallest {
            return built[*largest].process(frame, intrinsics);
        }
        heights_in(frame, upright)(people, elsewhere);
        zoom.seen(frame.time_ns, &[], Some(elsewhere));
        Ok(built[smallest].seen())
    }
}

/// Pixels across and down.
fn size_of(frame: &Frame) -> (usize, usize) {
    (frame.width as usize, frame.height as usize)
}

fn seconds(us: u32) -> f32 {
    us as f32 * 1e-6
}

/// How tall people are, pixels of the largest input.
fn heights_in(frame: &Frame, upright: bool) -> impl Fn(&[Observation], &mut Vec<f32>) {
    let (w, h) = turned(INPUTS[0], upright);
    let scale = (w as f32 / frame.width as f32).min(h as f32 / frame.height as f32);
    move |people, out| {
        out.clear();
        out.extend(people.iter().filter_map(stature).map(|s| s * scale));
    }
}

//! The stages at every size that pictures ask for.

use std::time::Instant;

use edgecap_client::message::{Intrinsics, Observation};

use super::crew::Crew;
use super::engine_args::{EngineArgs, turned};
use super::speed::Speed;
use super::zoom::{INPUTS, Zoom, stature};
use crate::camera::monotonic_ns;
use crate::capture::Frame;
use crate::commands::pipeline::{FrameObservations, Pipeline};

/// The stages for every input that pictures may ask for, made before the first of them: people in an upright picture
/// would be small in a network input that lies. All share one set of packed weights and one team of threads.
pub struct Pipelines<'a> {
    engine: &'a EngineArgs,
    /// By orientation (upright second; alone where the size is fixed) and, where the input follows the people in view,
    /// its size.
    built: Vec<Vec<Pipeline>>,
    following: Option<Following>,
    speed: Speed,
    crew: Crew,
}

/// The input that follows the people in view.
#[derive(Default)]
struct Following {
    zoom: Zoom,
    /// How tall people are by the present input and by another, pixels of the largest one.
    here: Vec<f32>,
    elsewhere: Vec<f32>,
}

impl<'a> Pipelines<'a> {
    /// Builds them all. The input of a `film` follows the people in view unless it is fixed; where pictures may take
    /// only `target` seconds each, no input is larger than the machine has time for.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn new(engine: &'a EngineArgs, film: bool, target: Option<f32>) -> anyhow::Result<Self> {
        let follows = film && !engine.is_fixed();
        let orientations = if engine.is_fixed() { 1 } else { 2 };
        let mut built: Vec<Vec<Pipeline>> = Vec::new();
        for upright in [false, true].into_iter().take(orientations) {
            let mut sizes = Vec::new();
            for size in engine.sizes(upright, follows) {
                let first = built.first().and_then(|sizes| sizes.first());
                sizes.push(match first.or(sizes.first()) {
                    Some(first) => first.resized(size.0, size.1)?,
                    None => engine.build(size)?,
                });
            }
            built.push(sizes);
        }
        Ok(Self {
            engine,
            built,
            following: follows.then(Following::default),
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
        let upright = frame.height > frame.width && !self.engine.is_fixed();
        let built = &mut self.built[usize::from(upright)];
        built[0].use_threads(self.crew.threads());
        let Some(Following {
            zoom,
            here,
            elsewhere,
        }) = &mut self.following
        else {
            let seen = built[0].process(frame, intrinsics)?;
            let seconds = seconds(seen.times.stage1_us);
            if let Some(change) = self.crew.took(monotonic_ns(), 0, seconds) {
                tracing::info!("{}", change.line());
            }
            return Ok(seen);
        };
        let heights = heights_in(frame, upright);
        let other = zoom.look_elsewhere(frame.time_ns);
        if let Some(level) = other {
            heights(built[level].process(frame, intrinsics)?.people, elsewhere);
        }
        zoom.limit(self.speed.limit());
        let level = zoom.level();
        let start = Instant::now();
        let seen = built[level].process(frame, intrinsics)?;
        let now = monotonic_ns();
        if !self.crew.is_trying() {
            let whole = start.elapsed().as_secs_f32();
            if let Some(slower) = self.speed.took(now, level, whole) {
                tracing::warn!("{}", slower.line());
            }
        }
        let network = seconds(seen.times.stage1_us);
        if let Some(change) = self.crew.took(now, level, network) {
            tracing::info!("{}", change.line());
        }
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
        let upright = frame.height > frame.width && !self.engine.is_fixed();
        let built = &mut self.built[usize::from(upright)];
        let smallest = built.len() - 1;
        let people = built[smallest].process(frame, intrinsics)?.people;
        if people.is_empty() && large && smallest > 0 {
            return built[0].process(frame, intrinsics);
        }
        if let Some(Following {
            zoom, elsewhere, ..
        }) = &mut self.following
        {
            heights_in(frame, upright)(people, elsewhere);
            zoom.seen(frame.time_ns, &[], Some(elsewhere));
        }
        Ok(built[smallest].seen())
    }
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

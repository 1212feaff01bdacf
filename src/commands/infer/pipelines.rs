//! The stages at every size that pictures ask for.

use edgecap_client::message::{Intrinsics, Observation};

use super::engine_args::{EngineArgs, turned};
use super::zoom::{INPUTS, Zoom, stature};
use crate::capture::Frame;
use crate::commands::pipeline::{Pipeline, Seen};

/// The stages, built when the first picture that needs them comes: people in an upright picture would be small in a network input
/// that lies.
pub struct Pipelines<'a> {
    engine: &'a EngineArgs,
    /// By orientation (upright second) and, where the input follows the people in view, its size.
    built: [[Option<Pipeline>; INPUTS.len()]; 2],
    following: Option<Following>,
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
    /// Builds the one for lying pictures, so that a wrong model is told before the first frame. The input of a `film` follows
    /// the people in view unless it is fixed.
    ///
    /// # Errors
    /// As [`Pipeline::new`].
    pub fn new(engine: &'a EngineArgs, film: bool) -> anyhow::Result<Self> {
        let mut built: [[Option<Pipeline>; INPUTS.len()]; 2] = Default::default();
        ready(&mut built[0][0], engine, engine.size_of(false, 0))?;
        Ok(Self {
            engine,
            built,
            following: (film && !engine.is_fixed()).then(Following::default),
        })
    }

    /// Everyone in the frame.
    ///
    /// # Errors
    /// As [`Pipeline::new`] and [`Pipeline::process`].
    pub fn process(&mut self, frame: &Frame, intrinsics: &Intrinsics) -> anyhow::Result<Seen<'_>> {
        let upright = frame.height > frame.width && !self.engine.is_fixed();
        let engine = self.engine;
        let built = &mut self.built[usize::from(upright)];
        let Some(Following {
            zoom,
            here,
            elsewhere,
        }) = &mut self.following
        else {
            return ready(&mut built[0], engine, engine.size_of(upright, 0))?
                .process(frame, intrinsics);
        };
        let (w, h) = turned(INPUTS[0], upright);
        let scale = (w as f32 / frame.width as f32).min(h as f32 / frame.height as f32);
        let heights = |people: &[Observation], out: &mut Vec<f32>| {
            out.clear();
            out.extend(people.iter().filter_map(stature).map(|s| s * scale));
        };
        let other = zoom.look_elsewhere(frame.time_ns);
        if let Some(level) = other {
            let pipeline = ready(&mut built[level], engine, engine.size_of(upright, level))?;
            heights(pipeline.process(frame, intrinsics)?.people, elsewhere);
        }
        let level = zoom.level();
        let pipeline = ready(&mut built[level], engine, engine.size_of(upright, level))?;
        let seen = pipeline.process(frame, intrinsics)?;
        heights(seen.people, here);
        zoom.seen(frame.time_ns, here, other.map(|_| &elsewhere[..]));
        if zoom.level() != level {
            tracing::debug!(?here, ?elsewhere, input = ?INPUTS[zoom.level()], "another input");
        }
        Ok(seen)
    }
}

/// The stages in this place, built if there are none yet.
fn ready<'p>(
    place: &'p mut Option<Pipeline>,
    engine: &EngineArgs,
    size: (usize, usize),
) -> anyhow::Result<&'p mut Pipeline> {
    Ok(match place {
        Some(pipeline) => pipeline,
        None => place.insert(engine.build(size)?),
    })
}

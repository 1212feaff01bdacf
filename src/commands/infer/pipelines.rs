//! The stages at every size that pictures ask for.

use edgecap_client::message::{Intrinsics, Observation, StageTimes};

use super::crops::Crops;
use super::engine_args::EngineArgs;
use super::looks::{Looks, sum};
use super::shapes::Shapes;
use super::turned::Turned;
use crate::camera::monotonic_ns;
use crate::capture::{Crop, Frame, Letterbox};
use crate::commands::pipeline::Pipeline;
use crate::follow::Between;
use crate::lift::FrameObservations;
use crate::machine::throttled;
use crate::schedule::crew::{Change, Crew};
use crate::schedule::inputs::{Inputs, fitted, inputs_of, whole_scale};
use crate::schedule::region::{Input, Region};
use crate::schedule::spacing::{ENOUGH, Spacing};
use crate::schedule::speed::{Slower, Speed};
use crate::schedule::zoom::{SHARES, Zoom, stature};

/// The stages for every input that pictures may ask for. All share one set of packed weights and one team of threads.
pub struct Pipelines {
    stages: Stages,
    speed: Speed,
    crew: Crew,
    /// Where not every picture is looked at.
    between: Option<Between>,
    /// Whether people were followed into the picture that has been chosen for.
    follows: bool,
    /// The network's input of the last look for all of a picture, where looks are not several; pixels across and down,
    /// zeros before the first.
    input: (usize, usize),
    /// What looks are timed by, monotonic nanoseconds.
    clock: Box<dyn Fn() -> u64 + Send>,
}

/// How a picture is gone through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// It is not looked at: people are followed into it.
    Followed,
    /// A part of it is looked at.
    Part,
    /// All of it is.
    Whole,
}

enum Stages {
    Fixed(Box<Pipeline>),
    Looks(Box<Looks>, [&'static [f32]; 2]),
    Following(Box<Following>),
}

/// The input that follows the people in view.
struct Following {
    /// Of the pictures' shape, for each of [`SHARES`].
    shapes: Shapes,
    /// The largest of [`SHARES`] that is wanted.
    largest: usize,
    zoom: Zoom,
    /// The crop of it that shows everybody.
    region: Region,
    crops: Crops,
    /// What `region` knows people in: pixels of pictures of this size, and which of [`SHARES`].
    seen_in: ((usize, usize), usize),
    /// How the next picture is looked at, where that has been chosen.
    choice: Option<Choice>,
    /// Looks at pictures on their side, too, and who is then in them.
    turned: Turned,
    people: Vec<Observation>,
    /// How tall people are by the present input and by another, pixels of the largest one.
    here: Vec<f32>,
    elsewhere: Vec<f32>,
}

/// How a picture is looked at.
#[derive(Debug, Clone, Copy)]
struct Choice {
    /// The input, counted as [`SHARES`].
    level: usize,
    /// What of it; `None` for all.
    crop: Option<Crop>,
}

impl Following {
    fn new(engine: &EngineArgs, largest: usize) -> anyhow::Result<Self> {
        Ok(Self {
            shapes: Shapes::new(engine)?,
            largest,
            zoom: Zoom::default(),
            region: Region::default(),
            crops: Crops::default(),
            seen_in: Default::default(),
            choice: None,
            turned: Turned::new(true),
            people: Vec::new(),
            here: Vec::new(),
            elsewhere: Vec::new(),
        })
    }

    /// How the next picture is looked at on a machine that has time for no larger input than `limit`.
    fn choose(&mut self, frame: &Frame, limit: usize) -> anyhow::Result<Choice> {
        let picture = size_of(frame);
        let built = self.shapes.of(sizes_of(picture))?;
        self.zoom.limit(limit.max(self.largest));
        let level = self.zoom.level();
        let seen_in = (picture, level);
        if std::mem::replace(&mut self.seen_in, seen_in) != seen_in {
            self.region.forget();
        }
        let crop = self.region.crop(frame, &input_of(&built[level], picture));
        Ok(Choice { level, crop })
    }
}

impl Pipelines {
    /// Builds them. The input of a `film` follows the people in view unless something else is asked for. Of a camera,
    /// whose pictures are wanted every `live` nanoseconds at most, no such input is larger than the machine has time
    /// for; where there is none to look at as many pictures as come, or are to be looked at, people are followed into
    /// some.
    ///
    /// # Errors
    /// As [`Pipeline::new`] and [`EngineArgs::inputs`].
    pub fn new(engine: &EngineArgs, film: bool, live: Option<u64>) -> anyhow::Result<Self> {
        let stages = match engine.inputs(film)? {
            Inputs::Fixed(size) => Stages::Fixed(Box::new(engine.build(size)?)),
            Inputs::Following(largest) => {
                Stages::Following(Box::new(Following::new(engine, largest)?))
            }
            Inputs::Looks(shares) => Stages::Looks(Box::new(Looks::new(engine, film)?), shares),
        };
        let one = match &stages {
            Stages::Fixed(one) => Some(&**one),
            Stages::Following(following) => Some(following.shapes.any()),
            Stages::Looks(..) => None,
        };
        let asked = engine.looks_apart();
        let between = one.filter(|_| film).and_then(|stages| match live {
            Some(shortest) => {
                let spacing = Spacing::new(shortest, asked);
                Some(Between::of_camera(spacing, stages.lifter().clone()))
            }
            None => asked.map(|interval| Between::new(interval, stages.lifter().clone())),
        });
        let target = live.map(|interval| ENOUGH.recip().max(interval as f32 * 1e-9));
        Ok(Self {
            between,
            follows: false,
            input: (0, 0),
            stages,
            speed: Speed::new(target),
            crew: Crew::new(engine.most_threads(), !film || engine.threads.is_some()),
            clock: Box::new(monotonic_ns),
        })
    }

    /// Chooses how the frame that [`process`](Self::process) is given next is gone through.
    ///
    /// # Errors
    /// When the network does not take its shape.
    pub fn choose(&mut self, frame: &Frame) -> anyhow::Result<Way> {
        self.follows = self.between.as_mut().is_some_and(|b| b.follow(frame));
        if self.follows {
            return Ok(Way::Followed);
        }
        let Stages::Following(following) = &mut self.stages else {
            return Ok(Way::Whole);
        };
        let choice = following.choose(frame, self.speed.limit())?;
        following.choice = Some(choice);
        Ok(match choice.crop {
            Some(_) => Way::Part,
            None => Way::Whole,
        })
    }

    /// The network's input of the last look for all of a picture, of two the larger, pixels across and down; zeros
    /// before the first look.
    pub fn input(&self) -> (usize, usize) {
        match &self.stages {
            Stages::Looks(looks, _) => looks.input(),
            _ => self.input,
        }
    }

    /// Everyone in the frame, as was chosen for it, else by a look.
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
            between,
            follows,
            input,
            clock,
        } = self;
        if std::mem::take(follows)
            && let Some(between) = between
        {
            let seen = between.lift(frame, intrinsics)?;
            if let Stages::Following(following) = stages {
                following.region.seen(frame, seen.people, false);
            }
            return Ok(seen);
        }
        let following = match stages {
            Stages::Fixed(one) => {
                one.use_threads(crew.threads(0));
                let start = clock();
                one.process(frame, intrinsics)?;
                *input = one.size();
                let now = clock();
                let seconds = (!crew.is_trying(0)).then_some(seconds_from(start, now));
                if let Some(between) = between {
                    between.looked(frame, one.found(), seconds);
                }
                warn(seconds.and_then(|seconds| speed.took(now, 0, seconds, true)));
                let seen = one.seen();
                log(crew.took(now, 0, network_seconds(&seen)), None);
                return Ok(seen);
            }
            Stages::Looks(looks, shares) => {
                looks.use_threads(crew.threads(0));
                let sizes = inputs_of(size_of(frame), *shares);
                let (start, all) = (clock(), sizes.len());
                looks.process(frame, intrinsics, sizes, all)?;
                let now = clock();
                // More looks say nothing of the machine.
                if !looks.has_turned() {
                    if !crew.is_trying(0) {
                        warn(speed.took(now, 0, seconds_from(start, now), true));
                    }
                    log(crew.took(now, 0, network_seconds(&looks.seen())), None);
                }
                return Ok(looks.seen());
            }
            Stages::Following(following) => following,
        };
        let Choice { level, crop } = match following.choice.take() {
            Some(choice) => choice,
            None => following.choose(frame, speed.limit())?,
        };
        let Following {
            shapes,
            zoom,
            region,
            crops,
            turned,
            people,
            here,
            elsewhere,
            ..
        } = &mut **following;
        let picture = size_of(frame);
        let built = shapes.of(sizes_of(picture))?;
        let heights = heights_in(picture);
        let other = zoom.look_elsewhere(frame.time_ns);
        let mut beside = StageTimes::default();
        if let Some(other) = other {
            built[other].use_threads(crew.usual(other));
            let seen = built[other].process(frame, intrinsics)?;
            beside = seen.times;
            heights(seen.people, elsewhere);
        }
        let whole = &mut built[level];
        *input = whole.size();
        // Times of crops of several sizes cannot be compared.
        whole.use_threads(match crop {
            None => crew.threads(level),
            Some(_) => crew.usual(level),
        });
        let start = clock();
        let used = match crop {
            None => {
                whole.process(frame, intrinsics)?;
                whole
            }
            Some(crop) => {
                let size = (crop.width, crop.height);
                let stages = crops.of(whole, size)?;
                stages.process_crop(frame, intrinsics, crop)?;
                stages
            }
        };
        let now = clock();
        let is_usual = crop.is_some() || !crew.is_trying(level);
        let seconds = is_usual.then_some(seconds_from(start, now));
        if let Some(between) = between {
            between.looked(frame, used.found(), seconds);
        }
        let seen = used.seen();
        warn(seconds.and_then(|seconds| speed.took(now, level, seconds, crop.is_none())));
        if crop.is_none() {
            let fitted = fitted(picture, SHARES[level]);
            log(crew.took(now, level, network_seconds(&seen)), Some(fitted));
        }
        let (without_neck, times) = (seen.without_neck, sum(beside, seen.times));
        people.clear();
        people.extend_from_slice(seen.people);
        let turned = turned.join(frame, intrinsics, shapes, people)?;
        region.seen(frame, people, crop.is_none());
        heights(people, here);
        let is_more = other.is_some() && elsewhere.len() > here.len();
        if is_more {
            region.forget();
        }
        zoom.seen(frame.time_ns, here, other.map(|_| &elsewhere[..]));
        // The optical flow goes on from upright looks alone.
        if let Some(between) = between
            && (turned.has_brought || is_more || zoom.level() != level)
        {
            between.forget();
        }
        if zoom.level() != level {
            tracing::debug!(?here, ?elsewhere, input = ?fitted(picture, SHARES[zoom.level()]), "another input");
        }
        Ok(FrameObservations {
            people,
            without_neck,
            times: sum(times, turned.times),
        })
    }

    /// Looks whether anybody is in the frame: with the smallest input, and if that shows nobody and `large`, with the
    /// largest, whether there is time for it or not; it is then that of the next frames, too.
    ///
    /// # Errors
    /// As [`Pipeline::process`].
    pub fn look(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
        large: bool,
    ) -> anyhow::Result<FrameObservations<'_>> {
        let Self {
            stages,
            crew,
            between,
            input,
            ..
        } = self;
        if let Some(between) = between {
            between.forget();
        }
        let following = match stages {
            Stages::Fixed(one) => {
                one.use_threads(crew.usual(0));
                *input = one.size();
                return one.process(frame, intrinsics);
            }
            Stages::Looks(looks, shares) => {
                looks.use_threads(crew.usual(0));
                let sizes = inputs_of(size_of(frame), *shares);
                let count = if large { sizes.len() } else { 1 };
                looks.process(frame, intrinsics, sizes, count)?;
                return Ok(looks.seen());
            }
            Stages::Following(following) => following,
        };
        let Following {
            shapes,
            largest,
            zoom,
            elsewhere,
            ..
        } = &mut **following;
        let picture = size_of(frame);
        let built = shapes.of(sizes_of(picture))?;
        let smallest = built.len() - 1;
        built[smallest].use_threads(crew.usual(smallest));
        *input = built[smallest].size();
        let seen = built[smallest].process(frame, intrinsics)?;
        if seen.people.is_empty() && large && *largest < smallest {
            let first = seen.times;
            built[*largest].use_threads(crew.usual(*largest));
            *input = built[*largest].size();
            let seen = built[*largest].process(frame, intrinsics)?;
            zoom.entered((!seen.people.is_empty()).then_some(*largest));
            return Ok(FrameObservations {
                times: sum(first, seen.times),
                ..seen
            });
        }
        heights_in(picture)(seen.people, elsewhere);
        zoom.entered(None);
        zoom.seen(frame.time_ns, &[], Some(elsewhere));
        Ok(built[smallest].seen())
    }
}

/// The input of these stages for all of a picture (pixels across and down).
fn input_of(stages: &Pipeline, (w, h): (usize, usize)) -> Input {
    let size = stages.size();
    Input {
        size,
        step: stages.step(),
        letterbox: Letterbox::fit(w as u32, h as u32, size.0 as u32, size.1 as u32),
    }
}

/// Pixels across and down.
fn size_of(frame: &Frame) -> (usize, usize) {
    (frame.width as usize, frame.height as usize)
}

/// What the network of Stage I took.
fn network_seconds(seen: &FrameObservations<'_>) -> f32 {
    seen.times.stage1_us as f32 * 1e-6
}

/// From one time of the clock to another, which are nanoseconds.
fn seconds_from(start: u64, now: u64) -> f32 {
    now.saturating_sub(start) as f32 * 1e-9
}

/// Logs that the machine has become slower.
fn warn(slower: Option<Slower>) {
    if let Some(slower) = slower {
        tracing::warn!("{}", slower.line(throttled()));
    }
}

/// Logs another number of threads, with the input (pixels across and down) that it holds for if there are others.
fn log(change: Option<Change>, input: Option<(usize, usize)>) {
    if let Some(change) = change {
        let input = input.map(tracing::field::debug);
        tracing::info!(input, "{}", change.line());
    }
}

/// The inputs of a picture (all pixels across and down) that follow the people in view, for each of [`SHARES`].
fn sizes_of(picture: (usize, usize)) -> Vec<(usize, usize)> {
    SHARES.map(|share| fitted(picture, share)).to_vec()
}

/// How tall people in a picture (pixels across and down) are, pixels of the largest input.
fn heights_in(picture: (usize, usize)) -> impl Fn(&[Observation], &mut Vec<f32>) {
    let scale = whole_scale(picture);
    move |people, out| {
        out.clear();
        out.extend(people.iter().filter_map(stature).map(|s| s * scale));
    }
}

#[cfg(test)]
mod tests;

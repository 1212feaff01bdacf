//! The stages at every size that pictures ask for.

use edgecap_client::message::{Intrinsics, Observation, StageTimes};

use super::crops::Crops;
use super::engine_args::EngineArgs;
use super::looks::{Looks, sum};
use super::shapes::Shapes;
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
            Inputs::Looks(shares) => Stages::Looks(Box::new(Looks::new(engine)?), shares),
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
                let seen = looks.process(frame, intrinsics, sizes, all)?;
                let now = clock();
                if !crew.is_trying(0) {
                    warn(speed.took(now, 0, seconds_from(start, now), true));
                }
                log(crew.took(now, 0, network_seconds(&seen)), None);
                return Ok(seen);
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
        region.seen(frame, seen.people, crop.is_none());
        warn(seconds.and_then(|seconds| speed.took(now, level, seconds, crop.is_none())));
        if crop.is_none() {
            let fitted = fitted(picture, SHARES[level]);
            log(crew.took(now, level, network_seconds(&seen)), Some(fitted));
        }
        heights(seen.people, here);
        let is_more = other.is_some() && elsewhere.len() > here.len();
        if is_more {
            region.forget();
        }
        zoom.seen(frame.time_ns, here, other.map(|_| &elsewhere[..]));
        if let Some(between) = between
            && (is_more || zoom.level() != level)
        {
            between.forget();
        }
        if zoom.level() != level {
            tracing::debug!(?here, ?elsewhere, input = ?fitted(picture, SHARES[zoom.level()]), "another input");
        }
        Ok(FrameObservations {
            times: sum(beside, seen.times),
            ..seen
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
                return looks.process(frame, intrinsics, sizes, count);
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
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;
    use crate::capture::{demo, open_bytes};
    use crate::engine::{Model, Network};
    use crate::schedule::inputs::Quality;

    const SECOND: u64 = 1_000_000_000;
    const WALL: (usize, usize) = (512, 320);

    /// For a film with the input that follows the people in view.
    fn following(live: Option<u64>) -> Pipelines {
        let engine = EngineArgs {
            threads: Some(1),
            ..EngineArgs::default()
        };
        Pipelines::new(&engine, true, live).unwrap()
    }

    fn wall() -> Frame {
        let (w, h) = WALL;
        Frame {
            width: w as u32,
            height: h as u32,
            rgb: vec![128; 3 * w * h],
            ..Frame::default()
        }
    }

    fn lens() -> Intrinsics {
        let (w, h) = WALL;
        Intrinsics::from_horizontal_fov(w as u32, h as u32, 60.0)
    }

    /// People of some 50 pixels, before the wall.
    fn far_away() -> Frame {
        let mut clip = open_bytes("demo", demo::CLIP).unwrap();
        let (mut near, mut far) = (Frame::default(), wall());
        assert!(clip.next_into(&mut near).unwrap());
        let [across, down] = [near.width, near.height].map(|n| n as usize / 4);
        for y in 0..down {
            for x in 0..across {
                let from = 4 * 3 * (y * near.width as usize + x);
                let to = 3 * ((80 + y) * far.width as usize + 80 + x);
                far.rgb[to..to + 3].copy_from_slice(&near.rgb[from..from + 3]);
            }
        }
        far
    }

    #[test]
    fn every_look_at_a_picture_counts_for_its_times() {
        let (mut pipelines, lens, mut picture) = (following(None), lens(), wall());
        pipelines.process(&picture, &lens).unwrap();
        picture.time_ns = SECOND;
        let both = pipelines.process(&picture, &lens).unwrap().times;
        let of = |pipelines: &mut Pipelines| match &mut pipelines.stages {
            Stages::Following(f) => {
                let built = f.shapes.of(sizes_of(WALL)).unwrap();
                [0, 1, 2].map(|level| built[level].seen().times)
            }
            _ => panic!("expected the input that follows people"),
        };
        let [large, middle, _] = of(&mut pipelines);
        assert!(middle.stage1_us > 0, "no other input was looked at");
        assert_eq!(both, sum(large, middle));
        let both = pipelines.look(&picture, &lens, true).unwrap().times;
        let [large, _, small] = of(&mut pipelines);
        assert!(small.stage1_us > 0);
        assert_eq!(both, sum(small, large));
    }

    fn grey((w, h): (usize, usize)) -> Frame {
        Frame {
            width: w as u32,
            height: h as u32,
            rgb: vec![128; 3 * w * h],
            ..Frame::default()
        }
    }

    #[test]
    fn of_thirty_pictures_a_second_every_other_one_is_looked_at_where_fifteen_are_wanted() {
        let engine = EngineArgs {
            threads: Some(1),
            quality: Some(Quality::Fast),
            ..EngineArgs::default()
        };
        let mut pipelines = Pipelines::new(&engine, true, None).unwrap();
        let mut clip = open_bytes("demo", demo::CLIP).unwrap();
        let mut picture = Frame::default();
        assert!(clip.next_into(&mut picture).unwrap());
        for k in 0..12 {
            picture.time_ns = SECOND + k * SECOND / 30;
            let way = pipelines.choose(&picture).unwrap();
            let seen = pipelines.process(&picture, &lens()).unwrap();
            assert_eq!(way == Way::Followed, seen.times.stage1_us == 0);
            // The first one is late by its whole time.
            let is_between = k > 1 && k % 2 == 1;
            assert_eq!(way == Way::Followed, is_between, "picture {k}");
        }
        picture.time_ns += SECOND / 30;
        pipelines.look(&picture, &lens(), false).unwrap();
        picture.time_ns += SECOND / 60;
        assert_ne!(pipelines.choose(&picture).unwrap(), Way::Followed);
    }

    #[test]
    fn pictures_of_any_time_are_looked_at() {
        for size in [Some("256x160"), None] {
            let engine = EngineArgs {
                threads: Some(1),
                size: size.map(|size| size.parse().unwrap()),
                looks: Some(15.0),
                ..EngineArgs::default()
            };
            let mut pipelines = Pipelines::new(&engine, true, None).unwrap();
            let times = [0, SECOND / 15, u64::MAX - 1, u64::MAX, u64::MAX, 0];
            for (k, time_ns) in times.into_iter().enumerate() {
                let mut picture = if k % 2 == 0 { far_away() } else { wall() };
                picture.time_ns = time_ns;
                pipelines.choose(&picture).unwrap();
                let seen = pipelines.process(&picture, &lens()).unwrap();
                assert!(seen.times.stage1_us > 0, "{time_ns}");
            }
        }
    }

    /// A clock by which so many nanoseconds go by from one question to the next.
    fn ticking(step: &Arc<AtomicU64>) -> Box<dyn Fn() -> u64 + Send> {
        let (step, now) = (Arc::clone(step), AtomicU64::new(0));
        Box::new(move || now.fetch_add(step.load(Ordering::Relaxed), Ordering::Relaxed))
    }

    #[test]
    fn a_machine_that_becomes_slower_is_told_of_with_inputs_of_any_kind() {
        let fixed = EngineArgs {
            threads: Some(1),
            size: Some("64x64".parse().unwrap()),
            ..EngineArgs::default()
        };
        let best = EngineArgs {
            threads: Some(1),
            quality: Some(Quality::Best),
            ..EngineArgs::default()
        };
        for engine in [fixed, best] {
            let mut pipelines = Pipelines::new(&engine, true, Some(0)).unwrap();
            if let Stages::Looks(_, shares) = &mut pipelines.stages {
                *shares = [&[0.125], &[0.125]];
            }
            let step = Arc::new(AtomicU64::new(SECOND / 10));
            pipelines.clock = ticking(&step);
            let (picture, lens) = (wall(), lens());
            let mut look = |pictures| {
                for _ in 0..pictures {
                    pipelines.process(&picture, &lens).unwrap();
                }
                pipelines.speed.has_told()
            };
            assert!(!look(101));
            step.store(SECOND / 2, Ordering::Relaxed);
            assert!(!look(20), "at once");
            assert!(look(20));
        }
    }

    #[test]
    fn a_glance_into_an_empty_room_needs_no_stages_of_its_own() {
        let engine = EngineArgs {
            threads: Some(1),
            quality: Some(Quality::Best),
            ..EngineArgs::default()
        };
        let mut pipelines = Pipelines::new(&engine, true, Some(0)).unwrap();
        let Stages::Looks(_, shares) = &mut pipelines.stages else {
            panic!("expected several looks");
        };
        *shares = [&[0.125, 0.25], &[0.125, 0.25]];
        let (picture, lens) = (wall(), lens());
        let mut inputs = Vec::new();
        for large in [Some(false), Some(true), None] {
            let seen = match large {
                Some(large) => pipelines.look(&picture, &lens, large),
                None => pipelines.process(&picture, &lens),
            };
            seen.unwrap();
            inputs.push(pipelines.input());
        }
        assert!(
            inputs[0] < inputs[1] && inputs[1] == inputs[2],
            "{inputs:?}"
        );
        let Stages::Looks(looks, _) = &pipelines.stages else {
            panic!("expected several looks");
        };
        assert_eq!(looks.shapes(), 1);
    }

    #[test]
    fn people_are_followed_where_a_camera_is_faster_than_any_machine() {
        let mut engine = EngineArgs {
            threads: Some(1),
            size: Some("256x160".parse().unwrap()),
            ..EngineArgs::default()
        };
        let mut follows = |looks, live| {
            engine.looks = looks;
            let mut pipelines = Pipelines::new(&engine, true, live).unwrap();
            pipelines.clock = ticking(&Arc::new(AtomicU64::new(SECOND / 50)));
            let (mut picture, lens) = (wall(), lens());
            // A thousand pictures a second, of which there is time for 25.
            for k in 0..52 {
                (picture.time_ns, picture.sequence) = (SECOND + k * SECOND / 25, 40 * k);
                let way = pipelines.choose(&picture).unwrap();
                assert!(way == Way::Whole || k > 50, "at once");
                pipelines.process(&picture, &lens).unwrap();
            }
            (0..4).any(|_| {
                picture.time_ns += SECOND / 1000;
                picture.sequence += 1;
                let way = pipelines.choose(&picture).unwrap();
                pipelines.process(&picture, &lens).unwrap();
                way == Way::Followed
            })
        };
        assert!(follows(None, Some(0)));
        assert!(!follows(None, None), "a film has time");
        assert!(!follows(Some(1000.0), Some(0)), "all are asked for");
    }

    #[test]
    fn inputs_have_the_shape_of_the_pictures_as_they_come() {
        let mut pipelines = following(None);
        let shapes = [(640, 480), (720, 720), (360, 640), (640, 480)];
        let inputs = [
            [(432, 320), (320, 240), (208, 160)],
            [(368, 368), (272, 272), (192, 192)],
            [(288, 512), (224, 384), (144, 256)],
            [(432, 320), (320, 240), (208, 160)],
        ];
        for (picture, inputs) in shapes.into_iter().zip(inputs) {
            let (w, h) = picture;
            let lens = Intrinsics::from_horizontal_fov(w as u32, h as u32, 60.0);
            pipelines.process(&grey(picture), &lens).unwrap();
            assert_eq!(sizes_of(picture), inputs);
            let Stages::Following(following) = &pipelines.stages else {
                panic!("expected the input that follows people");
            };
            assert_eq!(following.shapes.last(), Some(&inputs[..]));
        }
    }

    #[test]
    fn heights_are_pixels_of_the_largest_input_of_any_shape() {
        let mut clip = open_bytes("demo", demo::CLIP).unwrap();
        let mut frame = Frame::default();
        assert!(clip.next_into(&mut frame).unwrap());
        let mut pipelines = following(None);
        let people = pipelines.process(&frame, &lens()).unwrap().people.to_vec();
        let statures: Vec<f32> = people.iter().filter_map(stature).collect();
        assert!(!statures.is_empty());
        for picture in [(512, 320), (640, 480), (720, 720), (360, 640), (1280, 720)] {
            let (mut heights, input) = (Vec::new(), sizes_of(picture)[0]);
            heights_in(picture)(&people, &mut heights);
            let scale = (input.0 as f32 / picture.0 as f32).min(input.1 as f32 / picture.1 as f32);
            for (height, stature) in heights.iter().zip(&statures) {
                let error = height / (stature * scale) - 1.0;
                assert!(error.abs() < 0.03, "{picture:?}: {error}");
            }
        }
    }

    /// The picture in which `far_away` are, and at the other side the same people once more.
    fn more_come() -> Frame {
        let mut picture = far_away();
        let width = picture.width as usize;
        for y in 80..160 {
            let row = 3 * width * y;
            picture
                .rgb
                .copy_within(row + 3 * 80..row + 3 * 208, row + 3 * 336);
        }
        picture
    }

    #[test]
    fn a_crop_of_the_picture_shows_those_who_are_there_and_nobody_who_comes_is_missed() {
        let (mut pipelines, lens) = (following(None), lens());
        let mut look = |picture: &mut Frame, k: u64| {
            picture.time_ns = k * SECOND / 30;
            let seen = pipelines.process(picture, &lens).unwrap();
            let people = seen.people.to_vec();
            let Stages::Following(following) = &pipelines.stages else {
                panic!("expected the input that follows people");
            };
            (people, following.crops.count())
        };
        let (mut few, mut many) = (far_away(), more_come());
        let (whole, crops) = look(&mut few, 0);
        assert!(!whole.is_empty() && crops == 0);
        let (crop, crops) = look(&mut few, 1);
        assert_eq!((crop.len(), crops), (whole.len(), 1));
        for (a, b) in crop.iter().zip(&whole) {
            for (p, q) in a
                .joints2d
                .iter()
                .zip(&b.joints2d)
                .filter(|(p, _)| p[2] > 0.3)
            {
                let off = (p[0] - q[0]).hypot(p[1] - q[1]);
                assert!(off < 2.0, "{off} px: {p:?} {q:?}");
            }
        }
        let (all, _) = look(&mut many, 2);
        assert!(all.len() > crop.len(), "{} people", all.len());
    }

    #[test]
    fn whom_only_the_largest_input_sees_is_seen_on_a_slow_machine() {
        let (mut pipelines, lens) = (following(Some(SECOND / 10)), lens());
        let speed = &mut pipelines.speed;
        for k in 0..20 {
            speed.took(k * SECOND, speed.limit(), 1.0, true);
        }
        assert_eq!(speed.limit(), SHARES.len() - 1);
        let (far, empty) = (far_away(), wall());
        let mut sees = |picture, large: Option<bool>| {
            let seen = match large {
                None => pipelines.process(picture, &lens),
                Some(large) => pipelines.look(picture, &lens, large),
            };
            !seen.unwrap().people.is_empty()
        };
        assert!(!sees(&far, None));
        assert!(!sees(&far, Some(false)));
        assert!(!sees(&far, None));
        assert!(sees(&far, Some(true)));
        assert!(sees(&far, None), "lost with the next picture");
        assert!(!sees(&empty, Some(true)));
        assert!(!sees(&far, None), "the limit holds for whoever comes next");
    }

    #[test]
    fn a_network_of_other_multiples_needs_no_size() {
        let mut model = Model::shipped().unwrap();
        let text = model.network().source();
        let other = text.replace("multiple = 16", "multiple = 48");
        assert_ne!(text, other);
        model.network = Network::parse(&other).unwrap();
        model.contract.input.size_multiple = 48;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.ecm");
        model.save(&path).unwrap();
        let engine = EngineArgs {
            model: Some(path),
            threads: Some(1),
            ..EngineArgs::default()
        };
        engine.expect_model().unwrap();
        let picture = Frame {
            width: 64,
            height: 48,
            rgb: vec![128; 3 * 64 * 48],
            ..Frame::default()
        };
        let intrinsics = Intrinsics::from_horizontal_fov(64, 48, 60.0);
        for is_film in [true, false] {
            let mut stages = Pipelines::new(&engine, is_film, None).unwrap();
            stages.process(&picture, &intrinsics).unwrap();
            let (w, h) = stages.input();
            assert!(
                w > 0 && [w, h].iter().all(|s| s.is_multiple_of(48)),
                "{w}x{h}"
            );
        }
        let asked = EngineArgs {
            size: Some("512x320".parse().unwrap()),
            ..engine
        };
        let refused = Pipelines::new(&asked, true, None).err().unwrap();
        assert!(refused.to_string().contains("multiples of 48"), "{refused}");
    }
}

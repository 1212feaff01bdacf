//! Where people are in the pictures between two looks: their joints go with the optical flow, and Stage II lifts them
//! anew.

use std::time::Instant;

use edgecap_client::message::{Intrinsics, StageTimes};

use super::joints::follow;
use crate::capture::{Frame, Letterbox};
use crate::detect::Detection;
use crate::flow::{LucasKanade, Pyramid};
use crate::lift::{FrameObservations, LiftError, Lifter};
use crate::schedule::due::Due;
use crate::schedule::spacing::Spacing;

/// Whom a look at a picture found.
#[derive(Debug, Clone, Copy)]
pub struct Found<'a> {
    /// Everyone, before lifting.
    pub people: &'a [Detection],
    /// Where the picture lies in the input that they are in.
    pub letterbox: Letterbox,
    /// People left out because their neck was not found.
    pub without_neck: u32,
}

/// People on their way from one look to the next.
pub struct Between {
    /// The next look; `None` where every picture is looked at.
    due: Option<Due>,
    /// How far apart looks at a camera are.
    spacing: Option<Spacing>,
    flow: LucasKanade,
    lifter: Lifter,
    before: Pyramid,
    now: Pyramid,
    /// Whether the next look decides who is there, as the last one showed more or fewer.
    again: bool,
    /// When the picture was taken that `now` holds and that people could not be followed into.
    lost: Option<u64>,
    /// The last picture, pixels across and down, and when it was taken; `None` asks for a look.
    last: Option<((u32, u32), u64)>,
    people: Vec<Detection>,
    /// Where the picture lies in the input that `people` are in.
    letterbox: Letterbox,
    without_neck: u32,
    /// What following them took, microseconds.
    took_us: u32,
}

impl Between {
    /// For a film, with looks `interval` nanoseconds apart and this Stage II.
    pub fn new(interval: u64, lifter: Lifter) -> Self {
        Self::with(Some(interval), None, lifter)
    }

    /// For a camera, with looks as far apart as `spacing` says and this Stage II.
    pub fn of_camera(spacing: Spacing, lifter: Lifter) -> Self {
        Self::with(spacing.apart(), Some(spacing), lifter)
    }

    fn with(apart: Option<u64>, spacing: Option<Spacing>, lifter: Lifter) -> Self {
        Self {
            due: apart.map(Due::new),
            spacing,
            flow: LucasKanade::default(),
            lifter,
            before: Pyramid::default(),
            now: Pyramid::default(),
            again: false,
            lost: None,
            last: None,
            people: Vec::new(),
            letterbox: Letterbox::fit(1, 1, 1, 1),
            without_neck: 0,
            took_us: 0,
        }
    }

    /// Follows everybody into this picture. False where it is to be looked at: it is time to, it does not follow the
    /// last one, or somebody was lost.
    pub fn follow(&mut self, frame: &Frame) -> bool {
        let start = Instant::now();
        if let Some(spacing) = &mut self.spacing {
            spacing.came(frame);
        }
        let (Some((size, last)), Some(due)) = (self.last.take(), self.due) else {
            return false;
        };
        let now = frame.time_ns;
        let is_next = size == (frame.width, frame.height) && now > last;
        if !is_next || now >= due.at_ns() {
            return false;
        }
        if !self.people.is_empty() {
            self.now.fill(frame);
            let (pictures, flow) = ([&self.before, &self.now], &mut self.flow);
            let seconds = (now - last) as f32 * 1e-9;
            let mut people = self.people.iter_mut();
            if !people.all(|p| follow(p, &self.letterbox, pictures, seconds, flow)) {
                self.lost = Some(now);
                return false;
            }
            std::mem::swap(&mut self.before, &mut self.now);
        }
        self.last = Some((size, now));
        self.took_us = start.elapsed().as_micros() as u32;
        true
    }

    /// Takes in whom a look `found` in a picture, and how many seconds it took, if that tells anything. Where somebody
    /// is missed, or new, the next one is looked at, too: one look may be wrong.
    pub fn looked(&mut self, frame: &Frame, found: Found<'_>, seconds: Option<f32>) {
        if let (Some(spacing), Some(seconds)) = (&mut self.spacing, seconds) {
            if spacing.looked(frame.time_ns, seconds).is_some() {
                tracing::info!("{}", spacing.line());
            }
            let every = |interval| {
                self.due
                    .map_or(Due::new(interval), |due| due.every(interval))
            };
            self.due = spacing.apart().map(every);
        }
        let Some(due) = &mut self.due else {
            return;
        };
        let Found { people, .. } = found;
        let is_sure = self.again || people.len() == self.people.len();
        self.again = !is_sure;
        self.people.clear();
        self.people.extend_from_slice(people);
        self.letterbox = found.letterbox;
        self.without_neck = found.without_neck;
        let is_filled = self.lost.take() == Some(frame.time_ns);
        if is_filled {
            std::mem::swap(&mut self.before, &mut self.now);
        } else if !people.is_empty() {
            self.before.fill(frame);
        }
        due.done(frame.time_ns);
        self.last = is_sure.then_some(((frame.width, frame.height), frame.time_ns));
    }

    /// The next picture is looked at.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// Everyone in the picture into which they were followed.
    ///
    /// # Errors
    /// As [`Lifter::lift`].
    pub fn lift(
        &mut self,
        frame: &Frame,
        intrinsics: &Intrinsics,
    ) -> Result<FrameObservations<'_>, LiftError> {
        let start = Instant::now();
        let people = self
            .lifter
            .lift(&self.people, frame, &self.letterbox, intrinsics)?;
        Ok(FrameObservations {
            people,
            without_neck: self.without_neck,
            times: StageTimes {
                preprocess_us: self.took_us,
                stage2_us: start.elapsed().as_micros() as u32,
                ..StageTimes::default()
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use edgecap_client::joints::NECK;
    use edgecap_client::message::Observation;

    use super::*;
    use crate::capture::{Resizer, demo, open_bytes};
    use crate::detect::{AssociationConfig, Associator};
    use crate::engine::{Engine, EngineOptions, Model};
    use crate::lift::Encodings;

    const FRAME_NS: u64 = 33_333_333;
    const R_ANKLE: usize = 10;

    /// Pictures of the demo clip, taken 30 a second.
    fn pictures(n: u64) -> Vec<Frame> {
        let mut clip = open_bytes("demo", demo::CLIP).unwrap();
        let each = (0..n).map(|k| {
            let mut frame = Frame::default();
            assert!(clip.next_into(&mut frame).unwrap());
            frame.time_ns = k * FRAME_NS;
            frame
        });
        each.collect()
    }

    fn lens(frame: &Frame) -> Intrinsics {
        Intrinsics::from_horizontal_fov(frame.width, frame.height, 60.0)
    }

    /// The stages of a look at the usual input.
    struct Stages {
        resizer: Resizer,
        input: Vec<u8>,
        engine: Engine,
        associator: Associator,
        lifter: Lifter,
        letterbox: Letterbox,
    }

    impl Stages {
        fn shipped() -> Self {
            let model = Model::shipped().unwrap();
            let options = EngineOptions {
                threads: 1,
                ..EngineOptions::default()
            };
            let engine = Engine::new(&model, options).unwrap();
            let resizer = Resizer::new(options.width as u32, options.height as u32);
            let stage2 = &model.stage2().unwrap().layers;
            let encodings = match model.encodings_trained() {
                true => Encodings::Read,
                false => Encodings::Zero,
            };
            Self {
                input: vec![0; resizer.output_bytes()],
                resizer,
                associator: Associator::new(AssociationConfig::of(&model).unwrap()),
                lifter: Lifter::new(stage2, encodings, engine.isa()).unwrap(),
                engine,
                letterbox: Letterbox::fit(1, 1, 1, 1),
            }
        }

        /// Everyone in the frame.
        fn look(&mut self, frame: &Frame) -> &[Observation] {
            self.letterbox = self.resizer.run(frame, &mut self.input);
            let maps = self.engine.run(&self.input);
            let people = self.associator.associate(maps);
            let seen = self
                .lifter
                .lift(people, frame, &self.letterbox, &lens(frame));
            seen.unwrap()
        }

        /// The same of the last frame.
        fn seen(&self) -> &[Observation] {
            self.lifter.lifted()
        }

        fn found(&self) -> Found<'_> {
            Found {
                people: self.associator.found(),
                letterbox: self.letterbox,
                without_neck: self.associator.without_neck(),
            }
        }
    }

    /// The stages, and who is on their way to the next of two looks a second.
    fn looked(frame: &Frame) -> (Stages, Between) {
        let mut stages = Stages::shipped();
        let mut between = Between::new(500_000_000, stages.lifter.clone());
        assert!(!stages.look(frame).is_empty());
        // Who is new is looked at twice.
        between.looked(frame, stages.found(), None);
        between.looked(frame, stages.found(), None);
        (stages, between)
    }

    /// All of a picture, moved by whole pixels.
    fn moved(frame: &Frame, right: usize, down: usize) -> Frame {
        let mut other = frame.clone();
        let (width, height) = (frame.width as usize, frame.height as usize);
        for y in 0..height {
            for x in 0..width {
                let from = 3 * (width * y.saturating_sub(down) + x.saturating_sub(right));
                let to = 3 * (width * y + x);
                other.rgb[to..to + 3].copy_from_slice(&frame.rgb[from..from + 3]);
            }
        }
        other.time_ns += FRAME_NS;
        other
    }

    #[test]
    fn joints_go_with_what_they_lie_on() {
        let first = pictures(1).remove(0);
        let (stages, mut between) = looked(&first);
        let next = moved(&first, 5, 3);
        assert!(between.follow(&next));
        let seen = between.lift(&next, &lens(&next)).unwrap();
        assert_eq!(seen.times.stage1_us, 0);
        let before = stages.seen();
        assert_eq!(seen.people.len(), before.len());
        for (a, b) in before.iter().zip(seen.people) {
            assert_eq!(a.score, b.score);
            let pairs = a.joints2d.iter().zip(&b.joints2d);
            for (p, q) in pairs.filter(|(p, _)| p[2] > 0.0) {
                assert!(q[2] <= p[2]);
                let off = (q[0] - p[0] - 5.0).hypot(q[1] - p[1] - 3.0);
                assert!(off < 1.5, "{p:?} {q:?}");
            }
        }
    }

    #[test]
    fn a_joint_that_cannot_be_seen_goes_with_others_and_is_less_sure() {
        let first = pictures(1).remove(0);
        let (stages, mut between) = looked(&first);
        let before = stages.seen()[0];
        let [u, v, _] = before.joints2d[R_ANKLE];
        let mut next = moved(&first, 5, 3);
        for y in v as usize - 20..v as usize + 20 {
            let row = 3 * next.width as usize * y;
            next.rgb[row + 3 * (u as usize - 20)..row + 3 * (u as usize + 20)].fill(90);
        }
        assert!(between.follow(&next));
        let after = between.lift(&next, &lens(&next)).unwrap().people[0];
        let left = |j: usize| after.joints2d[j][2] / before.joints2d[j][2];
        assert!(
            left(R_ANKLE) < 0.9 * left(NECK),
            "{} {}",
            left(R_ANKLE),
            left(NECK)
        );
        let off =
            (after.joints2d[R_ANKLE][0] - u - 5.0).hypot(after.joints2d[R_ANKLE][1] - v - 3.0);
        assert!(off < 2.5, "{off} px");
    }

    #[test]
    fn who_is_new_or_missed_is_looked_at_once_more() {
        let film = pictures(3);
        let (mut stages, mut between) = looked(&film[0]);
        let mut wall = film[1].clone();
        wall.rgb.fill(90);
        let mut look = |between: &mut Between, frame: &Frame, next: &Frame| {
            stages.look(frame);
            between.looked(frame, stages.found(), None);
            between.follow(next)
        };
        let mut later = wall.clone();
        later.time_ns += FRAME_NS;
        assert!(!look(&mut between, &wall, &later), "missed");
        assert!(look(&mut between, &wall, &later));
        assert!(!look(&mut between, &film[1], &film[2]), "new");
        assert!(look(&mut between, &film[1], &film[2]));
        // Once more is once more, whoever is seen then.
        assert!(!look(&mut between, &wall, &later));
        assert!(look(&mut between, &film[1], &film[2]));
    }

    #[test]
    fn people_who_walk_are_where_a_look_sees_them() {
        let film = pictures(4);
        let (mut stages, mut between) = looked(&film[0]);
        for frame in &film[1..] {
            assert!(between.follow(frame));
        }
        let last = &film[3];
        let followed = between.lift(last, &lens(last)).unwrap().people.to_vec();
        let seen = stages.look(last);
        assert_eq!(followed.len(), seen.len());
        let mut off: Vec<f32> = Vec::new();
        for a in &followed {
            let apart = |b: &Observation| {
                let pairs = a.joints2d.iter().zip(&b.joints2d);
                let both = pairs.filter(|(p, q)| p[2] > 0.5 && q[2] > 0.5);
                let far = both.map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]));
                far.collect::<Vec<_>>()
            };
            let mean = |far: &Vec<f32>| far.iter().sum::<f32>() / far.len().max(1) as f32;
            let all = seen.iter().map(apart).filter(|far| !far.is_empty());
            off.extend(all.min_by(|a, b| mean(a).total_cmp(&mean(b))).unwrap());
        }
        off.sort_by(f32::total_cmp);
        let median = off[off.len() / 2];
        assert!(median < 3.0, "{median} px");
    }

    #[test]
    fn what_does_not_follow_the_last_picture_is_looked_at() {
        let film = pictures(2);
        let follows = |next: &Frame| looked(&film[0]).1.follow(next);
        assert!(follows(&film[1]));
        let changed = |change: fn(&mut Frame)| {
            let mut next = film[1].clone();
            change(&mut next);
            next
        };
        assert!(
            !follows(&changed(|f| f.time_ns = 0)),
            "no later than the last"
        );
        assert!(!follows(&changed(|f| f.time_ns = 500_000_000)), "due");
        assert!(!follows(&changed(|f| f.rgb.fill(90))), "another scene");
        let smaller = |f: &mut Frame| {
            f.height /= 2;
            f.rgb.truncate(f.rgb.len() / 2);
        };
        assert!(!follows(&changed(smaller)));
        let (_, mut between) = looked(&film[0]);
        between.forget();
        assert!(!between.follow(&film[1]));
    }
}

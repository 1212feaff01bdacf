//! Where people are in the pictures between two looks: their joints go with the optical flow, and Stage II lifts them
//! anew.

use std::time::Instant;

use edgecap_client::joints::{EVIDENCE_JOINTS, LIMB_JOINTS};
use edgecap_client::message::{Intrinsics, StageTimes};

use super::due::Due;
use super::spacing::Spacing;
use crate::capture::{Frame, Letterbox};
use crate::commands::pipeline::{FrameObservations, Pipeline};
use crate::detect::Detection;
use crate::flow::{LucasKanade, Pyramid};
use crate::lift::Lifter;

/// Radius of the window round a joint, share of the person's longer side: about a wrist and what is round it.
const WINDOW: f32 = 0.04;
/// How fast the confidence of a joint fades while it goes with others, as what is round it tells no place, per second:
/// of trunk and head, of elbows and knees, of wrists and ankles. One that is followed stays as sure as it was seen.
/// Measured on 1,200 pictures with truth, 30 a second.
const FADING: [f32; EVIDENCE_JOINTS] = [
    1.5, 1.5, 1.5, 5.0, 13.0, 1.5, 5.0, 13.0, 1.5, 5.0, 13.0, 1.5, 5.0, 13.0,
];
/// Whoever has fewer of the joints that were seen followed is to be looked at.
const FOLLOWED: f32 = 0.5;

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
    /// For a film, with looks `interval` nanoseconds apart and the Stage II of `stages`.
    pub fn new(interval: u64, stages: &Pipeline) -> Self {
        Self::with(Some(interval), None, stages)
    }

    /// For a camera, with looks by these `stages` as far apart as `spacing` says.
    pub fn of_camera(spacing: Spacing, stages: &Pipeline) -> Self {
        Self::with(spacing.apart(), Some(spacing), stages)
    }

    fn with(apart: Option<u64>, spacing: Option<Spacing>, stages: &Pipeline) -> Self {
        Self {
            due: apart.map(Due::new),
            spacing,
            flow: LucasKanade::default(),
            lifter: stages.lifter().clone(),
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

    /// Takes in whom `stages` saw in a picture that was looked at, and how many seconds that took, if it tells
    /// anything. Where somebody is missed, or new, the next one is looked at, too: one look may be wrong.
    pub fn looked(&mut self, frame: &Frame, stages: &Pipeline, seconds: Option<f32>) {
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
        let (people, letterbox) = stages.found();
        let is_sure = self.again || people.len() == self.people.len();
        self.again = !is_sure;
        self.people.clear();
        self.people.extend_from_slice(people);
        self.letterbox = letterbox;
        self.without_neck = stages.seen().without_neck;
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
    ) -> anyhow::Result<FrameObservations<'_>> {
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

/// Moves somebody's joints from the first of two pictures into the second, which lie in the network's input as
/// `letterbox` says and were taken so many `seconds` apart. False where too few could be followed.
fn follow(
    person: &mut Detection,
    letterbox: &Letterbox,
    [before, now]: [&Pyramid; 2],
    seconds: f32,
    flow: &mut LucasKanade,
) -> bool {
    let (joints, confidence) = (&mut person.joints, &mut person.confidence);
    let is_seen = joints.map(|j| j[2] > 0.0);
    let radius = WINDOW * longer_side(joints) / letterbox.scale;
    let ways: [Option<[f32; 2]>; EVIDENCE_JOINTS] = std::array::from_fn(|j| {
        let [u, v, _] = joints[j];
        let at = letterbox.to_original(u, v);
        let to = is_seen[j].then(|| flow.follow(before, now, at, radius))??;
        Some([0, 1].map(|k| (to[k] - at[k]) * letterbox.scale))
    });
    let count = |of: &[bool]| of.iter().filter(|is| **is).count() as f32;
    if count(&ways.map(|w| w.is_some())) < FOLLOWED * count(&is_seen) {
        return false;
    }
    let all = mean(ways.iter().flatten());
    for (j, joint) in joints.iter_mut().enumerate().filter(|(j, _)| is_seen[*j]) {
        let beside = LIMB_JOINTS.iter().filter_map(|&(a, b)| match j {
            _ if a == j => ways[b].as_ref(),
            _ if b == j => ways[a].as_ref(),
            _ => None,
        });
        let way = ways[j].or_else(|| mean(beside)).or(all);
        let [u, v] = way.unwrap_or_default();
        (joint[0], joint[1]) = (joint[0] + u, joint[1] + v);
        if ways[j].is_none() {
            confidence[j] *= (-FADING[j] * seconds).exp();
        }
    }
    true
}

/// The mean of ways, if there are any.
fn mean<'a>(ways: impl Iterator<Item = &'a [f32; 2]>) -> Option<[f32; 2]> {
    let sum = |[u, v, n]: [f32; 3], w: &[f32; 2]| [u + w[0], v + w[1], n + 1.0];
    let [u, v, n] = ways.fold([0.0; 3], sum);
    (n > 0.0).then(|| [u / n, v / n])
}

/// The longer side of the box round the seen joints, in their unit.
fn longer_side(joints: &[[f32; 3]; EVIDENCE_JOINTS]) -> f32 {
    let seen = || joints.iter().filter(|j| j[2] > 0.0);
    let side = |k: usize| {
        let low = seen().map(|j| j[k]).fold(f32::INFINITY, f32::min);
        let high = seen().map(|j| j[k]).fold(f32::NEG_INFINITY, f32::max);
        (high - low).max(0.0)
    };
    side(0).max(side(1))
}

#[cfg(test)]
mod tests {
    use edgecap_client::joints::NECK;

    use super::*;
    use crate::capture::{demo, open_bytes};
    use crate::commands::infer::EngineArgs;

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

    /// The stages, and who is on their way to the next of two looks a second.
    fn looked(frame: &Frame) -> (Pipeline, Between) {
        let engine = EngineArgs {
            threads: Some(1),
            ..EngineArgs::default()
        };
        let mut stages = engine.build((512, 320)).unwrap();
        let mut between = Between::new(500_000_000, &stages);
        stages.process(frame, &lens(frame)).unwrap();
        assert!(!stages.found().0.is_empty());
        // Who is new is looked at twice.
        between.looked(frame, &stages, None);
        between.looked(frame, &stages, None);
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
        let before = stages.seen().people;
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
        let before = stages.seen().people[0];
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
            stages.process(frame, &lens(frame)).unwrap();
            between.looked(frame, &stages, None);
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
        let seen = stages.process(last, &lens(last)).unwrap().people;
        assert_eq!(followed.len(), seen.len());
        let mut off: Vec<f32> = Vec::new();
        for a in &followed {
            let apart = |b: &edgecap_client::message::Observation| {
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

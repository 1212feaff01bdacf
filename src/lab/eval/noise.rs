//! Observations and exact truth go in, the statistics of what Stage I and II get wrong come out: how far off, how
//! steadily, how often not at all. The numbers are those that a generator of synthetic observations needs.
//!
//! Lengths are metres at the person's distance and canonical stature; errors in the picture are per axis. An error that
//! stays from frame to frame (slow part, falling off with a time constant) and one that is new in every frame (white
//! part) are told apart by their autocovariance: both add up at lag 0, only the slow part is left at later lags.

use std::collections::BTreeMap;

use edgecap_client::joints::{
    ANKLES, BODY_JOINTS, CANONICAL_STATURE, ELBOWS, EVIDENCE_JOINTS, HIPS, KNEES, MIRROR, NECK,
    PELVIS, SHOULDERS, WRISTS,
};
use edgecap_client::message::ObservationFrame;

use glam::{DVec3, Mat3};

use super::bias::{BiasMeter, Shown, part};
use super::geometry::{mean, minus, norm};
use crate::assignment::Matcher;
use crate::fit::SEEN_THROUGH;
use crate::lab::synth::detector::axes;
use crate::lab::synth::truth::{SELF_OCCLUDED, TruthFrame, TruthPerson, VISIBLE};

/// Mean distance in the picture, metres, up to which an observation is of a person.
const SAME_PERSON: f64 = 0.4;
/// Fewest joints that a detector could see of a person who is asked for.
const DETECTABLE: usize = 8;
/// A joint farther off than this (metres) is an outlier, not noise.
const FAR_OFF: f64 = 0.3;
/// Joints of arms and legs as right–left pairs.
const SIDES: [[[usize; 2]; 3]; 2] = [[SHOULDERS, ELBOWS, WRISTS], [HIPS, KNEES, ANKLES]];
/// Left and right can be told apart where a limb's joints lie this far apart (metres, mean over pairs) in the picture.
const APART: f64 = 0.15;
/// Seconds in a row for which a person is missed from which it is a burst, and beyond which the person is simply not
/// found.
const BURST: [f64; 2] = [0.1, 0.27];
/// Seconds within which joints begin to be missing together.
const TOGETHER: f64 = 0.1;
/// Seconds for which a hidden joint seems to be there, where left and right are exchanged for a moment.
const MOMENT: f64 = 1.0 / 30.0;
/// Seconds in a row for which a joint is missing from which it is hidden rather than lost; a fifth may fall to missed
/// frames.
const HIDDEN: f64 = 0.5;
/// Seconds that are no difference: those of whole frames are seldom exact.
const EXACT: f64 = 1e-9;
/// Longest lag of the autocovariance, seconds.
const LAGS: f64 = 1.5;

/// An error in two parts, per axis.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Spread {
    /// Standard deviation of what stays, metres.
    pub slow: f64,
    /// Standard deviation of what is new in every frame, metres.
    pub white: f64,
    /// Time constant of the slow part, seconds.
    pub time: f64,
}

impl Spread {
    /// Standard deviation of both, metres.
    pub fn whole(&self) -> f64 {
        self.slow.hypot(self.white)
    }
}

/// What observations get wrong. Rates are probabilities per frame unless said otherwise.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Noise {
    /// People who could be seen, times frames, and how many of them were.
    pub people: [usize; 2],
    /// Where evidence joints are told to be against where they are: to the person's left, up, forward, metres.
    pub bias: [[f64; 3]; EVIDENCE_JOINTS],
    /// Error of joints in the picture beside the bias, outliers left out.
    pub plane: Spread,
    /// Error of root-relative joints whose pixel was seen.
    pub space: Spread,
    /// Mean distance of root-relative joints from the truth: seen in the picture, not seen; metres.
    pub space_mean: [f64; 2],
    /// Person missed for less than 0.1 s.
    pub miss: f64,
    /// A burst of missed frames begins, of 0.1 to 0.27 s.
    pub burst: f64,
    /// Share of frames in longer absences: people whom the detector cannot see.
    pub absent: f64,
    /// Joint of a found person missing for less than half a second, per joint.
    pub lost: f64,
    /// Joint off by more than 0.3 m, per joint seen.
    pub outlier: f64,
    /// Joints of a found person begin to be missing for half a second or longer, per person; right within a factor of
    /// two.
    pub hidden: f64,
    /// Left and right of arms or legs exchanged in the picture, per person whose sides can be told apart.
    pub swap: f64,
    /// How long that lasts in the mean, seconds; 0 where it never happens.
    pub swap_time: f64,
    /// Observations of nobody per frame.
    pub phantom: f64,
}

/// One person in one frame in which the person could be seen.
struct Moment {
    frame: u64,
    found: bool,
    /// Joints that could be seen, and those that were.
    visible: [bool; EVIDENCE_JOINTS],
    seen: [bool; EVIDENCE_JOINTS],
    /// What the picture shows of the person's axes.
    shown: Shown,
    /// Whether arms and legs are exchanged.
    swapped: [bool; 2],
    /// Errors in the picture; none for outliers and exchanged limbs.
    plane: [Option<[f64; 2]>; EVIDENCE_JOINTS],
    /// Errors in space.
    space: [Option<[f64; 3]>; BODY_JOINTS],
}

/// Takes in frame after frame; [`NoiseMeter::finish`] tells the statistics.
#[derive(Default)]
pub struct NoiseMeter {
    people: BTreeMap<u32, Vec<Moment>>,
    frames: usize,
    phantoms: usize,
    bias: BiasMeter,
    outliers: [usize; 2],
    swaps: [usize; 2],
    matcher: Matcher,
}

impl NoiseMeter {
    /// Takes in one frame and the truth about it.
    pub fn add(&mut self, frame: &ObservationFrame, truth: &TruthFrame) {
        self.frames += 1;
        let (seen, people) = (frame.people(), &truth.people);
        let mut savings = Vec::with_capacity(seen.len() * people.len());
        for observation in seen {
            for person in people {
                let apart = distance(&observation.joints2d, person, truth);
                savings.push((SAME_PERSON - apart) as f32);
            }
        }
        let pairs = self
            .matcher
            .solve(seen.len(), people.len(), &savings)
            .to_vec();
        self.phantoms += pairs.iter().filter(|p| p.is_none()).count();
        for (t, person) in people.iter().enumerate() {
            let visible: [bool; EVIDENCE_JOINTS] =
                std::array::from_fn(|j| matches!(person.visibility[j], VISIBLE | SELF_OCCLUDED));
            if !visible[NECK] || visible.iter().filter(|v| **v).count() < DETECTABLE {
                continue;
            }
            let mut moment = Moment {
                frame: truth.frame,
                found: false,
                visible,
                seen: [false; EVIDENCE_JOINTS],
                shown: shown(person),
                swapped: [false; 2],
                plane: [None; EVIDENCE_JOINTS],
                space: [None; BODY_JOINTS],
            };
            if let Some(slot) = pairs.iter().position(|p| *p == Some(t)) {
                self.compare(&seen[slot], person, truth, &mut moment);
            }
            self.people.entry(person.id).or_default().push(moment);
        }
    }

    fn compare(
        &mut self,
        seen: &edgecap_client::message::Observation,
        person: &TruthPerson,
        truth: &TruthFrame,
        moment: &mut Moment,
    ) {
        moment.found = true;
        let metres = metres_per_pixel(person, truth);
        let off = |j: usize, k: usize| {
            [0, 1].map(|a| f64::from(seen.joints2d[j][a] - person.joints2d[k][a]) * metres[a])
        };
        let has = |j: usize| seen.joints2d[j][2] > 0.0;
        let length = |e: [f64; 2]| e[0].hypot(e[1]);
        let mut exchanged = [false; EVIDENCE_JOINTS];
        for (limb, pairs) in SIDES.into_iter().enumerate() {
            let pairs = pairs.iter().filter(|[r, l]| has(*r) && has(*l));
            let (mut as_is, mut crossed, mut apart, mut n) = (0.0, 0.0, 0.0, 0.0);
            for &[r, l] in pairs.clone() {
                as_is += length(off(r, r)) + length(off(l, l));
                crossed += length(off(r, l)) + length(off(l, r));
                let between = [0, 1]
                    .map(|a| f64::from(person.joints2d[r][a] - person.joints2d[l][a]) * metres[a]);
                apart += length(between);
                n += 1.0;
            }
            if n < 2.0 || apart < APART * n {
                continue;
            }
            self.swaps[1] += 1;
            if crossed < 0.6 * as_is && as_is - crossed > APART * n {
                self.swaps[0] += 1;
                moment.swapped[limb] = true;
                for &[r, l] in pairs {
                    (exchanged[r], exchanged[l]) = (true, true);
                }
            }
        }
        for j in (0..EVIDENCE_JOINTS).filter(|&j| has(j)) {
            moment.seen[j] = true;
            if !moment.visible[j] || exchanged[j] {
                continue;
            }
            let error = off(j, j);
            self.outliers[1] += 1;
            if length(error) > FAR_OFF {
                self.outliers[0] += 1;
            } else {
                moment.plane[j] = Some(error);
                self.bias.add(j, moment.shown, error);
            }
        }
        let scale = f64::from(CANONICAL_STATURE) / f64::from(person.stature);
        let wide = |p: [f32; 3]| p.map(f64::from);
        let root = wide(person.joints3d[PELVIS]);
        let centre = wide(seen.joints3d[PELVIS]);
        let between = |j: usize, k: usize| {
            let wanted = minus(wide(person.joints3d[k]), root).map(|x| x * scale);
            minus(minus(wide(seen.joints3d[j]), centre), wanted)
        };
        for pairs in SIDES {
            let (mut as_is, mut crossed) = (0.0, 0.0);
            for &[r, l] in &pairs {
                as_is += norm(between(r, r)) + norm(between(l, l));
                crossed += norm(between(r, l)) + norm(between(l, r));
            }
            if crossed < 0.6 * as_is {
                for [r, l] in pairs {
                    (exchanged[r], exchanged[l]) = (true, true);
                }
            }
        }
        for j in (0..BODY_JOINTS).filter(|&j| j != PELVIS) {
            if exchanged[SEEN_THROUGH[j]] {
                continue;
            }
            moment.space[j] = Some(between(j, j));
        }
    }

    /// The statistics of frames `fps` times a second; `None` when nobody was found.
    pub fn finish(&self, fps: f64) -> Option<Noise> {
        let found = |m: &&Moment| m.found;
        let moments = || self.people.values().flatten();
        let people = [moments().count(), moments().filter(found).count()];
        if people[1] == 0 {
            return None;
        }
        let share = |[part, whole]: [usize; 2]| part as f64 / whole.max(1) as f64;
        let (miss, burst, absent) = absences(self.people.values(), fps);
        let (lost, hidden) = missing_joints(self.people.values(), fps);
        let bias = self.bias.finish();
        let plane = |m: &Moment, j: usize| {
            let told = part(m.shown, bias[j]);
            m.plane[j].map(|[u, v]| vec![u - told.x, v - told.y])
        };
        let space = |m: &Moment, j: usize| {
            m.space[j]
                .filter(|_| m.seen[SEEN_THROUGH[j]])
                .map(Vec::from)
        };
        let space_mean = [true, false].map(|seen| {
            let errors: Vec<f64> = moments()
                .flat_map(|m| {
                    let joints = (0..BODY_JOINTS).filter(move |&j| m.seen[SEEN_THROUGH[j]] == seen);
                    joints.filter_map(|j| m.space[j].map(norm))
                })
                .collect();
            mean(&errors)
        });
        Some(Noise {
            people,
            bias: bias.map(|b| b.to_array()),
            plane: spread(&self.people, EVIDENCE_JOINTS, fps, &plane),
            space: spread(&self.people, BODY_JOINTS, fps, &space),
            space_mean,
            miss,
            burst,
            absent,
            lost,
            outlier: share(self.outliers),
            hidden,
            // Arms and legs are judged one by one.
            swap: SIDES.len() as f64 * share(self.swaps),
            swap_time: lasting(self.people.values()) / fps,
            phantom: self.phantoms as f64 / self.frames.max(1) as f64,
        })
    }
}

/// What a picture shows of a person's left, up and forward.
fn shown(person: &TruthPerson) -> Shown {
    let axes = axes(&person.joints3d).unwrap_or(Mat3::ZERO);
    let row = |k: usize| DVec3::from(axes.row(k).to_array().map(f64::from));
    [row(0), row(1)]
}

/// Mean frames in a row in which arms or legs are exchanged; 0 where they never are.
fn lasting<'a>(people: impl Iterator<Item = &'a Vec<Moment>>) -> f64 {
    let (mut frames, mut runs) = (0.0, 0.0_f64);
    for moments in people {
        for limb in 0..SIDES.len() {
            let same = |a: &Moment, b: &Moment| {
                a.swapped[limb] == b.swapped[limb] && b.frame == a.frame + 1
            };
            let of = moments.chunk_by(same).filter(|run| run[0].swapped[limb]);
            for run in of {
                frames += run.len() as f64;
                runs += 1.0;
            }
        }
    }
    frames / runs.max(1.0)
}

/// Metres at canonical stature and the person's distance per pixel, across and down.
fn metres_per_pixel(person: &TruthPerson, truth: &TruthFrame) -> [f64; 2] {
    let depth = f64::from(person.joints3d[PELVIS][2].max(0.1));
    let scale = f64::from(CANONICAL_STATURE / person.stature);
    [truth.camera.fx, truth.camera.fy].map(|f| depth * scale / f64::from(f))
}

/// Mean distance in the picture over the joints seen, metres, each at most half a metre more than counts; sides may be
/// exchanged as a whole.
fn distance(seen: &[[f32; 3]; EVIDENCE_JOINTS], person: &TruthPerson, truth: &TruthFrame) -> f64 {
    if person.joints3d[PELVIS][2] <= 0.1 {
        return f64::INFINITY;
    }
    let metres = metres_per_pixel(person, truth);
    let (mut sum, mut crossed, mut n) = (0.0, 0.0, 0.0);
    for j in (0..EVIDENCE_JOINTS).filter(|&j| seen[j][2] > 0.0) {
        let far = |k: usize| {
            let off = [0, 1].map(|a| f64::from(seen[j][a] - person.joints2d[k][a]) * metres[a]);
            off[0].hypot(off[1]).min(SAME_PERSON + 0.5)
        };
        sum += far(j);
        crossed += far(MIRROR[j]);
        n += 1.0;
    }
    if n > 0.0 {
        sum.min(crossed) / n
    } else {
        f64::INFINITY
    }
}

/// Share of short misses, rate of bursts a frame, share of long absences.
fn absences<'a>(people: impl Iterator<Item = &'a Vec<Moment>>, fps: f64) -> (f64, f64, f64) {
    let (mut short, mut bursts, mut long, mut all) = (0, 0, 0, 0);
    for moments in people {
        all += moments.len() as u64;
        for run in moments.chunk_by(|a, b| a.found == b.found && b.frame == a.frame + 1) {
            let n = run.len() as u64;
            let seconds = n as f64 / fps;
            match n {
                _ if run[0].found => {}
                _ if seconds < BURST[0] - EXACT => short += n,
                _ if seconds <= BURST[1] + EXACT => bursts += 1,
                _ => long += n,
            }
        }
    }
    // Whoever is away for long can neither be missed nor seen.
    let present = (all - long).max(1) as f64;
    (
        short as f64 / present,
        f64::from(bursts) / present,
        long as f64 / all.max(1) as f64,
    )
}

/// Share of joints missing for less than [`HIDDEN`], rate a frame at which longer gaps begin. Joints that go missing
/// together count as one gap.
fn missing_joints<'a>(people: impl Iterator<Item = &'a Vec<Moment>>, fps: f64) -> (f64, f64) {
    let long = 0.8 * HIDDEN * fps;
    let are_together = |a: &u64, b: &u64| (b - a) as f64 / fps <= TOGETHER + EXACT;
    let brief = (MOMENT * fps).round().max(1.0) as usize;
    let (mut lost, mut joints, mut gaps, mut free) = (0, 0, 0, 0);
    for moments in people {
        let found: Vec<&Moment> = moments.iter().filter(|m| m.found).collect();
        let mut begins: Vec<u64> = Vec::new();
        let mut gone = vec![false; found.len()];
        for j in 0..EVIDENCE_JOINTS {
            let asked: Vec<usize> = (0..found.len()).filter(|&k| found[k].visible[j]).collect();
            joints += asked.len();
            let mut seen: Vec<bool> = asked.iter().map(|&k| found[k].seen[j]).collect();
            without_islands(&mut seen, brief);
            let order: Vec<usize> = (0..asked.len()).collect();
            for run in order.chunk_by(|a, b| seen[*a] == seen[*b]) {
                if seen[run[0]] {
                    continue;
                }
                // Frames in which the person was missed or the joint could not be seen do not count.
                if (run.len() as f64) < long {
                    lost += run.len();
                } else {
                    joints -= run.len();
                    begins.push(found[asked[run[0]]].frame);
                    run.iter().for_each(|&i| gone[asked[i]] = true);
                }
            }
        }
        begins.sort_unstable();
        gaps += begins.chunk_by(are_together).count();
        free += gone.iter().filter(|g| !**g).count();
    }
    (
        lost as f64 / joints.max(1) as f64,
        gaps as f64 / free.max(1) as f64,
    )
}

/// Leaves out where a joint is seen for at most `brief` frames, and missing for at least twice as many before and
/// after: where left and right are exchanged for a moment, a hidden joint seems to be there.
fn without_islands(seen: &mut [bool], brief: usize) {
    let runs: Vec<usize> = seen.chunk_by(|a, b| a == b).map(<[bool]>::len).collect();
    let is_wide = |run: Option<usize>| {
        let frames = run.and_then(|k| runs.get(k));
        frames.is_some_and(|n| *n >= 2 * brief)
    };
    let mut begin = 0;
    for (k, n) in runs.iter().enumerate() {
        let run = &mut seen[begin..begin + n];
        if run[0] && *n <= brief && is_wide(k.checked_sub(1)) && is_wide(Some(k + 1)) {
            run.fill(false);
        }
        begin += n;
    }
}

/// Splits an error into its parts by its autocovariance, pooled over people, joints and axes.
fn spread(
    people: &BTreeMap<u32, Vec<Moment>>,
    joints: usize,
    fps: f64,
    error: &dyn Fn(&Moment, usize) -> Option<Vec<f64>>,
) -> Spread {
    let lags = (LAGS * fps).ceil() as usize;
    let mut sums = vec![[0.0f64; 2]; lags + 1];
    for moments in people.values() {
        for j in 0..joints {
            let series: Vec<(u64, Vec<f64>)> = moments
                .iter()
                .filter_map(|m| Some((m.frame, error(m, j)?)))
                .collect();
            for (k, (now, a)) in series.iter().enumerate() {
                for (then, b) in &series[k..] {
                    let lag = (then - now) as usize;
                    if lag > lags {
                        break;
                    }
                    for (x, y) in a.iter().zip(b) {
                        sums[lag][0] += x * y;
                        sums[lag][1] += 1.0;
                    }
                }
            }
        }
    }
    let covariance: Vec<f64> = sums.iter().map(|[s, n]| s / n.max(1.0)).collect();
    let mut best = (f64::INFINITY, Spread::default());
    for step in 0..=80 {
        // From 0.03 s to 10 s.
        let time = 0.03 * (10.0f64 / 0.03).powf(f64::from(step) / 80.0);
        let shape = |k: usize| (-(k as f64) / (fps * time)).exp();
        let (mut ss, mut sc) = (0.0, 0.0);
        for k in 1..=lags {
            ss += sums[k][1] * shape(k) * shape(k);
            sc += sums[k][1] * shape(k) * covariance[k];
        }
        let slow = (sc / f64::max(ss, 1e-12)).clamp(0.0, covariance[0]);
        let miss: f64 = (1..=lags)
            .map(|k| sums[k][1] * (covariance[k] - slow * shape(k)).powi(2))
            .sum();
        if miss < best.0 {
            let white = (covariance[0] - slow).max(0.0).sqrt();
            let slow = slow.sqrt();
            best = (miss, Spread { slow, white, time });
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of one person, who is missed, and whose wrists are missing, in stretches of so many seconds.
    fn moments(fps: u64, missed: &[[f64; 2]], without: &[[f64; 2]]) -> Vec<Moment> {
        let within = |stretches: &[[f64; 2]], frame: u64| {
            let middle = (frame as f64 + 0.5) / fps as f64;
            stretches.iter().any(|[a, b]| (*a..*b).contains(&middle))
        };
        let moment = |frame: u64| {
            let found = !within(missed, frame);
            let is_wrist = |j: usize| j == 4 || j == 7;
            Moment {
                frame,
                found,
                visible: [true; EVIDENCE_JOINTS],
                seen: std::array::from_fn(|j| found && !(is_wrist(j) && within(without, frame))),
                shown: [DVec3::ZERO; 2],
                swapped: [false; 2],
                plane: [None; EVIDENCE_JOINTS],
                space: [None; BODY_JOINTS],
            }
        };
        (0..12 * fps).map(moment).collect()
    }

    #[test]
    fn a_scene_is_the_same_at_every_rate() {
        let step = 1.0 / 15.0;
        // A miss, a burst, and somebody whom the detector cannot see.
        let missed = [[1.0, 1.0 + step], [2.0, 2.0 + 3.0 * step], [3.0, 3.4]];
        // Lost for a moment, and hidden twice, the second time with a moment in which they seem to be there.
        let without = [[5.0, 5.2], [6.0, 7.0], [8.0, 8.4], [8.4 + step / 2.0, 9.0]];
        let told = |fps: u64, without: &[[f64; 2]]| {
            let people = [moments(fps, &missed, without)];
            let (miss, burst, absent) = absences(people.iter(), fps as f64);
            let (lost, hidden) = missing_joints(people.iter(), fps as f64);
            [miss, burst * fps as f64, absent, lost, hidden * fps as f64]
        };
        let near = |a: [f64; 5], b: [f64; 5]| {
            let mut pairs = a.into_iter().zip(b);
            assert!(
                pairs.all(|(a, b)| a > 0.0 && (a - b).abs() < 1e-9),
                "{a:?}, {b:?}"
            );
        };
        near(told(15, &without[..2]), told(60, &without[..2]));
        near(told(30, &without), told(60, &without));
    }

    #[test]
    fn limits_are_seconds_also_where_they_lie_between_frames() {
        for (fps, frames, is_burst, is_absence) in [
            (24, 2, false, false),
            (24, 3, true, false),
            (25, 6, true, false),
            (25, 7, false, true),
            (30, 3, true, false),
        ] {
            let missed = [[1.0, 1.0 + f64::from(frames) / fps as f64]];
            let (miss, burst, absent) = absences([moments(fps, &missed, &[])].iter(), fps as f64);
            assert_eq!(
                (burst > 0.0, absent > 0.0, miss > 0.0),
                (is_burst, is_absence, !is_burst && !is_absence),
                "{frames} frames of {fps} a second"
            );
        }
        // Wrists that are gone for two seconds each, the second ones from 3 frames after the first on.
        for (fps, gaps) in [(25, 2.0), (30, 1.0)] {
            let mut of = moments(fps, &[], &[]);
            for moment in &mut of {
                let gone = |from: u64| (from..from + 2 * fps).contains(&moment.frame);
                (moment.seen[4], moment.seen[7]) = (!gone(fps), !gone(fps + 3));
            }
            let (_, hidden) = missing_joints([&of].into_iter(), fps as f64);
            let free = (12 * fps - 2 * fps - 3) as f64;
            assert!((hidden * free - gaps).abs() < 1e-9, "{hidden} at {fps}");
        }
    }
}

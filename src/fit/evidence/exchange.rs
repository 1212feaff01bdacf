//! In: evidence and the pose that motion predicts. Out: the evidence with left and right exchanged back where Stage I
//! or II confused them.
//!
//! Arms and legs, in the picture and in space, are each as they are seen or exchanged: a hidden Markov model of sixteen
//! states, filtered forwards. So what a single frame leaves open, as where legs pass each other, is decided by the
//! frames before and by the other limbs.

use glam::DVec3;

use super::Evidence;
use crate::body::skeleton::Posed;
use crate::joints::{ANKLES, ELBOWS, FOOT_TIPS, HANDS, HIPS, KNEES, PELVIS, SHOULDERS, WRISTS};

const ARMS: [[usize; 2]; 3] = [SHOULDERS, ELBOWS, WRISTS];
const LEGS: [[usize; 2]; 3] = [HIPS, KNEES, ANKLES];
/// Seconds after which a lasting exchange is taken for the truth: then the prediction was wrong.
const PATIENCE: f64 = 0.5;

/// What may be exchanged, a bit of a state each: arms and legs in the picture, arms and legs in space.
const KINDS: usize = 4;
const STATES: usize = 1 << KINDS;
/// Bits of arms and of legs, both in the picture and in space.
const LIMBS: [usize; 2] = [0b0101, 0b1010];
const WHOLE: usize = 0b1111;

/// Changes a second of limbs in the picture and in space together, or of the whole body …
const TOGETHER: f64 = 1.0;
/// … and of anything else.
const APART: f64 = 0.3;
/// That nothing is exchanged any more comes so many times as often.
const BACK: f64 = 10.0;
/// Seconds of a step of the chain: much less than any state is likely to last.
const STEP: f64 = 1.0 / 120.0;
/// Seconds after which the chain has forgotten where it was.
const FORGETS: f64 = 2.0;
/// Seconds for which errors are alike: of frames that are nearer to each other each counts less.
const CORRELATED: f64 = 1.0 / 60.0;
/// Metres by which joints are off where a state is right (those of a person are off together, so each tells little) …
const SPREAD: f64 = 0.25;
/// … and those from which on a joint is simply wrong.
const FAR: f64 = 0.35;
/// How much less likely it is, in nats, that one of two kinds is exchanged and the other is not: arms and legs in the
/// picture, arms in the picture and in space, legs so.
const PAIR: f64 = 0.3;
/// The least belief in a state.
const LEAST: f64 = 1e-9;

/// Memory of past exchanges of one person.
#[derive(Debug, Clone, Copy)]
pub struct SwapMemory {
    /// Probability of every state.
    belief: [f64; STATES],
    /// Seconds for which each kind has been exchanged, less those for which it has not.
    lasting: [f64; KINDS],
}

impl Default for SwapMemory {
    fn default() -> Self {
        Self {
            belief: std::array::from_fn(|state| if state == 0 { 1.0 } else { LEAST }),
            lasting: [0.0; KINDS],
        }
    }
}

impl SwapMemory {
    /// As after lasting exchanges: sides count as they are seen, until they have agreed with the prediction for a
    /// while.
    pub fn doubting_the_prediction() -> Self {
        Self {
            lasting: [PATIENCE; KINDS],
            ..Self::default()
        }
    }

    /// Undoes exchanges in `evidence`, `dt` seconds after the last call. Where limbs are exchanged in the picture or in
    /// space alone, what is said of them in space tells nothing: it is marked, and is where they are predicted.
    pub fn undo(&mut self, evidence: &mut Evidence, predicted: &Posed, dt: f64) {
        let mut off = [[0.0; 2]; KINDS];
        for (g, pairs) in [ARMS, LEGS].iter().enumerate() {
            off[g] = off_in_picture(evidence, predicted, pairs);
            if evidence.known3d {
                off[2 + g] = off_in_space(evidence, predicted, pairs);
            }
        }
        let exchanged = self.decide(&off, dt);
        for (g, pairs) in [ARMS, LEGS].iter().enumerate() {
            if exchanged[g] {
                for &[r, l] in pairs {
                    evidence.plane.swap(r, l);
                    evidence.confidence.swap(r, l);
                }
            }
            for &[r, l] in pairs.iter().chain([[HANDS], [FOOT_TIPS]][g].iter()) {
                if evidence.known3d && exchanged[g] != exchanged[2 + g] {
                    for j in [r, l] {
                        evidence.points3d[j] = predicted.joints[j] - predicted.joints[PELVIS];
                        evidence.tells3d[j] = false;
                    }
                } else if exchanged[2 + g] {
                    evidence.points3d.swap(r, l);
                }
            }
        }
    }

    /// Which kinds are exchanged and to be undone, `off` being by how much each is off as seen and exchanged.
    fn decide(&mut self, off: &[[f64; 2]; KINDS], dt: f64) -> [bool; KINDS] {
        let mut belief = self.belief;
        let span = dt.clamp(0.0, FORGETS);
        let steps = (span / STEP).ceil();
        for _ in 0..steps as usize {
            belief = stepped(&belief, span / steps);
        }
        let counts = (dt / CORRELATED).min(1.0);
        let log: [f64; STATES] = std::array::from_fn(|state| counts * likelihood(state, off));
        let most = log.into_iter().fold(f64::NEG_INFINITY, f64::max);
        for (p, l) in belief.iter_mut().zip(log) {
            *p = (*p * (l - most).exp()).max(LEAST);
        }
        let sum: f64 = belief.iter().sum();
        self.belief = belief.map(|p| p / sum);
        // Of states that are as likely the one with fewer exchanges.
        let order = |a: &usize, b: &usize| {
            let by_belief = self.belief[*a].total_cmp(&self.belief[*b]);
            by_belief.then(b.count_ones().cmp(&a.count_ones()))
        };
        let best = (0..STATES).max_by(order).unwrap_or(0);
        for limb in LIMBS {
            // In the picture and in space it is one exchange, which lasts since it was first seen.
            if best & limb == limb {
                let kinds = (0..KINDS).filter(|k| limb >> k & 1 == 1);
                let longest = kinds.clone().map(|k| self.lasting[k]).fold(0.0, f64::max);
                kinds.for_each(|k| self.lasting[k] = longest);
            }
        }
        std::array::from_fn(|k| {
            let lasting = &mut self.lasting[k];
            if best >> k & 1 == 0 {
                *lasting = (*lasting - dt).max(0.0);
                return false;
            }
            *lasting = (*lasting + dt).min(PATIENCE);
            *lasting < PATIENCE
        })
    }
}

/// What is believed `seconds` later, a short time.
fn stepped(belief: &[f64; STATES], seconds: f64) -> [f64; STATES] {
    let mut next = *belief;
    for (from, p) in belief.iter().enumerate() {
        for to in (0..STATES).filter(|&to| to != from) {
            let moved = p * rate(from, to) * seconds;
            next[to] += moved;
            next[from] -= moved;
        }
    }
    next
}

/// Changes a second from one state to another.
fn rate(from: usize, to: usize) -> f64 {
    let changed = from ^ to;
    let is_together = changed == WHOLE || LIMBS.contains(&changed);
    let rate = if is_together { TOGETHER } else { APART };
    match to {
        0 => BACK * rate,
        _ => rate,
    }
}

/// Logarithm of how likely a frame is in a state, up to what is the same in all.
fn likelihood(state: usize, off: &[[f64; 2]; KINDS]) -> f64 {
    let is_exchanged = |k: usize| state >> k & 1;
    let sum: f64 = (0..KINDS).map(|k| off[k][is_exchanged(k)]).sum();
    let apart = [(0, 1), (0, 2), (1, 3)].map(|(a, b)| is_exchanged(a) ^ is_exchanged(b));
    -sum / SPREAD - PAIR * apart.iter().sum::<usize>() as f64
}

/// By how much joints are off in the picture as seen, and exchanged: a sum, metres at the person's distance.
fn off_in_picture(e: &Evidence, predicted: &Posed, pairs: &[[usize; 2]]) -> [f64; 2] {
    let depth = predicted.joints[PELVIS].z;
    let mut sums = [0.0; 2];
    for (seen, this, other) in both_ways(pairs) {
        let (p, q) = (predicted.joints[this], predicted.joints[other]);
        if e.confidence[seen] > 0.0 && p.z > 0.2 && q.z > 0.2 {
            let off = |p: DVec3| (p.truncate() / p.z - e.plane[seen]).length() * depth;
            sums[0] += off(p).min(FAR);
            sums[1] += off(q).min(FAR);
        }
    }
    sums
}

/// The same in space, metres.
fn off_in_space(e: &Evidence, predicted: &Posed, pairs: &[[usize; 2]]) -> [f64; 2] {
    let root = predicted.joints[PELVIS];
    let mut sums = [0.0; 2];
    for (seen, this, other) in both_ways(pairs) {
        let off = |j: usize| (predicted.joints[j] - root - e.points3d[seen]).length();
        sums[0] += off(this).min(FAR);
        sums[1] += off(other).min(FAR);
    }
    sums
}

/// A joint that is seen, which one it is, and which one if sides are exchanged.
fn both_ways(pairs: &[[usize; 2]]) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
    pairs.iter().flat_map(|&[r, l]| [(r, r, l), (l, l, r)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame that shows sides as predicted, one that shows them exchanged, and one that tells neither.
    const AS_SEEN: [f64; 2] = [0.1, 2.0];
    const EXCHANGED: [f64; 2] = [2.0, 0.1];
    const OPEN: [f64; 2] = [0.5, 0.5];
    const DT: f64 = 1.0 / 30.0;

    #[test]
    fn an_exchange_is_undone_again_as_soon_as_a_lasting_one_has_passed() {
        let mut memory = SwapMemory::default();
        let undone = (0..300).filter(|_| memory.decide(&[EXCHANGED; KINDS], DT) == [true; KINDS]);
        let undone = undone.count();
        assert!((13..=15).contains(&undone), "half a second: {undone}");
        for _ in 0..30 {
            assert_eq!(memory.decide(&[AS_SEEN; KINDS], DT), [false; KINDS]);
        }
        assert_eq!(memory.decide(&[EXCHANGED; KINDS], DT), [true; KINDS]);
    }

    #[test]
    fn where_the_prediction_is_doubted_what_is_seen_counts() {
        let mut memory = SwapMemory::doubting_the_prediction();
        for _ in 0..30 {
            assert_eq!(memory.decide(&[EXCHANGED; KINDS], DT), [false; KINDS]);
        }
        for _ in 0..3 {
            assert_eq!(memory.decide(&[AS_SEEN; KINDS], DT), [false; KINDS]);
        }
        let undone = memory.decide(&[EXCHANGED; KINDS], DT);
        assert_eq!(undone, [true; KINDS], "an exchange of one frame");
    }

    #[test]
    fn limbs_are_exchanged_by_themselves_too() {
        for k in 0..KINDS {
            let mut off = [AS_SEEN; KINDS];
            off[k] = EXCHANGED;
            let undone = SwapMemory::default().decide(&off, DT);
            assert_eq!(undone, std::array::from_fn(|kind| kind == k));
        }
    }

    #[test]
    fn legs_that_pass_each_other_are_exchanged_as_the_arms_are() {
        let mut memory = SwapMemory::default();
        let turned = [EXCHANGED, OPEN, EXCHANGED, OPEN];
        let undone: Vec<_> = (0..4).map(|_| memory.decide(&turned, DT)).collect();
        assert_eq!(undone[3], [true; KINDS]);
        // While arms agree, legs do.
        let mut memory = SwapMemory::default();
        for _ in 0..30 {
            let undone = memory.decide(&[AS_SEEN, OPEN, AS_SEEN, OPEN], DT);
            assert_eq!(undone, [false; KINDS]);
        }
    }

    #[test]
    fn however_far_frames_are_apart_what_agrees_is_not_exchanged() {
        // Of somebody who stands: nothing is off as seen, arms and legs are apart from each other.
        let standing = [[0.0, 2.1], [0.0, 1.26], [0.0, 2.1], [0.0, 1.26]];
        for dt in [1.0 / 240.0, DT, 0.1, 0.17, 0.2, 0.34, 1.0, 60.0] {
            let mut memory = SwapMemory::default();
            for _ in 0..30 {
                memory.decide(&standing, DT);
            }
            assert_eq!(memory.decide(&standing, dt), [false; KINDS], "{dt} s");
        }
    }

    #[test]
    fn an_exchange_is_told_after_as_long_at_any_rate_of_frames() {
        // A little in favour of an exchange.
        let doubtful = [[0.35, 0.25]; KINDS];
        let seconds = [60.0, 120.0, 240.0].map(|fps| {
            let mut memory = SwapMemory::default();
            let frames = (1..1000).find(|_| memory.decide(&doubtful, 1.0 / fps) == [true; KINDS]);
            f64::from(frames.unwrap()) / fps
        });
        assert!(
            seconds.iter().all(|s| (s - seconds[0]).abs() < 0.03),
            "{seconds:?}"
        );
    }
}

//! In: evidence and the pose that motion predicts. Out: the evidence with left and right exchanged back where Stage I
//! or II confused them.

use super::Evidence;
use crate::body::skeleton::Posed;
use crate::joints::PELVIS;

const ARMS: [(usize, usize); 3] = [(2, 5), (3, 6), (4, 7)];
const LEGS: [(usize, usize); 3] = [(8, 11), (9, 12), (10, 13)];
const HANDS: (usize, usize) = (17, 18);
const FEET: (usize, usize) = (19, 20);
/// Exchanged evidence must be this much nearer to the prediction, as a share …
const RATIO: f64 = 0.6;
/// … and in metres a joint.
const MARGIN: f64 = 0.06;
/// Seconds after which a lasting exchange is taken for the truth: then the prediction was wrong.
const PATIENCE: f64 = 0.5;

/// Memory of past exchanges of one person: arms and legs, 2D and 3D.
#[derive(Debug, Clone, Copy, Default)]
pub struct SwapMemory {
    lasting: [f64; 4],
}

impl SwapMemory {
    /// As after lasting exchanges: sides count as they are seen, until they have agreed with the prediction for a
    /// while.
    pub const DOUBTS_PREDICTION: Self = Self {
        lasting: [PATIENCE; 4],
    };

    /// Undoes exchanges in `evidence`, `dt` seconds after the last call.
    pub fn undo(&mut self, evidence: &mut Evidence, predicted: &Posed, dt: f64) {
        for (g, pairs) in [ARMS, LEGS].iter().enumerate() {
            if self.decide(g, exchange_gain_2d(evidence, predicted, pairs), dt) {
                for &(r, l) in pairs {
                    evidence.plane.swap(r, l);
                    evidence.confidence.swap(r, l);
                }
            }
            if evidence.known3d
                && self.decide(2 + g, exchange_gain_3d(evidence, predicted, pairs), dt)
            {
                for &(r, l) in pairs.iter().chain([[HANDS], [FEET]][g].iter()) {
                    evidence.points3d.swap(r, l);
                }
            }
        }
    }

    fn decide(
        &mut self,
        group: usize,
        (as_is, exchanged, joints): (f64, f64, usize),
        dt: f64,
    ) -> bool {
        let wanted =
            joints > 0 && exchanged < RATIO * as_is && as_is - exchanged > MARGIN * joints as f64;
        let lasting = &mut self.lasting[group];
        if !wanted {
            *lasting = (*lasting - dt).max(0.0);
            return false;
        }
        *lasting = (*lasting + dt).min(PATIENCE);
        *lasting < PATIENCE
    }
}

/// Sum of distances as observed and exchanged, and the number of joints behind them.
fn exchange_gain_2d(
    e: &Evidence,
    predicted: &Posed,
    pairs: &[(usize, usize)],
) -> (f64, f64, usize) {
    let depth = predicted.joints[PELVIS].z;
    let (mut as_is, mut exchanged, mut joints) = (0.0, 0.0, 0);
    for &(r, l) in pairs {
        for (seen, this, other) in [(r, r, l), (l, l, r)] {
            let (p, q) = (predicted.joints[this], predicted.joints[other]);
            if e.confidence[seen] > 0.0 && p.z > 0.2 && q.z > 0.2 {
                let at = |p: glam::DVec3| (p.truncate() / p.z - e.plane[seen]).length() * depth;
                as_is += at(p);
                exchanged += at(q);
                joints += 1;
            }
        }
    }
    (as_is, exchanged, joints)
}

fn exchange_gain_3d(
    e: &Evidence,
    predicted: &Posed,
    pairs: &[(usize, usize)],
) -> (f64, f64, usize) {
    let root = predicted.joints[PELVIS];
    let (mut as_is, mut exchanged) = (0.0, 0.0);
    for &(r, l) in pairs {
        for (seen, this, other) in [(r, r, l), (l, l, r)] {
            as_is += (predicted.joints[this] - root - e.points3d[seen]).length();
            exchanged += (predicted.joints[other] - root - e.points3d[seen]).length();
        }
    }
    (as_is, exchanged, 2 * pairs.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exchange_is_undone_again_as_soon_as_a_lasting_one_has_passed() {
        const WANTED: (f64, f64, usize) = (6.0, 0.0, 6);
        const NOT_WANTED: (f64, f64, usize) = (0.0, 6.0, 6);
        let dt = 1.0 / 30.0;
        let mut memory = SwapMemory::default();
        let undone = (0..300).filter(|_| memory.decide(0, WANTED, dt)).count();
        assert!((13..=15).contains(&undone), "half a second: {undone}");
        for _ in 0..30 {
            assert!(!memory.decide(0, NOT_WANTED, dt));
        }
        assert!(memory.decide(0, WANTED, dt));
    }

    #[test]
    fn where_the_prediction_is_doubted_what_is_seen_counts() {
        const WANTED: (f64, f64, usize) = (6.0, 0.0, 6);
        const NOT_WANTED: (f64, f64, usize) = (0.0, 6.0, 6);
        let dt = 1.0 / 30.0;
        let mut memory = SwapMemory::DOUBTS_PREDICTION;
        for _ in 0..30 {
            assert!((0..4).all(|group| !memory.decide(group, WANTED, dt)));
        }
        for _ in 0..3 {
            assert!(!memory.decide(0, NOT_WANTED, dt));
        }
        assert!(memory.decide(0, WANTED, dt), "an exchange of one frame");
    }
}

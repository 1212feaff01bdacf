//! The fitted body's joints beside the set's: as they are named, and after a constant offset a joint in the axes of the
//! bone it sits on, which is learned from other people.

use glam::{DMat3, DVec3};

use super::archive::JOINTS;
use crate::body::mesh::PosedTree;
use crate::joints::{
    HEAD_TOP, L_ANKLE, L_ELBOW, L_HIP, L_KNEE, L_SHOULDER, L_WRIST, NECK, PELVIS, R_ANKLE, R_ELBOW,
    R_HIP, R_KNEE, R_SHOULDER, R_WRIST,
};
use crate::lab::eval::align_similarity;
use crate::multiview::body_joints;

/// The set's joints among edgecap's 21; the set's head is the head's top.
const OWN: [usize; JOINTS] = [
    PELVIS, NECK, L_SHOULDER, L_ELBOW, L_WRIST, R_SHOULDER, R_ELBOW, R_WRIST, L_HIP, L_KNEE,
    L_ANKLE, R_HIP, R_KNEE, R_ANKLE, HEAD_TOP,
];
/// The bone whose axes each sits in, a joint of SMPL's tree: pelvis, chest, head, upper arms, forearms, thighs, shanks.
const BONE: [usize; JOINTS] = [0, 9, 9, 16, 18, 9, 17, 19, 0, 1, 4, 0, 2, 5, 15];
/// Elbows, wrists, knees and ankles, which all definitions have in nearly one place.
const LIMBS: [usize; 8] = [3, 4, 6, 7, 9, 10, 12, 13];

/// One frame: fitted and true, world, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    /// The fitted body's joints in the set's order.
    pub own: [DVec3; JOINTS],
    /// Axes of the bones that they sit on.
    pub axes: [DMat3; JOINTS],
    /// The set's joints.
    pub truth: [DVec3; JOINTS],
}

impl Pair {
    /// A posed body and the set's joints of its frame.
    pub fn new(posed: &PosedTree, truth: &[DVec3; JOINTS]) -> Self {
        let joints = body_joints(posed);
        Self {
            own: OWN.map(|j| joints[j]),
            axes: BONE.map(|b| posed.rotations()[b]),
            truth: *truth,
        }
    }

    fn moved(&self, offsets: &Offsets) -> [DVec3; JOINTS] {
        std::array::from_fn(|j| self.own[j] + self.axes[j] * offsets.by[j])
    }
}

/// Where the set has its joints, seen from the body's, in bone axes, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offsets {
    /// By joint of the set.
    pub by: [DVec3; JOINTS],
}

impl Offsets {
    /// Means over frames; `None` without any.
    pub fn learn<'a>(pairs: impl Iterator<Item = &'a Pair>) -> Option<Self> {
        let (mut sum, mut count) = ([DVec3::ZERO; JOINTS], 0.0_f64);
        for pair in pairs {
            count += 1.0;
            for (j, sum) in sum.iter_mut().enumerate() {
                *sum += pair.axes[j].transpose() * (pair.truth[j] - pair.own[j]);
            }
        }
        (count > 0.0).then(|| Self {
            by: sum.map(|s| s / count),
        })
    }
}

/// Mean distances over frames, metres.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Distances {
    /// All 15 joints as they are named, where they are in the world.
    pub named: f64,
    /// Elbows, wrists, knees and ankles alone.
    pub limbs: f64,
    /// All, each frame's body moved, turned and scaled onto the truth.
    pub named_aligned: f64,
    /// All with offsets, in the world and aligned, where offsets are known.
    pub mapped: Option<[f64; 2]>,
}

impl Distances {
    /// Of so many frames, at least one.
    pub fn new(pairs: &[Pair], offsets: Option<&Offsets>) -> Self {
        let mut sum = Self::default();
        for pair in pairs {
            let limb = |j: &usize| pair.own[*j].distance(pair.truth[*j]);
            sum.named += mean(&pair.own, &pair.truth);
            sum.limbs += LIMBS.iter().map(limb).sum::<f64>() / LIMBS.len() as f64;
            sum.named_aligned += aligned(&pair.own, &pair.truth);
        }
        sum.mapped = offsets.map(|offsets| {
            pairs.iter().fold([0.0; 2], |[plain, turned], pair| {
                let moved = pair.moved(offsets);
                [
                    plain + mean(&moved, &pair.truth),
                    turned + aligned(&moved, &pair.truth),
                ]
            })
        });
        sum.scaled(1.0 / pairs.len().max(1) as f64)
    }

    fn scaled(self, by: f64) -> Self {
        Self {
            named: self.named * by,
            limbs: self.limbs * by,
            named_aligned: self.named_aligned * by,
            mapped: self.mapped.map(|m| m.map(|x| x * by)),
        }
    }
}

fn mean(a: &[DVec3; JOINTS], b: &[DVec3; JOINTS]) -> f64 {
    a.iter().zip(b).map(|(p, q)| p.distance(*q)).sum::<f64>() / JOINTS as f64
}

fn aligned(own: &[DVec3; JOINTS], truth: &[DVec3; JOINTS]) -> f64 {
    let plain = |p: &[DVec3; JOINTS]| p.map(|q| q.to_array());
    let moved = align_similarity(&plain(own), &plain(truth));
    let each = moved.iter().zip(truth);
    each.map(|(p, q)| DVec3::from(*p).distance(*q)).sum::<f64>() / JOINTS as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offset_that_a_bone_carries_is_learned_and_taken_off() {
        let by = DVec3::new(0.02, -0.05, 0.01);
        let pair = |turn: f64| {
            let axes = DMat3::from_rotation_y(turn) * DMat3::from_rotation_x(0.3 * turn);
            let own: [DVec3; JOINTS] = std::array::from_fn(|j| {
                let j = j as f64;
                axes * DVec3::new((2.0 * j).sin(), 0.1 * j, (3.0 * j).cos())
            });
            Pair {
                own,
                axes: [axes; JOINTS],
                truth: own.map(|p| p + axes * by),
            }
        };
        let pairs = [0.0, 0.7, 2.9].map(pair);
        let learned = Offsets::learn(pairs[..2].iter()).unwrap();
        assert!(learned.by.iter().all(|o| o.distance(by) < 1e-12));
        let found = Distances::new(&pairs[2..], Some(&learned));
        assert!(found.mapped.unwrap()[0] < 1e-12 && (found.named - by.length()).abs() < 1e-12);
        // One offset for all moves the body as a whole.
        assert!(found.named_aligned < 1e-9 && (found.limbs - by.length()).abs() < 1e-12);
        // Where nobody is to learn from, nothing is known of them.
        assert_eq!(Offsets::learn(pairs[..0].iter()), None);
        assert_eq!(Distances::new(&pairs, None).mapped, None);
    }
}

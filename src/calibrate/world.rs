//! Size, floor and axes of a room that is known up to a similarity: people tell how large it is, where its floor is and
//! what is up.

use glam::{DMat3, DVec3};

use super::pose::Pose;
use crate::body::skeleton::{ANKLE_HEIGHT, Skeleton};
use crate::joints::{
    ANKLES, CANONICAL_STATURE, EVIDENCE_JOINTS, HEAD_TOP, L_ANKLE, L_ELBOW, L_HIP, L_KNEE,
    L_SHOULDER, L_WRIST, NECK, PARENTS, PELVIS, R_ANKLE, R_ELBOW, R_HIP, R_KNEE, R_SHOULDER,
    R_WRIST,
};

/// Somebody's joints in one frame.
pub type Joints = [Option<DVec3>; EVIDENCE_JOINTS];

/// Segments that make up a height: ends of the right and of the left side; evidence joints.
const SEGMENTS: [[[usize; 2]; 2]; 3] = [
    [[HEAD_TOP, NECK], [HEAD_TOP, NECK]],
    [[R_HIP, R_KNEE], [L_HIP, L_KNEE]],
    [[R_KNEE, R_ANKLE], [L_KNEE, L_ANKLE]],
];
/// Feet tell the floor's slope when they were so far apart both ways, metres.
const WIDE: f64 = 0.6;
/// They may tilt it against people's own axis by so much, radians.
const TILT: f64 = 0.2;
/// An ankle so far above the lowest way of its neighbours stands on nothing, metres.
const STANDING: f64 = 0.08;

/// Height of the person with these joints as a share of the canonical stature, from the medians of segments over all
/// frames.
pub fn size(people: &[Joints]) -> Option<f64> {
    let skeleton = Skeleton::builtin();
    let rest = rest_joints(skeleton);
    let (mut seen, mut canonical) = (0.0, 0.0);
    let between = |joints: &Joints, [a, b]: [usize; 2]| Some(joints[a]?.distance(joints[b]?));
    let trunk =
        |joints: &Joints| Some(joints[NECK]?.distance((joints[R_HIP]? + joints[L_HIP]?) / 2.0));
    for sides in SEGMENTS {
        let mut all: Vec<f64> = people
            .iter()
            .flat_map(|joints| sides.map(|ends| between(joints, ends)))
            .flatten()
            .collect();
        seen += median(&mut all)?;
        canonical += between(&rest, sides[0])?;
    }
    seen += median(&mut people.iter().filter_map(trunk).collect::<Vec<_>>())?;
    canonical += trunk(&rest)?;
    Some(seen / canonical)
}

/// Bones by the ends of the right one and of the left one, evidence joints.
const BONES: [[[usize; 2]; 2]; 6] = [
    [[NECK, R_SHOULDER], [NECK, L_SHOULDER]],
    [[R_SHOULDER, R_ELBOW], [L_SHOULDER, L_ELBOW]],
    [[R_ELBOW, R_WRIST], [L_ELBOW, L_WRIST]],
    [[NECK, R_HIP], [NECK, L_HIP]],
    [[R_HIP, R_KNEE], [L_HIP, L_KNEE]],
    [[R_KNEE, R_ANKLE], [L_KNEE, L_ANKLE]],
];
/// How much a bone may seem longer or shorter than it is, as a logarithm.
const RIGID: f64 = 0.15;

/// Which share of all bones is about as long as in the other frames and on the other side: bodies that are seen from
/// wrong places stretch and bend. 0 where no bone is known.
pub fn solidity(people: &[Joints]) -> f64 {
    let (mut alike, mut all) = (0, 0);
    for sides in BONES {
        let between = |joints: &Joints, [a, b]: [usize; 2]| Some(joints[a]?.distance(joints[b]?));
        let mut lengths: Vec<f64> = people
            .iter()
            .flat_map(|joints| sides.map(|ends| between(joints, ends)))
            .flatten()
            .collect();
        let Some(usual) = median(&mut lengths) else {
            continue;
        };
        all += lengths.len();
        alike += lengths
            .iter()
            .filter(|l| (*l / usual).ln().abs() < RIGID)
            .count();
    }
    f64::from(alike as u32) / f64::from(all.max(1) as u32)
}

/// The canonical person at rest.
pub(super) fn rest_joints(skeleton: &Skeleton) -> Joints {
    let at = |mut j: usize| {
        let mut p = DVec3::ZERO;
        while j != PELVIS {
            p += skeleton.directions()[j] * skeleton.lengths()[j];
            j = PARENTS[j];
        }
        p
    };
    std::array::from_fn(|j| Some(at(j)))
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// The room.
#[derive(Debug, Clone, Copy)]
pub struct Floor {
    /// Up, a unit vector.
    pub up: DVec3,
    /// A point on the floor, below where people were.
    pub origin: DVec3,
    /// Whether feet told the slope, or only how people hold themselves.
    pub by_feet: bool,
}

/// Finds the floor that everyone stands on; `stature` is that of whom `people` shows, metres.
pub fn floor(people: &[Joints], stature: f64) -> Option<Floor> {
    let axis = |joints: &Joints| {
        let feet = (joints[R_ANKLE]? + joints[L_ANKLE]?) / 2.0;
        (joints[NECK]? - feet).try_normalize()
    };
    let axes: Vec<DVec3> = people.iter().filter_map(axis).collect();
    let mut up = axes.iter().sum::<DVec3>().try_normalize()?;
    // Who bends down now and then says little about what is up.
    for _ in 0..5 {
        let weighed = axes.iter().map(|a| *a / (0.05 + a.distance(up)));
        up = weighed.sum::<DVec3>().try_normalize()?;
    }
    let mut low: Vec<DVec3> = people
        .iter()
        .filter_map(|joints| {
            let [a, b] = ANKLES.map(|j| joints[j]);
            let (a, b) = (a?, b?);
            Some(if a.dot(up) < b.dot(up) { a } else { b })
        })
        .collect();
    if low.is_empty() {
        return None;
    }
    let mut by_feet = false;
    for _ in 0..3 {
        let heights: Vec<f64> = low.iter().map(|p| p.dot(up)).collect();
        let mut sorted = heights.clone();
        let level = median(&mut sorted)?;
        let standing: Vec<DVec3> = low
            .iter()
            .zip(&heights)
            .filter(|(_, h)| (**h - level).abs() < STANDING)
            .map(|(p, _)| *p)
            .collect();
        let Some(normal) = plane(&standing) else {
            break;
        };
        let normal = normal * normal.dot(up).signum();
        if normal.angle_between(up) > TILT {
            break;
        }
        (up, by_feet) = (normal, true);
        low.sort_by(|a, b| a.dot(up).total_cmp(&b.dot(up)));
    }
    let mut heights: Vec<f64> = low.iter().map(|p| p.dot(up)).collect();
    heights.sort_by(f64::total_cmp);
    // A step lifts even the lower ankle for a while.
    let level =
        heights.get(heights.len() / 4)? - ANKLE_HEIGHT * stature / f64::from(CANONICAL_STATURE);
    let mean = low.iter().sum::<DVec3>() / low.len() as f64;
    Some(Floor {
        up,
        origin: mean + (level - mean.dot(up)) * up,
        by_feet,
    })
}

/// Normal of the plane through points that lie wide apart both ways.
fn plane(points: &[DVec3]) -> Option<DVec3> {
    let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let mut spread = nalgebra::Matrix3::zeros();
    for p in points {
        let d = *p - mean;
        let d = nalgebra::Vector3::new(d.x, d.y, d.z);
        spread.ger(1.0 / points.len() as f64, &d, &d, 1.0);
    }
    let eigen = nalgebra::SymmetricEigen::new(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    // Spread evenly over a length a, points have a deviation of a / √12.
    let wide = eigen.eigenvalues[order[1]].max(0.0).sqrt() * 12.0_f64.sqrt() > WIDE;
    let n = eigen.eigenvectors.column(order[0]);
    wide.then(|| DVec3::new(n[0], n[1], n[2]))
}

/// Cameras in axes with z up, the origin on the floor below where people were, y towards the first camera.
pub fn upright(cameras: &[Pose], floor: &Floor) -> Option<Vec<Pose>> {
    let to = cameras[0].position - floor.origin;
    let y = (to - to.dot(floor.up) * floor.up).try_normalize()?;
    // Columns of the world's axes in the old ones.
    let axes = DMat3::from_cols(y.cross(floor.up), y, floor.up);
    let turned = cameras.iter().map(|c| Pose {
        rotation: c.rotation * axes,
        position: axes.transpose() * (c.position - floor.origin),
    });
    Some(turned.collect())
}

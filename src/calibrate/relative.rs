//! Two views without known places: points that both saw go in, the second camera's direction and place relative to the
//! first come out, up to scale. Eight-point algorithm (Hartley 1997) on random samples, outliers among them or not.

use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3};
use rand::Rng;
use rand::rngs::SmallRng;

use super::consensus::{Search, distinct};
use super::pose::Pose;

const SEARCH: Search = Search {
    samples: 800,
    finalists: 40,
    refinements: REFINEMENTS,
};
const SAMPLE: usize = 8;
/// Groups that a sample is taken of.
const GROUPS: usize = 3;
/// Answers that are kept, and how far they are from each other, radians.
const MOST_ANSWERS: usize = 3;
const DIFFERENT: f64 = 0.3;
/// Rounds in which all points are weighed and used.
const REFINEMENTS: usize = 5;
/// Points of either view in front of both cameras that a reading must have.
const IN_FRONT: f64 = 0.75;

/// The second of two cameras, the first being at the origin along its axes.
#[derive(Debug, Clone)]
pub struct Relative {
    /// Its place, one unit away.
    pub pose: Pose,
    /// Share of the points that agree.
    pub agreeing: f64,
    /// Median angle between the rays of points that agree, radians.
    pub angle: f64,
}

/// A point on the planes z = 1 of both.
pub type Pair = (DVec2, DVec2);

/// Finds it from what both saw, one group of points for every two figures that may be the same person; `sigma` is how
/// exact points are. People far away look alike from the front and from behind, so there may be several answers: the
/// best first, none where too few points agree.
pub fn relative(groups: &[Vec<Pair>], sigma: f64, random: &mut SmallRng) -> Vec<Relative> {
    let pairs: Vec<Pair> = groups.iter().flatten().copied().collect();
    if pairs.len() < 4 * SAMPLE {
        return Vec::new();
    }
    let cost = |e: &DMat3| -> f64 {
        let each = pairs
            .iter()
            .map(|p| (sampson(e, p) / (sigma * sigma)).min(1.0));
        each.sum()
    };
    let guess = || {
        let sample = sample::<_, SAMPLE>(groups, random);
        eight_points(sample.iter().map(|p| (p, 1.0)))
    };
    let better = |e: &DMat3| {
        let weight = |p: &Pair| {
            let w = 1.0 / (1.0 + sampson(e, p) / (sigma * sigma));
            w * w
        };
        eight_points(pairs.iter().map(|p| (p, weight(p))))
    };
    let found = SEARCH.run(guess, cost, better).into_iter();
    let found = found.filter_map(|(_, e)| told(&e, &pairs, sigma));
    let is_different = |a: &Relative, b: &Relative| apart(&a.pose, &b.pose) > DIFFERENT;
    distinct(found, MOST_ANSWERS, is_different)
}

/// The second camera where it is known how it is turned; `None` where points do not tell its place.
pub fn turned(groups: &[Vec<Pair>], rotation: DMat3, sigma: f64) -> Option<Relative> {
    let pairs: Vec<Pair> = groups.iter().flatten().copied().collect();
    let pose = |across: DVec3| Pose {
        rotation,
        position: -(rotation.transpose() * across),
    };
    let mut weights = vec![1.0; pairs.len()];
    let mut across = DVec3::ZERO;
    for _ in 0..REFINEMENTS {
        // Both rays and the way between the cameras lie in one plane.
        let mut normal = Matrix3::zeros();
        for ((a, b), w) in pairs.iter().zip(&weights) {
            let n = (rotation * a.extend(1.0).normalize()).cross(b.extend(1.0).normalize());
            let n = Vector3::new(n.x, n.y, n.z);
            normal.ger(*w, &n, &n, 1.0);
        }
        let eigen = SymmetricEigen::try_new(normal, 1e-14, 200)?;
        let least = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imin())
            .into_owned();
        across = DVec3::new(least[0], least[1], least[2]);
        let e = essential(&pose(across));
        for (pair, w) in pairs.iter().zip(&mut weights) {
            *w = (1.0 + sampson(&e, pair) / (sigma * sigma)).powi(-2);
        }
    }
    of_readings(
        &[pose(across), pose(-across)],
        &essential(&pose(across)),
        &pairs,
        sigma,
    )
}

/// What an essential matrix says, where most points lie in front of both cameras.
fn told(e: &DMat3, pairs: &[Pair], sigma: f64) -> Option<Relative> {
    of_readings(&readings(e), e, pairs, sigma)
}

/// The reading that has most points in front of both cameras, if most are.
fn of_readings(readings: &[Pose], e: &DMat3, pairs: &[Pair], sigma: f64) -> Option<Relative> {
    let agreeing: Vec<Pair> = pairs
        .iter()
        .copied()
        .filter(|p| sampson(e, p) < 4.0 * sigma * sigma)
        .collect();
    let (pose, in_front) = readings
        .iter()
        .map(|pose| (*pose, in_front(pose, &agreeing)))
        .max_by_key(|(_, n)| *n)?;
    if (in_front as f64) < IN_FRONT * agreeing.len() as f64 {
        return None;
    }
    let mut angles: Vec<f64> = agreeing
        .iter()
        .map(|(a, b)| pose.direction(*b).angle_between(a.extend(1.0)))
        .collect();
    angles.sort_by(f64::total_cmp);
    Some(Relative {
        pose,
        agreeing: agreeing.len() as f64 / pairs.len() as f64,
        angle: *angles.get(angles.len() / 2)?,
    })
}

/// The angle by which two rotations differ, radians.
pub(super) fn angle(a: &DMat3, b: &DMat3) -> f64 {
    let turn = DQuat::from_mat3(&(*a * b.transpose()));
    2.0 * turn.w.abs().min(1.0).acos()
}

/// Angle between two cameras' directions, or between their places seen from the first, whichever is more; radians.
fn apart(a: &Pose, b: &Pose) -> f64 {
    angle(&a.rotation, &b.rotation).max(a.position.angle_between(b.position))
}

/// Points of few groups: who is who is right or wrong for a whole group.
pub(super) fn sample<T: Copy, const N: usize>(groups: &[Vec<T>], random: &mut SmallRng) -> [T; N] {
    let chosen: [&Vec<T>; GROUPS] =
        std::array::from_fn(|_| &groups[random.random_range(0..groups.len())]);
    std::array::from_fn(|k| {
        let group = chosen[k % GROUPS];
        group[random.random_range(0..group.len())]
    })
}

/// How far a pair is from the epipolar geometry of a pose, on the plane z = 1.
pub fn off(pose: &Pose, pair: &Pair) -> f64 {
    sampson(&essential(pose), pair).sqrt()
}

/// The essential matrix of a second camera.
fn essential(pose: &Pose) -> DMat3 {
    let t = -(pose.rotation * pose.position);
    let cross = DMat3::from_cols(
        DVec3::new(0.0, t.z, -t.y),
        DVec3::new(-t.z, 0.0, t.x),
        DVec3::new(t.y, -t.x, 0.0),
    );
    cross * pose.rotation
}

/// Squared distance of a pair from the epipolar geometry, to first order (Sampson).
fn sampson(e: &DMat3, (a, b): &Pair) -> f64 {
    let (a, b) = (a.extend(1.0), b.extend(1.0));
    let (ea, eb) = (*e * a, e.transpose() * b);
    let scale = ea.truncate().length_squared() + eb.truncate().length_squared();
    b.dot(ea).powi(2) / scale.max(1e-30)
}

/// The essential matrix of least algebraic error: b · E a = 0.
fn eight_points<'a>(pairs: impl Iterator<Item = (&'a Pair, f64)> + Clone) -> Option<DMat3> {
    let (ta, tb) = (
        normaliser(pairs.clone().map(|((a, _), w)| (*a, w)))?,
        normaliser(pairs.clone().map(|((_, b), w)| (*b, w)))?,
    );
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for ((a, b), w) in pairs {
        let (a, b) = (ta * a.extend(1.0), tb * b.extend(1.0));
        let row = SVector::<f64, 9>::from_fn(|k, _| b[k / 3] * a[k % 3]);
        normal.ger(w, &row, &row, 1.0);
    }
    let eigen = SymmetricEigen::new(normal);
    let least = eigen.eigenvalues.imin();
    let v = eigen.eigenvectors.column(least);
    // Row-major in v.
    let f = DMat3::from_cols_array(&std::array::from_fn(|k| v[3 * (k % 3) + k / 3]));
    let e = tb.transpose() * f * ta;
    let svd = to_nalgebra(&e).try_svd(true, true, 1e-14, 200)?;
    let (u, vt) = (svd.u?, svd.v_t?);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    let mut sizes = Matrix3::zeros();
    (sizes[(order[0], order[0])], sizes[(order[1], order[1])]) = (1.0, 1.0);
    let e = to_glam(&(u * sizes * vt));
    e.is_finite().then_some(e)
}

/// Moves points to the origin and to a mean distance of 1 (Hartley).
fn normaliser(points: impl Iterator<Item = (DVec2, f64)> + Clone) -> Option<DMat3> {
    let total: f64 = points.clone().map(|(_, w)| w).sum();
    let mean = points.clone().map(|(p, w)| w * p).sum::<DVec2>() / total;
    let apart = points.map(|(p, w)| w * p.distance(mean)).sum::<f64>() / total;
    (apart > 1e-9).then(|| {
        let s = 1.0 / apart;
        DMat3::from_cols(
            DVec3::new(s, 0.0, 0.0),
            DVec3::new(0.0, s, 0.0),
            DVec3::new(-s * mean.x, -s * mean.y, 1.0),
        )
    })
}

/// The four cameras that an essential matrix may mean.
fn readings(e: &DMat3) -> Vec<Pose> {
    let svd = to_nalgebra(e).svd(true, true);
    let (Some(u), Some(vt)) = (svd.u, svd.v_t) else {
        return Vec::new();
    };
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| svd.singular_values[*b].total_cmp(&svd.singular_values[*a]));
    let pick = |m: &Matrix3<f64>| Matrix3::from_columns(&order.map(|k| m.column(k).into_owned()));
    let (u, v) = (pick(&u), pick(&vt.transpose()));
    let w = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let t = DVec3::new(u[(0, 2)], u[(1, 2)], u[(2, 2)]);
    let mut all = Vec::new();
    for w in [w, w.transpose()] {
        let r = to_glam(&(u * w * v.transpose()));
        let rotation = r * r.determinant().signum();
        for t in [t, -t] {
            all.push(Pose {
                rotation,
                position: -(rotation.transpose() * t),
            });
        }
    }
    all
}

fn in_front(pose: &Pose, pairs: &[Pair]) -> usize {
    pairs
        .iter()
        .filter(|(a, b)| {
            // Depths where the two rays are nearest to each other.
            let (da, db) = (a.extend(1.0).normalize(), pose.direction(*b));
            let (w, c) = (-pose.position, da.dot(db));
            let scale = 1.0 - c * c;
            let (s, t) = (c * w.dot(db) - w.dot(da), w.dot(db) - c * w.dot(da));
            scale > 1e-9 && s > 0.0 && t > 0.0
        })
        .count()
}

pub(super) fn to_nalgebra(m: &DMat3) -> Matrix3<f64> {
    Matrix3::from_column_slice(&m.to_cols_array())
}

pub(super) fn to_glam(m: &Matrix3<f64>) -> DMat3 {
    DMat3::from_cols_slice(m.as_slice())
}

//! Where the rays of several views meet, outliers among them or not: every pair is tried, the best start is refined.

use glam::{DMat3, DVec3};

use super::sight::{Sight, distance};
use crate::camera::View;
use crate::joints::EVIDENCE_JOINTS;

/// Ray distance beyond which a view counts little, metres.
pub const SIGMA: f64 = 0.08;
/// Rays that meet under less than this angle tell no depth: twice the squared sine, of 2.2 degrees.
const LEAST_ANGLE: f64 = 3e-3;
/// Below this squared sine of their angle rays are parallel to what numbers hold.
const PARALLEL: f64 = 1e-9;
const REFINEMENTS: usize = 6;

/// A ray with the place of its camera, and how much it counts.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// The camera.
    pub origin: DVec3,
    /// Unit vector.
    pub direction: DVec3,
    /// Weight.
    pub weight: f64,
}

/// Geman–McClure: e² at first, never more than σ².
pub fn robust(e2: f64, sigma: f64) -> f64 {
    let s2 = sigma * sigma;
    s2 * e2 / (s2 + e2)
}

/// Its weight in reweighted least squares.
pub fn robust_weight(e2: f64, sigma: f64) -> f64 {
    let s2 = sigma * sigma;
    let w = s2 / (s2 + e2);
    w * w
}

/// The point of least robust distance to all lines, and that cost; `None` for fewer than two lines, or parallel ones.
pub fn meet(lines: &[Line]) -> Option<(DVec3, f64)> {
    let cost = |p: DVec3| -> f64 {
        let one = |l: &Line| l.weight * robust(distance(l.origin, l.direction, p).powi(2), SIGMA);
        lines.iter().map(one).sum()
    };
    let mut best: Option<(DVec3, f64)> = None;
    for (k, a) in lines.iter().enumerate() {
        for b in &lines[..k] {
            let Some(p) = nearest([a, b].into_iter().map(|l| (l, 1.0))) else {
                continue;
            };
            let c = cost(p);
            if best.is_none_or(|(_, least)| c < least) {
                best = Some((p, c));
            }
        }
    }
    let (mut point, mut least) = best?;
    if lines.len() > 2 {
        for _ in 0..REFINEMENTS {
            let weigh = |l: &Line| {
                l.weight * robust_weight(distance(l.origin, l.direction, point).powi(2), SIGMA)
            };
            let Some(p) = nearest(lines.iter().map(|l| (l, weigh(l)))) else {
                break;
            };
            let c = cost(p);
            if c >= least {
                break;
            }
            (point, least) = (p, c);
        }
    }
    Some((point, least))
}

/// Robust cost of lines that hardly differ in direction, as if every two of them met halfway where they are nearest: as
/// [`meet`] has it of two. 0 for fewer than two.
pub fn passing(lines: &[Line]) -> f64 {
    let mut sum = 0.0;
    for (k, a) in lines.iter().enumerate() {
        for b in &lines[..k] {
            sum += (a.weight + b.weight) * robust((gap(a, b) / 2.0).powi(2), SIGMA);
        }
    }
    // Every line is in as many pairs as there are others.
    sum / lines.len().saturating_sub(1).max(1) as f64
}

/// Shortest distance between two rays, neither going on behind its camera.
fn gap(a: &Line, b: &Line) -> f64 {
    let (w, c) = (b.origin - a.origin, a.direction.dot(b.direction));
    let scale = 1.0 - c * c;
    let along = [
        (w.dot(a.direction) - c * w.dot(b.direction)) / scale,
        (c * w.dot(a.direction) - w.dot(b.direction)) / scale,
    ];
    // Parallel rays are as near at a camera as anywhere.
    if scale > PARALLEL && along.iter().all(|t| *t > 0.0) {
        let [p, q] = [(a, along[0]), (b, along[1])].map(|(l, t)| l.origin + t * l.direction);
        return p.distance(q);
    }
    let from = |a: &Line, b: &Line| distance(b.origin, b.direction, a.origin);
    from(a, b).min(from(b, a))
}

fn nearest<'a>(lines: impl Iterator<Item = (&'a Line, f64)>) -> Option<DVec3> {
    let (mut a, mut b, mut sum) = (DMat3::ZERO, DVec3::ZERO, 0.0);
    for (line, weight) in lines {
        let d = line.direction;
        let across = weight * (DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z));
        a += across;
        b += across * line.origin;
        sum += weight;
    }
    // Of two lines the determinant is twice the squared sine of their angle.
    if sum <= 0.0 || (a * (2.0 / sum)).determinant() < LEAST_ANGLE {
        return None;
    }
    let point = a.inverse() * b;
    point.is_finite().then_some(point)
}

/// The joints of one person in space.
#[derive(Debug, Clone, PartialEq)]
pub struct Joints3d {
    /// World, metres; none where fewer than two views saw the joint.
    pub points: [Option<DVec3>; EVIDENCE_JOINTS],
    /// Robust cost of every joint, mean of its rays by their weights, square metres.
    pub costs: [f64; EVIDENCE_JOINTS],
}

/// Triangulates every joint of one person; one entry a view.
pub fn triangulate(views: &[View], sights: &[Option<&Sight>]) -> Joints3d {
    let mut joints = Joints3d {
        points: [None; EVIDENCE_JOINTS],
        costs: [0.0; EVIDENCE_JOINTS],
    };
    let mut lines = Vec::with_capacity(views.len());
    for j in 0..EVIDENCE_JOINTS {
        lines.clear();
        lines.extend(views.iter().zip(sights).filter_map(|(view, sight)| {
            let ray = sight.as_ref()?.rays[j]?;
            Some(Line {
                origin: view.position,
                direction: ray.direction,
                weight: ray.confidence,
            })
        }));
        if let Some((point, cost)) = meet(&lines) {
            let weights: f64 = lines.iter().map(|l| l.weight).sum();
            (joints.points[j], joints.costs[j]) = (Some(point), cost / weights);
        }
    }
    joints
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_line_in_four_may_be_anywhere() {
        let point = DVec3::new(0.2, 1.1, -0.3);
        let mut lines: Vec<Line> = [0.0, 1.5, 3.0, 4.5_f64]
            .map(|a| {
                let origin = DVec3::new(4.0 * a.sin(), 1.5, 4.0 * a.cos());
                Line {
                    origin,
                    direction: (point - origin).normalize(),
                    weight: 0.8,
                }
            })
            .to_vec();
        let (found, cost) = meet(&lines).unwrap();
        assert!((found - point).length() < 1e-9 && cost < 1e-12);
        lines[2].direction = (lines[2].direction + DVec3::new(0.0, 0.3, 0.1)).normalize();
        let (found, _) = meet(&lines).unwrap();
        assert!((found - point).length() < 0.01, "{found}");
        assert!(meet(&lines[..1]).is_none());
        assert!(meet(&[lines[0], lines[0]]).is_none());
    }

    #[test]
    fn rays_that_tell_no_depth_tell_how_far_they_pass() {
        let line = |origin: DVec3, to: DVec3| Line {
            origin,
            direction: (to - origin).normalize(),
            weight: 1.0,
        };
        let (a, b) = (DVec3::new(-4.0, 1.0, 0.0), DVec3::new(4.0, 1.0, 0.0));
        // Two cameras face each other; their rays miss by so much in the middle.
        for off in [0.0, 0.01, 0.1] {
            let miss = DVec3::new(0.0, off / 2.0, 0.0);
            let rays = [line(a, DVec3::Y + miss), line(b, DVec3::Y - miss)];
            assert!(meet(&rays).is_none());
            let expected = 2.0 * robust(off * off / 4.0, SIGMA);
            assert!((passing(&rays) - expected).abs() < 1e-6, "{off}");
        }
        // A camera beside another: the rays meet behind them, or before.
        let beside = a + DVec3::new(0.0, 0.0, 0.1);
        let apart = [line(a, DVec3::Y), line(beside, DVec3::new(0.0, 1.0, 0.15))];
        let expected = 2.0 * robust(0.05 * 0.05, SIGMA);
        assert!((passing(&apart) - expected).abs() < 1e-6);
        let towards = [line(a, DVec3::Y), line(beside, DVec3::new(0.0, 1.0, 0.05))];
        assert!(passing(&towards) < 1e-12);
        assert_eq!(passing(&towards[..1]), 0.0);
    }
}

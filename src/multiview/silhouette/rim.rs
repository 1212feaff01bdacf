//! Which vertex belongs to which place of a contour, and what that costs.

use glam::{DVec2, DVec3, Vec2};

use super::contour::{Contour, Point};
use super::outline::{Outline, Rimmed};
use crate::body::mesh::{FREEDOM, MeshBody, Surface};
use crate::camera::View;
use crate::multiview::fitted::Fitted;
use crate::multiview::sight::DATA;
use crate::solve::NormalEquations;

/// What a whole contour weighs, in joints, and one of a mask that does not know every pixel: it may be wrong by more.
const JOINTS: f64 = 120.0;
const UNSURE: f64 = 40.0;
/// What a mask that ends outside of the body weighs, as a part of one that ends inside: clothes and hair are outside.
const LOOSE: f64 = 0.4;
/// Distance from which on absolute distances count, metres.
const EVEN: f64 = 0.005;
/// Least cosine between the directions in which outline and contour end.
const ALIKE: f64 = 0.4;
/// Nearer to a camera nothing is seen.
const NEAREST: f64 = 0.1;

/// A vertex and the line on the plane z = 1 that it should be on. Those of all frames of a person are held at once.
#[derive(Debug, Clone, Copy)]
struct Pair {
    vertex: u32,
    weight: f32,
    normal: Vec2,
    /// Where the line is along its normal.
    along: f32,
}

/// One view's pairs.
#[derive(Debug, Clone)]
pub struct Rim<'a> {
    view: &'a View,
    depth: f64,
    pairs: Vec<Pair>,
}

impl<'a> Rim<'a> {
    /// Pairs an outline with a contour, both ways; `reach`: metres at `depth`; `even`: distances count as they are, not
    /// squared.
    pub fn new(
        view: &'a View,
        depth: f64,
        weight: f64,
        outline: &Outline,
        contour: &Contour,
        reach: f64,
        even: bool,
    ) -> Self {
        let reach = reach / depth;
        let all = (outline.rim.len() + contour.points.len()).max(1) as f64;
        let joints = if contour.is_sure { JOINTS } else { UNSURE };
        let whole = weight * DATA * joints / all;
        let mut pairs = Vec::new();
        let mut pair = |rimmed: &Rimmed, at: &Point| {
            let (normal, plane) = (at.normal.as_dvec2(), at.plane.as_dvec2());
            let off = depth * normal.dot(rimmed.plane - plane);
            let share = match (even, off < 0.0) {
                (false, _) => 1.0,
                (true, outside) => EVEN / off.abs().max(EVEN) * if outside { LOOSE } else { 1.0 },
            };
            pairs.push(Pair {
                vertex: rimmed.vertex,
                weight: (share * whole) as f32,
                normal: at.normal,
                along: normal.dot(plane) as f32,
            });
        };
        let alike = |r: &Rimmed, p: &Point| r.normal.dot(p.normal.as_dvec2()) > ALIKE;
        let apart = |r: &Rimmed, p: &Point| r.plane.distance_squared(p.plane.as_dvec2());
        for r in &outline.rim {
            let of = contour.points.iter().filter(|p| alike(r, p));
            if let Some(p) = nearest(of.map(|p| (p, apart(r, p))), reach) {
                pair(r, p);
            }
        }
        for p in &contour.points {
            let of = outline.rim.iter().filter(|r| alike(r, p));
            if let Some(r) = nearest(of.map(|r| (r, apart(r, p))), reach) {
                pair(r, p);
            }
        }
        pairs.shrink_to_fit();
        Self { view, depth, pairs }
    }

    /// Signed distance of a vertex from its line, metres, and how it changes with the vertex' place.
    fn off(&self, pair: &Pair, at: DVec3) -> Option<(f64, DVec3)> {
        let p = self.view.to_camera(at);
        (p.z > NEAREST).then(|| {
            let n = pair.normal.as_dvec2();
            let flat = DVec2::new(p.x, p.y) / p.z;
            let off = self.depth * (n.dot(flat) - f64::from(pair.along));
            let scale = self.depth / p.z;
            let by = scale * DVec3::new(n.x, n.y, -n.dot(flat));
            (off, self.view.rotation.transpose() * by)
        })
    }

    /// The cost.
    pub fn cost(&self, body: &MeshBody, at: &Fitted) -> f64 {
        let surface = Surface::new(body, &at.person, &at.posed);
        let each = self.pairs.iter().map(|pair| {
            let off = self.off(pair, surface.vertex(pair.vertex as usize));
            off.map_or(0.0, |(off, _)| f64::from(pair.weight) * off * off)
        });
        each.sum()
    }

    /// Adds gradient and Gauss–Newton matrix; `shapes` coefficients follow the pose.
    pub fn add(&self, body: &MeshBody, at: &Fitted, shapes: usize, out: &mut NormalEquations) {
        let mut surface = Surface::new(body, &at.person, &at.posed);
        surface.prepare(shapes);
        let mut row: Vec<(usize, f64)> = Vec::with_capacity(FREEDOM + shapes);
        for pair in &self.pairs {
            let (vertex, weight) = (pair.vertex as usize, f64::from(pair.weight));
            let Some((off, by)) = self.off(pair, surface.vertex(vertex)) else {
                continue;
            };
            row.clear();
            surface.jacobian(vertex, |k, moves| row.push((k, moves.dot(by))));
            for (a, &(k, ck)) in row.iter().enumerate() {
                out.pull(k, weight * off * ck);
                for &(l, cl) in &row[..=a] {
                    out.add(k, l, weight * ck * cl);
                }
            }
        }
    }
}

fn nearest<'b, T>(of: impl Iterator<Item = (&'b T, f64)>, reach: f64) -> Option<&'b T> {
    of.filter(|(_, d)| *d < reach * reach)
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(t, _)| t)
}

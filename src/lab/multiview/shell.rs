//! Two surfaces go in, how far apart they are comes out, after one is moved and turned, not scaled, onto the other.

use std::collections::HashMap;

use glam::{DMat3, DQuat, DVec3, IVec3, Vec3};

/// Side of the cubes in which triangles are looked up, metres.
const CELL: f32 = 0.025;
/// How many cubes away triangles are looked for: 1.5 m.
const FARTHEST: i32 = 60;
/// Rounds of moving and turning at most.
const ROUNDS: usize = 60;
/// A round that moves the surface by less is the last, metres.
const STILL: f64 = 1e-5;
/// One vertex in so many decides how a surface is moved.
const SPARSE: usize = 5;

/// A surface of triangles, metres.
#[derive(Debug, Clone)]
pub struct Shell {
    at: Vec<Vec3>,
    faces: Vec<[u32; 3]>,
    /// The triangles that may reach into a cube.
    cells: HashMap<IVec3, Vec<u32>>,
}

impl Shell {
    /// From vertices and triangles of their numbers.
    pub fn new(at: Vec<Vec3>, faces: Vec<[u32; 3]>) -> Self {
        let mut cells: HashMap<IVec3, Vec<u32>> = HashMap::new();
        for (number, face) in (0..).zip(&faces) {
            let [a, b, c] = face.map(|v| at[v as usize]);
            let (low, high) = (cell(a.min(b).min(c)), cell(a.max(b).max(c)));
            for x in low.x..=high.x {
                for y in low.y..=high.y {
                    for z in low.z..=high.z {
                        cells.entry(IVec3::new(x, y, z)).or_default().push(number);
                    }
                }
            }
        }
        Self { at, faces, cells }
    }

    /// The vertices.
    pub fn vertices(&self) -> &[Vec3] {
        &self.at
    }

    /// The point of the surface nearest to `p`; `p` itself where there is none within 1.5 m.
    pub fn nearest(&self, p: Vec3) -> Vec3 {
        let (home, mut best, mut least) = (cell(p), p, f32::INFINITY);
        for ring in 0..FARTHEST {
            let outer = |d: IVec3| d.abs().max_element() == ring;
            for d in cube(ring).filter(|d| outer(*d)) {
                for &number in self.cells.get(&(home + d)).into_iter().flatten() {
                    let corners = self.faces[number as usize].map(|v| self.at[v as usize]);
                    let q = on_triangle(p, corners);
                    if p.distance(q) < least {
                        (best, least) = (q, p.distance(q));
                    }
                }
            }
            // Cubes not looked into yet are at least so far away.
            if least <= ring as f32 * CELL {
                break;
            }
        }
        best
    }

    /// Mean distance of another surface's vertices, metres.
    fn from(&self, other: &Self) -> f64 {
        let each = other.at.iter();
        let sum: f64 = each.map(|p| f64::from(p.distance(self.nearest(*p)))).sum();
        sum / other.at.len() as f64
    }
}

/// Moves and turns `a` onto `b`, each of its vertices to the nearest point again and again, then tells the mean
/// distance of its vertices from `b`'s surface, and of `b`'s vertices from its surface, metres.
pub fn apart(a: &Shell, b: &Shell) -> [f64; 2] {
    let mut at: Vec<DVec3> = a.at.iter().map(|p| p.as_dvec3()).collect();
    for _ in 0..ROUNDS {
        let few = at.iter().step_by(SPARSE);
        let pairs: Vec<[DVec3; 2]> = few
            .map(|p| [*p, b.nearest(p.as_vec3()).as_dvec3()])
            .collect();
        let [from, to] = [0, 1].map(|k| pairs.iter().map(|p| p[k]).sum::<DVec3>());
        let [from, to] = [from, to].map(|sum| sum / pairs.len() as f64);
        // The turn is small: its axis and angle solve linear equations.
        let (mut square, mut moment) = (DMat3::ZERO, DVec3::ZERO);
        for [p, q] in &pairs {
            let (x, y) = (*p - from, *q - to);
            square += DMat3::from_diagonal(DVec3::splat(x.length_squared()));
            square -= DMat3::from_cols(x * x.x, x * x.y, x * x.z);
            moment += x.cross(y);
        }
        let by = square.inverse() * moment;
        let turn = DQuat::from_scaled_axis(by);
        at.iter_mut().for_each(|p| *p = turn * (*p - from) + to);
        if by.length() + from.distance(to) < STILL {
            break;
        }
    }
    let moved = Shell::new(at.iter().map(|p| p.as_vec3()).collect(), a.faces.clone());
    [b.from(&moved), moved.from(b)]
}

fn cell(p: Vec3) -> IVec3 {
    (p / CELL).floor().as_ivec3()
}

/// All offsets of at most `r` along every axis.
fn cube(r: i32) -> impl Iterator<Item = IVec3> {
    let line = move || -r..=r;
    line().flat_map(move |x| line().flat_map(move |y| line().map(move |z| IVec3::new(x, y, z))))
}

fn on_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> Vec3 {
    let normal = (b - a).cross(c - a);
    let edges = [(a, b), (b, c), (c, a)];
    let within = |(s, e): (Vec3, Vec3)| (e - s).cross(p - s).dot(normal) >= 0.0;
    if normal.length_squared() > 0.0 && edges.into_iter().all(within) {
        return p - normal * ((p - a).dot(normal) / normal.length_squared());
    }
    let on_edge = |(s, e): (Vec3, Vec3)| {
        let along = (p - s).dot(e - s) / (e - s).length_squared().max(f32::MIN_POSITIVE);
        s + along.clamp(0.0, 1.0) * (e - s)
    };
    let [first, others @ ..] = edges.map(on_edge);
    let nearer = |q: Vec3, r: Vec3| if p.distance(r) < p.distance(q) { r } else { q };
    others.into_iter().fold(first, nearer)
}

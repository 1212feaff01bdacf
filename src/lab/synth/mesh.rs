//! Skin: a rest-pose solid goes in, a closed triangle mesh with bone weights comes out (surface nets).

use glam::{IVec3, Quat, Vec3};

use super::flesh::Flesh;
use super::outfit::{Matter, Outfit, Spot};
use super::pose::Posed;
use super::shape::{BONES, Bone, Shape};
use super::weights::weights;
use crate::joints::{L_HIP, NECK};

/// Cells along one side of a block that is evaluated or skipped as a whole.
const BLOCK: i32 = 4;

/// One vertex of the rest pose.
#[derive(Debug, Clone, Copy)]
pub struct Vertex {
    /// Rest position, metres.
    pub rest: Vec3,
    /// Outward normal.
    pub normal: Vec3,
    /// 1 in the open, less in creases.
    pub openness: f32,
    /// Nearest part's substance.
    pub matter: Matter,
    /// Nearest part's bone.
    pub bone: Bone,
    /// Bones that move it; weights sum to 1.
    pub weights: [(u8, f32); 4],
}

/// Surface of a dressed person in the rest pose.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Vertices.
    pub vertices: Vec<Vertex>,
    /// Vertex indices, anticlockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Polygonises a solid with cells of `step` metres.
    pub fn new(shape: &Shape, outfit: &Outfit, step: f32) -> Self {
        let flesh = Flesh::new(shape, outfit);
        let (lo, hi) = flesh.bounds();
        let (lo, hi) = (lo - 2.0 * step, hi + 2.0 * step);
        let size = ((hi - lo) / (step * BLOCK as f32)).ceil().as_ivec3();
        let cells = size * BLOCK;
        let corners = cells + IVec3::ONE;
        let index = |c: IVec3| ((c.z * corners.y + c.y) * corners.x + c.x) as usize;
        let mut field = vec![f32::NAN; (corners.x * corners.y * corners.z) as usize];
        let mut active = Vec::new();
        let half = 0.5 * step * BLOCK as f32;
        for bz in 0..size.z {
            for by in 0..size.y {
                for bx in 0..size.x {
                    let base = IVec3::new(bx, by, bz) * BLOCK;
                    let centre = lo + base.as_vec3() * step + Vec3::splat(half);
                    let near = flesh.near(centre, 1.8 * half);
                    // Distances of squashed solids are only estimates: keep a margin.
                    if near.is_empty() || flesh.distance(centre, &near).abs() > 2.6 * half {
                        continue;
                    }
                    for z in 0..=BLOCK {
                        for y in 0..=BLOCK {
                            for x in 0..=BLOCK {
                                let c = base + IVec3::new(x, y, z);
                                let at = &mut field[index(c)];
                                if at.is_nan() {
                                    *at = flesh.distance(lo + c.as_vec3() * step, &near);
                                }
                            }
                        }
                    }
                    active.push((base, near));
                }
            }
        }
        let mut mesh = Self::default();
        let mut vertex_of = vec![u32::MAX; field.len()];
        for (base, near) in &active {
            for z in 0..BLOCK {
                for y in 0..BLOCK {
                    for x in 0..BLOCK {
                        let c = *base + IVec3::new(x, y, z);
                        if let Some(p) = crossing(&field, c, index) {
                            vertex_of[index(c)] = mesh.vertices.len() as u32;
                            let p = lo + (c.as_vec3() + p) * step;
                            mesh.vertices.push(vertex(&flesh, shape, p, near, step));
                        }
                    }
                }
            }
        }
        for (base, _) in &active {
            for z in 0..BLOCK {
                for y in 0..BLOCK {
                    for x in 0..BLOCK {
                        quads(
                            &mut mesh,
                            &field,
                            &vertex_of,
                            *base + IVec3::new(x, y, z),
                            index,
                        );
                    }
                }
            }
        }
        mesh
    }

    /// Positions and normals of the posed surface, world space.
    pub fn pose(&self, posed: &Posed, pivots: &[Vec3; BONES]) -> (Vec<Vec3>, Vec<Vec3>) {
        let moves: [(Quat, Vec3); BONES] =
            std::array::from_fn(|b| (posed.turn[b], posed.at[b] - posed.turn[b] * pivots[b]));
        let rotations = moves.map(|(q, t)| (glam::Mat3::from_quat(q), t));
        let mut at = Vec::with_capacity(self.vertices.len());
        let mut normals = Vec::with_capacity(self.vertices.len());
        for v in &self.vertices {
            let (mut p, mut n) = (Vec3::ZERO, Vec3::ZERO);
            for &(b, w) in &v.weights {
                if w > 0.0 {
                    let (r, t) = &rotations[b as usize];
                    p += w * (*r * v.rest + *t);
                    n += w * (*r * v.normal);
                }
            }
            at.push(p);
            normals.push(n.normalize_or_zero());
        }
        (at, normals)
    }
}

/// Mean of the edge crossings of a cell in cell units, if the surface passes through it.
fn crossing(field: &[f32], c: IVec3, index: impl Fn(IVec3) -> usize) -> Option<Vec3> {
    let corner = |k: i32| IVec3::new(k & 1, (k >> 1) & 1, (k >> 2) & 1);
    let mut v = [0.0f32; 8];
    for k in 0..8 {
        v[k as usize] = field[index(c + corner(k))];
    }
    if v.iter().any(|x| x.is_nan()) || v.iter().all(|x| *x < 0.0) || v.iter().all(|x| *x >= 0.0) {
        return None;
    }
    let (mut sum, mut n) = (Vec3::ZERO, 0.0);
    for a in 0..8i32 {
        for axis in 0..3 {
            let b = a | (1 << axis);
            let (va, vb) = (v[a as usize], v[b as usize]);
            if b != a && (va < 0.0) != (vb < 0.0) {
                let t = va / (va - vb);
                sum += corner(a).as_vec3().lerp(corner(b).as_vec3(), t);
                n += 1.0;
            }
        }
    }
    Some(sum / n)
}

/// Emits the quads of the three edges that start at a corner.
fn quads(
    mesh: &mut Mesh,
    field: &[f32],
    vertex_of: &[u32],
    c: IVec3,
    index: impl Fn(IVec3) -> usize,
) {
    let v0 = field[index(c)];
    if v0.is_nan() {
        return;
    }
    let axes = [IVec3::X, IVec3::Y, IVec3::Z];
    for k in 0..3 {
        let v1 = field[index(c + axes[k])];
        if v1.is_nan() || (v0 < 0.0) == (v1 < 0.0) {
            continue;
        }
        let (s, t) = (axes[(k + 1) % 3], axes[(k + 2) % 3]);
        let cells = [c - s - t, c - t, c, c - s];
        if cells.iter().any(|q| q.min_element() < 0) {
            continue;
        }
        let q = cells.map(|q| vertex_of[index(q)]);
        if q.contains(&u32::MAX) {
            continue;
        }
        // The surface faces from negative (inside) to positive.
        if v0 < 0.0 {
            mesh.triangles.push([q[0], q[1], q[2]]);
            mesh.triangles.push([q[0], q[2], q[3]]);
        } else {
            mesh.triangles.push([q[0], q[2], q[1]]);
            mesh.triangles.push([q[0], q[3], q[2]]);
        }
    }
}

fn vertex(flesh: &Flesh, shape: &Shape, p: Vec3, near: &[u16], step: f32) -> Vertex {
    let e = 0.35 * step;
    let d = |p: Vec3| flesh.distance(p, near);
    let gradient = |p: Vec3| {
        // four taps of a tetrahedron
        let k = [
            Vec3::new(1.0, -1.0, -1.0),
            Vec3::new(-1.0, -1.0, 1.0),
            Vec3::new(-1.0, 1.0, -1.0),
            Vec3::ONE,
        ];
        k.iter()
            .map(|k| *k * d(p + *k * e))
            .sum::<Vec3>()
            .normalize_or_zero()
    };
    let normal = gradient(p);
    let rest = p - normal * d(p).clamp(-step, step);
    let out = 0.045;
    let openness = (d(rest + normal * out) / out).clamp(0.0, 1.0);
    let (mut best, mut first) = (f32::MAX, &flesh.parts[0]);
    let mut gap = [f32::MAX; BONES];
    for &k in near {
        let part = &flesh.parts[k as usize];
        let e = part.distance(rest);
        if e < best {
            (best, first) = (e, part);
        }
        gap[part.bone as usize] = gap[part.bone as usize].min(e);
    }
    Vertex {
        rest,
        normal,
        openness,
        matter: first.matter,
        bone: first.bone,
        weights: weights(shape, rest, first, gap),
    }
}

/// Describes a rest-pose point on a bone for [`Outfit::colour`].
pub fn spot(shape: &Shape, p: Vec3, bone: Bone) -> Spot {
    let u = shape.unit();
    let (hip, neck) = (shape.joints[L_HIP].y, shape.joints[NECK].y);
    let y = if p.y < hip {
        p.y * 0.518 / hip
    } else if p.y < neck {
        0.518 + (p.y - hip) * (0.845 - 0.518) / (neck - hip)
    } else {
        0.845 + (p.y - neck) / u
    };
    let side = if p.x < 0.0 { 0 } else { 1 };
    let j = &shape.joints;
    let along = |a: Vec3, b: Vec3| (p - a).dot(b - a) / (b - a).length_squared();
    let chain = |k: usize| {
        let first = along(j[k], j[k + 1]);
        if first < 1.0 {
            first
        } else {
            1.0 + along(j[k + 1], j[k + 2]).max(0.0)
        }
    };
    let on_arm = matches!(
        bone,
        Bone::RClavicle
            | Bone::RUpperArm
            | Bone::RForearm
            | Bone::RHand
            | Bone::LClavicle
            | Bone::LUpperArm
            | Bone::LForearm
            | Bone::LHand
    );
    let on_leg = matches!(
        bone,
        Bone::RThigh
            | Bone::RShin
            | Bone::RFoot
            | Bone::LThigh
            | Bone::LShin
            | Bone::LFoot
            | Bone::Pelvis
    );
    Spot {
        p,
        table: Vec3::new(p.x / u, y, p.z / u),
        arm: on_arm.then(|| chain(2 + 3 * side)),
        leg: on_leg.then(|| chain(8 + 3 * side)),
        head: bone == Bone::Head,
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::lab::synth::noise::Dice;
    use crate::lab::synth::outfit::Hair;

    /// From the finest cells of stills, which those of clips are, to the coarsest.
    const STEPS: [f32; 3] = [0.0125, 0.0175, 0.026];

    fn dressed(seed: u64) -> (Shape, Outfit) {
        let mut dice = Dice::new(seed, 0);
        let shape = Shape::random(&mut dice);
        let outfit = Outfit::random(shape.feminine, &mut dice);
        (shape, outfit)
    }

    fn expect_closed(mesh: &Mesh, who: &str) {
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for t in &mesh.triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
            }
        }
        let open = edges.values().filter(|n| **n != 0).count();
        assert_eq!(open, 0, "{who}: open edges of {}", edges.len());
    }

    #[test]
    fn surfaces_are_closed_and_face_outwards() {
        for seed in 0..40 {
            let (shape, outfit) = dressed(seed);
            let mesh = Mesh::new(&shape, &outfit, STEPS[seed as usize % STEPS.len()]);
            assert!(mesh.triangles.len() > 2_000);
            expect_closed(&mesh, &format!("seed {seed}"));
            let volume = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|i| mesh.vertices[i as usize].rest);
                a.dot(b.cross(c)) / 6.0
            };
            let volume: f32 = mesh.triangles.iter().map(volume).sum();
            // litres of a dressed person of 1.45–2.0 m
            assert!((0.035..0.20).contains(&volume), "volume {volume} m³");
            for v in &mesh.vertices {
                assert!(v.rest.y > -0.02 && v.rest.y < shape.stature + 0.12);
                let sum: f32 = v.weights.iter().map(|w| w.1).sum();
                assert!((sum - 1.0).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn whatever_is_worn_leaves_no_hole() {
        use Hair::*;
        let styles = [
            Bald, Short, Full, Afro, Bob, Long, Ponytail, Bun, Cap, Beanie,
        ];
        for (k, hair) in styles.into_iter().enumerate() {
            let (shape, mut outfit) = dressed(k as u64);
            outfit.hair = hair;
            outfit.skirt = [None, Some(0.4), Some(1.0), Some(1.6)][k % 4];
            for step in STEPS {
                let who = format!("{hair:?} hair, skirt {:?}, step {step}", outfit.skirt);
                expect_closed(&Mesh::new(&shape, &outfit, step), &who);
            }
        }
    }

    #[test]
    fn rucksacks_are_whole_however_tall_their_wearer_is() {
        for stature in [1.5, 1.6, 1.7, 1.85, 2.0] {
            let shape = Shape::new(stature, 0.0, 0.5, 0.0, &mut Dice::new(1, 1));
            let (_, mut outfit) = dressed(1);
            outfit.bag = true;
            for step in STEPS {
                let mesh = Mesh::new(&shape, &outfit, step);
                expect_closed(&mesh, &format!("a rucksack at {stature} m, step {step}"));
                let back = mesh.vertices.iter().map(|v| v.rest.z);
                let back = back.fold(0.0, f32::min) / shape.unit();
                assert!((back + 0.163).abs() < 0.003, "it ends {back} statures back");
            }
        }
    }

    #[test]
    fn the_skin_is_as_tall_as_the_person() {
        for seed in 0..20 {
            let (shape, mut outfit) = dressed(seed);
            outfit.hair = Hair::Bald;
            let mesh = Mesh::new(&shape, &outfit, 0.0175);
            let top = mesh.vertices.iter().map(|v| v.rest.y).fold(0.0, f32::max);
            let more = 1e3 * (top - shape.stature);
            assert!(more.abs() < 3.0, "{more} mm more than {} m", shape.stature);
        }
    }
}

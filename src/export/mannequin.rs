//! A simple body around a skeleton at rest: a tube for each bone, bent with its joints. It shows where limbs are, not
//! what anybody looks like.

use glam::DVec3;

use crate::body::skeleton::{RIG_BONES, TPose};

/// Corners of a ring.
const CORNERS: usize = 10;

/// A skin: as many of each as there are vertices, but for the triangles.
#[derive(Debug, Default)]
pub struct Mannequin {
    /// In the T-pose, hips at the origin, metres.
    pub positions: Vec<[f32; 3]>,
    /// Unit vectors outwards.
    pub normals: Vec<[f32; 3]>,
    /// The two bones that carry a vertex.
    pub bones: Vec<[u8; 4]>,
    /// How much each of them does; they sum to 1.
    pub weights: Vec<[f32; 4]>,
    /// Corners, seen from outside against the clock.
    pub triangles: Vec<u16>,
}

/// A ring of a tube: where along the bone, half its size sidewards and to the front for a person of 1.70 m.
type Ring = (f64, f64, f64);

const SHOULDER: [Ring; 4] = [
    (0.15, 0.045, 0.040),
    (0.4, 0.052, 0.050),
    (0.9, 0.050, 0.048),
    (1.05, 0.020, 0.020),
];
const LIMB: [Ring; 5] = [
    (-0.06, 0.020, 0.020),
    (0.0, 0.045, 0.045),
    (0.35, 0.052, 0.052),
    (1.0, 0.036, 0.036),
    (1.06, 0.016, 0.016),
];
const THIGH: [Ring; 5] = [
    (-0.08, 0.04, 0.04),
    (0.05, 0.078, 0.082),
    (0.4, 0.074, 0.078),
    (1.0, 0.050, 0.052),
    (1.05, 0.02, 0.02),
];
const HAND: [Ring; 4] = [
    (0.0, 0.026, 0.018),
    (0.6, 0.040, 0.016),
    (1.5, 0.036, 0.013),
    (1.75, 0.014, 0.008),
];
const FOOT: [Ring; 4] = [
    (-0.25, 0.022, 0.022),
    (0.0, 0.036, 0.036),
    (0.8, 0.042, 0.026),
    (1.1, 0.02, 0.014),
];
const HIPS: [Ring; 5] = [
    (-0.45, 0.06, 0.05),
    (-0.25, 0.135, 0.09),
    (0.0, 0.155, 0.10),
    (0.6, 0.135, 0.092),
    (1.02, 0.125, 0.085),
];
const TRUNK: [Ring; 6] = [
    (-0.05, 0.125, 0.085),
    (0.3, 0.145, 0.098),
    (0.62, 0.165, 0.105),
    (0.80, 0.150, 0.085),
    (0.93, 0.075, 0.055),
    (1.0, 0.055, 0.05),
];
const NECK: [Ring; 3] = [
    (-0.1, 0.055, 0.052),
    (0.5, 0.050, 0.050),
    (1.0, 0.054, 0.06),
];
const HEAD: [Ring; 7] = [
    (-0.45, 0.03, 0.035),
    (-0.25, 0.058, 0.075),
    (0.1, 0.074, 0.098),
    (0.4, 0.077, 0.102),
    (0.7, 0.066, 0.088),
    (0.9, 0.040, 0.055),
    (1.0, 0.012, 0.016),
];

impl Mannequin {
    /// Around a skeleton.
    pub fn new(rest: &TPose, height: f64) -> Self {
        let mut skin = Self::default();
        for (bone, start) in starts(rest).into_iter().enumerate() {
            let (along, rings): (DVec3, &[Ring]) = match bone {
                0 => (rest.offsets[1], &HIPS),
                1 => (rest.ends[1], &TRUNK),
                2 => (rest.ends[2], &NECK),
                3 => (rest.ends[3], &HEAD),
                4 | 8 => (rest.ends[bone], &SHOULDER),
                7 | 11 => (rest.ends[bone], &HAND),
                12 | 15 => (rest.ends[bone], &THIGH),
                14 | 17 => (rest.ends[bone], &FOOT),
                _ => (rest.ends[bone], &LIMB),
            };
            let parent = rest.parents[bone].unwrap_or(bone);
            skin.tube(start, along, rings, height / 1.7, [bone, parent]);
        }
        skin
    }

    fn tube(
        &mut self,
        start: DVec3,
        along: DVec3,
        rings: &[Ring],
        scale: f64,
        [bone, parent]: [usize; 2],
    ) {
        let direction = along.normalize_or(DVec3::Y);
        // To the front where that is across the bone, else up: feet are flat, and so are hands of arms stretched
        // sideways.
        let front = match direction.z.abs() > 0.7 {
            true => DVec3::Y,
            false if direction.x.abs() > 0.7 => DVec3::Y,
            false => DVec3::Z,
        };
        let side = front.cross(direction).normalize_or(DVec3::X);
        let front = direction.cross(side);
        let first = self.positions.len();
        for &(t, across, deep) in rings {
            let centre = start + along * t;
            // At its start a bone bends with the one that carries it.
            let own = (0.5 + 4.0 * t).clamp(0.2, 1.0) as f32;
            for k in 0..CORNERS {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / CORNERS as f64).sin_cos();
                let out = side * (cos * across * scale) + front * (sin * deep * scale);
                self.vertex(centre + out, out, [bone, parent], own);
            }
        }
        let vertex = |ring: usize, k: usize| (first + ring * CORNERS + k % CORNERS) as u16;
        for ring in 0..rings.len() - 1 {
            for k in 0..CORNERS {
                let (a, b) = (vertex(ring, k), vertex(ring, k + 1));
                let (c, d) = (vertex(ring + 1, k), vertex(ring + 1, k + 1));
                self.triangles.extend([a, b, c, b, d, c]);
            }
        }
        for (ring, outward) in [(0, -direction), (rings.len() - 1, direction)] {
            let (t, ..) = rings[ring];
            let own = (0.5 + 4.0 * t).clamp(0.2, 1.0) as f32;
            let pole = self.positions.len() as u16;
            self.vertex(start + along * t, outward, [bone, parent], own);
            for k in 0..CORNERS {
                let (a, b) = (vertex(ring, k), vertex(ring, k + 1));
                let turned = if ring == 0 {
                    [pole, b, a]
                } else {
                    [pole, a, b]
                };
                self.triangles.extend(turned);
            }
        }
    }

    fn vertex(&mut self, at: DVec3, outward: DVec3, [bone, parent]: [usize; 2], own: f32) {
        self.positions.push(at.as_vec3().to_array());
        let normal = outward.normalize_or(DVec3::Y).as_vec3();
        self.normals.push(normal.to_array());
        let shared = own < 1.0 && bone != parent;
        let (second, own) = if shared {
            (parent as u8, own)
        } else {
            (0, 1.0)
        };
        self.bones.push([bone as u8, second, 0, 0]);
        self.weights.push([own, 1.0 - own, 0.0, 0.0]);
    }
}

/// Where every bone starts at rest, hips at the origin.
pub fn starts(rest: &TPose) -> [DVec3; RIG_BONES] {
    let mut at = [DVec3::ZERO; RIG_BONES];
    for bone in 0..RIG_BONES {
        if let Some(parent) = rest.parents[bone] {
            at[bone] = at[parent] + rest.offsets[bone];
        }
    }
    at
}

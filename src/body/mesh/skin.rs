//! The skinned mesh: a person and a posed tree go in, vertices come out.

use glam::{Affine3A, DMat3, Mat3A, Vec3, Vec3A};

use super::{JOINTS, MeshBody, Person, PosedTree};
use crate::body::mesh::MeshPose;

/// Skinning weights without the zeros: every vertex has a run of (joint, weight).
#[derive(Debug, Clone)]
pub(super) struct Weights {
    first: Vec<u32>,
    entries: Vec<(u8, f32)>,
}

impl Weights {
    /// From rows of [`JOINTS`] weights.
    pub(super) fn new(dense: &[f64]) -> Self {
        let mut weights = Self {
            first: vec![0],
            entries: Vec::new(),
        };
        for row in dense.chunks_exact(JOINTS) {
            for (joint, &w) in row.iter().enumerate() {
                if w != 0.0 {
                    weights.entries.push((joint as u8, w as f32));
                }
            }
            weights.first.push(weights.entries.len() as u32);
        }
        weights
    }

    pub(super) fn of(&self, vertex: usize) -> &[(u8, f32)] {
        &self.entries[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }
}

/// A person's mesh at rest, kept so that every frame only moves it.
#[derive(Debug, Clone)]
pub struct Skin {
    rest: Vec<Vec3A>,
    joints: [Vec3A; JOINTS],
    /// Rest and pose correctives, where the body has any.
    corrected: Vec<Vec3A>,
}

impl Skin {
    /// The mesh of `person` at rest.
    pub fn new(body: &MeshBody, person: &Person) -> Self {
        let mut rest: Vec<Vec3A> = body.template.iter().copied().map(Vec3A::from).collect();
        for (&beta, component) in person.betas().iter().zip(&body.components) {
            let beta = beta as f32;
            for (vertex, step) in rest.iter_mut().zip(component) {
                *vertex += beta * Vec3A::from(*step);
            }
        }
        Self {
            rest,
            joints: person.joints().map(|j| j.as_vec3().into()),
            corrected: Vec::new(),
        }
    }

    /// Vertices at rest, metres in the body's axes.
    pub fn rest(&self) -> impl ExactSizeIterator<Item = Vec3> {
        self.rest.iter().map(|&v| v.into())
    }

    /// Vertices of the posed body, metres, in the axes of the pose. `posed` is the same pose's tree.
    pub fn pose(
        &mut self,
        body: &MeshBody,
        pose: &MeshPose,
        posed: &PosedTree,
        out: &mut Vec<Vec3>,
    ) {
        let rest = if body.correctives.is_empty() {
            &self.rest
        } else {
            self.correct(body, pose);
            &self.corrected
        };
        let moves: [Affine3A; JOINTS] = std::array::from_fn(|j| {
            let turn = posed.turn[j].as_mat3();
            let place: Vec3A = posed.place[j].as_vec3().into();
            let turn = Mat3A::from(turn);
            Affine3A {
                matrix3: turn,
                translation: place - turn * self.joints[j],
            }
        });
        out.clear();
        out.extend(rest.iter().enumerate().map(|(v, &at)| {
            let mut sum = Vec3A::ZERO;
            for &(joint, w) in body.weights.of(v) {
                sum += w * moves[usize::from(joint)].transform_point3a(at);
            }
            Vec3::from(sum)
        }));
    }

    fn correct(&mut self, body: &MeshBody, pose: &MeshPose) {
        self.corrected.clone_from(&self.rest);
        for (joint, rotation) in pose.rotations.iter().enumerate().skip(1) {
            let bent = DMat3::from_quat(*rotation) - DMat3::IDENTITY;
            // Row after row, as SMPL's own code flattens them.
            for (k, value) in bent.transpose().to_cols_array().into_iter().enumerate() {
                let value = value as f32;
                let steps = &body.correctives[9 * (joint - 1) + k];
                for (vertex, step) in self.corrected.iter_mut().zip(steps) {
                    *vertex += value * Vec3A::from(*step);
                }
            }
        }
    }
}

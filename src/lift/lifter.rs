//! Detections go in, observations come out.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS, NECK};
use edgecap_client::message::{Intrinsics, Observation};
use edgecap_kernels::Isa;

use super::weights::{INPUTS, OUTPUTS};
use super::{LiftError, input, mlp::Mlp, torso_colours, unseen, view};
use crate::capture::{Frame, Letterbox};
use crate::detect::Detection;
use crate::engine::model::Linear;

/// What Stage II is fed at the places of the encodings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encodings {
    /// What Stage I's 3D head says.
    Read,
    /// Zeros: the 3D head was not trained and says nothing. Stage II then lifts from 2D alone.
    Zero,
}

/// Lifts detections to full 3D, occluded joints included: Stage II, XNect §4.2. All people of a frame go through the
/// network as one batch; nothing is allocated once the largest crowd has been seen.
#[derive(Debug, Clone)]
pub struct Lifter {
    mlp: Mlp,
    encodings: Encodings,
    input: Vec<f32>,
    observations: Vec<Observation>,
}

impl Lifter {
    /// A lifter with these layers, as a model's Stage II has them, computing with the kernels of `isa`.
    ///
    /// # Errors
    /// When the layers do not fit each other or Stage II's input and output, a weight is not finite, or the CPU lacks
    /// `isa`.
    pub fn new(layers: &[Linear], encodings: Encodings, isa: Isa) -> Result<Self, LiftError> {
        Ok(Self {
            mlp: Mlp::new(layers, isa)?,
            encodings,
            input: Vec::new(),
            observations: Vec::new(),
        })
    }

    /// Stage II's raw output for every detection: body joints relative to the pelvis, metres at canonical stature,
    /// **view-aligned** (z along the ray through the neck).
    ///
    /// # Errors
    /// When a kernel refuses its tensors, which would be a fault of this program.
    pub fn lift_aligned(
        &mut self,
        detections: &[Detection],
    ) -> Result<impl ExactSizeIterator<Item = [[f32; 3]; BODY_JOINTS]>, LiftError> {
        self.input.resize(detections.len() * INPUTS, 0.0);
        let read = self.encodings == Encodings::Read;
        for (d, row) in detections.iter().zip(self.input.chunks_exact_mut(INPUTS)) {
            input::fill(d, read, row);
        }
        let output = self.mlp.run(detections.len(), &self.input)?;
        Ok(output.chunks_exact(OUTPUTS).map(|row| {
            let mut joints = [[0.0; 3]; BODY_JOINTS];
            joints.as_flattened_mut().copy_from_slice(row);
            joints
        }))
    }

    /// One observation per detection, in the same order. `letterbox` says where `frame` lies in the network's input,
    /// and `intrinsics` is the camera of `frame`.
    ///
    /// # Errors
    /// As [`lift_aligned`](Self::lift_aligned).
    pub fn lift(
        &mut self,
        detections: &[Detection],
        frame: &Frame,
        letterbox: &Letterbox,
        intrinsics: &Intrinsics,
    ) -> Result<&[Observation], LiftError> {
        let mut observations = std::mem::take(&mut self.observations);
        observations.clear();
        let lifted = self.lift_aligned(detections)?;
        for (d, aligned) in detections.iter().zip(lifted) {
            let mut joints2d = original(d, letterbox);
            let [u, v] = anchor(&joints2d);
            let turn = view::to_camera(intrinsics.ray(u, v));
            let (hue, saturation) = torso_colours::histograms(frame, &joints2d);
            let joints3d = aligned.map(|p| view::rotate(&turn, p));
            unseen::fill(&mut joints2d, &joints3d, intrinsics);
            observations.push(Observation {
                score: d.score,
                joints2d,
                joints3d,
                hue,
                saturation,
            });
        }
        self.observations = observations;
        Ok(&self.observations)
    }

    /// What [`lift`](Self::lift) returned last.
    pub fn lifted(&self) -> &[Observation] {
        &self.observations
    }
}

/// Joints in pixels of the original picture.
fn original(d: &Detection, letterbox: &Letterbox) -> [[f32; 3]; EVIDENCE_JOINTS] {
    std::array::from_fn(|j| {
        let ([u, v, _], confidence) = (d.joints[j], d.confidence[j]);
        if confidence > 0.0 {
            let [u, v] = letterbox.to_original(u, v);
            [u, v, confidence]
        } else {
            [0.0; 3]
        }
    })
}

/// Where the person's axes are aligned: the neck, or the mean of the seen joints without one.
fn anchor(joints: &[[f32; 3]; EVIDENCE_JOINTS]) -> [f32; 2] {
    if joints[NECK][2] > 0.0 {
        return [joints[NECK][0], joints[NECK][1]];
    }
    let seen = joints.iter().filter(|j| j[2] > 0.0);
    let (mut sum, mut count) = ([0.0; 2], 0.0_f32);
    for j in seen {
        sum = [sum[0] + j[0], sum[1] + j[1]];
        count += 1.0;
    }
    sum.map(|s| s / count.max(1.0))
}

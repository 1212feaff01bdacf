//! Detections go in, observations come out.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS, NECK};
use edgecap_client::message::{Intrinsics, Observation};
use edgecap_kernels::Isa;

use super::weights::{INPUTS, OUTPUTS};
use super::{LiftError, Stage2Weights, appearance, input, mlp::Mlp, view};
use crate::capture::{Frame, Letterbox};
use crate::detect::Detection;

/// What Stage II is fed at the places of the encodings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encodings {
    /// What Stage I's 3D head says, and zeros as well: the mean of both answers. Stage II trusts encodings as far as they were right
    /// in training; of real people never seen before they are worse than that (models/README.md, Stage II).
    #[default]
    Averaged,
    /// What Stage I's 3D head says.
    Read,
    /// Zeros: the 3D head was not trained and says nothing. Stage II then lifts from 2D alone.
    Zero,
}

impl Encodings {
    /// Whether they are read, for every answer that counts.
    const fn looks(self) -> &'static [bool] {
        match self {
            Self::Averaged => &[true, false],
            Self::Read => &[true],
            Self::Zero => &[false],
        }
    }
}

/// Lifts detections to full 3D, occluded joints included: Stage II, XNect §4.2. All people of a frame go through the network
/// as one batch; nothing is allocated once the largest crowd has been seen.
#[derive(Debug, Clone)]
pub struct Lifter {
    mlp: Mlp,
    encodings: Encodings,
    input: Vec<f32>,
    observations: Vec<Observation>,
}

impl Lifter {
    /// A lifter with these weights, computing with the kernels of `isa`.
    ///
    /// # Errors
    /// When the CPU lacks `isa`.
    pub fn new(weights: &Stage2Weights, encodings: Encodings, isa: Isa) -> Result<Self, LiftError> {
        Ok(Self {
            mlp: Mlp::new(weights, isa)?,
            encodings,
            input: Vec::new(),
            observations: Vec::new(),
        })
    }

    /// Stage II's raw output for every detection: body joints relative to the pelvis, metres at canonical stature, **view-aligned**
    /// (z along the ray through the neck).
    ///
    /// # Errors
    /// When a kernel refuses its tensors, which would be a fault of this program.
    pub fn lift_aligned(
        &mut self,
        detections: &[Detection],
    ) -> Result<impl ExactSizeIterator<Item = [[f32; 3]; BODY_JOINTS]>, LiftError> {
        let looks = self.encodings.looks();
        let rows = looks.len() * detections.len();
        self.input.resize(rows * INPUTS, 0.0);
        let people = looks
            .iter()
            .flat_map(|read| detections.iter().map(move |d| (d, *read)));
        for ((d, read), row) in people.zip(self.input.chunks_exact_mut(INPUTS)) {
            input::fill(d, read, row);
        }
        let output = self.mlp.run(rows, &self.input)?;
        let (count, share) = (detections.len(), 1.0 / looks.len() as f32);
        Ok((0..count).map(move |person| {
            let mut joints = [[0.0; 3]; BODY_JOINTS];
            for answer in output.chunks_exact(OUTPUTS).skip(person).step_by(count) {
                for (mean, x) in joints.as_flattened_mut().iter_mut().zip(answer) {
                    *mean += share * x;
                }
            }
            joints
        }))
    }

    /// One observation per detection, in the same order. `letterbox` says where `frame` lies in the network's input, and
    /// `intrinsics` is the camera of `frame`.
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
            let joints2d = original(d, letterbox);
            let [u, v] = anchor(&joints2d);
            let turn = view::to_camera(intrinsics.ray(u, v));
            let (hue, saturation) = appearance::histograms(frame, &joints2d);
            observations.push(Observation {
                score: d.score,
                joints2d,
                joints3d: aligned.map(|p| view::rotate(&turn, p)),
                hue,
                saturation,
            });
        }
        self.observations = observations;
        Ok(&self.observations)
    }
}

/// Joints in pixels of the original picture.
fn original(d: &Detection, letterbox: &Letterbox) -> [[f32; 3]; EVIDENCE_JOINTS] {
    d.joints.map(|[u, v, confidence]| {
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

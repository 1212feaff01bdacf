//! One person before several cameras: what they see goes in, how far the fitted body is from the truth comes out.

use glam::DVec3;
use serde::Serialize;

use super::Bare;
use super::own::Walker;
use super::parts::{self, PARTS};
use crate::body::mesh::{MeshBody, Skin};
use crate::camera::View;
use crate::fit::{FitConfig, Fitter};
use crate::joints::EVIDENCE_JOINTS;
use crate::lab::eval::align_similarity;
use crate::lab::synth::studio::Studio;
use crate::message::Observation;
use crate::multiview::{
    Detections, Mask, Masks, MultiviewFit, MultiviewOptions, Run, Sight, Step, evidence_joints,
    fit, fit_tracks, one_view, stage_three, stature,
};

/// Who is before the cameras.
#[derive(Debug, Clone)]
pub enum Cast {
    /// A body of the fitted model.
    Walker(Box<Walker>),
    /// A dressed person in a hall.
    Studio(Box<Studio>),
}

/// What is seen of one person, and what is true about them.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Who is seen.
    pub cast: Cast,
    /// The cameras.
    pub views: Vec<View>,
    /// By frame, by view, who is seen there.
    pub seen: Vec<Vec<Vec<Observation>>>,
    /// By frame, the evidence joints in the world, metres.
    pub joints: Vec<[DVec3; EVIDENCE_JOINTS]>,
    /// Crown to floor, metres.
    pub stature: f64,
    /// Shape coefficients of bodies of the fitted model.
    pub betas: Option<Vec<f64>>,
    /// Frames a second.
    pub rate: f64,
}

/// How far fitted bodies are from the truth; lengths in metres, which are no numbers (null in JSON) or none where
/// nobody was found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Errors {
    /// Share of frames with a body.
    pub found: f64,
    /// Mean distance of evidence joints in the world.
    pub joints: f64,
    /// The same after every frame's body is moved, turned and scaled onto the truth.
    pub aligned: f64,
    /// Mean distance of the rest mesh's vertices, their common offset left out.
    pub shape: Option<f64>,
    /// Difference of statures, without sign.
    pub stature: f64,
    /// Of people of `synth`: mean distance of the rest mesh's vertices from the person without clothes, and back.
    pub rest: Option<[f64; 2]>,
    /// Of bodies of the fitted model: mean distance of posed meshes' vertices in the world, by [`PARTS`].
    pub parts: Option<[f64; PARTS.len()]>,
}

impl Errors {
    /// Of nobody found: 0 would be the best of all distances.
    pub const NOBODY: Self = Self {
        found: 0.0,
        joints: f64::NAN,
        aligned: f64::NAN,
        shape: None,
        stature: f64::NAN,
        rest: None,
        parts: None,
    };
}

impl Trial {
    /// The mask of a frame in a view.
    pub fn mask(&self, frame: usize, view: usize) -> Mask {
        match &self.cast {
            Cast::Walker(walker) => walker.mask(frame, &self.views[view]),
            Cast::Studio(studio) => {
                let view = &studio.cameras[view];
                Mask {
                    size: [view.width, view.height],
                    owners: studio.owners(view, frame as u64),
                    unknown: None,
                }
            }
        }
    }

    /// Fits the person. One view starts from Stage III.
    pub fn fit(
        &self,
        options: MultiviewOptions,
        masks: Option<&Masks<'_>>,
        progress: &(dyn Fn(Step) + Sync),
    ) -> MultiviewFit {
        let body = MeshBody::shipped();
        let run = Run::new(masks, progress);
        let frames: Vec<Vec<Detections>> = self
            .seen
            .iter()
            .map(|frame| {
                let each = self.views.iter().zip(frame);
                each.map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
                    .collect()
            })
            .collect();
        let [view] = &self.views[..] else {
            let used = vec![true; self.views.len()];
            return fit(body, &self.views, &used, &frames, options, run);
        };
        let mut fitter = Fitter::new(FitConfig::default()).expect("the usual settings are valid");
        let time = |k: usize| (1e9 * k as f64 / self.rate).round() as u64;
        let people = self.seen.iter().enumerate();
        let people = people.map(|(k, views)| (time(k), views[0].as_slice()));
        let bodies = stage_three(&mut fitter, view, people);
        let seen: Vec<Detections> = frames.into_iter().map(|mut f| f.swap_remove(0)).collect();
        let tracks = one_view(view, &bodies, &seen);
        let weights = vec![1.0];
        fit_tracks(body, &self.views, weights, tracks, options, run)
    }

    /// Errors of the person who was found most often.
    pub fn errors(&self, found: &MultiviewFit) -> Errors {
        let body = MeshBody::shipped();
        let Some(person) = found.people.iter().max_by_key(|p| p.frames.len()) else {
            return Errors::NOBODY;
        };
        let (mut joints, mut aligned) = (0.0, 0.0);
        for f in &person.frames {
            let own = evidence_joints(&f.body.posed).map(|p| p.to_array());
            let truth = self.joints[f.frame].map(|p| p.to_array());
            joints += mean_distance(&own, &truth);
            aligned += mean_distance(&align_similarity(&own, &truth), &truth);
        }
        let frames = person.frames.len() as f64;
        let (rest, parts) = match &self.cast {
            Cast::Studio(studio) => {
                let bare = Bare::new(&studio.clip.scene.people[0]);
                (Some(bare.apart(&person.betas)), None)
            }
            Cast::Walker(walker) => (None, Some(parts::apart(&person.frames, walker))),
        };
        Errors {
            found: frames / self.joints.len() as f64,
            joints: joints / frames,
            aligned: aligned / frames,
            shape: self.betas.as_ref().map(|b| at_rest(&person.betas, b)),
            stature: (stature(body, &person.betas) - self.stature).abs(),
            rest,
            parts,
        }
    }
}

fn mean_distance(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let each = a.iter().zip(b);
    let sum: f64 = each
        .map(|(p, q)| DVec3::from(*p).distance(DVec3::from(*q)))
        .sum();
    sum / a.len() as f64
}

/// Mean distance of two people's vertices at rest, their offset left out, metres.
fn at_rest(a: &[f64], b: &[f64]) -> f64 {
    let body = MeshBody::shipped();
    let rest = |betas: &[f64]| -> Vec<[f64; 3]> {
        let skin = Skin::new(body, &body.person(betas));
        let all: Vec<DVec3> = skin.rest().map(|v| v.as_dvec3()).collect();
        let mean = all.iter().sum::<DVec3>() / all.len() as f64;
        all.iter().map(|v| (*v - mean).to_array()).collect()
    };
    mean_distance(&rest(a), &rest(b))
}

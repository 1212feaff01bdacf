//! How well bodies fit what views saw: residuals by view, a line a person.

use glam::DVec3;
use serde::Serialize;

use super::fit::MultiviewFit;
use super::person::PersonFrame;
use super::points;
use super::sight::Sight;
use crate::body::BodyModel;
use crate::body::mesh::{MeshBody, PosedTree};
use crate::camera::View;
use crate::joints::EVIDENCE_JOINTS;

/// A person's residual in a view beyond which a joint was somewhere else, in % of the person's height.
const FAR: f64 = 15.0;

/// All figures of a run.
#[derive(Debug, Clone, Serialize)]
pub struct MultiviewReport {
    /// Frames of the sequence.
    pub frames: usize,
    /// One entry a view.
    pub views: Vec<ViewReport>,
    /// One entry a person.
    pub people: Vec<PersonReport>,
    /// What was recognised in the calibration.
    pub notes: Vec<String>,
}

/// How far the bodies' joints are from where one view saw them.
#[derive(Debug, Clone, Serialize)]
pub struct ViewReport {
    /// The camera.
    pub name: String,
    /// How much it counted: 1, less where it disagrees with the others, 0 where it was only measured.
    pub weight: f64,
    /// By how many seconds it started before the first view, where that was told.
    pub offset_s: Option<f64>,
    /// People and frames of bodies that it saw.
    pub sights: usize,
    /// People and frames of bodies that are in its picture, by its calibration, whether anything hides them or not.
    pub shown: usize,
    /// People and frames that its detector told of, whoever they are; as many where nobody counted.
    pub told: usize,
    /// Of the people and frames it saw, those whose outline a mask showed; `None` without masks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contours: Option<usize>,
    /// Joints.
    pub joints: usize,
    /// Median distance, pixels.
    pub median_px: Option<f64>,
    /// Mean distance, pixels.
    pub mean_px: Option<f64>,
    /// Median distance, % of the person's height in this view.
    pub median_percent: Option<f64>,
    /// Mean distance, % of the person's height.
    pub mean_percent: Option<f64>,
    /// Joints further off than 15 % of the height, %.
    pub far_percent: Option<f64>,
}

/// One person.
#[derive(Debug, Clone, Serialize)]
pub struct PersonReport {
    /// Identity.
    pub id: u32,
    /// First frame.
    pub first: usize,
    /// Last frame.
    pub last: usize,
    /// Frames with a body.
    pub frames: usize,
    /// Frames that no view saw and that were filled in.
    pub filled: usize,
    /// Limbs of one view and frame whose sides were exchanged, and healed.
    pub exchanges_healed: usize,
    /// Height of the body at rest, metres.
    pub stature_m: f64,
    /// Shape coefficients, standard deviations.
    pub betas: Vec<f64>,
    /// Mean acceleration of the joints, metres per square second.
    pub acceleration: Option<f64>,
}

/// What a view saw of everybody in a frame, by view, frame number and everybody's joints.
pub type Observed<'a> =
    dyn Fn(usize, usize, &[[DVec3; EVIDENCE_JOINTS]]) -> Vec<Option<Sight>> + 'a;

/// One residual: pixels, and % of the person's height.
type Residual = [f64; 2];

/// Somebody in a frame, and where their joints are.
type Seen<'a> = (&'a PersonReport, &'a PersonFrame, [DVec3; EVIDENCE_JOINTS]);

/// Measures a fit. `observed` tells what a view saw that the fit did not use.
pub fn report(
    body: &MeshBody,
    views: &[View],
    fit: &MultiviewFit,
    frames: usize,
    rate: f64,
    observed: &Observed<'_>,
) -> MultiviewReport {
    let people: Vec<PersonReport> = fit
        .people
        .iter()
        .map(|p| {
            let filled = p
                .frames
                .iter()
                .filter(|f| f.moment.sights.iter().all(Option::is_none))
                .count();
            PersonReport {
                id: p.id,
                first: p.frames.first().map_or(0, |f| f.frame),
                last: p.frames.last().map_or(0, |f| f.frame),
                frames: p.frames.len(),
                filled,
                exchanges_healed: p.frames.iter().map(|f| f.moment.healed).sum(),
                stature_m: stature(body, &p.betas),
                betas: p.betas.clone(),
                acceleration: acceleration(body, p, rate),
            }
        })
        .collect();
    let mut by_frame: Vec<Vec<Seen<'_>>> = vec![Vec::new(); frames];
    for (p, person) in fit.people.iter().zip(&people) {
        for f in &p.frames {
            if let Some(all) = by_frame.get_mut(f.frame) {
                all.push((person, f, points::evidence(&f.body.posed)));
            }
        }
    }
    let all = || {
        by_frame
            .iter()
            .flatten()
            .map(|(_, f, _)| &f.moment.contours)
    };
    let is_masked = all().any(|contours| !contours.is_empty());
    let outlined = |v: usize| {
        let has = |contours: &&Vec<_>| contours.get(v).is_some_and(Option::is_some);
        is_masked.then(|| all().filter(has).count())
    };
    let view = |(v, view): (usize, &View)| {
        let (mut residuals, mut sights): (Vec<Residual>, usize) = (Vec::new(), 0);
        let each = by_frame.iter().flatten();
        let shown = each.filter(|(_, _, joints)| shows(view, joints)).count();
        for (frame, all) in by_frame.iter().enumerate() {
            let joints: Vec<_> = all.iter().map(|seen| seen.2).collect();
            let others = match fit.weights[v] > 0.0 || all.is_empty() {
                true => vec![None; all.len()],
                false => observed(v, frame, &joints),
            };
            for ((person, f, joints), other) in all.iter().zip(&others) {
                let Some(sight) = f.moment.sights[v].as_ref().or(other.as_ref()) else {
                    continue;
                };
                sights += 1;
                for (joint, ray) in joints.iter().zip(&sight.rays) {
                    let (Some(ray), Some(pixel)) = (ray, view.project(*joint)) else {
                        continue;
                    };
                    let off = pixel.distance(ray.pixel);
                    let height = view.focal.y * person.stature_m / view.to_camera(*joint).z;
                    residuals.push([off, 100.0 * off / height]);
                }
            }
        }
        let [px, percent] = [0, 1].map(|k| summary(residuals.iter().map(|r| r[k]).collect()));
        let far = residuals.iter().filter(|r| r[1] > FAR).count();
        ViewReport {
            name: view.name.clone(),
            weight: fit.weights[v],
            offset_s: None,
            sights,
            shown,
            told: sights,
            contours: outlined(v),
            joints: residuals.len(),
            median_px: px.map(|p| p[0]),
            mean_px: px.map(|p| p[1]),
            median_percent: percent.map(|p| p[0]),
            mean_percent: percent.map(|p| p[1]),
            far_percent: (!residuals.is_empty())
                .then(|| 100.0 * far as f64 / residuals.len() as f64),
        }
    };
    MultiviewReport {
        frames,
        views: views.iter().enumerate().map(view).collect(),
        people,
        notes: Vec::new(),
    }
}

/// Whether most joints are in a view's picture.
fn shows(view: &View, joints: &[DVec3; EVIDENCE_JOINTS]) -> bool {
    let [width, height] = view.size.map(f64::from);
    let is_inside = |joint: &&DVec3| {
        let pixel = view.project(**joint);
        pixel.is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x < width && p.y < height)
    };
    2 * joints.iter().filter(is_inside).count() > EVIDENCE_JOINTS
}

/// Median and mean.
fn summary(mut values: Vec<f64>) -> Option<[f64; 2]> {
    values.sort_by(f64::total_cmp);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.get(values.len() / 2).map(|median| [*median, mean])
}

/// Height of a body at rest, metres: of the mesh.
pub fn stature(body: &MeshBody, betas: &[f64]) -> f64 {
    let person = body.person(betas);
    let skin = crate::body::mesh::Skin::new(body, &person);
    let (low, high) = skin
        .rest()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| {
            (l.min(v.y), h.max(v.y))
        });
    f64::from(high - low)
}

fn acceleration(body: &MeshBody, person: &super::PersonFit, rate: f64) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0_f64);
    let mut posed = PosedTree::default();
    let mut joints = |k: usize| {
        let f = &person.frames[k].body;
        body.kinematics(&f.pose, &f.person, &mut posed);
        points::evidence(&posed)
    };
    for k in 2..person.frames.len() {
        if person.frames[k].frame != person.frames[k - 2].frame + 2 {
            continue;
        }
        let (a, b, c) = (joints(k - 2), joints(k - 1), joints(k));
        for j in 0..EVIDENCE_JOINTS {
            sum += (a[j] - 2.0 * b[j] + c[j]).length() * rate * rate;
            count += 1.0;
        }
    }
    (count > 0.0).then(|| sum / count)
}

//! Stage two: one person over time. The shape is the median of all frames', and every joint's path is made of few
//! cosines.
//!
//! Trajectories and poses take turns: coefficients are eliminated by projecting the paths onto the base, and every
//! frame is pulled towards its projection.

use glam::DVec3;
use rayon::prelude::*;

use super::dct;
use super::energy::{Energy, Free, Targets};
use super::exchange;
use super::fitted::Fitted;
use super::moment::Moment;
use super::points;
use super::refine;
use super::silhouette::Rim;
use super::stage_one::FINE;
use crate::body::mesh::MeshBody;
use crate::camera::View;
use crate::joints::BODY_JOINTS;
use crate::solve::{Effort, Solver};

/// Weight of a joint's distance from its path, as a part of that of a view.
const PATH: f64 = 0.4;
const TURNS: usize = 10;
const STEPS: u32 = 3;

/// The median of every shape coefficient.
pub fn median_shape(fits: &[&Fitted]) -> Vec<f64> {
    let count = fits.first().map_or(0, |f| f.person.betas().len());
    (0..count)
        .map(|c| {
            let mut all: Vec<f64> = fits.iter().map(|f| f.person.betas()[c]).collect();
            all.sort_by(f64::total_cmp);
            let n = all.len();
            0.5 * (all[(n - 1) / 2] + all[n / 2])
        })
        .collect()
}

/// Fits consecutive frames of one person again, the shape held; smooth in time when `paths`.
pub fn refit(
    body: &MeshBody,
    views: &[View],
    weights: &[f64],
    moments: &mut [Moment],
    fits: &mut [Fitted],
    paths: bool,
) {
    let masked = moments.iter().any(|m| !m.contours.is_empty());
    let mut rims: Vec<Vec<Rim<'_>>> = vec![Vec::new(); fits.len()];
    for turn in 0..if paths { TURNS } else { 2 } {
        // Outlines take long to find and change little.
        if masked && (turn == 0 || turn == TURNS / 2) {
            rims = moments
                .par_iter()
                .zip(fits.par_iter())
                .map(|(moment, fitted)| refine::rims(body, views, weights, moment, fitted, 1.0))
                .collect();
        }
        let targets: Vec<Targets> = if paths {
            project(body, fits)
        } else {
            vec![[None; BODY_JOINTS]; fits.len()]
        };
        let each = moments
            .par_iter_mut()
            .zip(fits.par_iter_mut())
            .zip(targets.par_iter().zip(&rims));
        each.for_each_init(
            Solver::default,
            |solver, ((moment, fitted), (targets, rims))| {
                if turn == TURNS / 2 {
                    let joints = points::evidence(body, &fitted.posed);
                    for (view, sight) in views.iter().zip(&mut moment.sights) {
                        moment.healed += sight
                            .as_mut()
                            .map_or(0, |s| exchange::follow(view, s, &joints));
                    }
                }
                let seen = moment.seen(views, weights);
                let energy = Energy {
                    body,
                    seen: &seen,
                    sigma: FINE,
                    targets: paths.then_some(targets),
                    target_sigma: dct::SIGMA,
                    lifted: moment.lifted(),
                    rims,
                    prior: 1.0,
                    shape: 0.0,
                    free: Free::Pose,
                };
                let iterations = if paths { STEPS } else { 10 };
                let mut spare = fitted.clone();
                solver.solve(
                    &energy,
                    Effort {
                        iterations,
                        tolerance: 1e-5,
                    },
                    fitted,
                    &mut spare,
                );
            },
        );
    }
}

fn project(body: &MeshBody, fits: &[Fitted]) -> Vec<Targets> {
    let joints: Vec<_> = fits.iter().map(|f| points::all(body, &f.posed)).collect();
    let mut targets = vec![[None; BODY_JOINTS]; fits.len()];
    for j in 0..BODY_JOINTS {
        let path: Vec<DVec3> = joints.iter().map(|p| p[j]).collect();
        for (target, point) in targets.iter_mut().zip(dct::smooth(&path)) {
            target[j] = Some((point, PATH));
        }
    }
    targets
}

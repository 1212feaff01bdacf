//! Pose and shape of a body solved for with what masks show of it ([`silhouette`](super::silhouette)).

use super::energy::Energy;
use super::fitted::Fitted;
use super::moment::Moment;
use super::silhouette::{Contour, Masks, Outline, Rim};
use crate::body::mesh::{MeshBody, Skin};
use crate::camera::View;
use crate::solve::{Effort, Solver};

/// Pairs are found so many times; the first time distances count squared.
const ROUNDS: usize = 4;
const STEPS: u32 = 6;
/// Nearest the contour that a rim can be drawn to, metres at the person: at first and in the end.
const REACH: [f64; 2] = [0.2, 0.06];

/// Contours of a person in the views that see them.
pub fn contours(
    masks: &Masks<'_>,
    frame: usize,
    views: &[View],
    moment: &Moment,
) -> Vec<Option<Contour>> {
    views
        .iter()
        .zip(&moment.sights)
        .enumerate()
        .map(|(v, (view, sight))| {
            let seen = sight.as_ref()?;
            let mask = masks(frame, v)?;
            let owner = mask.owner(seen.rays.iter().flatten().map(|r| r.pixel))?;
            Contour::new(&mask, owner, view)
        })
        .collect()
}

/// Rims of a body against its contours; `round` as a part of all rounds, 0 to 1.
pub fn rims<'a>(
    body: &MeshBody,
    views: &'a [View],
    weights: &[f64],
    moment: &Moment,
    fitted: &Fitted,
    round: f64,
) -> Vec<Rim<'a>> {
    let mut skin = Skin::new(body, &fitted.person);
    let mut vertices = Vec::new();
    skin.pose(body, &fitted.pose, &fitted.posed, &mut vertices);
    let each = views.iter().zip(weights).zip(&moment.contours);
    each.filter_map(|((view, &weight), contour)| {
        let contour = contour.as_ref().filter(|_| weight > 0.0)?;
        let depth = moment.depth(view)?;
        let outline = Outline::new(body, &vertices, view)?;
        let reach = REACH[0] + (REACH[1] - REACH[0]) * round;
        Some(Rim::new(
            view,
            depth,
            weight,
            &outline,
            contour,
            reach,
            round > 0.0,
        ))
    })
    .collect()
}

/// Fits pose and shape of a body to joints and contours.
pub fn refine(
    solver: &mut Solver,
    (body, views, weights): (&MeshBody, &[View], &[f64]),
    moment: &Moment,
    fitted: &mut Fitted,
    (sigma, prior, shape): (f64, f64, f64),
) {
    let seen = moment.seen(views, weights);
    for round in 0..ROUNDS {
        let part = round as f64 / (ROUNDS - 1) as f64;
        let rims = rims(body, views, weights, moment, fitted, part);
        if rims.is_empty() {
            return;
        }
        let energy = Energy {
            body,
            seen: &seen,
            sigma,
            targets: None,
            target_sigma: sigma,
            lifted: moment.lifted.as_ref(),
            rims: &rims,
            prior,
            shape,
            free: moment.free(),
        };
        let effort = Effort {
            iterations: STEPS,
            tolerance: 1e-4,
        };
        let mut spare = fitted.clone();
        solver.solve(&energy, effort, fitted, &mut spare);
    }
}

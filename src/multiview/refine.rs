//! Pose and shape of a body solved for with what masks show of it ([`silhouette`](super::silhouette)).

use glam::DVec2;

use super::energy::{Energy, Free};
use super::fitted::Fitted;
use super::moment::Moment;
use super::points;
use super::silhouette::{Contour, Mask, Masks, Outline, Rim};
use crate::body::mesh::{MeshBody, Skin};
use crate::camera::View;
use crate::fit::{Bounds, overlap};
use crate::solve::{Effort, Solver};

/// Pairs are found so many times; the first time distances count squared.
const ROUNDS: usize = 4;
const STEPS: u32 = 6;
/// Nearest the contour that a rim can be drawn to, metres at the person: at first and in the end.
const REACH: [f64; 2] = [0.2, 0.06];

/// Where a body is in a view.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    /// How far away the pelvis is, metres.
    depth: f64,
    /// The box round the joints, whether the view shows them or not, pixels.
    bounds: Bounds,
}

impl Extent {
    /// Of this body.
    pub fn new(fitted: &Fitted, view: &View) -> Self {
        let joints = points::evidence(&fitted.posed).into_iter();
        let nowhere = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        Self {
            depth: view.to_camera(fitted.pose.pelvis).z,
            bounds: joints
                .filter_map(|joint| view.project(joint))
                .fold(nowhere, |(low, high), p| (low.min(p), high.max(p))),
        }
    }
}

/// Somebody in a frame.
#[derive(Debug, Clone, Copy)]
pub struct Person<'a> {
    /// What views saw.
    pub moment: &'a Moment,
    /// Where their body is, by view.
    pub extents: &'a [Extent],
}

impl Person<'_> {
    /// Whose value of a view's mask most of their joints have.
    fn owner(&self, mask: &Mask, v: usize) -> Option<u8> {
        let seen = self.moment.sights.get(v)?.as_ref()?;
        mask.owner(seen.rays.iter().flatten().map(|r| r.pixel))
    }
}

/// Contours of a person in the views that see them; `others` are in the frame as well. Who stands behind somebody has
/// joints on that one's value: it is the nearest one's, unless the mask has one value for all and their boxes do not
/// overlap.
pub fn contours(
    masks: &Masks<'_>,
    frame: usize,
    views: &[View],
    own: Person<'_>,
    others: &[Person<'_>],
) -> Vec<Option<Contour>> {
    let each = views.iter().enumerate().map(|(v, view)| {
        own.moment.sights.get(v)?.as_ref()?;
        let mask = masks(frame, v)?;
        let owner = own.owner(&mask, v)?;
        let extent = own.extents.get(v)?;
        let hides = |other: &Person<'_>| {
            let Some(theirs) = other.extents.get(v).filter(|e| e.depth < extent.depth) else {
                return false;
            };
            // A value is one person's, too, where all that is seen of the two is that person.
            other.owner(&mask, v) == Some(owner)
                && (mask.tells_people_apart() || overlap(extent.bounds, theirs.bounds))
        };
        if others.iter().any(hides) {
            return None;
        }
        Contour::new(&mask, owner, view)
    });
    each.collect()
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
            lifted: moment.lifted.as_ref().map(|l| &l.joints),
            rims: &rims,
            prior,
            shape,
            free: Free::of(moment),
        };
        let effort = Effort {
            iterations: STEPS,
            tolerance: 1e-4,
        };
        let mut spare = fitted.clone();
        solver.solve(&energy, effort, fitted, &mut spare);
    }
}

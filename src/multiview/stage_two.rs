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
use super::run::{Run, Step};
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

/// Stage two of some consecutive frames of one person.
pub struct Refit<'a> {
    /// The model.
    pub body: &'a MeshBody,
    /// The cameras.
    pub views: &'a [View],
    /// How much each counts.
    pub weights: &'a [f64],
    /// Whether paths are smooth in time.
    pub paths: bool,
    /// Frames a second.
    pub rate: f64,
    /// How the fit runs.
    pub run: Run<'a>,
}

impl Refit<'_> {
    /// Fits the frames again, the shape held. `part` is what this is called where it is kept, in the middle and when it
    /// is done.
    pub fn fit(&self, part: &str, moments: &mut [Moment], fits: &mut [Fitted]) {
        let middle = format!("{part}-half");
        let turns = if self.paths { TURNS } else { 2 };
        let mut begin = 0;
        if self.restore(part, moments, fits) {
            (self.run.progress)(Step::Restored(fits.len()));
            return;
        }
        // In the middle outlines are found anew, and nothing else goes on from the turn before.
        if turns > TURNS / 2 && self.restore(&middle, moments, fits) {
            begin = TURNS / 2;
        }
        let masked = moments.iter().any(|m| !m.contours.is_empty());
        let mut rims: Vec<Vec<Rim<'_>>> = vec![Vec::new(); fits.len()];
        for turn in begin..turns {
            if turn == TURNS / 2 && begin == 0 {
                self.keep(&middle, moments, fits);
            }
            // Outlines take long to find and change little.
            if masked && (turn == 0 || turn == TURNS / 2) {
                rims = moments
                    .par_iter()
                    .zip(fits.par_iter())
                    .map(|(moment, fitted)| {
                        refine::rims(self.body, self.views, self.weights, moment, fitted, 1.0)
                    })
                    .collect();
            }
            let targets: Vec<Targets> = if self.paths {
                project(fits, self.rate)
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
                        let joints = points::evidence(&fitted.posed);
                        for (view, sight) in self.views.iter().zip(&mut moment.sights) {
                            moment.healed += sight
                                .as_mut()
                                .map_or(0, |s| exchange::follow(view, s, &joints));
                        }
                    }
                    self.turn(solver, moment, fitted, targets, rims);
                    if turn + 1 == turns {
                        (self.run.progress)(Step::Smoothed);
                    }
                },
            );
        }
        self.keep(part, moments, fits);
    }

    /// Some steps of one frame towards its joints' paths.
    fn turn(
        &self,
        solver: &mut Solver,
        moment: &Moment,
        fitted: &mut Fitted,
        targets: &Targets,
        rims: &[Rim<'_>],
    ) {
        let seen = moment.seen(self.views, self.weights);
        let is_told = !seen.is_empty() || !rims.is_empty() || moment.lifted.is_some();
        // A frame of which nothing tells is where its neighbours put it: the priors alone would make a mean pose of it.
        if !is_told && !self.paths {
            return;
        }
        let energy = Energy {
            body: self.body,
            seen: &seen,
            sigma: FINE,
            targets: self.paths.then_some(targets),
            target_sigma: dct::SIGMA,
            lifted: moment.lifted.as_ref().map(|l| &l.joints),
            rims,
            prior: 1.0,
            shape: 0.0,
            free: Free::Pose,
        };
        let effort = Effort {
            iterations: if self.paths { STEPS } else { 10 },
            tolerance: 1e-5,
        };
        let mut spare = fitted.clone();
        solver.solve(&energy, effort, fitted, &mut spare);
    }

    fn restore(&self, part: &str, moments: &mut [Moment], fits: &mut [Fitted]) -> bool {
        let mut moments: Vec<&mut Moment> = moments.iter_mut().collect();
        let Some(restored) = self.run.restore(part, self.body, &mut moments) else {
            return false;
        };
        for (fitted, restored) in fits.iter_mut().zip(restored) {
            if let Some((restored, _)) = restored {
                *fitted = restored;
            }
        }
        true
    }

    fn keep(&self, part: &str, moments: &[Moment], fits: &[Fitted]) {
        let fits = fits.iter().map(|f| Some((f, 0.0)));
        self.run.keep(part, moments.iter().zip(fits));
    }
}

fn project(fits: &[Fitted], rate: f64) -> Vec<Targets> {
    let joints: Vec<_> = fits.iter().map(|f| points::all(&f.posed)).collect();
    let mut targets = vec![[None; BODY_JOINTS]; fits.len()];
    for j in 0..BODY_JOINTS {
        let path: Vec<DVec3> = joints.iter().map(|p| p[j]).collect();
        for (target, point) in targets.iter_mut().zip(dct::smooth(&path, rate)) {
            target[j] = Some((point, PATH));
        }
    }
    targets
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::body::mesh::{JOINTS, MeshPose};
    use crate::joints::EVIDENCE_JOINTS;
    use crate::multiview::PosePrior;

    #[test]
    fn without_paths_a_frame_of_which_nothing_tells_stays_as_it_is() {
        let body = MeshBody::shipped();
        let mut rotations: [DQuat; JOINTS] = PosePrior::shipped().mean();
        // Both arms up, as nobody of the prior holds them.
        rotations[16] = DQuat::from_rotation_z(1.3) * rotations[16];
        rotations[17] = DQuat::from_rotation_z(-1.3) * rotations[17];
        let pose = MeshPose {
            pelvis: DVec3::Y,
            rotations,
        };
        let start = Fitted::new(body, pose, &[0.0; 10]);
        let mut moments = [Moment {
            sights: vec![None],
            joints: points::evidence(&start.posed).map(Some),
            healed: 0,
            lifted: None,
            contours: Vec::new(),
        }];
        let mut fits = [start.clone()];
        let refit = Refit {
            body,
            views: &[],
            weights: &[],
            paths: false,
            rate: 30.0,
            run: Run::new(None, &|_| ()),
        };
        refit.fit("paths", &mut moments, &mut fits);
        let [was, is] = [&start, &fits[0]].map(|f| points::evidence(&f.posed));
        for j in 0..EVIDENCE_JOINTS {
            assert!(was[j].distance(is[j]) < 1e-9, "joint {j}");
        }
    }
}

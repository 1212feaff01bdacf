//! Stage one of one person: every frame for itself, again from its neighbours where it ended in a bad place, then with
//! outlines. What is done is kept block by block.

use rayon::prelude::*;

use super::fit::{PersonFit, PersonFrame};
use super::fitted::Fitted;
use super::kept::Placed;
use super::moment::Moment;
use super::people::Track;
use super::points;
use super::refine::contours;
use super::run::{Run, Step};
use super::silhouette::Masks;
use super::stage_one::StageOne;
use crate::body::mesh::MeshBody;
use crate::camera::View;

/// By what factor a frame's cost exceeds its neighbours' before it is fitted again from there.
const DOUBT: f64 = 1.5;
/// Frames that are kept together: by joints they take less than a second of one core, with outlines some.
const BLOCK: usize = 256;

type Frames = [(usize, Moment)];

/// Stage one of one person.
pub struct OverFrames<'a> {
    /// The model.
    pub body: &'a MeshBody,
    /// The cameras.
    pub views: &'a [View],
    /// How much each counts.
    pub weights: &'a [f64],
    /// Whether a frame goes from a coarse energy to the fine one.
    pub hierarchy: bool,
    /// How the fit runs.
    pub run: Run<'a>,
}

impl OverFrames<'_> {
    /// Fits all frames; `None` where none could be.
    pub fn fit(&self, track: Track) -> Option<PersonFit> {
        let (id, mut moments) = (track.id, track.moments);
        let part = format!("placed-{id}");
        let mut fits = match self.restore(&part, &mut moments) {
            Some(fits) => {
                (self.run.progress)(Step::Restored(moments.len()));
                fits
            }
            None => {
                let mut fits = self.each(id, &mut moments);
                self.take_from_neighbours(&mut moments, &mut fits);
                (self.run.progress)(Step::Settled);
                self.keep(&part, &moments, &fits);
                fits
            }
        };
        // From here on the body itself tells how far away they are whom one view alone saw, not its neighbour: that one
        // is not kept.
        for ((_, moment), placed) in moments.iter_mut().zip(&fits) {
            if let Some((fitted, _)) = placed {
                moment.place_by(self.body, fitted);
            }
        }
        if let Some(masks) = self.run.masks {
            self.outline(id, masks, &mut moments, &mut fits);
        }
        let frames: Vec<PersonFrame> = moments
            .into_iter()
            .zip(fits)
            .filter_map(|((frame, mut moment), fitted)| {
                let (fitted, _) = fitted?;
                // The body tells where joints are that no two views saw.
                let joints = points::evidence(self.body, &fitted.posed);
                for (known, joint) in moment.joints.iter_mut().zip(joints) {
                    *known = known.or(Some(joint));
                }
                Some(PersonFrame {
                    frame,
                    body: fitted,
                    moment,
                })
            })
            .collect();
        (!frames.is_empty()).then_some(PersonFit {
            id,
            betas: Vec::new(),
            frames,
        })
    }

    fn restore(&self, part: &str, moments: &mut Frames) -> Option<Vec<Placed>> {
        let mut moments: Vec<&mut Moment> = moments.iter_mut().map(|(_, m)| m).collect();
        self.run.restore(part, self.body, &mut moments)
    }

    fn keep(&self, part: &str, moments: &Frames, fits: &[Placed]) {
        let fits = fits.iter().map(|f| f.as_ref().map(|(f, cost)| (f, *cost)));
        self.run
            .keep(part, moments.iter().map(|(_, m)| m).zip(fits));
    }

    fn stage(&self) -> StageOne {
        StageOne::new(self.hierarchy)
    }

    fn solve(&self, stage: &mut StageOne, moment: &mut Moment, near: Option<&Fitted>) -> Placed {
        stage.fit(self.body, self.views, self.weights, moment, near)
    }

    /// Every frame for itself.
    fn each(&self, id: u32, moments: &mut Frames) -> Vec<Placed> {
        let mut fits = Vec::with_capacity(moments.len());
        for (block, moments) in moments.chunks_mut(BLOCK).enumerate() {
            let part = format!("joints-{id}-{block}");
            if let Some(restored) = self.restore(&part, moments) {
                (self.run.progress)(Step::Restored(moments.len()));
                fits.extend(restored);
                continue;
            }
            let each = moments.par_iter_mut().map_init(
                || self.stage(),
                |stage, (_, moment)| {
                    let fitted = self.solve(stage, moment, None);
                    (self.run.progress)(Step::Placed);
                    fitted
                },
            );
            let fitted: Vec<Placed> = each.collect();
            self.keep(&part, moments, &fitted);
            fits.extend(fitted);
        }
        fits
    }

    /// From the neighbours, forth and back: what ended in a bad place, or had no place to start.
    fn take_from_neighbours(&self, moments: &mut Frames, fits: &mut [Placed]) {
        let mut stage = self.stage();
        let count = fits.len();
        for (k, from) in (1..count)
            .map(|k| (k, k - 1))
            .chain((0..count.saturating_sub(1)).rev().map(|k| (k, k + 1)))
        {
            let Some((near, cost)) = fits[from].clone() else {
                continue;
            };
            if fits[k].as_ref().is_none_or(|(_, own)| *own > DOUBT * cost) {
                // Sides that the other body exchanges are those of the other body: both are taken, or neither.
                let mut moment = moments[k].1.clone();
                let again = self.solve(&mut stage, &mut moment, Some(&near));
                if again
                    .as_ref()
                    .is_some_and(|(_, c)| fits[k].as_ref().is_none_or(|(_, own)| c < own))
                {
                    (moments[k].1, fits[k]) = (moment, again);
                }
            }
        }
    }

    /// Every frame to its outlines as well. Contours are always made, stage two wants them.
    fn outline(&self, id: u32, masks: &Masks<'_>, moments: &mut Frames, fits: &mut [Placed]) {
        let blocks = moments.chunks_mut(BLOCK).zip(fits.chunks_mut(BLOCK));
        for (block, (moments, fits)) in blocks.enumerate() {
            let part = format!("outlines-{id}-{block}");
            let restored = self.restore(&part, moments);
            let is_restored = restored.is_some();
            for (fitted, restored) in fits.iter_mut().zip(restored.into_iter().flatten()) {
                *fitted = restored;
            }
            moments.par_iter_mut().zip(&mut *fits).for_each_init(
                || self.stage(),
                |stage, ((frame, moment), fitted)| {
                    let Some((fitted, _)) = fitted else {
                        return;
                    };
                    moment.contours = contours(masks, *frame, self.views, moment);
                    if !is_restored {
                        stage.outline(self.body, self.views, self.weights, moment, fitted);
                        (self.run.progress)(Step::Outlined);
                    }
                },
            );
            if is_restored {
                (self.run.progress)(Step::Restored(moments.len()));
            } else {
                self.keep(&part, moments, fits);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat, DVec2, DVec3};

    use super::*;
    use crate::body::mesh::MeshPose;
    use crate::joints::EVIDENCE_JOINTS;
    use crate::message::Observation;
    use crate::multiview::{PosePrior, Sight};

    /// Level, at the origin, the world's y up.
    fn camera() -> View {
        View {
            name: "one".into(),
            size: [1280, 960],
            focal: DVec2::splat(1000.0),
            centre: DVec2::new(639.5, 479.5),
            distortion: Default::default(),
            rotation: DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
            position: DVec3::Y,
        }
    }

    /// The mean pose four metres before the camera, turned about y.
    fn standing(turned: f64) -> Fitted {
        let mut rotations = PosePrior::shipped().mean();
        rotations[0] = DQuat::from_rotation_y(turned);
        let pose = MeshPose {
            pelvis: DVec3::new(0.0, 0.9, -4.0),
            rotations,
        };
        Fitted::new(MeshBody::shipped(), pose, &[0.0; 10])
    }

    /// What one view sees of a body.
    fn seen(views: &[View; 1], truth: &Fitted) -> Moment {
        let body = MeshBody::shipped();
        let mut seen = Observation::default();
        for (out, joint) in seen
            .joints2d
            .iter_mut()
            .zip(points::evidence(body, &truth.posed))
        {
            let pixel = views[0].project(joint).unwrap();
            *out = [pixel.x as f32, pixel.y as f32, 0.9];
        }
        let sight = Sight::new(&views[0], &seen);
        Moment {
            sights: vec![Some(sight)],
            joints: [None; EVIDENCE_JOINTS],
            healed: 0,
            lifted: None,
            contours: Vec::new(),
        }
    }

    #[test]
    fn a_person_is_settled_after_all_frames_are_placed_and_before_any_is_outlined() {
        let (body, views) = (MeshBody::shipped(), [camera()]);
        let truth = standing(0.3);
        let mut moment = seen(&views, &truth);
        moment.joints = points::evidence(body, &truth.posed).map(Some);
        let heard = std::sync::Mutex::new(Vec::new());
        let hear = |step: Step| heard.lock().unwrap().push(step);
        let masks: &Masks<'_> = &|_, _| None;
        let over = OverFrames {
            body,
            views: &views,
            weights: &[1.0],
            hierarchy: true,
            run: Run::new(Some(masks), &hear),
        };
        let moments = vec![(0, moment.clone()), (1, moment)];
        over.fit(Track { id: 1, moments }).unwrap();
        let wanted = [
            Step::Placed,
            Step::Placed,
            Step::Settled,
            Step::Outlined,
            Step::Outlined,
        ];
        assert_eq!(*heard.lock().unwrap(), wanted);
    }

    #[test]
    fn a_try_that_ends_worse_leaves_sides_as_they_were() {
        let (body, views) = (MeshBody::shipped(), [camera()]);
        let (truth, back) = (standing(0.3), standing(0.3 + std::f64::consts::PI));
        let moment = seen(&views, &truth);
        let over = OverFrames {
            body,
            views: &views,
            weights: &[1.0],
            hierarchy: true,
            run: Run::new(None, &|_| ()),
        };
        // Costs that no try comes under; the frame's own is so much higher that it is tried again from the other.
        let mut moments = [(0, moment.clone()), (1, moment.clone())];
        let mut fits = [Some((back, 1e-9)), Some((truth, 1e-6))];
        over.take_from_neighbours(&mut moments, &mut fits);
        let (_, after) = &moments[1];
        assert_eq!((&after.sights, after.healed), (&moment.sights, 0));
        assert_eq!(fits[1].as_ref().unwrap().1, 1e-6);
    }
}

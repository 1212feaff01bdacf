//! Stage one of one person: every frame for itself, again from its neighbours where it ended in a bad place, then with
//! outlines, and again where views turn out to count less. What is done is kept block by block.

use rayon::prelude::*;

use super::fitted::Fitted;
use super::kept::Placed;
use super::moment::Moment;
use super::people::Track;
use super::person::{PersonFit, PersonFrame};
use super::points;
use super::refine::{Extent, Person, contours};
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

/// One person's frames in stage one.
pub struct InFrames {
    id: u32,
    /// Rising.
    moments: Vec<(usize, Moment)>,
    fits: Vec<Placed>,
    /// By frame and view where joints have placed the body, whatever outlines make of it; empty where there is none.
    extents: Vec<Vec<Extent>>,
}

impl InFrames {
    /// The person in a frame, where they have a body there.
    fn at(&self, frame: usize) -> Option<Person<'_>> {
        let k = self
            .moments
            .binary_search_by_key(&frame, |(f, _)| *f)
            .ok()?;
        let extents = &self.extents[k];
        (!extents.is_empty()).then_some(Person {
            moment: &self.moments[k].1,
            extents,
        })
    }
}

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
    /// Fits all frames of everybody; who has no frame that could be fitted is left out.
    pub fn fit(&self, tracks: Vec<Track>) -> Vec<PersonFit> {
        let mut people: Vec<InFrames> = tracks.into_iter().map(|t| self.place(t)).collect();
        if let Some(masks) = self.run.masks {
            // Whose an outline is depends on where the others are.
            for k in 0..people.len() {
                let (before, rest) = people.split_at_mut(k);
                if let [own, after @ ..] = rest {
                    let others: Vec<&InFrames> = before.iter().chain(after.iter()).collect();
                    self.outline(masks, own, &others);
                }
            }
        }
        let each = people.into_iter().filter_map(|p| self.placed(p));
        each.collect()
    }

    /// By joints.
    fn place(&self, track: Track) -> InFrames {
        let (id, mut moments) = (track.id, track.moments);
        let part = format!("placed-{id}");
        let fits = match self.restore(&part, &mut moments) {
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
                moment.place_by(fitted);
            }
        }
        let extents = fits.iter().map(|placed| {
            let fitted = placed.iter().map(|(fitted, _)| fitted);
            let each = fitted.flat_map(|f| self.views.iter().map(|view| Extent::new(f, view)));
            each.collect()
        });
        InFrames {
            id,
            extents: extents.collect(),
            moments,
            fits,
        }
    }

    /// The frames that have a body; `None` where none has.
    fn placed(&self, person: InFrames) -> Option<PersonFit> {
        let id = person.id;
        let each = person.moments.into_iter().zip(person.fits);
        let frames: Vec<PersonFrame> = each
            .filter_map(|((frame, mut moment), fitted)| {
                let (fitted, _) = fitted?;
                // The body tells where joints are that no two views saw.
                let joints = points::evidence(&fitted.posed);
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

    /// Fits frames again that tell a shape, from the bodies that they have, where views count otherwise than they did.
    pub fn again(&self, person: &mut PersonFit) {
        let id = person.id;
        for (block, frames) in person.frames.chunks_mut(BLOCK).enumerate() {
            let part = format!("weighed-{id}-{block}");
            let mut moments: Vec<&mut Moment> = frames.iter_mut().map(|f| &mut f.moment).collect();
            if let Some(restored) = self.run.restore(&part, self.body, &mut moments) {
                for (f, restored) in frames.iter_mut().zip(restored) {
                    if let Some((fitted, _)) = restored {
                        f.body = fitted;
                    }
                }
                continue;
            }
            let telling = frames.par_iter_mut().filter(|f| f.moment.tells_size());
            telling.for_each_init(
                || self.stage(),
                |stage, f| {
                    stage.again(self.body, self.views, self.weights, &f.moment, &mut f.body);
                },
            );
            let each = frames.iter().map(|f| (&f.moment, Some((&f.body, 0.0))));
            self.run.keep(&part, each);
        }
        (self.run.progress)(Step::Settled);
    }

    /// Every frame to its outlines as well. Contours are always made, stage two wants them.
    fn outline(&self, masks: &Masks<'_>, own: &mut InFrames, others: &[&InFrames]) {
        let InFrames {
            id,
            moments,
            fits,
            extents,
        } = own;
        let blocks = moments.chunks_mut(BLOCK).zip(fits.chunks_mut(BLOCK));
        let blocks = blocks.zip(extents.chunks(BLOCK));
        for (block, ((moments, fits), extents)) in blocks.enumerate() {
            let part = format!("outlines-{id}-{block}");
            let restored = self.restore(&part, moments);
            let is_restored = restored.is_some();
            for (fitted, restored) in fits.iter_mut().zip(restored.into_iter().flatten()) {
                *fitted = restored;
            }
            let each = moments.par_iter_mut().zip(&mut *fits).zip(extents);
            each.for_each_init(
                || self.stage(),
                |stage, (((frame, moment), fitted), extents)| {
                    let Some((fitted, _)) = fitted else {
                        return;
                    };
                    let near: Vec<Person<'_>> =
                        others.iter().filter_map(|p| p.at(*frame)).collect();
                    let own = Person {
                        moment: &*moment,
                        extents,
                    };
                    moment.contours = contours(masks, *frame, self.views, own, &near);
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
    use crate::multiview::kept::{Kept, write};
    use crate::multiview::silhouette::Mask;
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
        let mut seen = Observation::default();
        for (out, joint) in seen.joints2d.iter_mut().zip(points::evidence(&truth.posed)) {
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
        moment.joints = points::evidence(&truth.posed).map(Some);
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
        assert_eq!(over.fit(vec![Track { id: 1, moments }]).len(), 1);
        let wanted = [
            Step::Placed,
            Step::Placed,
            Step::Settled,
            Step::Outlined,
            Step::Outlined,
        ];
        assert_eq!(*heard.lock().unwrap(), wanted);
    }

    /// What an earlier run has kept: the first person's outlined body.
    struct Outlined(Vec<u8>);

    impl Kept for Outlined {
        fn get(&self, part: &str) -> Option<Vec<u8>> {
            (part == "outlines-1-0").then(|| self.0.clone())
        }

        fn put(&self, _: &str, _: &[u8]) {}
    }

    #[test]
    fn whose_an_outline_is_does_not_depend_on_whether_a_run_goes_on() {
        let (body, views) = (MeshBody::shipped(), [camera()]);
        let at = |z: f64| {
            let mut pose = standing(0.0).pose;
            pose.pelvis.z = z;
            Fitted::new(body, pose, &[0.0; 10])
        };
        let track = |id: u32, truth: &Fitted| {
            let mut moment = seen(&views, truth);
            moment.joints = points::evidence(&truth.posed).map(Some);
            Track {
                id,
                moments: vec![(0, moment)],
            }
        };
        // Of two in a line the one before covers the other, in a mask that tells people apart.
        let (front, back) = (at(-4.0), at(-5.5));
        let tracks = vec![track(1, &front), track(2, &back)];
        let [w, h] = views[0].size;
        let inside = |k: u32| (440..840).contains(&(k % w)) && (200..760).contains(&(k / w));
        let mask = Mask {
            size: [w, h],
            owners: (0..w * h).map(|k| u8::from(inside(k))).collect(),
            unknown: Some(255),
        };
        let masks: &Masks<'_> = &|_, _| Some(mask.clone());
        // The outline has drawn the first one behind the other.
        let far = at(-8.0);
        let first = (&tracks[0].moments[0].1, Some((&far, 0.0)));
        let kept = Outlined(write([first].into_iter()));
        let anew = Run::new(Some(masks), &|_| ());
        let goes_on = Run {
            kept: &kept,
            ..anew
        };
        for run in [anew, goes_on] {
            let over = OverFrames {
                body,
                views: &views,
                weights: &[1.0],
                hierarchy: true,
                run,
            };
            let found = over.fit(tracks.clone());
            let outlined = |k: usize| found[k].frames[0].moment.contours[0].is_some();
            assert_eq!([outlined(0), outlined(1)], [true, false]);
        }
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

//! Synchronised observations and bodies of every view go in; how far each view is from what the others know comes out.

use std::fmt::{self, Display, Formatter};

use edgecap_client::joints::{
    BODY_JOINTS, EVIDENCE_JOINTS, HEAD_TOP, JOINT_NAMES, L_ANKLE, L_ELBOW, L_HIP, L_KNEE,
    L_SHOULDER, L_WRIST, NECK, R_ANKLE, R_ELBOW, R_HIP, R_KNEE, R_SHOULDER, R_WRIST,
};
use edgecap_client::message::{BodyFrame, ObservationFrame};
use glam::{DVec2, DVec3};

use super::triangulate::triangulate;
use crate::camera::View;
use crate::lab::eval::PoseErrors;

/// Candidates of a view that are combined with those of the others: the best scores.
const CANDIDATES: usize = 4;
/// Most combinations of the people of some views that all go on to the next view: those of four views, so that of up to
/// five all are tried.
const ALL: usize = CANDIDATES.pow(4);
/// Of more so many go on, the best. Otherwise every view more would be [`CANDIDATES`] times the work.
const KEPT: usize = 32;
/// Source views that a triangulation needs.
const SOURCES: usize = 3;
/// Of a figure's height: the nearest report within it is meant …
const NEAR: f64 = 0.5;
/// … and it is that person seen rightly, where another detector says what is right.
const RIGHT: f64 = 0.12;
/// Head top and neck: every detector marks them elsewhere.
const MARKED_DIFFERENTLY: [usize; 2] = [HEAD_TOP, NECK];
/// Bones between evidence joints whose summed length gives the size of a person.
const BONES: [(usize, usize); 12] = [
    (NECK, R_SHOULDER),
    (NECK, L_SHOULDER),
    (R_SHOULDER, R_ELBOW),
    (R_ELBOW, R_WRIST),
    (L_SHOULDER, L_ELBOW),
    (L_ELBOW, L_WRIST),
    (NECK, R_HIP),
    (NECK, L_HIP),
    (R_HIP, R_KNEE),
    (R_KNEE, R_ANKLE),
    (L_HIP, L_KNEE),
    (L_KNEE, L_ANKLE),
];

/// The evidence joints of one person in space; unknown where views do not see or do not agree.
type Figure = [Option<DVec3>; EVIDENCE_JOINTS];

/// Takes in frame after frame; [`MultiviewCheck::finish`] tells the figures.
pub struct MultiviewCheck {
    views: Vec<View>,
    agree: f64,
    report: MultiviewReport,
    seen: [Vec<f64>; EVIDENCE_JOINTS],
    fitted: [Vec<f64>; EVIDENCE_JOINTS],
    /// Triangulated figures in camera axes with Stage II's and Stage III's person.
    pairs: [Vec<(Figure, [DVec3; BODY_JOINTS])>; 2],
}

/// What [`MultiviewCheck`] found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MultiviewReport {
    /// Frames with every view, times views judged.
    pub judged: usize,
    /// Those in which the views that tell agree on a person …
    pub triangulated: usize,
    /// … whom Stage II of the view left out saw as well, and whom its fit followed.
    pub found: [usize; 2],
    /// Median distance, pixels, between the reprojected joint and this view's own 2D, and between it and the fit's
    /// joint; with the number of joints behind it.
    pub pixels: [[Option<(f64, usize)>; 2]; EVIDENCE_JOINTS],
    /// The same over all joints.
    pub all_pixels: [Option<f64>; 2],
    /// Root-relative 3D error of Stage II and Stage III, metres: mean after bringing both to one size, and after
    /// Procrustes.
    pub mpjpe: [Option<f64>; 2],
    /// See `mpjpe`.
    pub pa_mpjpe: [Option<f64>; 2],
}

impl MultiviewCheck {
    /// For views in the order of the frames that will come; joints whose views disagree by more than `agree` pixels
    /// (mean distance to their own reprojections) do not count.
    pub fn new(views: Vec<View>, agree: f64) -> Self {
        Self {
            views,
            agree,
            report: MultiviewReport::default(),
            seen: Default::default(),
            fitted: Default::default(),
            pairs: Default::default(),
        }
    }

    /// Takes in what every view saw at one moment, in the order of the views.
    ///
    /// # Panics
    /// If there are not as many frames as views.
    pub fn add(&mut self, frames: &[(ObservationFrame, BodyFrame)]) {
        assert_eq!(frames.len(), self.views.len(), "one frame a view");
        for out in 0..frames.len() {
            self.report.judged += 1;
            let others = frames.iter().enumerate().filter(|(v, _)| *v != out);
            let others: Vec<_> = others.map(|(v, (seen, _))| (v, seen)).collect();
            if let Some(figure) = self.best_figure(&others) {
                self.compare(&figure, NEAR, out, &frames[out]);
            }
        }
    }

    /// Takes in what every view saw at one moment and what another detector saw there, in the order of the views. All
    /// views of the other detector together are the truth; head top and neck, which everybody marks differently, are
    /// left out of it, and whoever is further from it than 0.12 of the height is not found.
    ///
    /// # Panics
    /// If there are not as many frames of each as views.
    pub fn add_against(
        &mut self,
        truth: &[ObservationFrame],
        frames: &[(ObservationFrame, BodyFrame)],
    ) {
        assert_eq!(frames.len(), self.views.len(), "one frame a view");
        assert_eq!(truth.len(), self.views.len(), "one truth a view");
        self.report.judged += frames.len();
        let all: Vec<_> = truth.iter().enumerate().collect();
        let Some(mut figure) = self.best_figure(&all) else {
            return;
        };
        for j in MARKED_DIFFERENTLY {
            figure[j] = None;
        }
        for (out, frame) in frames.iter().enumerate() {
            self.compare(&figure, RIGHT, out, frame);
        }
    }

    /// The person on whom the sources, views by number, agree best. Every combination of their people is tried, but of
    /// more than [`ALL`] of the views before one the best alone go on to it.
    fn best_figure(&self, sources: &[(usize, &ObservationFrame)]) -> Option<Figure> {
        let least = SOURCES.min(sources.len());
        // A view that sees nobody has no part in any combination, and forbids none.
        let sources: Vec<_> = sources
            .iter()
            .filter(|(_, seen)| !seen.people().is_empty())
            .copied()
            .collect();
        let mut tried: Vec<Vec<usize>> = vec![Vec::new()];
        for (n, (_, seen)) in sources.iter().enumerate() {
            if tried.len() > ALL {
                self.keep_best(&mut tried, &sources[..n], least);
            }
            let picks = 0..seen.people().len().min(CANDIDATES);
            let longer = |pick: usize| {
                let with = move |people: &Vec<usize>| [&people[..], &[pick]].concat();
                tried.iter().map(with)
            };
            tried = picks.flat_map(longer).collect();
        }
        let mut best: Option<(usize, Figure)> = None;
        for people in &tried {
            let (figure, _) = self.figure(&sources, people, least);
            let known = figure.iter().flatten().count();
            if known >= 6 && best.as_ref().is_none_or(|(most, _)| known > *most) {
                best = Some((known, figure));
            }
        }
        best.map(|(_, figure)| figure)
    }

    /// Keeps the [`KEPT`] combinations of one person a source in which most joints agree, of equals the nearest ones.
    fn keep_best(
        &self,
        tried: &mut Vec<Vec<usize>>,
        sources: &[(usize, &ObservationFrame)],
        least: usize,
    ) {
        let rated = std::mem::take(tried).into_iter().map(|people| {
            let (figure, off) = self.figure(sources, &people, least);
            (figure.iter().flatten().count(), off, people)
        });
        let mut rated: Vec<_> = rated.collect();
        rated.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)));
        rated.truncate(KEPT);
        tried.extend(rated.into_iter().map(|(_, _, people)| people));
    }

    /// The joints on which at least `least` sources agree that `people`, one a source, are one person, and the sum over
    /// these joints of their mean distances to their reprojections, pixels.
    fn figure(
        &self,
        sources: &[(usize, &ObservationFrame)],
        people: &[usize],
        least: usize,
    ) -> (Figure, f64) {
        let joint = |j: usize| {
            let pixels: Vec<(&View, DVec2)> = sources
                .iter()
                .zip(people)
                .filter_map(|((v, seen), &p)| {
                    let [u, w, c] = seen.people[p].joints2d[j].map(f64::from);
                    (c > 0.0).then(|| (&self.views[*v], DVec2::new(u, w)))
                })
                .collect();
            if pixels.len() < least {
                return None;
            }
            let point = triangulate(&pixels, self.agree)?;
            let mut off = 0.0;
            for (view, pixel) in &pixels {
                off += view.project(point)?.distance(*pixel) / pixels.len() as f64;
            }
            (off <= self.agree).then_some((point, off))
        };
        let joints: [Option<(DVec3, f64)>; EVIDENCE_JOINTS] = std::array::from_fn(joint);
        let off = joints.iter().flatten().map(|(_, off)| off).sum();
        (joints.map(|known| known.map(|(point, _)| point)), off)
    }

    /// `near`: of the figure's height, see [`NEAR`].
    fn compare(
        &mut self,
        figure: &Figure,
        near: f64,
        out: usize,
        (seen, bodies): &(ObservationFrame, BodyFrame),
    ) {
        self.report.triangulated += 1;
        let view = &self.views[out];
        let pixels: [Option<DVec2>; EVIDENCE_JOINTS] = figure.map(|p| view.project(p?));
        let reach = near * height(&pixels);
        let distance = |j: usize, at: [f32; 2]| {
            let at = DVec2::new(f64::from(at[0]), f64::from(at[1]));
            pixels[j].map(|p| p.distance(at))
        };
        let mean = |joints: &dyn Fn(usize) -> Option<f64>| {
            let all: Vec<f64> = (0..EVIDENCE_JOINTS).filter_map(joints).collect();
            (all.len() >= 4).then(|| all.iter().sum::<f64>() / all.len() as f64)
        };
        let own = |p: &edgecap_client::message::Observation, j: usize| {
            let [u, v, c] = p.joints2d[j];
            (c > 0.0).then(|| distance(j, [u, v])).flatten()
        };
        let nearest = |far: Vec<Option<f64>>| {
            let all = far.into_iter().enumerate();
            all.filter_map(|(k, d)| Some((k, d.filter(|d| *d < reach)?)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .map(|(k, _)| k)
        };
        let observed = seen.people().iter().map(|p| mean(&|j| own(p, j)));
        let fitted = bodies
            .bodies()
            .iter()
            .map(|b| mean(&|j| distance(j, b.joints2d[j])));
        let in_camera = figure.map(|p| Some(view.to_camera(p?)));
        let wide = |p: [f32; 3]| DVec3::from(p.map(f64::from));
        if let Some(k) = nearest(observed.collect()) {
            let person = &seen.people()[k];
            for j in 0..EVIDENCE_JOINTS {
                self.seen[j].extend(own(person, j));
            }
            self.report.found[0] += 1;
            self.pairs[0].push((in_camera, person.joints3d.map(wide)));
        }
        if let Some(k) = nearest(fitted.collect()) {
            let body = &bodies.bodies()[k];
            for j in 0..EVIDENCE_JOINTS {
                self.fitted[j].extend(distance(j, body.joints2d[j]));
            }
            self.report.found[1] += 1;
            self.pairs[1].push((in_camera, body.joints3d.map(wide)));
        }
    }

    /// The figures so far.
    pub fn finish(&self) -> MultiviewReport {
        let mut report = self.report.clone();
        for j in 0..EVIDENCE_JOINTS {
            report.pixels[j] = [&self.seen[j], &self.fitted[j]].map(|all| {
                let middle = median(all.clone())?;
                Some((middle, all.len()))
            });
        }
        report.all_pixels = [&self.seen, &self.fitted].map(|all| median(all.concat()));
        for (stage, pairs) in self.pairs.iter().enumerate() {
            (report.mpjpe[stage], report.pa_mpjpe[stage]) = errors(pairs);
        }
        report
    }
}

/// Height of what is known of a figure in the picture, pixels.
fn height(pixels: &[Option<DVec2>; EVIDENCE_JOINTS]) -> f64 {
    let rows = || pixels.iter().flatten().map(|p| p.y);
    rows().fold(f64::NEG_INFINITY, f64::max) - rows().fold(f64::INFINITY, f64::min)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Mean root-relative error over all joints, sizes made equal over all people at once, and the same after Procrustes
/// per person. The root is the middle of the hips on both sides: that is what evidence joints know.
fn errors(pairs: &[(Figure, [DVec3; BODY_JOINTS])]) -> (Option<f64>, Option<f64>) {
    let sizes = pairs.iter().filter_map(|(figure, person)| {
        let (mut known, mut claimed) = (0.0, 0.0);
        for (a, b) in BONES {
            if let (Some(p), Some(q)) = (figure[a], figure[b]) {
                known += p.distance(q);
                claimed += person[a].distance(person[b]);
            }
        }
        (claimed > 0.0).then(|| known / claimed)
    });
    let Some(size) = median(sizes.collect()) else {
        return (None, None);
    };
    let (mut sums, mut joints) = ([0.0; 2], [0.0; 2]);
    for (figure, person) in pairs {
        let (Some(r), Some(l)) = (figure[8], figure[11]) else {
            continue;
        };
        let mut truth = [None; BODY_JOINTS];
        for (t, p) in truth.iter_mut().zip(figure) {
            *t = p.map(|p| p.to_array());
        }
        truth[edgecap_client::joints::PELVIS] = Some(r.midpoint(l).to_array());
        let mut claimed = person.map(|p| (p * size).to_array());
        claimed[edgecap_client::joints::PELVIS] =
            (person[8].midpoint(person[11]) * size).to_array();
        if let Some(errors) = PoseErrors::new(&truth, &claimed) {
            sums[0] += errors.aligned.iter().sum::<f64>();
            sums[1] += errors.procrustes.iter().sum::<f64>();
            // The root itself is no joint whose error counts, but where it is aligned like any other.
            joints[0] += (errors.aligned.len() - 1) as f64;
            joints[1] += errors.procrustes.len() as f64;
        }
    }
    let mean = |k: usize| (joints[k] > 0.0).then(|| sums[k] / joints[k]);
    (mean(0), mean(1))
}

impl Display for MultiviewReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let [seen, fitted] = self.found;
        writeln!(f, "frames times views               {}", self.judged)?;
        writeln!(f, "  the views that tell agree      {}", self.triangulated)?;
        writeln!(f, "  the view saw the person        {seen}")?;
        writeln!(f, "  its fit followed the person    {fitted}")?;
        let px = |p: Option<f64>| p.map_or("-".into(), |p| format!("{p:.1} px"));
        writeln!(f, "median distance to the triangulated joint")?;
        for (name, [seen, fitted]) in JOINT_NAMES.iter().zip(&self.pixels) {
            let part = |p: &Option<(f64, usize)>| px(p.map(|p| p.0));
            let n = seen.map_or(0, |s| s.1);
            writeln!(
                f,
                "  {name:<12} own 2D {:>9}   fit {:>9}   ({n})",
                part(seen),
                part(fitted)
            )?;
        }
        let [seen, fitted] = self.all_pixels.map(px);
        writeln!(f, "  {:<12} own 2D {seen:>9}   fit {fitted:>9}", "all")?;
        let mm = |e: Option<f64>| e.map_or("-".into(), |e| format!("{:.1} mm", 1e3 * e));
        for (stage, name) in ["Stage II", "Stage III"].iter().enumerate() {
            writeln!(
                f,
                "{name:<10} MPJPE {:>9}   PA-MPJPE {:>9}",
                mm(self.mpjpe[stage]),
                mm(self.pa_mpjpe[stage])
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use edgecap_client::joints::PELVIS;

    use super::*;
    use crate::lab::eval::align_similarity;

    #[test]
    fn a_view_that_sees_nobody_leaves_the_others_to_tell() {
        let views = [0.0, 70.0, 140.0, 210.0, 290.0].map(View::around);
        let sees = |view: &View| {
            let mut frame = ObservationFrame {
                count: 1,
                ..ObservationFrame::default()
            };
            for (j, out) in frame.people[0].joints2d.iter_mut().enumerate() {
                let j = j as f64;
                let at = DVec3::new(0.2 * (2.0 * j).sin(), 0.1 * j - 0.7, 0.2 * (3.0 * j).cos());
                let p = view.project(at).unwrap();
                *out = [p.x as f32, p.y as f32, 0.8];
            }
            (frame, BodyFrame::default())
        };
        let triangulated = |empty: &[usize]| {
            let mut check = MultiviewCheck::new(views.to_vec(), 20.0);
            let mut frames: Vec<_> = views.iter().map(sees).collect();
            for view in empty {
                frames[*view].0.count = 0;
            }
            check.add(&frames);
            check.finish().triangulated
        };
        assert_eq!((triangulated(&[]), triangulated(&[1])), (5, 5));
        // The two that are left out in turn need three others; the three that see the person have two.
        assert_eq!(triangulated(&[1, 3]), 2);
        assert_eq!(triangulated(&[0, 1, 2, 3, 4]), 0);
    }

    /// Of four people in each of eleven views there are four million combinations.
    #[test]
    fn many_views_of_several_people_agree_on_one_of_them() {
        let views: Vec<View> = (0..11).map(|v| View::around(32.0 * f64::from(v))).collect();
        let joint = |person: usize, j: usize| {
            let (x, j) = (0.5 * person as f64 - 0.75, j as f64);
            DVec3::new(x + 0.1 * j.sin(), 0.1 * j - 0.7, 0.1 * (2.0 * j).cos())
        };
        let mut frames = vec![ObservationFrame::default(); views.len()];
        for (v, (frame, view)) in frames.iter_mut().zip(&views).enumerate() {
            frame.count = CANDIDATES as u32;
            for (slot, seen) in frame.people[..CANDIDATES].iter_mut().enumerate() {
                // Every view tells them in an order of its own.
                let person = (slot + 3 * v) % CANDIDATES;
                for (j, out) in seen.joints2d.iter_mut().enumerate() {
                    let p = view.project(joint(person, j)).unwrap();
                    *out = [p.x as f32, p.y as f32, 0.8];
                }
            }
        }
        let sources: Vec<_> = frames.iter().enumerate().collect();
        let check = MultiviewCheck::new(views, 20.0);
        let figure = check.best_figure(&sources).unwrap();
        let off = |person: usize| {
            let joints = figure.iter().enumerate();
            let far =
                joints.map(|(j, p)| p.map_or(f64::INFINITY, |p| p.distance(joint(person, j))));
            far.fold(0.0, f64::max)
        };
        let best = (0..CANDIDATES).map(off).fold(f64::INFINITY, f64::min);
        // They stand half a metre apart.
        assert!(best < 0.1, "{best} m off");
    }

    #[test]
    fn errors_after_procrustes_are_the_mean_over_all_aligned_joints() {
        let figure: Figure = std::array::from_fn(|j| {
            let x = j as f64;
            Some(DVec3::new((2.0 * x).sin(), 0.1 * x, (3.0 * x).cos()))
        });
        let mut person = [DVec3::ZERO; BODY_JOINTS];
        for (at, truth) in person.iter_mut().zip(figure.iter().flatten()) {
            *at = *truth;
        }
        // The head's top is at the end of none of the bones that make the size.
        person[0] += DVec3::new(0.2, 0.0, 0.1);
        let hips = |p: &[DVec3]| p[8].midpoint(p[11]);
        let known: Vec<DVec3> = figure.iter().flatten().copied().collect();
        let with_root = |p: &[DVec3]| {
            let joints = p[..EVIDENCE_JOINTS].iter().copied();
            let joints = joints.chain([hips(p)]);
            joints.map(|p| p.to_array()).collect::<Vec<_>>()
        };
        let (own, truth) = (with_root(&person), with_root(&known));
        assert_eq!(truth.len(), EVIDENCE_JOINTS + 1);
        assert_eq!(PELVIS, EVIDENCE_JOINTS);
        let aligned = align_similarity(&own, &truth);
        let off = aligned.iter().zip(&truth);
        let off = off.map(|(a, b)| DVec3::from(*a).distance(DVec3::from(*b)));
        let expected = off.sum::<f64>() / truth.len() as f64;
        let (mpjpe, pa_mpjpe) = errors(&[(figure, person)]);
        let off = DVec3::new(0.2, 0.0, 0.1).length() / EVIDENCE_JOINTS as f64;
        assert!((mpjpe.unwrap() - off).abs() < 1e-9, "{mpjpe:?}");
        assert!((pa_mpjpe.unwrap() - expected).abs() < 1e-9, "{pa_mpjpe:?}");
    }
}

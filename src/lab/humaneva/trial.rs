//! One piece before some of its cameras: who the fit finds there, beside the truth.

use std::ops::Range;

use edgecap_kernels::Isa;
use glam::DVec2;

use super::archive::{CAMERAS, Piece, RATE, SIZE};
use super::compare::Pair;
use super::evidence;
use crate::body::mesh::MeshBody;
use crate::camera::View;
use crate::capture::{Frame, Letterbox};
use crate::detect::Detection;
use crate::engine::{HEAD3D_CHANNELS, Model};
use crate::fit::{FitConfig, Fitter};
use crate::joints::{EVIDENCE_JOINTS, LIMBS};
use crate::lift::{Encodings, Lifter};
use crate::message::Observation;
use crate::multiview::{
    Detections, MultiviewFit, MultiviewOptions, Run, Sight, fit, fit_tracks, one_view, stage_three,
};

/// Side of the input that Stage II's coordinates are of; it reads proportions alone.
const INPUT: [u32; 2] = [512, 320];

/// Whose 2D goes in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Exact.
    Exact,
    /// The detector's.
    Detected,
}

impl Source {
    /// What a camera saw in a frame; nothing where the truth is none.
    fn seen(self, piece: &Piece, frame: usize, camera: usize) -> Option<Observation> {
        if !piece.is_sound(frame) {
            return None;
        }
        match self {
            Self::Exact => Some(evidence::of_set(&piece.exact[frame][camera])),
            Self::Detected => piece.detected[frame][camera]
                .as_ref()
                .map(evidence::of_coco),
        }
    }

    /// The frames from first to last that all cameras saw, at most so many.
    pub fn span(self, piece: &Piece, most: usize) -> Range<usize> {
        let all = |f: &usize| (0..CAMERAS).all(|c| self.seen(piece, *f, c).is_some());
        let frames = 0..piece.joints.len();
        let first = frames.clone().find(all).unwrap_or(0);
        let last = frames.rev().find(all).map_or(0, |f| f + 1);
        first..last.min(first.saturating_add(most)).max(first)
    }

    /// How many of these frames all cameras saw: those are measured, whatever cameras are used.
    pub fn whole(self, piece: &Piece, frames: Range<usize>) -> usize {
        frames.filter(|f| self.is_whole(piece, *f)).count()
    }

    fn is_whole(self, piece: &Piece, frame: usize) -> bool {
        (0..CAMERAS).all(|c| self.seen(piece, frame, c).is_some())
    }
}

/// Fits a piece's frames as `views` saw them, cameras of the same numbers, and pairs what is found with the truth.
pub fn found(
    piece: &Piece,
    frames: Range<usize>,
    (views, cameras): (&[View], &[usize]),
    source: Source,
    paths: bool,
    lifter: Option<&Lifter>,
) -> Vec<Pair> {
    let options = MultiviewOptions {
        rate: RATE,
        paths,
        hierarchy: true,
    };
    let seen: Vec<Vec<Vec<Observation>>> = frames
        .clone()
        .map(|f| {
            let each = cameras.iter().map(|c| source.seen(piece, f, *c));
            each.map(|o| o.into_iter().collect()).collect()
        })
        .collect();
    let fitted = match (views, lifter) {
        ([view], Some(lifter)) => alone(view, seen, options, lifter.clone()),
        _ => several(views, &seen, options),
    };
    let Some(person) = fitted.people.iter().max_by_key(|p| p.frames.len()) else {
        return Vec::new();
    };
    let of = person.frames.iter().map(|f| (f, frames.start + f.frame));
    of.filter(|(_, k)| source.is_whole(piece, *k))
        .map(|(f, k)| Pair::new(&f.body.posed, &piece.joints[k]))
        .collect()
}

fn sights(views: &[View], frame: &[Vec<Observation>]) -> Vec<Detections> {
    let each = views.iter().zip(frame);
    each.map(|(view, seen)| seen.iter().map(|o| Sight::new(view, o)).collect())
        .collect()
}

fn several(
    views: &[View],
    seen: &[Vec<Vec<Observation>>],
    options: MultiviewOptions,
) -> MultiviewFit {
    let frames: Vec<Vec<Detections>> = seen.iter().map(|f| sights(views, f)).collect();
    let used = vec![true; views.len()];
    fit(
        MeshBody::shipped(),
        views,
        &used,
        &frames,
        options,
        Run::new(None, &|_| ()),
    )
}

fn alone(
    view: &View,
    mut seen: Vec<Vec<Vec<Observation>>>,
    options: MultiviewOptions,
    mut lifter: Lifter,
) -> MultiviewFit {
    for one in seen.iter_mut().flatten().flatten() {
        lift(&mut lifter, view, one);
    }
    let views = std::slice::from_ref(view);
    let mut fitter = Fitter::new(FitConfig::default()).expect("the usual settings are valid");
    let time = |k: usize| (1e9 * k as f64 / options.rate).round() as u64;
    let people = seen.iter().enumerate();
    let people = people.map(|(k, views)| (time(k), views[0].as_slice()));
    let bodies = stage_three(&mut fitter, view, people);
    let frames = seen.iter().map(|f| sights(views, f).swap_remove(0));
    let tracks = one_view(view, &bodies, &frames.collect::<Vec<_>>());
    fit_tracks(
        MeshBody::shipped(),
        views,
        vec![1.0],
        tracks,
        options,
        Run::new(None, &|_| ()),
    )
}

/// Stage II from 2D alone, as there are no pictures; `None` in a build without weights.
pub fn lifter() -> Option<Lifter> {
    let model = Model::shipped().ok()?;
    let layers = &model.stage2()?.layers;
    Lifter::new(layers, Encodings::Zero, Isa::detect().ok()?).ok()
}

fn lift(lifter: &mut Lifter, view: &View, seen: &mut Observation) {
    let letterbox = Letterbox::fit(SIZE[0], SIZE[1], INPUT[0], INPUT[1]);
    let detection = Detection {
        joints: seen.joints2d.map(|[u, v, confidence]| {
            // Stage II's view is a pinhole.
            let pixel = view.by_pinhole(DVec2::new(u.into(), v.into()));
            let [u, v] = letterbox.to_input(pixel.x as f32, pixel.y as f32);
            if confidence > 0.0 {
                [u, v, confidence]
            } else {
                [0.0; 3]
            }
        }),
        confidence: seen.joints2d.map(|[_, _, confidence]| confidence),
        encodings: [[0.0; HEAD3D_CHANNELS]; EVIDENCE_JOINTS],
        limbs: [0.0; LIMBS],
        score: seen.score,
    };
    let grey = Frame {
        width: 1,
        height: 1,
        rgb: vec![128; 3],
        ..Frame::default()
    };
    let lens = view.intrinsics();
    if let Ok([lifted]) = lifter.lift(&[detection], &grey, &letterbox, &lens) {
        seen.joints3d = lifted.joints3d;
    }
}

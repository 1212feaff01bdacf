//! Everyone, from all views: identities, stage one, the weights of the views, stage two.

use super::fitted::Fitted;
use super::moment::Moment;
use super::over_frames::OverFrames;
use super::people::{Detections, Track, track_by};
use super::person::{PersonFit, PersonFrame};
use super::points;
use super::run::{Run, Step};
use super::sight::distance;
use super::stage_one::between;
use super::stage_two::{Refit, median_shape};
use crate::body::mesh::MeshBody;
use crate::camera::View;

/// A pause in which nobody saw a person, seconds, that is filled in; a longer one parts their paths.
const BRIDGED: f64 = 0.35;
/// By what factor a view's residual exceeds the others' before it counts less.
const WORSE: f64 = 3.0;

/// Choices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MultiviewOptions {
    /// Frames a second.
    pub rate: f64,
    /// Whether paths are smoothed by windows of few cosines.
    pub paths: bool,
    /// Whether stage one goes from joints in space over a coarse energy to the fine one, as it should: without, the
    /// fine one starts from the mean pose, turned as the trunk is.
    pub hierarchy: bool,
}

/// Everyone, and how much every view counted.
#[derive(Debug, Clone)]
pub struct MultiviewFit {
    /// By rising identity.
    pub people: Vec<PersonFit>,
    /// 1, or less for a view that disagrees with the others.
    pub weights: Vec<f64>,
}

/// Fits everyone. `frames`: per frame, per view, who is seen there; `used`: which views count, the others are only
/// measured.
pub fn fit(
    body: &MeshBody,
    views: &[View],
    used: &[bool],
    frames: &[Vec<Detections>],
    options: MultiviewOptions,
    run: Run<'_>,
) -> MultiviewFit {
    let tracks = track_by(views, used, frames, options.rate);
    let weights: Vec<f64> = used.iter().map(|u| f64::from(u8::from(*u))).collect();
    fit_tracks(body, views, weights, tracks, options, run)
}

/// Fits people who are told apart already; `weights`: how much every view counts.
pub fn fit_tracks(
    body: &MeshBody,
    views: &[View],
    mut weights: Vec<f64>,
    tracks: Vec<Track>,
    options: MultiviewOptions,
    run: Run<'_>,
) -> MultiviewFit {
    let stages = 2 + usize::from(run.masks.is_some());
    let frames: usize = tracks.iter().map(|t| t.moments.len()).sum();
    (run.progress)(Step::Planned(stages * frames));
    let over_frames = OverFrames {
        body,
        views,
        weights: &weights,
        hierarchy: options.hierarchy,
        run,
    };
    let mut people = over_frames.fit(tracks);
    let weighed = weigh(views, &weights, &people);
    if weighed != weights {
        // Stage two holds the shape: it has to be of views that count so already.
        let anew = OverFrames {
            weights: &weighed,
            ..over_frames
        };
        people.iter_mut().for_each(|person| anew.again(person));
        weights = weighed;
    }
    let bridged = (BRIDGED * options.rate).round() as usize;
    for person in &mut people {
        let told = person.frames.iter().filter(|f| f.moment.tells_size());
        let bodies: Vec<&Fitted> = told.map(|f| &f.body).collect();
        person.betas = median_shape(&bodies);
        let pieces = pieces(
            std::mem::take(&mut person.frames),
            bridged,
            body,
            views.len(),
        );
        let refit = Refit {
            body,
            views,
            weights: &weights,
            paths: options.paths,
            rate: options.rate,
            run,
        };
        for (k, mut piece) in pieces.into_iter().enumerate() {
            for f in &mut piece {
                f.body = Fitted::new(body, f.body.pose, &person.betas);
            }
            let (numbers, mut moments, mut fits) = parts(piece);
            refit.fit(&format!("paths-{}-{k}", person.id), &mut moments, &mut fits);
            let joined = numbers.into_iter().zip(fits).zip(moments);
            person
                .frames
                .extend(joined.map(|((frame, body), moment)| PersonFrame {
                    frame,
                    body,
                    moment,
                }));
        }
    }
    MultiviewFit { people, weights }
}

fn parts(piece: Vec<PersonFrame>) -> (Vec<usize>, Vec<Moment>, Vec<Fitted>) {
    let (mut numbers, mut moments, mut fits) = (Vec::new(), Vec::new(), Vec::new());
    for f in piece {
        numbers.push(f.frame);
        moments.push(f.moment);
        fits.push(f.body);
    }
    (numbers, moments, fits)
}

/// Parts a person's frames at long pauses and fills in short ones.
fn pieces(
    frames: Vec<PersonFrame>,
    bridged: usize,
    body: &MeshBody,
    views: usize,
) -> Vec<Vec<PersonFrame>> {
    let mut pieces: Vec<Vec<PersonFrame>> = Vec::new();
    for f in frames {
        match pieces.last_mut() {
            Some(piece)
                if piece
                    .last()
                    .is_some_and(|l| f.frame - l.frame <= bridged.max(1)) =>
            {
                let last = piece[piece.len() - 1].clone();
                let gap = f.frame - last.frame;
                for k in 1..gap {
                    let filled = between(body, &last.body, &f.body, k as f64 / gap as f64);
                    let joints = points::evidence(&filled.posed).map(Some);
                    let moment = Moment {
                        sights: vec![None; views],
                        joints,
                        healed: 0,
                        lifted: None,
                        contours: Vec::new(),
                    };
                    piece.push(PersonFrame {
                        frame: last.frame + k,
                        body: filled,
                        moment,
                    });
                }
                piece.push(f);
            }
            _ => pieces.push(vec![f]),
        }
    }
    pieces
}

/// Views that lie much further from the bodies than the others count less. From the bodies, not from where rays meet:
/// a wrong view draws that to itself. Frames that one view alone saw tell nothing of how views agree.
fn weigh(views: &[View], weights: &[f64], people: &[PersonFit]) -> Vec<f64> {
    let joints: Vec<_> = people
        .iter()
        .flat_map(|p| &p.frames)
        .filter(|f| f.moment.tells_size())
        .map(|f| (&f.moment, points::evidence(&f.body.posed)))
        .collect();
    let median = |v: usize| -> Option<f64> {
        let mut each: Vec<f64> = joints
            .iter()
            .filter_map(|(moment, joints)| Some((moment.sights[v].as_ref()?, joints)))
            .flat_map(|(sight, joints)| {
                let each = sight.rays.iter().zip(joints);
                each.filter_map(|(ray, joint)| {
                    let direction = ray.as_ref()?.direction;
                    Some(distance(views[v].position, direction, *joint))
                })
            })
            .collect();
        each.sort_by(f64::total_cmp);
        (!each.is_empty()).then(|| each[each.len() / 2])
    };
    let medians: Vec<Option<f64>> = (0..views.len())
        .map(|v| if weights[v] > 0.0 { median(v) } else { None })
        .collect();
    let mut out = weights.to_vec();
    for v in 0..views.len() {
        let mut others: Vec<f64> = (0..views.len())
            .filter(|&o| o != v)
            .filter_map(|o| medians[o])
            .collect();
        others.sort_by(f64::total_cmp);
        if let (Some(own), [.., _]) = (medians[v], &others[..]) {
            let typical = others[others.len() / 2];
            if own > WORSE * typical {
                out[v] *= (typical / own).powi(2).max(0.01);
            }
        }
    }
    out
}

//! Films that may not have started together: the time of each at which people make the cameras go together best.

use rayon::prelude::*;

use super::OTHERWISE;
use super::found::{Found, refused};
use crate::camera::View;
use crate::commands::common_time::{Common, about_together, by_times};
use crate::commands::view_file::ViewFile;

/// Seconds by which the time of a film is tried first, and then; at last by a frame.
const STEPS: [f64; 2] = [0.4, 0.1];
/// Farthest that films are looked for apart, and most by which they may differ in length, seconds.
const MOST_APART: f64 = 1.0;
/// Rays must meet so many times better at another time.
const BETTER: f64 = 1.02;
/// Calibrations by which the time of films is looked for, at most.
const MOST_TRIED: usize = 40;
/// Instants a second by which it is looked for, about: fewer, and nobody can be followed.
const LOOKED_RATE: f64 = 10.0;
/// Instants by which it is looked for where there are as many, and at most.
const LOOKED: [usize; 2] = [60, 120];

/// The cameras by films at the time at which rays meet best, where that is better than as if they had started
/// together. `notes` gets which films did not, `said` what there is to say of the views' times then.
///
/// # Errors
/// When films differ in length by more than they may have started apart, or no cameras are found.
pub fn by_films(
    seen: &[ViewFile],
    lenses: &[View],
    stature: f64,
    notes: &mut Vec<String>,
    said: &mut Vec<String>,
) -> anyhow::Result<Found> {
    let common = about_together(seen.to_vec(), MOST_APART, OTHERWISE, said)?;
    let shifts = Search::new(seen, lenses, &common, stature).shifts();
    let together = Found::new(lenses, common, stature).map_err(refused);
    if shifts.iter().all(|s| *s == 0.0) {
        return together;
    }
    let mut said_then = Vec::new();
    let common = by_times(seen.to_vec(), &shifts, OTHERWISE, &mut said_then);
    let other = common.ok().map(|c| Found::new(lenses, c, stature));
    let Some(Ok(other)) = other else {
        return together;
    };
    if let Ok(now) = &together
        && other.worth() <= BETTER * now.worth()
    {
        return together;
    }
    *said = said_then;
    for (view, seconds) in seen.iter().zip(&shifts).filter(|s| *s.1 != 0.0) {
        let way = if *seconds < 0.0 { "after" } else { "before" };
        notes.push(format!(
            "camera {} started {:.3} s {way} {}, as people move: its frames are taken so",
            view.name,
            seconds.abs(),
            seen[0].name
        ));
    }
    Ok(other)
}

/// Looks for the time of films at which cameras that are found anew go together best: those that were found at another
/// time have turned to follow it, and prefer it. By whole frames, as joints between two frames have less noise and meet
/// better at any time.
struct Search<'a> {
    /// The films; nobody is seen beyond the part that is looked at.
    seen: Vec<ViewFile>,
    lenses: &'a [View],
    /// How tall people are taken to be, metres.
    stature: f64,
    /// Frames a second of the fastest film.
    rate: f64,
    /// Of so many instants one is looked at.
    stride: usize,
    /// By how many frames every film started before the first one, and how well rays met then.
    tried: Vec<(Vec<i64>, f64)>,
}

impl<'a> Search<'a> {
    /// `common` is what films saw if they started together.
    fn new(seen: &[ViewFile], lenses: &'a [View], common: &Common, stature: f64) -> Self {
        let instants = 0..common.times.len();
        let views = |k: usize| common.people.iter().filter(|p| !p[k].is_empty()).count();
        // How many of the instants before each one at least two views saw somebody in.
        let mut shared = vec![0];
        shared.extend(instants.scan(0, |sum, k| {
            *sum += usize::from(views(k) > 1);
            Some(*sum)
        }));
        let [least, most] = LOOKED;
        let stride = (common.rate / LOOKED_RATE) as usize;
        let stride = stride.min(shared[shared.len() - 1] / least).max(1);
        // The part in which most is shared.
        let length = (most * stride).min(common.times.len());
        let starts = 0..=common.times.len() - length;
        let begin = starts.rev().max_by_key(|k| shared[k + length] - shared[*k]);
        let begin = begin.unwrap_or(0);
        let since = |k: usize| common.times[k].saturating_sub(seen[0].times[0]);
        let (first, last) = (since(begin), since((begin + length).max(1) - 1));
        let part = |view: &ViewFile| {
            let each = view.times.iter().zip(&view.frames).map(|(time, people)| {
                let is_looked_at = (first..=last).contains(&(time - view.times[0]));
                if is_looked_at {
                    people.clone()
                } else {
                    Vec::new()
                }
            });
            ViewFile {
                name: view.name.clone(),
                frames: each.collect(),
                times: view.times.clone(),
                numbers: view.numbers.clone(),
                ..*view
            }
        };
        Self {
            seen: seen.iter().map(part).collect(),
            lenses,
            stature,
            rate: common.rate,
            stride,
            tried: Vec::new(),
        }
    }

    /// By how many seconds films started before the first one where rays meet best.
    fn shifts(mut self) -> Vec<f64> {
        let mut best = vec![0; self.seen.len()];
        let mut most = self.worth(&best);
        // Of two it does not matter which one is moved; of more the first one may be out of time.
        let movable = usize::from(best.len() == 2)..best.len();
        let moved = |all: &[i64], k: usize, way: i64| {
            let mut other = all.to_vec();
            other[k] += way;
            other
        };
        let steps = STEPS.map(|seconds| (seconds * self.rate).round().max(1.0) as i64);
        for step in steps.into_iter().chain([1]) {
            loop {
                let mut next: Option<(usize, i64, f64)> = None;
                let ways = movable.clone().flat_map(|k| [(k, step), (k, -step)]);
                let ways: Vec<(usize, i64)> = ways.collect();
                let around: Vec<_> = ways.iter().map(|(k, way)| moved(&best, *k, *way)).collect();
                self.look(&around);
                for (k, way) in ways {
                    let now = self.worth(&moved(&best, k, way));
                    if now > next.map_or(BETTER * most, |(_, _, worth)| worth) {
                        next = Some((k, way, now));
                    }
                }
                let Some((k, way, mut now)) = next else {
                    break;
                };
                while now > BETTER * most {
                    (best, most) = (moved(&best, k, way), now);
                    now = self.worth(&moved(&best, k, way));
                }
            }
        }
        let seconds = |frames: &i64| (frames - best[0]) as f64 / self.rate;
        best.iter().map(seconds).collect()
    }

    /// How well rays meet where films started so many frames before the first one; 0 where that is not known.
    fn worth(&mut self, frames: &[i64]) -> f64 {
        self.look(&[frames.to_vec()]);
        let frames = since_first(frames);
        let known = self.tried.iter().find(|t| t.0 == frames);
        known.map_or(0.0, |t| t.1)
    }

    /// Looks at these times at once, as if at one after the other.
    fn look(&mut self, times: &[Vec<i64>]) {
        let mut new: Vec<Vec<i64>> = Vec::new();
        for frames in times.iter().map(|frames| since_first(frames)) {
            let seconds = |f: &i64| (*f as f64 / self.rate).abs();
            let is_far = frames.iter().any(|f| seconds(f) > MOST_APART);
            if !(is_far || self.tried.iter().any(|t| t.0 == frames) || new.contains(&frames)) {
                new.push(frames);
            }
        }
        new.truncate(MOST_TRIED - self.tried.len());
        let found: Vec<f64> = new.par_iter().map(|f| self.found_worth(f)).collect();
        self.tried.extend(new.into_iter().zip(found));
    }

    /// How well rays meet by cameras that are found at this time; 0 where none are.
    fn found_worth(&self, frames: &[i64]) -> f64 {
        let shifts: Vec<f64> = frames.iter().map(|f| *f as f64 / self.rate).collect();
        let common = by_times(self.seen.clone(), &shifts, OTHERWISE, &mut Vec::new());
        let found = common.ok().map(|common| {
            let common = common.thinned(self.stride);
            Found::new(self.lenses, common, self.stature)
        });
        match found {
            Some(Ok(found)) => found.worth(),
            _ => 0.0,
        }
    }
}

/// The same time by how many frames films started before the first one.
fn since_first(frames: &[i64]) -> Vec<i64> {
    frames.iter().map(|f| f - frames[0]).collect()
}

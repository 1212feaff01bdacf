//! Which frames of several views belong together: by number, by a clock that all had, or by what moves in them.

use crate::camera::View;
use crate::commands::exit::Failure;
use crate::commands::view_file::{ViewFile, together};
use crate::message::Observation;
use crate::multiview::Sight;
use crate::multiview::between;
use crate::multiview::time::{MOST, Offset, Watched, offsets};

/// Offsets below this share of a frame need no interpolation.
const IN_STEP: f64 = 0.25;
/// How much rates of views in step may differ.
const ONE_RATE: f64 = 0.01;
/// Frames nearer than this are of one instant, seconds.
const SAME: f64 = 1e-3;
/// Longest time between two frames that is interpolated, in frames.
const GAP: f64 = 4.0;

/// How views are brought to one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Sync {
    /// Records of live cameras by their clock, others by what moves; frame by frame where that cannot be told
    Auto,
    /// By what moves in all views, to parts of a frame
    Motion,
    /// By the times in the files: of live cameras on one machine, or of films that start together
    Times,
    /// Frame by frame: views are of one rate and start together
    None,
}

/// What all views saw, frame by frame.
pub struct Together {
    /// Per view, per frame.
    pub people: Vec<Vec<Vec<Observation>>>,
    /// When every frame was taken, nanoseconds, on the clock of the view that has most of them.
    pub times: Vec<u64>,
    /// Frames a second.
    pub rate: f64,
    /// By how many seconds each view started before the first one, where that was told.
    pub offsets: Vec<Option<f64>>,
    /// Whether frames are the files' own, not made of those before and after.
    pub in_step: bool,
}

/// Brings views to one time; one file a view.
///
/// # Errors
/// Views that do not go together, or of which it cannot be told.
pub fn bring_together(
    (sync, fps): (Sync, Option<f64>),
    views: &[View],
    mut seen: Vec<ViewFile>,
    notes: &mut Vec<String>,
) -> anyhow::Result<Together> {
    if let Some(fps) = fps {
        for s in &mut seen {
            s.at_rate(fps);
        }
    }
    let timed = seen.iter().all(|s| s.times.len() > 1 && s.is_in_order());
    let one_clock = fps.is_none() && seen.iter().all(|s| s.of_machine);
    let name = |k: usize| views[k].name.as_str();
    let starts: Vec<u64> = seen
        .iter()
        .map(|s| s.times.first().copied().unwrap_or(0))
        .collect();
    let told = match sync {
        Sync::Times | Sync::Auto if timed && (one_clock || sync == Sync::Times) => {
            let first = starts[0] as f64;
            let each = starts.iter().map(|s| (first - *s as f64) * 1e-9);
            Some(each.map(Offset::Told).collect::<Vec<_>>())
        }
        Sync::Auto | Sync::Motion if timed => {
            let found = by_motion(views, &seen, &starts);
            for (k, offset) in found.iter().enumerate().skip(1) {
                notes.push(said(*offset, name(0), name(k)));
                if sync == Sync::Motion && *offset == Offset::CannotTell {
                    return Err(Failure::data(format!(
                        "cannot tell the time between cameras {} and {}: expected somebody who moves and whom both see for some seconds, at most {MOST} s apart; give --sync times or --sync none if they started together",
                        name(0),
                        name(k)
                    ))
                    .into());
                }
            }
            Some(found)
        }
        Sync::None | Sync::Auto => None,
        Sync::Motion | Sync::Times => {
            return Err(Failure::data(
                "expected files that tell when each frame was taken, found none or unordered times; give --fps, or --sync none",
            )
            .into());
        }
    };
    let in_step = told.as_ref().is_none_or(|told| {
        let interval = |s: &ViewFile| 1.0 / s.rate().unwrap_or(1.0);
        let first = interval(&seen[0]);
        let near = told.iter().all(|o| o.seconds().abs() < IN_STEP * first);
        near && seen
            .iter()
            .all(|s| (interval(s) / first - 1.0).abs() < ONE_RATE)
    });
    let offsets: Vec<Option<f64>> = match &told {
        None => vec![None; seen.len()],
        Some(told) => told
            .iter()
            .map(|o| (*o != Offset::CannotTell).then(|| o.seconds()))
            .collect(),
    };
    // Where motion tells nothing of any view, frames stand for themselves as they come.
    let nothing = sync == Sync::Auto && !one_clock && offsets.iter().skip(1).all(Option::is_none);
    if in_step || nothing {
        let (rate, count) = together(fps, &mut seen, notes)?;
        let times = seen[0].times[..count].to_vec();
        let people = seen.into_iter().map(|s| s.frames).collect();
        return Ok(Together {
            people,
            times,
            rate,
            offsets,
            in_step: true,
        });
    }
    let shifts: Vec<f64> = offsets.iter().map(|o| o.unwrap_or(0.0)).collect();
    sampled(&seen, &starts, &shifts, offsets)
}

fn by_motion(views: &[View], seen: &[ViewFile], starts: &[u64]) -> Vec<Offset> {
    let times: Vec<Vec<f64>> = seen
        .iter()
        .zip(starts)
        .map(|(s, start)| s.times.iter().map(|t| (t - start) as f64 * 1e-9).collect())
        .collect();
    let people: Vec<Vec<Vec<Sight>>> = seen
        .iter()
        .zip(views)
        .map(|(s, view)| {
            let frame = |f: &Vec<Observation>| f.iter().map(|o| Sight::new(view, o)).collect();
            s.frames.iter().map(frame).collect()
        })
        .collect();
    let watched: Vec<Watched<'_>> = views
        .iter()
        .zip(&times)
        .zip(&people)
        .map(|((view, times), people)| Watched {
            view,
            times,
            people,
        })
        .collect();
    offsets(&watched)
}

/// What was found out, in words.
fn said(offset: Offset, first: &str, camera: &str) -> String {
    let seconds = offset.seconds();
    let way = if seconds < 0.0 { "after" } else { "before" };
    let by = seconds.abs();
    match offset {
        Offset::Told(0.0) => {
            format!("camera {camera} started together with {first}, as people move")
        }
        Offset::Told(_) => {
            format!("camera {camera} started {by:.3} s {way} {first}, as people move")
        }
        Offset::Ambiguous(_) => format!(
            "camera {camera} started {by:.3} s {way} {first}, or at another time at which people moved in the same way: check it, or give --sync times or --sync none"
        ),
        Offset::CannotTell => format!(
            "cannot tell when camera {camera} started beside {first}: nobody whom both see moves enough; taken as if together"
        ),
    }
}

/// What every view saw at the times of the view with most frames a second, while all of them ran.
fn sampled(
    seen: &[ViewFile],
    starts: &[u64],
    shifts: &[f64],
    offsets: Vec<Option<f64>>,
) -> anyhow::Result<Together> {
    let rates: Vec<f64> = seen.iter().map(|s| s.rate().unwrap_or(0.0)).collect();
    let lead = (0..seen.len())
        .max_by(|a, b| rates[*a].total_cmp(&rates[*b]).then(b.cmp(a)))
        .unwrap_or(0);
    let seconds = |v: usize, ns: u64| (ns - starts[v]) as f64 * 1e-9;
    let mut all = Together {
        people: vec![Vec::new(); seen.len()],
        times: Vec::new(),
        rate: rates[lead],
        offsets,
        in_step: false,
    };
    for time in &seen[lead].times {
        let common = seconds(lead, *time) - shifts[lead];
        let now = |v: usize| common + shifts[v];
        let runs = |v: usize| {
            let last = seen[v].times.last().map_or(0.0, |t| seconds(v, *t));
            (-SAME..=last + SAME).contains(&now(v))
        };
        if !(0..seen.len()).all(runs) {
            continue;
        }
        all.times.push(*time);
        for (v, people) in all.people.iter_mut().enumerate() {
            let times = &seen[v].times;
            let next = times.partition_point(|t| seconds(v, *t) <= now(v));
            people.push(at(
                &seen[v],
                next,
                now(v),
                &|k| seconds(v, times[k]),
                rates[v],
            ));
        }
    }
    if all.times.is_empty() {
        return Err(Failure::data(
            "expected views that ran at one time, found none in which all did; give --sync none if frames belong together by number",
        )
        .into());
    }
    Ok(all)
}

/// Who was seen at a time; `next` is the first frame after it.
fn at(
    seen: &ViewFile,
    next: usize,
    now: f64,
    seconds: &dyn Fn(usize) -> f64,
    rate: f64,
) -> Vec<Observation> {
    let before = next.checked_sub(1);
    let after = (next < seen.frames.len()).then_some(next);
    let off = |k: usize| (seconds(k) - now).abs();
    if let Some(k) = [before, after]
        .into_iter()
        .flatten()
        .find(|k| off(*k) < SAME)
    {
        return seen.frames[k].clone();
    }
    let (Some(b), Some(a)) = (before, after) else {
        return Vec::new();
    };
    let step = seconds(a) - seconds(b);
    if step > GAP / rate {
        return Vec::new();
    }
    let share = off(b) / step;
    if share < 0.5 {
        between(&seen.frames[b], &seen.frames[a], share)
    } else {
        between(&seen.frames[a], &seen.frames[b], 1.0 - share)
    }
}

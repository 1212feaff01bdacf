//! Which frames of several views belong together: by number, by a clock that all had, or by what moves in them.

use crate::camera::View;
use crate::commands::common_time::{self, Common, IN_STEP};
use crate::commands::exit::Failure;
use crate::commands::view_file::ViewFile;
use crate::message::Observation;
use crate::multiview::Sight;
use crate::multiview::time::{MOST, Offset, Watched, offsets};

/// How views are brought to one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Sync {
    /// Records of live cameras by their clock, others by what moves; where that cannot be told as if they started
    /// together
    Auto,
    /// By what moves in all views, to parts of a frame
    Motion,
    /// By the times in the files: of live cameras on one machine, or of films that start together
    Times,
    /// Frame by frame: views are of one rate and start together
    None,
}

/// What to do where views never ran together.
pub const OTHERWISE: &str = "give --sync motion if they are of several clocks, --sync none if frames belong together by number";

/// Views at one time.
pub struct Together {
    /// The views that are, by number; others started when nobody can tell.
    pub used: Vec<usize>,
    /// What these saw.
    pub common: Common,
    /// By how many seconds each of these started before the first of them, where that was told.
    pub offsets: Vec<Option<f64>>,
    /// Whether the instants are of the machine's clock.
    pub of_machine: bool,
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
    let one_clock = fps.is_none() && seen.iter().all(|s| s.of_machine);
    let is_whole = sync == Sync::None || !ViewFile::put_in_order(&mut seen, notes);
    let timed = seen.iter().all(ViewFile::tells_times);
    let everyone: Vec<usize> = (0..seen.len()).collect();
    let of_machine = on_machine_clock(&seen[0]);
    let together = match sync {
        Sync::Times | Sync::Auto if timed && (one_clock || sync == Sync::Times) => {
            let shifts = common_time::by_clock(&seen);
            Ok(Together {
                used: everyone,
                common: common_time::by_times(seen, &shifts, OTHERWISE, notes)?,
                offsets: shifts.into_iter().map(Some).collect(),
                of_machine,
            })
        }
        Sync::Auto | Sync::Motion if timed => in_motion(sync, views, seen, notes),
        Sync::None | Sync::Auto => {
            if sync == Sync::Auto {
                common_time::expect_no_other_start(one_clock, &seen, "--sync none")?;
                notes.extend(
                    seen.iter()
                        .filter(|s| !s.is_in_order())
                        .map(ViewFile::by_number),
                );
            }
            notes.extend(ViewFile::begin_apart(seen.iter()));
            Ok(Together {
                offsets: vec![None; seen.len()],
                used: everyone,
                common: common_time::by_number(fps, seen, notes)?,
                of_machine,
            })
        }
        Sync::Motion | Sync::Times => Err(no_times().into()),
    };
    let mut together = together?;
    // Masks and films are numbered by the file's own frames.
    together.common.in_step &= is_whole;
    Ok(together)
}

/// Whether instants on this view's clock are of the machine's: times in no order are replaced.
pub fn on_machine_clock(view: &ViewFile) -> bool {
    view.of_machine && view.is_in_order()
}

/// Why views do not go by times that the user has asked for.
pub fn no_times() -> Failure {
    Failure::data(
        "expected files that tell when each frame was taken, found none or unordered times; give --fps, or --sync none",
    )
}

/// Brings views to one time by what moves in them.
fn in_motion(
    sync: Sync,
    views: &[View],
    seen: Vec<ViewFile>,
    notes: &mut Vec<String>,
) -> anyhow::Result<Together> {
    let found = by_motion(views, &seen);
    let is_told = |k: &usize| found[*k] != Offset::CannotTell;
    let told: Vec<usize> = (0..seen.len()).filter(is_told).collect();
    let first = told[0];
    let name = |k: usize| views[k].name.as_str();
    let near = IN_STEP / seen[first].rate().unwrap_or(1.0);
    let apart = found.iter().any(|o| o.seconds().abs() >= near);
    for k in (0..seen.len()).filter(|k| *k != first) {
        if sync == Sync::Motion && !is_told(&k) {
            return Err(Failure::data(format!(
                "cannot tell the time between cameras {} and {}: expected somebody who moves and whom both see for some seconds, at most {MOST} s apart; give --sync times or --sync none if they started together",
                name(first),
                name(k)
            ))
            .into());
        }
        notes.push(said(found[k], name(first), name(k), apart));
    }
    // Where the others did not start together, nothing speaks for one of which it cannot be told.
    let used = if apart {
        told.clone()
    } else {
        (0..seen.len()).collect()
    };
    let offset = |k: &usize| is_told(k).then(|| found[*k].seconds());
    let offsets = match told.len() {
        1 => vec![None; used.len()],
        _ => used.iter().map(offset).collect(),
    };
    let shifts: Vec<f64> = used.iter().map(|k| found[*k].seconds()).collect();
    let of_machine = on_machine_clock(&seen[used[0]]);
    let mut number = 0..;
    let kept: Vec<ViewFile> = seen
        .into_iter()
        .filter(|_| number.next().is_some_and(|k| used.contains(&k)))
        .collect();
    // Those of which the time is not told go by their starts, as does the first.
    let by_start = used.iter().zip(&kept);
    let by_start = by_start.filter(|(k, _)| **k == first || !is_told(k));
    notes.extend(ViewFile::begin_apart(by_start.map(|(_, view)| view)));
    let common = match told.len() {
        1 => common_time::as_if_together(kept, OTHERWISE, notes)?,
        _ => common_time::by_times(kept, &shifts, OTHERWISE, notes)?,
    };
    Ok(Together {
        used,
        common,
        offsets,
        of_machine,
    })
}

/// By how much each view started before the first one of which that can be told beside another; where it can be told of
/// none, before the very first. At least one is told.
fn by_motion(views: &[View], seen: &[ViewFile]) -> Vec<Offset> {
    let since = |s: &ViewFile, t: &u64| (t - s.times[0]) as f64 * 1e-9;
    let times: Vec<Vec<f64>> = seen
        .iter()
        .map(|s| s.times.iter().map(|t| since(s, t)).collect())
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
    for from in 0..views.len().saturating_sub(1) {
        let found = offsets(&watched[from..]);
        if found[1..].iter().any(|o| *o != Offset::CannotTell) {
            return [vec![Offset::CannotTell; from], found].concat();
        }
    }
    let mut nothing = vec![Offset::CannotTell; views.len()];
    nothing[0] = Offset::Told(0.0);
    nothing
}

/// What was found out, in words; whether the views are `apart` decides what becomes of one that is not told.
fn said(offset: Offset, first: &str, camera: &str, apart: bool) -> String {
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
            "cannot tell when camera {camera} started beside {first}: nobody whom both see moves enough; {}",
            match apart {
                true => "left out, as others did not start together",
                false => "taken as if together",
            }
        ),
    }
}

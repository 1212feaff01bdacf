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
    /// By how many seconds each of these started before the first of them that is not held out, where that was told.
    pub offsets: Vec<Option<f64>>,
    /// Whether the instants are of the machine's clock.
    pub of_machine: bool,
}

/// Brings views to one time; one file a view. Of views that are `held` out nothing depends: what they saw at the
/// others' instants is found afterwards, and as many stay as have a time that can be told.
///
/// # Errors
/// Views that do not go together, or of which it cannot be told.
pub fn bring_together(
    how: (Sync, Option<f64>),
    views: &[View],
    mut seen: Vec<ViewFile>,
    held: &[bool],
    notes: &mut Vec<String>,
) -> anyhow::Result<Together> {
    if let (_, Some(fps)) = how {
        seen.iter_mut().for_each(|s| s.at_rate(fps));
    }
    if !held.contains(&true) {
        return Ok(counted(how, views, seen, notes)?.0);
    }
    let (mut aside, mut kept) = (Vec::new(), Vec::new());
    for (k, (file, held)) in seen.into_iter().zip(held).enumerate() {
        match held {
            true => aside.push((k, file)),
            false => kept.push((k, file)),
        }
    }
    let (numbers, files): (Vec<usize>, Vec<ViewFile>) = kept.into_iter().unzip();
    let own: Vec<View> = numbers.iter().map(|k| views[*k].clone()).collect();
    let (mut together, way) = counted(how, &own, files.clone(), notes)?;
    let others = Others::new(own, files, &together, way);
    let mut held = Vec::new();
    for (k, file) in aside {
        let found = others.beside(how, &views[k], file, notes)?;
        held.extend(found.map(|found| (k, found)));
    }
    together.used = together.used.iter().map(|k| numbers[*k]).collect();
    for (k, found) in held {
        let at = together.used.partition_point(|other| *other < k);
        together.used.insert(at, k);
        together.offsets.insert(at, found.offset);
        together.common.people.insert(at, found.people);
        // Only masks ask for the numbers of pictures, and of who is only measured there are none.
        together.common.numbers.insert(at, Vec::new());
    }
    Ok(together)
}

/// How views were brought to one time.
enum Way {
    /// By one clock.
    Clock,
    /// By motion, or as if together where that tells nothing.
    Motion,
    /// By number.
    Number,
}

/// Brings together the views by which is measured.
fn counted(
    (sync, fps): (Sync, Option<f64>),
    views: &[View],
    mut seen: Vec<ViewFile>,
    notes: &mut Vec<String>,
) -> anyhow::Result<(Together, Way)> {
    let one_clock = fps.is_none() && seen.iter().all(|s| s.of_machine);
    let is_whole = sync == Sync::None || !ViewFile::put_in_order(&mut seen, notes);
    let timed = seen.iter().all(ViewFile::tells_times);
    let everyone: Vec<usize> = (0..seen.len()).collect();
    let of_machine = on_machine_clock(&seen[0]);
    let together = match sync {
        Sync::Times | Sync::Auto if timed && (one_clock || sync == Sync::Times) => {
            let shifts = common_time::by_clock(&seen);
            let together = Together {
                used: everyone,
                common: common_time::by_times(seen, &shifts, OTHERWISE, notes)?,
                offsets: shifts.into_iter().map(Some).collect(),
                of_machine,
            };
            Ok((together, Way::Clock))
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
            let together = Together {
                offsets: vec![None; seen.len()],
                used: everyone,
                common: common_time::by_number(fps, seen, notes)?,
                of_machine,
            };
            Ok((together, Way::Number))
        }
        Sync::Motion | Sync::Times => Err(no_times().into()),
    };
    let mut together = together?;
    // Masks and films are numbered by the file's own frames.
    together.0.common.in_step &= is_whole;
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

/// Why a view's time is not told by motion, as the user has asked for.
fn no_motion(first: &str, camera: &str) -> anyhow::Error {
    Failure::data(format!(
        "cannot tell the time between cameras {first} and {camera}: expected somebody who moves and whom both see for some seconds, at most {MOST} s apart; give --sync times or --sync none if they started together"
    ))
    .into()
}

/// Views by which is measured, brought together.
struct Others<'a> {
    views: Vec<View>,
    /// With their frames in order, as these were brought together.
    files: Vec<ViewFile>,
    together: &'a Together,
    way: Way,
}

/// What a view that is held out saw at the others' instants.
struct Beside {
    people: Vec<Vec<Observation>>,
    /// By how many seconds it started before the first of the others, where that was told.
    offset: Option<f64>,
}

impl<'a> Others<'a> {
    fn new(views: Vec<View>, mut files: Vec<ViewFile>, together: &'a Together, way: Way) -> Self {
        // What that says has been said.
        ViewFile::put_in_order(&mut files, &mut Vec::new());
        Self {
            views,
            files,
            together,
            way,
        }
    }

    /// What one that is held out saw; `None`, which is said, where its time cannot be told, or it never ran with the
    /// others.
    ///
    /// # Errors
    /// Where it cannot be told as the user has asked for.
    fn beside(
        &self,
        (sync, fps): (Sync, Option<f64>),
        view: &View,
        mut file: ViewFile,
        notes: &mut Vec<String>,
    ) -> anyhow::Result<Option<Beside>> {
        let common = &self.together.common;
        let left_out =
            |why: &str| format!("camera {}, which is held out, {why}; left out", view.name);
        if matches!(self.way, Way::Number) {
            let beside = [&self.files[self.together.used[0]], &file];
            let apart = ViewFile::begin_apart(beside.into_iter());
            let people = common.seen_by_number(file, fps.is_some());
            match people.is_some() {
                true => notes.extend(apart),
                false => notes.push(left_out("has another rate or length than the others")),
            }
            return Ok(people.map(|people| Beside {
                people,
                offset: None,
            }));
        }
        ViewFile::put_in_order(std::slice::from_mut(&mut file), notes);
        if !file.tells_times() {
            if sync != Sync::Auto {
                return Err(no_times().into());
            }
            notes.push(left_out("does not tell when its frames were taken"));
            return Ok(None);
        }
        let first = &self.files[self.together.used[0]];
        let by_clock = matches!(self.way, Way::Clock) && (file.of_machine || sync == Sync::Times);
        let shift = if by_clock {
            let apart = i128::from(first.times[0]) - i128::from(file.times[0]);
            Offset::Told(apart as f64 * 1e-9)
        } else {
            let shift = self.by_motion(view, &file);
            let fate = self.fate(&file);
            if sync == Sync::Motion && shift == Offset::CannotTell {
                return Err(no_motion(&first.name, &view.name));
            }
            notes.push(said(shift, &first.name, &view.name, fate));
            if shift == Offset::CannotTell && fate != Fate::AsIfTogether {
                return Ok(None);
            }
            shift
        };
        let seconds = shift.seconds();
        let people = common.seen_beside(first, &file, seconds);
        if people.is_none() {
            notes.push(left_out("did not run while the others did"));
        }
        Ok(people.map(|people| Beside {
            people,
            offset: (shift != Offset::CannotTell).then_some(seconds),
        }))
    }

    /// By how many seconds each of the others started before the first one.
    fn shifts(&self) -> Vec<f64> {
        let each = self.together.offsets.iter();
        each.map(|offset| offset.unwrap_or(0.0)).collect()
    }

    /// What becomes of one whose time motion does not tell.
    fn fate(&self, file: &ViewFile) -> Fate {
        let used = self.together.used.iter().map(|k| &self.files[*k]);
        let rate = self.files[self.together.used[0]].rate().unwrap_or(1.0);
        let mut shifts = self.shifts().into_iter();
        match shifts.any(|s| s.abs() >= IN_STEP / rate) {
            true => Fate::OthersApart,
            false if common_time::is_as_long(file, used) => Fate::AsIfTogether,
            false => Fate::OtherLength,
        }
    }

    /// By how much one started before the first of the others, as people move.
    fn by_motion(&self, view: &View, file: &ViewFile) -> Offset {
        let used = &self.together.used;
        let mut views: Vec<View> = used.iter().map(|k| self.views[*k].clone()).collect();
        let mut files: Vec<ViewFile> = used.iter().map(|k| self.files[*k].clone()).collect();
        views.push(view.clone());
        files.push(file.clone());
        let (found, shifts) = (by_motion(&views, &files), self.shifts());
        // Beside the first one of which anything is told.
        let base = found.iter().position(|o| *o != Offset::CannotTell);
        let base = base.and_then(|b| shifts.get(b)).copied().unwrap_or(0.0);
        match found[used.len()] {
            Offset::Told(s) => Offset::Told(s + base),
            Offset::Ambiguous(s) => Offset::Ambiguous(s + base),
            Offset::CannotTell => Offset::CannotTell,
        }
    }
}

/// Brings views to one time by what moves in them.
fn in_motion(
    sync: Sync,
    views: &[View],
    seen: Vec<ViewFile>,
    notes: &mut Vec<String>,
) -> anyhow::Result<(Together, Way)> {
    let found = by_motion(views, &seen);
    let is_told = |k: &usize| found[*k] != Offset::CannotTell;
    let told: Vec<usize> = (0..seen.len()).filter(is_told).collect();
    let first = told[0];
    let name = |k: usize| views[k].name.as_str();
    let near = IN_STEP / seen[first].rate().unwrap_or(1.0);
    let apart = found.iter().any(|o| o.seconds().abs() >= near);
    // Where the others did not start together, nothing speaks for one of which it cannot be told; where they did, its
    // length may speak against it.
    let fate = |k: usize| match told.len() {
        1 => Fate::AsIfTogether,
        _ if apart => Fate::OthersApart,
        _ if common_time::is_as_long(&seen[k], told.iter().map(|t| &seen[*t])) => {
            Fate::AsIfTogether
        }
        _ => Fate::OtherLength,
    };
    for k in (0..seen.len()).filter(|k| *k != first) {
        if sync == Sync::Motion && !is_told(&k) {
            return Err(no_motion(name(first), name(k)));
        }
        notes.push(said(found[k], name(first), name(k), fate(k)));
    }
    let stays = |k: &usize| is_told(k) || fate(*k) == Fate::AsIfTogether;
    let used: Vec<usize> = (0..seen.len()).filter(stays).collect();
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
    let together = Together {
        used,
        common,
        offsets,
        of_machine,
    };
    Ok((together, Way::Motion))
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

/// What becomes of a view whose time cannot be told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fate {
    /// It is taken to have started with the others.
    AsIfTogether,
    /// It is left out, as the others did not start together.
    OthersApart,
    /// It is left out: it is so much longer or shorter that it cannot have started and ended with the others.
    OtherLength,
}

/// What was found out, in words; `fate` is that of a view of which it cannot be told.
fn said(offset: Offset, first: &str, camera: &str, fate: Fate) -> String {
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
            match fate {
                Fate::AsIfTogether => "taken as if together",
                Fate::OthersApart => "left out, as others did not start together",
                Fate::OtherLength =>
                    "left out, as it is not as long as the others, which are taken to have started together; give --sync times if it did so, too",
            }
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::Intrinsics;

    /// Somebody in every frame, 30 a second from this one on.
    fn view(name: &str, begin: u64, frames: u64) -> ViewFile {
        let numbers: Vec<u64> = (begin..begin + frames).collect();
        ViewFile {
            name: name.to_owned(),
            size: [1080, 1920],
            intrinsics: Intrinsics::default(),
            frames: vec![vec![Observation::default()]; numbers.len()],
            times: numbers.iter().map(|n| n * 33_333_333).collect(),
            numbers,
            of_machine: false,
        }
    }

    #[test]
    fn why_a_view_that_is_held_out_may_not_be_measured_is_said() {
        let views = ["a", "b", "c"].map(|name| View {
            name: name.to_owned(),
            ..View::around(0.0)
        });
        for (sync, (begin, frames), words, stays) in [
            (Sync::None, (0, 90), None, true),
            (
                Sync::None,
                (3, 90),
                Some("camera c begins with picture 3"),
                true,
            ),
            (Sync::None, (0, 300), Some("rate or length"), false),
            (Sync::Times, (300, 90), Some("did not run"), false),
            (Sync::Times, (30, 90), None, true),
        ] {
            let seen = vec![view("a", 0, 90), view("b", 0, 90), view("c", begin, frames)];
            let mut notes = Vec::new();
            let held = [false, false, true];
            let together = bring_together((sync, None), &views, seen, &held, &mut notes);
            let used = together.unwrap().used;
            assert_eq!(used.contains(&2), stays, "{notes:?}");
            match words {
                Some(words) => assert!(notes.iter().any(|n| n.contains(words)), "{notes:?}"),
                None => assert!(notes.is_empty(), "{notes:?}"),
            }
        }
    }
}

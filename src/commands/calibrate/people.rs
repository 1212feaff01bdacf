//! Places by people who walk about: what several cameras saw of them goes in, a calibration comes out.

use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::PathBuf;

use rayon::prelude::*;

use super::lenses::{Lenses, folded, is_usual};
use super::{CalibrateArgs, ON_FLOOR, STATURES, report, write};
use crate::calibrate::{CalibrateError, Room, ViewQuality, calibrate as find};
use crate::camera::{DEFAULT_FOV, View};
use crate::capture::is_photo;
use crate::commands::common_time::{
    Common, about_together, by_clock, by_number, by_times, expect_no_other_start,
};
use crate::commands::exit::{self, Failure};
use crate::commands::multiview::expect_few;
use crate::commands::say;
use crate::commands::view_file::{Looked, ViewFile, is_film};
use crate::joints::CANONICAL_STATURE;
use crate::message::Observation;
use crate::multiview::{Detections, Sight, agreement, to_view};
use crate::record::CameraSource;

/// Joints of a view, %, that may lie far from where the others have them: on films of a man on a treadmill places were
/// right where it was 13 at most, and wrong by a metre where it was 20.
const FAR: f64 = 16.0;
/// Sights of a view, %, that may go with no other view's.
const ALONE: f64 = 10.0;
/// Joints of a view may be so many times farther off than those of the others: a camera that turned to follow a film
/// out of time hides most of what its joints would be off.
const SEVERAL: f64 = 3.0;
/// Joints that are off by less are so by a detector's noise, pixels.
const NOISE: f64 = 3.0;
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
/// Statures by `--distance` of which nothing is said, metres: below are young children, above hardly anybody.
const USUAL_STATURES: RangeInclusive<f64> = 1.2..=2.2;
/// What to do where views never ran together.
const OTHERWISE: &str = "give files of one time, or --fps if frames belong together by number";

/// What gives the room its size.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Scale {
    /// Height of the tallest of those who are seen at least half as long as the longest stay of anybody, visits of one
    /// height together, metres.
    Stature(f64),
    /// Distance between two cameras, by number, metres.
    Distance(usize, usize, f64),
}

impl Scale {
    /// How tall people are taken to be while cameras are looked for, metres: how far joints are off is judged by it.
    fn stature(self) -> f64 {
        match self {
            Self::Stature(metres) => metres,
            Self::Distance(..) => f64::from(CANONICAL_STATURE),
        }
    }

    /// The room at this size.
    fn of(self, room: Room) -> Room {
        match self {
            Self::Stature(_) => room,
            Self::Distance(a, b, metres) => room.with_distance(a, b, metres),
        }
    }
}

/// Cameras by what they saw of people.
///
/// # Errors
/// When a file cannot be read, views do not go together, too little was seen of anybody, or `--distance` makes people
/// of a size that nobody has, after what was found on the way is said; where a film could be seen in part alone, after
/// the cameras are written.
pub fn by_people(args: &CalibrateArgs, files: &[(String, PathBuf)]) -> anyhow::Result<()> {
    if files.len() < 2 {
        return Err(Failure::usage(format!(
            "expected at least two --view, found {}",
            files.len()
        ))
        .into());
    }
    expect_few(files.len())?;
    let photos = |file: &PathBuf| file.is_dir() || is_photo(file);
    if let Some((name, file)) = files.iter().find(|(_, file)| photos(file)) {
        return Err(Failure::usage(format!(
            "expected a record or a film of camera {name}, found photos, {}; these need --board",
            file.display()
        ))
        .into());
    }
    let lenses = Lenses::read(&args.lens, files)?;
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    let (mut assumed, mut notes) = (Vec::new(), Vec::new());
    let scale = scale(args, &names, &mut assumed)?;
    let found = placed(args, files, &lenses, scale, &mut notes);
    if found.is_err() {
        // Of a room that is not there.
        assumed.clear();
    }
    for note in assumed.iter().chain(&notes) {
        say::err(note);
    }
    let (room, are_whole) = found?;
    if args.distance.is_some() && !STATURES.contains(&room.stature) {
        return Err(impossible(room.stature).into());
    }
    write(&args.out, &room.views, &lenses)?;
    let told = report(&args.out, &table(&room));
    // Places are of what could be read of a film; what is wrong with it has been said.
    match are_whole {
        true => told,
        false => Err(Failure::silent(exit::DATA).into()),
    }
}

/// The room by the people in these files, and whether all films could be read; `notes` gets what there is to say.
fn placed(
    args: &CalibrateArgs,
    files: &[(String, PathBuf)],
    lenses: &Lenses,
    scale: Scale,
    notes: &mut Vec<String>,
) -> anyhow::Result<(Room, bool)> {
    let (mut seen, mut views, mut unknown) = (Vec::new(), Vec::new(), Vec::new());
    let mut are_whole = true;
    for (name, file) in files {
        let fov = lenses.fov_degrees(name);
        let told = CameraSource::Recorded {
            fov_degrees: fov as f32,
        };
        let (mut read, looked) = ViewFile::read(name, told, fov, file)?;
        are_whole &= looked == Looked::Whole;
        // Films are looked at as they are shown; records may be of pictures that were turned.
        let view = match is_film(file) {
            true => lenses.of(name, read.size),
            false => lenses.of_record(name, read.size, read.intrinsics),
        };
        let view = view.map_err(Failure::data)?;
        if !lenses.knows(name) && is_usual(read.size, &read.intrinsics) {
            unknown.push(name.as_str());
        }
        for people in &mut read.frames {
            to_view(&view, &read.intrinsics, people);
        }
        views.push(view);
        seen.push(read);
    }
    notes.extend(guessed(&unknown, files.len()));
    notes.extend(views.iter().filter_map(folded));
    let is_one_clock = args.fps.is_none() && seen.iter().all(|s| s.of_machine);
    if args.fps.is_none() {
        ViewFile::put_in_order(&mut seen, notes);
        expect_no_other_start(is_one_clock, &seen, "--fps")?;
        notes.extend(
            seen.iter()
                .filter(|s| !s.is_in_order())
                .map(ViewFile::by_number),
        );
    }
    let timed = args.fps.is_none() && seen.iter().all(ViewFile::tells_times);
    let is_by_clock = timed && is_one_clock;
    let mut said = Vec::new();
    let found = if timed && !is_by_clock {
        // Places are not known yet by which what moves would tell the time between films.
        Found::of_films(&seen, &views, scale.stature(), notes, &mut said)
    } else if timed {
        let shifts = by_clock(&seen);
        by_times(seen, &shifts, OTHERWISE, &mut said)
            .and_then(|common| Found::new(&views, common, scale.stature()).map_err(refused))
    } else {
        notes.extend(ViewFile::begin_apart(seen.iter()));
        by_number(args.fps, seen, &mut said)
            .and_then(|common| Found::new(&views, common, scale.stature()).map_err(refused))
    };
    notes.extend(said);
    let room = scale.of(found?.room);
    notes.extend(doubts(args, &room, is_by_clock));
    Ok((room, are_whole))
}

/// What to say of a room that is found.
fn doubts(args: &CalibrateArgs, room: &Room, is_by_clock: bool) -> Vec<String> {
    let mut notes = Vec::new();
    if !room.floor_by_feet {
        notes.push(
            "feet were in one place: the floor is level as people hold themselves; walk about for a slope".into(),
        );
    }
    notes.extend(room.quality.iter().filter_map(sunk));
    notes.extend(
        args.stature
            .zip(room.taller)
            .map(|(given, taller)| too_seldom(given, taller)),
    );
    notes.extend((0..room.quality.len()).filter_map(|v| doubt(&room.quality, v, is_by_clock)));
    let is_possible = STATURES.contains(&room.stature);
    if args.distance.is_some() && is_possible && !USUAL_STATURES.contains(&room.stature) {
        notes.push(unusual(room.stature));
    }
    notes
}

/// Cameras by views that were brought to one time.
struct Found {
    room: Room,
    common: Common,
}

impl Found {
    fn new(lenses: &[View], common: Common, stature: f64) -> Result<Self, CalibrateError> {
        let room = find(lenses, &sights(lenses, &common), common.rate, stature)?;
        Ok(Self { room, common })
    }

    fn worth(&self) -> f64 {
        worth(&self.room.views, &self.common)
    }

    /// The cameras by films at the time at which rays meet best, where that is better than as if they had started
    /// together. `notes` gets which films did not, `said` what there is to say of the views' times then.
    fn of_films(
        seen: &[ViewFile],
        lenses: &[View],
        stature: f64,
        notes: &mut Vec<String>,
        said: &mut Vec<String>,
    ) -> anyhow::Result<Self> {
        let common = about_together(seen.to_vec(), MOST_APART, OTHERWISE, said)?;
        let shifts = Search::new(seen, lenses, &common, stature).shifts();
        let together = Self::new(lenses, common, stature).map_err(refused);
        if shifts.iter().all(|s| *s == 0.0) {
            return together;
        }
        let mut said_then = Vec::new();
        let common = by_times(seen.to_vec(), &shifts, OTHERWISE, &mut said_then);
        let other = common.ok().map(|c| Self::new(lenses, c, stature));
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
}

/// How well the rays of these cameras meet: the better, the more.
fn worth(views: &[View], common: &Common) -> f64 {
    let met = agreement(views, &sights(views, common), common.rate);
    met.map_or(0.0, |a| a.confirmed / a.apart.max(1e-6))
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

/// What every view saw, instant by instant.
fn sights(views: &[View], common: &Common) -> Vec<Vec<Detections>> {
    let one = |k: usize, (view, people): (&View, &Vec<Vec<Observation>>)| -> Detections {
        people[k].iter().map(|o| Sight::new(view, o)).collect()
    };
    let all = |k: usize| {
        views
            .iter()
            .zip(&common.people)
            .map(move |pair| one(k, pair))
    };
    (0..common.times.len()).map(|k| all(k).collect()).collect()
}

/// What to say of cameras whose lens nobody told, of so many.
fn guessed(unknown: &[&str], cameras: usize) -> Option<String> {
    let whose = match unknown.len() {
        0 => return None,
        all if all == cameras => "every camera".to_owned(),
        _ => unknown.join(", "),
    };
    Some(format!(
        "no --lens for {whose}: a field of view of {DEFAULT_FOV} degrees is taken; places are as far off as it is"
    ))
}

/// What to say of a view that contradicts the others; `is_by_clock` where one clock told the times of all.
fn doubt(all: &[ViewQuality], view: usize, is_by_clock: bool) -> Option<String> {
    let others = all.iter().enumerate().filter(|(v, _)| *v != view);
    let others = others.map(|(_, q)| q.rms_px).sum::<f64>() / (all.len() as f64 - 1.0).max(1.0);
    let view = &all[view];
    let found = if view.far_percent > FAR {
        format!(
            "its joints where the other views have them, found {:.0} % far off",
            view.far_percent
        )
    } else if view.alone_percent > ALONE {
        format!(
            "people that it sees to be seen by the other views, found {:.0} % that go with nobody",
            view.alone_percent
        )
    } else if all.len() > 2 && view.rms_px > NOISE.max(SEVERAL * others) {
        format!(
            "its joints about as near as those of the other views, found {:.1} px off, and {others:.1} px there",
            view.rms_px
        )
    } else {
        return None;
    };
    let films = match is_by_clock {
        true => "",
        false => "films may not have started together: cut them to one moment; else ",
    };
    Some(format!(
        "camera {}: expected {found}: the places may be wrong; {films}let somebody walk about, or add a view",
        view.name
    ))
}

/// What to say of a camera that came out a little below the floor.
fn sunk(view: &ViewQuality) -> Option<String> {
    (view.height_m < -ON_FLOOR).then(|| {
        format!(
            "camera {}: found {:.2} m below the floor, which came out tilted: let somebody walk about, feet in view, on both sides of the room",
            view.name, -view.height_m
        )
    })
}

/// What to say of somebody who measures `taller` metres where `--stature` is `given`, which is of others.
fn too_seldom(given: f64, taller: f64) -> String {
    format!(
        "somebody who is seen less than half as long as the longest stay of anybody measures {taller:.2} m: --stature {given} was taken for the tallest of the others; if it is this one's, let them stay in view"
    )
}

/// What to say of a size by `--distance` that few people have; `stature` in metres.
fn unusual(stature: f64) -> String {
    format!(
        "by --distance the tallest person is {stature:.2} m tall: if nobody is, measure from lens to lens, in metres; distances are as far off as this is"
    )
}

/// Why cameras are not written by a `--distance` by which the tallest person would have this `stature`, metres.
fn impossible(stature: f64) -> Failure {
    let (least, most) = (STATURES.start(), STATURES.end());
    Failure::data(format!(
        "expected --distance to make the tallest person {least} to {most} m tall, found {stature:.2} m; measure from lens to lens, in metres"
    ))
}

fn refused(e: CalibrateError) -> anyhow::Error {
    Failure::data(e.to_string()).into()
}

fn scale(args: &CalibrateArgs, names: &[&str], notes: &mut Vec<String>) -> anyhow::Result<Scale> {
    if let Some(text) = &args.distance {
        let wrong = || {
            Failure::usage(format!(
                "expected two cameras and metres, as in {},{}=3.2, found --distance {text}",
                names[0], names[1]
            ))
        };
        let (pair, metres) = text.rsplit_once('=').ok_or_else(wrong)?;
        let number = |name: &str| names.iter().position(|n| *n == name);
        // A name may hold commas.
        let commas = pair
            .match_indices(',')
            .map(|(at, _)| (&pair[..at], &pair[at + 1..]));
        let known = commas.clone().find_map(|(a, b)| number(a).zip(number(b)));
        let Some((a, b)) = known else {
            let (a, b) = commas.clone().next().ok_or_else(wrong)?;
            let other = if number(a).is_none() { a } else { b };
            return Err(Failure::usage(format!(
                "--distance {text}: no --view is of {other}; expected two of {}",
                names.join(", ")
            ))
            .into());
        };
        let metres: f64 = metres.parse().map_err(|_| wrong())?;
        if a == b || !(0.05..=100.0).contains(&metres) {
            return Err(wrong().into());
        }
        return Ok(Scale::Distance(a, b, metres));
    }
    Ok(Scale::Stature(args.stature.unwrap_or_else(|| {
        notes.push(
            "neither --stature nor --distance: people are taken for 1.70 m; distances are as far off as this is".into(),
        );
        f64::from(CANONICAL_STATURE)
    })))
}

/// The report for people.
fn table(room: &Room) -> String {
    let mut text = "camera              sights  rms px  held out px  far %  height m\n".to_owned();
    for q in &room.quality {
        let held_out = q
            .held_out_rms_px
            .map_or("-".into(), |px| format!("{px:.1}"));
        let _ = writeln!(
            text,
            "{:<18}  {:>6}  {:>6.1}  {:>11}  {:>5.1}  {:>8.2}",
            q.name, q.sights, q.rms_px, held_out, q.far_percent, q.height_m
        );
    }
    let _ = writeln!(text, "tallest person {:.2} m", room.stature);
    text
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[test]
    fn cameras_without_a_lens_are_named_and_have_the_usual_one() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("camera.toml");
        std::fs::write(&file, "fov_degrees = 90\n").unwrap();
        let names = ["door", "hall", "yard"];
        let cameras = names.map(|name| (name.to_owned(), PathBuf::from("none")));
        let read = |given: &[&str]| {
            let given = given.iter().map(|of| format!("{of}{}", file.display()));
            Lenses::read(&given.collect::<Vec<_>>(), &cameras).unwrap()
        };
        let some = read(&["hall="]);
        let unknown = |lenses: &Lenses| -> Vec<&str> {
            let all = names.iter().copied();
            all.filter(|name| !lenses.knows(name)).collect()
        };
        let said = guessed(&unknown(&some), names.len()).unwrap();
        assert!(said.contains("for door, yard:"), "{said}");
        let fov = |name: &str| some.of(name, [640, 480]).unwrap().fov_degrees().round();
        assert_eq!(names.map(fov), [60.0, 90.0, 60.0]);
        let none = guessed(&unknown(&read(&[])), names.len()).unwrap();
        assert!(none.contains("for every camera:"), "{none}");
        for all in [&[""][..], &["door=", "hall=", "yard="]] {
            assert_eq!(guessed(&unknown(&read(all)), names.len()), None);
        }
    }

    #[test]
    fn a_view_that_contradicts_the_others_is_doubted() {
        let view = |rms_px, far_percent, alone_percent| ViewQuality {
            name: "door".into(),
            sights: 100,
            rms_px,
            held_out_rms_px: None,
            far_percent,
            alone_percent,
            height_m: 2.0,
        };
        let other = || view(2.5, 0.0, 0.0);
        let doubt = |of, is_by_clock| doubt(&[other(), of, other()], 1, is_by_clock);
        assert_eq!(doubt(view(7.0, 13.0, 9.0), false), None);
        for (rms, far, alone, word) in [
            (7.0, 20.0, 0.0, "20 %"),
            (7.0, 5.0, 20.0, "20 %"),
            (9.9, 3.5, 0.0, "9.9 px"),
        ] {
            let said = doubt(view(rms, far, alone), false).unwrap();
            assert!(said.contains("door") && said.contains(word), "{said}");
            assert!(said.contains("may not have started together"), "{said}");
            let said = doubt(view(rms, far, alone), true).unwrap();
            assert!(!said.contains("films"), "{said}");
        }
    }

    #[test]
    fn a_camera_on_the_floor_is_not_below_it() {
        let at = |height_m| ViewQuality {
            name: "low".into(),
            sights: 100,
            rms_px: 2.0,
            held_out_rms_px: None,
            far_percent: 0.0,
            alone_percent: 0.0,
            height_m,
        };
        for height in [0.1, 0.0, -0.003] {
            assert_eq!(sunk(&at(height)), None, "{height}");
        }
        let said = sunk(&at(-0.12)).unwrap();
        assert!(said.contains("camera low: found 0.12 m below"), "{said}");
    }

    #[test]
    fn whose_height_was_taken_is_said() {
        let said = too_seldom(1.78, 1.954);
        assert!(
            said.contains("1.95 m") && said.contains("--stature 1.78"),
            "{said}"
        );
    }

    #[test]
    fn cameras_whose_names_hold_commas_can_be_told_apart() {
        let names = ["hall,left", "hall", "left,door"];
        let find = |distance: &str| {
            let line = [
                "calibrate",
                "--view",
                "a",
                "--out",
                "b",
                "--distance",
                distance,
            ];
            let args = Line::parse_from(line).args;
            scale(&args, &names, &mut Vec::new()).map_err(|e| e.to_string())
        };
        let found = find("hall,left,left,door=3.2").unwrap();
        assert_eq!(found, Scale::Distance(0, 2, 3.2));
        assert_eq!(
            find("hall,left,hall=2").unwrap(),
            Scale::Distance(0, 1, 2.0)
        );
        let said = find("hall,yard=2").unwrap_err();
        assert!(said.contains("no --view is of yard"), "{said}");
        assert!(find("hall=2").is_err());
    }

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: CalibrateArgs,
    }
}

//! Places by people who walk about: what several cameras saw of them goes in, a calibration comes out.

mod doubts;
mod found;
mod scale;
mod start_times;

use std::fmt::Write as _;
use std::path::PathBuf;

use self::doubts::{doubts, guessed};
use self::found::{Found, refused};
use self::scale::{Scale, impossible, scale};
use self::start_times::by_films;
use super::lenses::{Lenses, folded, is_usual};
use super::{CalibrateArgs, STATURES, report, write};
use crate::calibrate::Room;
use crate::capture::is_photo;
use crate::commands::common_time::{by_clock, by_number, by_times, expect_no_other_start};
use crate::commands::exit::{self, Failure};
use crate::commands::multiview::expect_few;
use crate::commands::say;
use crate::commands::view_file::{Looked, ViewFile, is_film};
use crate::multiview::to_view;
use crate::record::CameraSource;

/// What to do where views never ran together.
const OTHERWISE: &str = "give files of one time, or --fps if frames belong together by number";

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
        by_films(&seen, &views, scale.stature(), notes, &mut said)
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

//! Places by people who walk about: what several cameras saw of them goes in, a calibration comes out.

use std::fmt::Write as _;
use std::path::PathBuf;

use super::CalibrateArgs;
use super::lenses::Lenses;
use crate::calibrate::{CalibrateError, Room, Scale, ViewQuality, calibrate as find};
use crate::camera::calibration::write_pose2sim;
use crate::camera::{DEFAULT_FOV, View};
use crate::commands::common_time::{Common, as_if_together, by_clock, by_number, by_times};
use crate::commands::exit::Failure;
use crate::commands::multiview::expect_few;
use crate::commands::say;
use crate::commands::view_file::ViewFile;
use crate::message::Observation;
use crate::multiview::{Detections, Sight, to_view};
use crate::output;
use crate::record::CameraSource;

/// Joints of a view, %, that may lie far from where the others have them: on films of a man on a treadmill places were
/// right where it was 13 at most, and wrong by a metre where it was 20.
const FAR: f64 = 16.0;
/// What to do where views never ran together.
const OTHERWISE: &str = "give files of one time, or --fps if frames belong together by number";

/// Cameras by what they saw of people.
///
/// # Errors
/// When a file cannot be read, views do not go together, or too little was seen of anybody.
pub fn by_people(args: &CalibrateArgs, files: &[(String, PathBuf)]) -> anyhow::Result<()> {
    if files.len() < 2 {
        return Err(Failure::usage(format!(
            "expected at least two --view, found {}",
            files.len()
        ))
        .into());
    }
    expect_few(files.len())?;
    let lenses = Lenses::read(&args.lens, files)?;
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    let mut notes: Vec<String> = guessed(&lenses, &names).into_iter().collect();
    let scale = scale(args, &names, &mut notes)?;
    let mut seen = Vec::new();
    let mut views = Vec::new();
    for (name, file) in files {
        let fov = lenses.fov_degrees(name);
        let told = CameraSource::Recorded {
            fov_degrees: fov as f32,
        };
        let mut read = ViewFile::read(name, told, fov, file)?;
        let view = lenses.of(name, read.size).map_err(Failure::data)?;
        for people in &mut read.frames {
            to_view(&view, &read.intrinsics, people);
        }
        views.push(view);
        seen.push(read);
    }
    let timed = args.fps.is_none() && seen.iter().all(ViewFile::tells_times);
    let common = if !timed {
        by_number(args.fps, seen, &mut notes)?
    } else if seen.iter().all(|s| s.of_machine) {
        let shifts = by_clock(&seen);
        by_times(seen, &shifts, OTHERWISE, &mut notes)?
    } else {
        // Places are not known yet by which what moves would tell the time between films.
        as_if_together(seen, OTHERWISE, &mut notes)?
    };
    let Common {
        people,
        times,
        rate,
        ..
    } = common;
    let one = |k: usize, (view, people): (&View, &Vec<Vec<Observation>>)| -> Detections {
        people[k].iter().map(|o| Sight::new(view, o)).collect()
    };
    let frames: Vec<Vec<Detections>> = (0..times.len())
        .map(|k| views.iter().zip(&people).map(|pair| one(k, pair)).collect())
        .collect();
    let room = find(&views, &frames, rate, scale).map_err(refused)?;
    if !room.floor_by_feet {
        notes.push(
            "feet were in one place: the floor is level as people hold themselves; walk about for a slope".into(),
        );
    }
    notes.extend(room.quality.iter().filter_map(doubt));
    for note in &notes {
        say::err(note);
    }
    output::write(&args.out, write_pose2sim(&room.views).as_bytes())
        .map_err(|e| Failure::output(&args.out, &e))?;
    say::whole(&table(&room))
}

/// What to say of cameras whose lens nobody told.
fn guessed(lenses: &Lenses, names: &[&str]) -> Option<String> {
    let unknown = names.iter().copied().filter(|name| !lenses.knows(name));
    let unknown: Vec<&str> = unknown.collect();
    let whose = match unknown.len() {
        0 => return None,
        all if all == names.len() => "every camera".to_owned(),
        _ => unknown.join(", "),
    };
    Some(format!(
        "no --lens for {whose}: a field of view of {DEFAULT_FOV} degrees is taken; places are as far off as it is"
    ))
}

/// What to say of a view that contradicts the others.
fn doubt(view: &ViewQuality) -> Option<String> {
    (view.far_percent > FAR).then(|| {
        format!(
            "camera {}: expected its joints where the other views have them, found {:.0} % far off: the places may be wrong; let somebody walk about, or add a view",
            view.name, view.far_percent
        )
    })
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
        let (a, b) = pair.split_once(',').ok_or_else(wrong)?;
        let number = |name: &str| names.iter().position(|n| *n == name);
        for name in [a, b] {
            if number(name).is_none() {
                return Err(Failure::usage(format!(
                    "--distance {text}: no --view is of {name}; expected two of {}",
                    names.join(", ")
                ))
                .into());
            }
        }
        let (a, b) = number(a).zip(number(b)).ok_or_else(wrong)?;
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
        f64::from(crate::joints::CANONICAL_STATURE)
    })))
}

/// The report for people.
fn table(room: &Room) -> String {
    let mut text = "camera              sights  rms px  held out px  far %  height m\n".to_owned();
    for q in &room.quality {
        let _ = writeln!(
            text,
            "{:<18}  {:>6}  {:>6.1}  {:>11.1}  {:>5.1}  {:>8.2}",
            q.name, q.sights, q.rms_px, q.held_out_rms_px, q.far_percent, q.height_m
        );
    }
    let _ = writeln!(text, "tallest person {:.2} m", room.stature);
    text
}

#[cfg(test)]
mod tests {
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
        let said = guessed(&some, &names).unwrap();
        assert!(said.contains("for door, yard:"), "{said}");
        let fov = |name: &str| some.of(name, [640, 480]).unwrap().fov_degrees().round();
        assert_eq!(names.map(fov), [60.0, 90.0, 60.0]);
        let none = guessed(&read(&[]), &names).unwrap();
        assert!(none.contains("for every camera:"), "{none}");
        for all in [&[""][..], &["door=", "hall=", "yard="]] {
            assert_eq!(guessed(&read(all), &names), None);
        }
    }

    #[test]
    fn a_view_that_contradicts_the_others_is_doubted() {
        let view = |far_percent| ViewQuality {
            name: "door".into(),
            sights: 100,
            rms_px: 12.0,
            held_out_rms_px: 12.0,
            far_percent,
            height_m: 2.0,
        };
        assert_eq!(doubt(&view(13.0)), None);
        let said = doubt(&view(20.0)).unwrap();
        assert!(said.contains("door") && said.contains("20 %"), "{said}");
    }
}

//! What to say of a room that is found, and of lenses that nobody told: why places or sizes may be wrong.

use std::ops::RangeInclusive;

use crate::calibrate::{Room, ViewQuality};
use crate::camera::DEFAULT_FOV;
use crate::commands::calibrate::{CalibrateArgs, ON_FLOOR, STATURES};

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
/// Statures by `--distance` of which nothing is said, metres: below are young children, above hardly anybody.
const USUAL_STATURES: RangeInclusive<f64> = 1.2..=2.2;

/// What to say of a room that is found.
pub fn doubts(args: &CalibrateArgs, room: &Room, is_by_clock: bool) -> Vec<String> {
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

/// What to say of cameras whose lens nobody told, of so many.
pub fn guessed(unknown: &[&str], cameras: usize) -> Option<String> {
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

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::commands::calibrate::lenses::Lenses;

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
}

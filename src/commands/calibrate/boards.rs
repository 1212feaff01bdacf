//! Lenses and places by pictures of a board.

use std::fmt::Write as _;
use std::path::PathBuf;

use super::lenses::{Lenses, folded};
use super::shots::{Picture, Pictures};
use super::{CalibrateArgs, ON_FLOOR, report, write};
use crate::board::Board;
use crate::calibrate::boards::{Rig, Shot, Shots, calibrate_by_board};
use crate::camera::{CameraFile, View};
use crate::capture::natural_order;
use crate::commands::exit::{self, Failure};
use crate::commands::say;
use crate::output;

/// A lens is only known as far out as boards reach; less than this share of the way to the corners is said.
const REACH: f64 = 0.75;

/// Calibrates by a board: one camera's lens, or lenses and places of several.
///
/// # Errors
/// When pictures do not tell lenses or places, after what was not used of them is said; where some could not be read,
/// after the result is written.
pub fn by_board(
    args: &CalibrateArgs,
    mut board: Board,
    files: &[(String, PathBuf)],
) -> anyhow::Result<()> {
    let several = files.len() > 1;
    check(args, &mut board, several)?;
    let lenses = Lenses::read(&args.lens, files)?;
    let mut notes = Vec::new();
    let found = Found::new(args, &board, files, &lenses, &mut notes);
    for note in &notes {
        say::err(note);
    }
    let Found {
        rig,
        cameras,
        are_whole,
    } = found?;
    if several {
        write(&args.out, &rig.views, &lenses)?;
    } else {
        let text = lens_file(&rig.views[0]).map_err(Failure::data)?;
        output::write(&args.out, text.as_bytes()).map_err(|e| Failure::output(&args.out, &e))?;
    }
    let told = report(&args.out, &table(&rig, &cameras, args.floor.is_some()));
    // The result is of what could be read; what is wrong with the rest has been said.
    match are_whole {
        true => told,
        false => Err(Failure::silent(exit::DATA).into()),
    }
}

/// Cameras by their pictures.
struct Found {
    rig: Rig,
    cameras: Vec<Shots>,
    /// Whether all pictures could be read.
    are_whole: bool,
}

impl Found {
    /// Looks at the pictures of all cameras, and calibrates these; `notes` gets what was not used, and why.
    fn new(
        args: &CalibrateArgs,
        board: &Board,
        files: &[(String, PathBuf)],
        lenses: &Lenses,
        notes: &mut Vec<String>,
    ) -> anyhow::Result<Self> {
        let mut read = Vec::new();
        for (name, file) in files {
            let pictures = Pictures::read(name, file, board)?;
            notes.extend(pictures.told(name));
            read.push((name.as_str(), pictures));
        }
        let mut moments: Vec<String> = read
            .iter()
            .flat_map(|(_, p)| p.found.iter().map(|p| p.moment.clone()))
            .collect();
        moments.sort_by(|a, b| natural_order(a, b).then_with(|| a.cmp(b)));
        moments.dedup();
        let number = |name: &String| moments.iter().position(|m| m == name);
        let floor = match &args.floor {
            Some(name) => Some(number(name).ok_or_else(|| no_floor(name, &moments[0], &read))?),
            None => None,
        };
        let mut cameras = Vec::new();
        for (name, pictures) in &read {
            let lens = match lenses.knows(name) {
                true => Some(lenses.of(name, pictures.size).map_err(Failure::data)?),
                false => None,
            };
            let shot = |p: &Picture| {
                Some(Shot {
                    moment: number(&p.moment)?,
                    corners: p.corners.clone(),
                })
            };
            cameras.push(Shots {
                name: (*name).to_owned(),
                size: pictures.size,
                lens,
                pictures: pictures.count,
                shots: pictures.found.iter().filter_map(shot).collect(),
            });
        }
        let rig = calibrate_by_board(&cameras, &moments, args.square.unwrap_or(1.0), floor)
            .map_err(|e| Failure::data(e.to_string()))?;
        notes.extend(doubts(&rig, &moments));
        if let Some(picture) = &args.floor {
            notes.extend(rig.views.iter().filter_map(|view| sunk(view, picture)));
        }
        Ok(Self {
            rig,
            cameras,
            are_whole: read.iter().all(|(_, pictures)| pictures.are_whole()),
        })
    }
}

/// Why no picture tells the floor that `--floor` names so; `other` is one that could.
fn no_floor(name: &str, other: &str, read: &[(&str, Pictures)]) -> Failure {
    let refused = read.iter().find_map(|(camera, pictures)| {
        let (_, reason) = pictures.refused.iter().find(|(m, _)| m == name)?;
        Some(format!("camera {camera}: {reason}"))
    });
    let lacking = || {
        read.iter().find_map(|(camera, pictures)| {
            let reason = pictures.lacks(name)?;
            Some(format!("camera {camera}: {reason}"))
        })
    };
    match refused.or_else(lacking) {
        Some(why) => Failure::data(format!(
            "expected the board in picture {name} of some camera, which --floor names, found it in none ({why}); take it again, or name another, such as {other}"
        )),
        None => Failure::usage(format!(
            "expected --floor to name a picture in which the board was found, such as {other}, found {name}"
        )),
    }
}

/// What to say of pictures that were put aside, and of lenses that are known in part.
fn doubts(rig: &Rig, moments: &[String]) -> Vec<String> {
    let mut notes = Vec::new();
    for (view, quality) in rig.views.iter().zip(&rig.quality) {
        for (moment, px) in &quality.aside {
            let why = match px {
                Some(px) => {
                    format!("corners are {px:.1} px from where the other pictures have them")
                }
                None => {
                    "the board shows its corners so nowhere; they may be another board's".into()
                }
            };
            notes.push(format!(
                "camera {}: not used: {}: {why}",
                view.name, moments[*moment]
            ));
        }
        notes.extend(folded(view));
        if quality.reach < REACH && quality.focal_error_px.is_some() {
            notes.push(format!(
                "camera {}: boards reach {:.0} % of the way from the middle to the corners of the picture; beyond, distortion is a guess",
                view.name,
                100.0 * quality.reach
            ));
        }
    }
    notes
}

/// What to say of a camera that came out a little below the board in `picture`, which tells the floor.
fn sunk(view: &View, picture: &str) -> Option<String> {
    let height = view.position.z;
    (height < -ON_FLOOR).then(|| {
        format!(
            "camera {}: found {:.2} m below the floor: in picture {picture} the board lay tilted; lay it flat on the floor, large in view of several cameras",
            view.name, -height
        )
    })
}

/// What of the command line does not go together.
fn check(args: &CalibrateArgs, board: &mut Board, several: bool) -> anyhow::Result<()> {
    if let (Some(marker), Some(square)) = (args.marker, args.square) {
        let Board::Charuco(marked) = board else {
            return Err(Failure::usage(format!(
                "expected a ChArUco board with --marker, found --board {board}; leave --marker out"
            ))
            .into());
        };
        if marker >= square {
            return Err(Failure::usage(format!(
                "expected markers smaller than squares, found --marker {marker} and --square {square}"
            ))
            .into());
        }
        marked.marker = marker / square;
    }
    if !several {
        if args.floor.is_some() {
            return Err(Failure::usage(
                "expected two or more --view with --floor, found one, of which only the lens is told",
            )
            .into());
        }
        if !args.lens.is_empty() {
            return Err(Failure::usage(
                "expected no --lens with one --view: the lens is what is looked for; leave it out",
            )
            .into());
        }
        return Ok(());
    }
    if args.square.is_none() {
        return Err(Failure::usage(
            "expected the side of the board's squares with several --view, found no --square; measure one and give metres, as in --square 0.025",
        )
        .into());
    }
    if board.looks_alike_turned() {
        return Err(Failure::usage(format!(
            "expected a board of an odd and an even number of corners with several --view, found {board}: two cameras cannot tell which way up it is; take another, or a ChArUco board"
        ))
        .into());
    }
    Ok(())
}

/// The text of a `camera.toml`, if it is one that is read again.
///
/// # Errors
/// One line when it would not be, of a lens that no picture shows as it is.
fn lens_file(view: &View) -> Result<String, String> {
    let lens = CameraFile::Calibrated {
        intrinsics: view.intrinsics(),
        width: view.size[0],
        height: view.size[1],
        distortion: view.distortion,
    };
    let text = toml::to_string(&lens).map_err(|e| e.to_string())?;
    CameraFile::parse(&text).map_err(|reason| {
        format!(
            "camera {}: {reason}; take more pictures of the board, tilted both ways and in the corners as well, none of them cropped",
            view.name
        )
    })?;
    Ok(text)
}

/// The report for people.
fn table(rig: &Rig, cameras: &[Shots], on_floor: bool) -> String {
    let mut text =
        "camera              pictures  used  rms px  held out px  focal px        degrees"
            .to_owned();
    text.push_str(if on_floor { "  height m\n" } else { "\n" });
    for ((view, q), camera) in rig.views.iter().zip(&rig.quality).zip(cameras) {
        let held_out = q
            .held_out_rms_px
            .map_or("-".into(), |px| format!("{px:.2}"));
        let error = q
            .focal_error_px
            .map_or(String::new(), |px| format!("± {px:.1}"));
        let half = f64::from(view.size[0]) / 2.0 / view.focal.x;
        let degrees = 2.0 * half.atan().to_degrees();
        let _ = write!(
            text,
            "{:<18}  {:>8}  {:>4}  {:>6.2}  {:>11}  {:>7.1} {:<7}  {:>6.1}",
            view.name, camera.pictures, q.used, q.rms_px, held_out, view.focal.x, error, degrees
        );
        if on_floor {
            let _ = write!(text, "  {:>8.2}", view.position.z);
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_below_the_board_s_plane_is_told_of() {
        let at = |z: f64| View {
            name: "low".into(),
            position: glam::DVec3::new(2.0, 0.0, z),
            ..View::barrel(-0.1)
        };
        for z in [1.5, 0.0, -0.003] {
            assert_eq!(sunk(&at(z), "floor"), None, "{z}");
        }
        let said = sunk(&at(-0.08), "first").unwrap();
        for word in ["camera low: found 0.08 m below", "picture first"] {
            assert!(said.contains(word), "{said}");
        }
    }

    #[test]
    fn a_lens_that_nobody_would_read_is_not_written() {
        let mut view = View {
            name: "door".into(),
            ..View::barrel(-0.1)
        };
        let text = lens_file(&view).unwrap();
        assert_eq!(
            CameraFile::parse(&text).unwrap().distortion(),
            view.distortion
        );
        view.centre.x = -30.0;
        let said = lens_file(&view).unwrap_err();
        assert!(said.contains("door") && said.contains("cx -30"), "{said}");
    }
}

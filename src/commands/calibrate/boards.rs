//! Lenses and places by pictures of a board.

use std::fmt::Write as _;
use std::path::PathBuf;

use super::lenses::{Lenses, folded};
use super::shots::Pictures;
use super::{CalibrateArgs, report, write};
use crate::board::Board;
use crate::calibrate::boards::{Rig, Shot, Shots, calibrate_by_board};
use crate::camera::{CameraFile, View};
use crate::capture::natural_order;
use crate::commands::exit::Failure;
use crate::commands::say;
use crate::output;

/// A lens is only known as far out as boards reach; less than this share of the way to the corners is said.
const REACH: f64 = 0.75;

/// Calibrates by a board: one camera's lens, or lenses and places of several.
///
/// # Errors
/// When pictures cannot be read, or do not tell lenses or places.
pub fn by_board(
    args: &CalibrateArgs,
    mut board: Board,
    files: &[(String, PathBuf)],
) -> anyhow::Result<()> {
    let several = files.len() > 1;
    check(args, &mut board, several)?;
    let lenses = Lenses::read(&args.lens, files)?;
    let mut notes = Vec::new();
    let mut read = Vec::new();
    for (name, file) in files {
        let pictures = Pictures::read(name, file, &board)?;
        notes.extend(pictures.told(name));
        read.push(pictures);
    }
    let mut moments: Vec<String> = read
        .iter()
        .flat_map(|p| p.found.iter().map(|p| p.moment.clone()))
        .collect();
    moments.sort_by(|a, b| natural_order(a, b).then_with(|| a.cmp(b)));
    moments.dedup();
    let number = |name: &String| moments.iter().position(|m| m == name);
    let floor = match &args.floor {
        Some(name) => Some(number(name).ok_or_else(|| {
            Failure::usage(format!(
                "expected --floor to name a picture in which the board was found, such as {}, found {name}",
                moments[0]
            ))
        })?),
        None => None,
    };
    let mut cameras = Vec::new();
    for ((name, _), pictures) in files.iter().zip(&read) {
        let lens = match lenses.knows(name) {
            true => Some(lenses.of(name, pictures.size).map_err(Failure::data)?),
            false => None,
        };
        let shot = |p: &super::shots::Picture| {
            Some(Shot {
                moment: number(&p.moment)?,
                corners: p.corners.clone(),
            })
        };
        cameras.push(Shots {
            name: name.clone(),
            size: pictures.size,
            lens,
            pictures: pictures.count,
            shots: pictures.found.iter().filter_map(shot).collect(),
        });
    }
    let rig = calibrate_by_board(&cameras, &moments, args.square.unwrap_or(1.0), floor)
        .map_err(|e| Failure::data(e.to_string()))?;
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
    for note in &notes {
        say::err(note);
    }
    if several {
        write(&args.out, &rig.views, &lenses)?;
    } else {
        let text = lens_file(&rig.views[0]).map_err(Failure::data)?;
        output::write(&args.out, text.as_bytes()).map_err(|e| Failure::output(&args.out, &e))?;
    }
    report(&args.out, &table(&rig, &cameras, floor.is_some()))
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

/// The text of a `camera.toml`.
fn lens_file(view: &View) -> Result<String, String> {
    let lens = CameraFile::Calibrated {
        intrinsics: view.intrinsics(),
        width: view.size[0],
        height: view.size[1],
        distortion: view.distortion,
    };
    toml::to_string(&lens).map_err(|e| e.to_string())
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

//! `edgecap calibrate`: what several cameras saw of people who walk about in, the cameras' places and directions out.

use std::fmt::Write as _;
use std::path::PathBuf;

use glam::{DMat3, DVec2, DVec3};

use super::exit::Failure;
use super::multiview::{named as one_named, told};
use super::say;
use super::view_file::{ViewFile, together};
use crate::calibrate::{CalibrateError, Room, Scale, calibrate as find};
use crate::camera::calibration::{self, write_pose2sim};
use crate::camera::{Brown, CameraFile, DEFAULT_FOV, View};
use crate::message::Intrinsics;
use crate::multiview::{Detections, Sight};
use crate::output;
use crate::record::CameraSource;

/// Options of `edgecap calibrate`.
#[derive(Debug, Clone, clap::Args)]
pub struct CalibrateArgs {
    /// What a camera saw of somebody who walked about: the JSON lines or record of 'infer', or a film; once for every
    /// camera, of the same time. A camera is called like its file, or CAMERA=FILE says how
    #[arg(long, value_name = "[CAMERA=]FILE", required = true)]
    pub view: Vec<String>,
    /// Lens of all cameras, or of one: a camera.toml, or a calibration of another program whose places are not believed
    /// [default: a field of view of 60 degrees]
    #[arg(long, value_name = "[CAMERA=]FILE")]
    pub lens: Vec<String>,
    /// Height of the tallest person in view, metres: it gives the room its size
    #[arg(long, value_name = "METRES", value_parser = stature)]
    pub stature: Option<f64>,
    /// Distance between two cameras, as in left,right=3.2; it gives the room its size, more exactly than a height
    #[arg(long, value_name = "A,B=METRES", conflicts_with = "stature")]
    pub distance: Option<String>,
    /// Frames a second [default: by the times in the files]
    #[arg(long, value_name = "RATE", value_parser = super::multiview::rate)]
    pub fps: Option<f64>,
    /// File to write, Pose2Sim's Calib.toml, as 'multiview' reads it
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

fn stature(text: &str) -> Result<f64, String> {
    let metres = text
        .parse()
        .map_err(|_| "expected metres, such as 1.78".to_owned())?;
    if (0.5..=2.6).contains(&metres) {
        Ok(metres)
    } else {
        Err("expected 0.5 to 2.6 metres".into())
    }
}

/// Runs the verb.
///
/// # Errors
/// When a file cannot be read, views do not go together, or too little was seen of anybody.
pub fn calibrate(args: CalibrateArgs) -> anyhow::Result<()> {
    let files = named(&args.view)?;
    if files.len() < 2 {
        return Err(Failure::usage(format!(
            "expected at least two --view, found {}",
            files.len()
        ))
        .into());
    }
    let lenses = Lenses::read(&args.lens, &files)?;
    let mut notes = Vec::new();
    if lenses.guessed {
        notes.push(format!(
            "no --lens: a field of view of {DEFAULT_FOV} degrees is taken for every camera; places are as far off as it is"
        ));
    }
    let mut seen = Vec::new();
    let mut views = Vec::new();
    for (name, file) in &files {
        let lens = |w: u32, h: u32| Ok(lenses.of(name, [w, h])?.intrinsics());
        let read = ViewFile::read(name, CameraSource::Given(&lens), file)?;
        views.push(lenses.of(name, read.size).map_err(Failure::data)?);
        seen.push(read);
    }
    let (rate, count) = together(args.fps, &seen, &mut notes)?;
    let scale = scale(&args, &views, &mut notes)?;
    let one = |k: usize, (view, file): (&View, &ViewFile)| -> Detections {
        file.frames[k].iter().map(|o| Sight::new(view, o)).collect()
    };
    let frames: Vec<Vec<Detections>> = (0..count)
        .map(|k| views.iter().zip(&seen).map(|pair| one(k, pair)).collect())
        .collect();
    let room = find(&views, &frames, rate, scale).map_err(refused)?;
    if !room.floor_by_feet {
        notes.push(
            "feet were in one place: the floor is level as people hold themselves; walk about for a slope".into(),
        );
    }
    for note in &notes {
        say::err(note);
    }
    output::write(&args.out, write_pose2sim(&room.views).as_bytes())
        .map_err(|e| Failure::output(&args.out, &e))?;
    say::out(table(&room).trim_end());
    Ok(())
}

fn refused(e: CalibrateError) -> anyhow::Error {
    Failure::data(e.to_string()).into()
}

/// Names and files of `NAME=FILE`, or of files that are called like their camera.
fn named(given: &[String]) -> anyhow::Result<Vec<(String, PathBuf)>> {
    let mut all: Vec<(String, PathBuf)> = Vec::new();
    for text in given {
        let (name, file) = one_named(text);
        if let Some((_, other)) = all.iter().find(|(n, _)| *n == name) {
            return Err(Failure::usage(format!(
                "expected every camera once, found {name} in {} and {}; name them by CAMERA=FILE",
                other.display(),
                file.display()
            ))
            .into());
        }
        all.push((name, file));
    }
    Ok(all)
}

/// What is known of lenses.
struct Lenses {
    /// For one camera, or for all.
    known: Vec<(Option<String>, Lens)>,
    guessed: bool,
}

enum Lens {
    File(CameraFile),
    Calibrated(Vec<View>, PathBuf),
}

impl Lenses {
    fn read(given: &[String], cameras: &[(String, PathBuf)]) -> anyhow::Result<Self> {
        let mut known = Vec::new();
        for text in given {
            let (camera, file) = match told(text) {
                Some((camera, file)) => (Some(camera), PathBuf::from(file)),
                None => (None, PathBuf::from(text)),
            };
            if let Some(camera) = camera
                && !cameras.iter().any(|(n, _)| n == camera)
            {
                return Err(Failure::usage(format!(
                    "expected one of the cameras in --lens {text}, found {camera}"
                ))
                .into());
            }
            // A file that is no camera.toml may be another program's calibration.
            let lens = match CameraFile::read(&file) {
                Ok(lens) => Lens::File(lens),
                Err(own) => match calibration::read(&file) {
                    Ok(calibration) => Lens::Calibrated(calibration.views, file),
                    Err(_) if file.extension().is_some_and(|e| e == "toml") => {
                        return Err(own.into());
                    }
                    Err(other) => return Err(other.into()),
                },
            };
            known.push((camera.map(ToOwned::to_owned), lens));
        }
        let guessed = known.is_empty();
        Ok(Self { known, guessed })
    }

    /// The camera without a place.
    fn of(&self, name: &str, size: [u32; 2]) -> Result<View, String> {
        let own = self.known.iter().find(|(n, _)| n.as_deref() == Some(name));
        let lens = own.or_else(|| self.known.iter().find(|(n, _)| n.is_none()));
        match lens.map(|(_, lens)| lens) {
            None if self.guessed => plain(name, size, &CameraFile::default()),
            None => Err(format!("expected a --lens for camera {name}, found none")),
            Some(Lens::File(file)) => plain(name, size, file),
            Some(Lens::Calibrated(views, path)) => {
                let own = views.iter().find(|v| v.name == name);
                let view = match (own, &views[..]) {
                    (Some(view), _) | (None, [view]) => view,
                    _ => {
                        return Err(format!(
                            "{}: expected camera {name}, found none of this name",
                            path.display()
                        ));
                    }
                };
                let fitting = view.for_pictures(size).ok_or_else(|| {
                    format!(
                        "{}: expected pictures of {}x{} pixels of camera {name}, found {}x{}",
                        path.display(),
                        view.size[0],
                        view.size[1],
                        size[0],
                        size[1]
                    )
                })?;
                Ok(View {
                    name: name.to_owned(),
                    rotation: DMat3::IDENTITY,
                    position: DVec3::ZERO,
                    ..fitting
                })
            }
        }
    }
}

fn plain(name: &str, size: [u32; 2], file: &CameraFile) -> Result<View, String> {
    let Intrinsics { fx, fy, cx, cy } = file.for_frame(size[0], size[1])?;
    Ok(View {
        name: name.to_owned(),
        size,
        focal: DVec2::new(fx.into(), fy.into()),
        centre: DVec2::new(cx.into(), cy.into()),
        distortion: Brown::default(),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    })
}

fn scale(args: &CalibrateArgs, views: &[View], notes: &mut Vec<String>) -> anyhow::Result<Scale> {
    if let Some(text) = &args.distance {
        let wrong = || {
            Failure::usage(format!(
                "expected two cameras and metres, as in {},{}=3.2, found --distance {text}",
                views[0].name, views[1].name
            ))
        };
        let (pair, metres) = text.rsplit_once('=').ok_or_else(wrong)?;
        let (a, b) = pair.split_once(',').ok_or_else(wrong)?;
        let number = |name: &str| views.iter().position(|v| v.name == name);
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

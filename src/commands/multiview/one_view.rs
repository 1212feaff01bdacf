//! One view alone: Stage III says who is who and about where, the mesh body is fitted to that and to what was seen.

use glam::{DMat3, DVec2, DVec3};

use super::MultiviewArgs;
use super::Sync;
use super::read::{Films, Scene};
use super::store::Store;
use super::sync::{OTHERWISE, no_times, on_machine_clock};
use crate::camera::{Brown, View, calibration};
use crate::commands::common_time::{Common, by_number, by_times};
use crate::commands::exit::Failure;
use crate::commands::fit_settings::fitter;
use crate::commands::view_file::{ViewFile, in_part, is_film};
use crate::commands::views::{named, no_such_camera, pictured, told};
use crate::multiview::{Detections, Sight, Track, one_view, stage_three, to_view};

/// Reads the view, and finds everyone in it.
///
/// # Errors
/// When the file cannot be read, or the calibration has no such camera.
pub fn scene(args: &MultiviewArgs, store: &Store) -> anyhow::Result<(Scene, Vec<Track>)> {
    if let Some(held) = args.hold_out.first() {
        return Err(Failure::usage(format!(
            "expected several views where one is held out, found --hold-out {held} and one --view"
        ))
        .into());
    }
    let (name, path) = named(&args.view[0]);
    let mut notes = Vec::new();
    let calibrated = match &args.calibration {
        None => None,
        Some(path) => {
            let calibration = calibration::read(path)?;
            let as_written = calibration.as_written(path);
            notes.extend(calibration.notes.into_iter().chain(as_written));
            let views = calibration.views;
            let own = views.iter().find(|v| v.name == name);
            // A file needs not be called like the only camera; a camera that is named has to be it.
            let is_named = told(&args.view[0]).is_some();
            let own = own.or(views.first().filter(|_| views.len() == 1 && !is_named));
            let view =
                own.ok_or_else(|| Failure::usage(no_such_camera(&views, "in --view", &name)))?;
            Some((view.clone(), path))
        }
    };
    let known = calibrated.as_ref().map(|(view, _)| view);
    let mut films = Films::default();
    let mut file = films.read(&name, known, &path, store)?;
    notes.extend(films.in_part.iter().map(|camera| in_part(camera)));
    if let Some(fps) = args.fps {
        file.at_rate(fps);
    }
    let view = match &calibrated {
        None => camera_axes(&file),
        Some((view, from)) => pictured(view, file.size, &from.display().to_string())?,
    };
    for people in &mut file.frames {
        to_view(&view, &file.intrinsics, people);
    }
    let is_whole = args.sync == Sync::None
        || !ViewFile::put_in_order(std::slice::from_mut(&mut file), &mut notes);
    let of_machine = on_machine_clock(&file);
    let is_in_order = file.is_in_order();
    let common = match args.sync {
        Sync::Auto | Sync::Times | Sync::Motion if file.tells_times() => {
            by_times(vec![file], &[0.0], OTHERWISE, &mut notes)?
        }
        Sync::Times | Sync::Motion if !is_in_order => return Err(no_times().into()),
        _ => {
            if args.sync == Sync::Auto && !is_in_order {
                notes.push(format!(
                    "camera {name}: its times do not tell when frames were taken; they go by number"
                ));
            }
            by_number(args.fps, vec![file], &mut notes)?
        }
    };
    let Common {
        mut people,
        times,
        numbers: pictures,
        rate,
        in_step,
    } = common;
    let people = people.swap_remove(0);
    let frames: Vec<Detections> = people
        .iter()
        .map(|people| people.iter().map(|o| Sight::new(&view, o)).collect())
        .collect();
    let seen = times.iter().copied().zip(people.iter().map(Vec::as_slice));
    let bodies = stage_three(&mut fitter(None, false)?, &view, seen);
    let tracks = one_view(&view, &bodies, &frames);
    let scene = Scene {
        views: vec![view],
        films: vec![is_film(&path).then_some(path)],
        are_whole: films.in_part.is_empty(),
        frames: frames.into_iter().map(|f| vec![f]).collect(),
        times,
        pictures,
        of_machine,
        rate,
        offsets: vec![None],
        // Masks are numbered by the file's own frames.
        in_step: in_step && is_whole,
        in_world: args.calibration.is_some(),
        notes,
    };
    Ok((scene, tracks))
}

/// The record's camera at the origin: the world's axes are the camera's.
fn camera_axes(file: &ViewFile) -> View {
    let i = file.intrinsics;
    View {
        name: file.name.clone(),
        size: file.size,
        focal: DVec2::new(i.fx.into(), i.fy.into()),
        centre: DVec2::new(i.cx.into(), i.cy.into()),
        distortion: Brown::default(),
        rotation: DMat3::IDENTITY,
        position: DVec3::ZERO,
    }
}

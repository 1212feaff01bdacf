//! Several cameras that see the same people: one process a camera sees pictures, one fits for all of them.

use std::path::Path;
use std::sync::Arc;

use super::RunArgs;
use super::cameras::{PROCESSES, checked, figures};
use super::live::{self, Plan};
use super::pulse::Pulse;
use super::taken;
use crate::camera::{CameraFile, View};
use crate::commands::fit::{FitTask, ROOM, choose_cameras};
use crate::commands::infer::InferTask;
use crate::commands::input::NamedInput;
use crate::commands::say;
use crate::commands::settings::FittingArgs;
use crate::commands::status::StatusFile;
use crate::commands::stop::Stop;
use crate::commands::table::Table;
use crate::config::Setting;
use crate::metrics::Meter;
use crate::supervise::ServiceManager;

/// Runs calibrated cameras, whose people are fitted as `fitting` says, until the user stops it or none goes on.
///
/// # Errors
/// Cameras that the calibration does not know; as [`live::run`].
pub fn run(
    runs: &[RunArgs],
    fitting: FittingArgs,
    calibration: &Path,
    stop: &Stop,
) -> anyhow::Result<()> {
    let chosen = runs
        .iter()
        .map(checked)
        .collect::<anyhow::Result<Vec<_>>>()?;
    let names: Vec<String> = chosen.iter().map(|c| c.name.clone()).collect();
    let views = choose_cameras(&names, calibration)?.views;
    let mut args = runs[0].clone();
    // What is said of results is said of the room: by all cameras, or by the first that does.
    if let Some(run) = runs.iter().find(|r| !r.record.is_empty()) {
        args.record = run.record.clone();
    }
    let name = args.multiview.room.clone();
    let plan = Plan {
        name: name.unwrap_or_else(|| ROOM.to_owned()),
        source: names.join(", "),
        stands_in: false,
        infers: runs
            .iter()
            .zip(&chosen)
            .zip(&views)
            .map(|((run, chosen), view)| (chosen.name.clone(), infer_task(run, chosen, view)))
            .collect(),
        fit: FitTask {
            name: args.multiview.room.clone(),
            cameras: names,
            calibration: Some(calibration.to_owned()),
            config: fitting.fit,
            stills: false,
            rate: fitting.rate,
            events: fitting.events,
        },
    };
    // Cameras whose names are taken are tried again, and the others go on without them.
    taken::expect_free_bodies(&plan.name)?;
    let slowest = runs.iter().map(|run| run.pace.interval()).max();
    let meter = Meter::new(&plan.name, &plan.source, &PROCESSES);
    let meter = Arc::new(meter.with_interval(slowest.unwrap_or_default()));
    let meters = vec![Arc::clone(&meter)];
    let _figures = figures(Some(&args), &meters)?;
    let page = args.bridges.serve(args.show_picture)?;
    if let Some(page) = &page {
        say::err(&format!("the page: {}", page.url()));
    }
    let hub = page.as_ref().map(|p| p.hub());
    let _status = StatusFile::keep(meters);
    let manager = ServiceManager::from_env([plan.name.as_str()]);
    let (table, pulse) = (Table::new(args.table), Pulse::new(&manager, 0));
    live::run(&args, plan, table, &meter, &pulse, hub, stop)
}

/// What a camera sees, with the calibration's lens where none is given.
fn infer_task(run: &RunArgs, chosen: &NamedInput, view: &View) -> InferTask {
    let mut task = run.infer_task(chosen);
    task.input
        .lens
        .get_or_insert_with(|| Setting::Given(lens(view)));
    task
}

/// The lens of a view. Where its calibration does not say for pictures of which size it is, how wide it sees is all
/// that can be told.
fn lens(view: &View) -> CameraFile {
    if view.size == [0; 2] {
        return CameraFile::Fov {
            degrees: view.fov_degrees().clamp(1.0, 179.0) as f32,
        };
    }
    CameraFile::Calibrated {
        intrinsics: view.intrinsics(),
        width: view.size[0],
        height: view.size[1],
        distortion: view.distortion,
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2, DVec3};

    use super::*;

    /// Lenses go to the process that sees pictures as text, which it checks.
    #[test]
    fn lenses_of_any_calibration_arrive() {
        for size in [[1280, 720], [0; 2]] {
            let view = View {
                name: "cam01".into(),
                size,
                focal: DVec2::splat(640.0),
                centre: DVec2::new(639.5, 359.5),
                distortion: Default::default(),
                rotation: DMat3::IDENTITY,
                position: DVec3::ZERO,
            };
            let sent = serde_json::to_string(&lens(&view)).unwrap();
            let arrived: CameraFile = serde_json::from_str(&sent).unwrap();
            assert!((arrived.fov_degrees() - 90.0).abs() < 0.2, "{arrived:?}");
            let of_picture = arrived.for_frame(1280, 720).unwrap();
            assert!((of_picture.fx - 640.0).abs() < 1.0, "{of_picture:?}");
        }
    }
}

//! Several cameras that see the same people: one process a camera sees pictures, one fits for all of them.

use std::path::Path;
use std::sync::Arc;

use super::RunArgs;
use super::cameras::{PROCESSES, figures};
use super::live::{self, Plan};
use super::pulse::Pulse;
use crate::camera::{CameraFile, View};
use crate::capture::Mounting;
use crate::commands::fit::numbers::Before;
use crate::commands::fit::{FitTask, ROOM};
use crate::commands::infer::InferTask;
use crate::commands::input::{CaptureSize, NamedInput};
use crate::commands::say;
use crate::commands::settings::{FittingArgs, expect_camera, expect_each_its_own};
use crate::commands::status::StatusFile;
use crate::commands::stop::Stop;
use crate::commands::table::Table;
use crate::commands::taken::{What, expect_free};
use crate::commands::views::choose;
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
        .map(expect_camera)
        .collect::<anyhow::Result<Vec<_>>>()?;
    expect_each_its_own(runs, &chosen)?;
    let names: Vec<String> = chosen.iter().map(|c| c.name.clone()).collect();
    let views = choose(&names, calibration)?.views;
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
        is_again: false,
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
            before: Before::default(),
        },
    };
    // Cameras whose names are taken are tried again, and the others go on without them: one that has the room's name,
    // too, and what is said under that is the camera's own.
    let of_room: &[What] = match plan.infers.iter().any(|(camera, _)| *camera == plan.name) {
        true => &[What::Bodies],
        false => &[What::Bodies, What::Health],
    };
    expect_free(&plan.name, of_room)?;
    let slowest = runs.iter().map(|run| run.pace.interval()).max();
    let meter = Meter::new(&plan.name, &plan.source, &PROCESSES);
    let meter = Arc::new(meter.with_interval(slowest.unwrap_or_default()));
    let meters = vec![Arc::clone(&meter)];
    let _figures = figures(Some(&args), &meters)?;
    let page = args.bridges.serve(args.show_picture)?;
    if let Some(page) = &page {
        say::err(&format!("the page: {}", page.url_for_log()));
    }
    let hub = page.as_ref().map(|p| p.hub());
    let _status = StatusFile::keep(meters);
    let manager = ServiceManager::from_env([plan.name.as_str()]);
    Stop::wake_when_children_end()?;
    let (table, pulse) = (Table::new(args.table), Pulse::new(&manager, 0));
    live::run(&args, plan, table, &meter, &pulse, hub, stop)
}

/// What a camera sees, at the size and with the lens of its calibration where none is given.
fn infer_task(run: &RunArgs, chosen: &NamedInput, view: &View) -> InferTask {
    let mut task = run.infer_task(chosen);
    let (lens, size) = own_lens(view, task.input.mounting());
    task.input.lens.get_or_insert(Setting::Given(lens));
    task.input.capture_size = task.input.capture_size.or(size);
    task
}

/// The lens of a camera's own pictures, given that of the upright ones, for which cameras are calibrated. With it comes
/// the size of the camera's own pictures. Where a calibration does not say for pictures of which size it is, how wide
/// it sees is all that can be told.
fn own_lens(upright: &View, mounting: Mounting) -> (CameraFile, Option<CaptureSize>) {
    let back = mounting.undoing();
    let [width, height] = upright.likely_size();
    let intrinsics = back.intrinsics(upright.intrinsics(), width, height);
    let (width, height) = back.size(width, height);
    if upright.size == [0; 2] {
        let half = (0.5 * width as f32 / intrinsics.fx.abs()).atan();
        let degrees = (2.0 * half).to_degrees().clamp(1.0, 179.0);
        return (CameraFile::Fov { degrees }, None);
    }
    let lens = CameraFile::Calibrated {
        intrinsics,
        width,
        height,
        distortion: back.distortion(upright.distortion),
    };
    (lens, format!("{width}x{height}").parse().ok())
}

#[cfg(test)]
mod tests {
    use edgecap_client::message::Intrinsics;

    use crate::camera::Brown;
    use glam::{DMat3, DVec2, DVec3};

    use super::*;
    use crate::commands::input;

    fn view(size: [u32; 2], lens: Intrinsics) -> View {
        View {
            name: "cam01".into(),
            size,
            focal: DVec2::new(lens.fx.into(), lens.fy.into()),
            centre: DVec2::new(lens.cx.into(), lens.cy.into()),
            distortion: Brown {
                radial: [-0.2, 0.05, 0.0],
                tangential: [0.003, -0.008],
            },
            rotation: DMat3::IDENTITY,
            position: DVec3::ZERO,
        }
    }

    /// What the process that sees pictures gets, which is text and is checked there.
    fn sent(run: &RunArgs, view: &View) -> InferTask {
        let mut run = run.clone();
        run.input.input = Some("stand-in:/nowhere".into());
        let chosen = input::choose(&run.input).unwrap();
        let text = serde_json::to_string(&infer_task(&run, &chosen, view)).unwrap();
        serde_json::from_str(&text).unwrap()
    }

    fn lens(task: InferTask) -> CameraFile {
        match task.input.lens {
            Some(Setting::Given(lens)) => lens,
            other => panic!("expected a lens, found {other:?}"),
        }
    }

    const LENS: Intrinsics = Intrinsics {
        fx: 640.0,
        fy: 650.0,
        cx: 620.0,
        cy: 350.0,
    };

    #[test]
    fn lenses_of_any_calibration_arrive() {
        let centred = Intrinsics {
            cx: 639.5,
            cy: 359.5,
            ..LENS
        };
        for size in [[1280, 720], [0; 2]] {
            let arrived = lens(sent(&RunArgs::default(), &view(size, centred)));
            assert!((arrived.fov_degrees() - 90.0).abs() < 0.2, "{arrived:?}");
            let of_picture = arrived.for_frame(1280, 720).unwrap();
            assert!((of_picture.fx - 640.0).abs() < 1.0, "{of_picture:?}");
        }
    }

    /// Calibrations are of upright pictures, and a lens is that of the camera's own.
    #[test]
    fn the_lens_of_a_camera_on_its_side_is_that_of_its_own_pictures() {
        for k in 0..8 {
            let mut run = RunArgs::default();
            run.input.rotate = Some(90 * (k % 4));
            run.input.mirror = k > 3;
            let mounting = run.input.mounting();
            let upright = mounting.intrinsics(LENS, 1280, 720);
            let upright = view(mounting.size(1280, 720).into(), upright);
            let task = sent(&run, &upright);
            let asked = task.input.capture_size.map(|s| s.to_string());
            assert_eq!(asked.as_deref(), Some("1280x720"), "{mounting:?}");
            let own = lens(task);
            let arrived = own.for_frame(1280, 720).unwrap();
            let [one, other] = [arrived, LENS].map(|i| [i.fx, i.fy, i.cx, i.cy]);
            for (one, other) in one.into_iter().zip(other) {
                assert!((one - other).abs() < 1e-2, "{mounting:?}: {arrived:?}");
            }
            // What is done to pictures is done to directions in them.
            let put_upright = |d: DVec2| {
                let mirrored = if mounting.mirrored { -d.x } else { d.x };
                let start = DVec2::new(mirrored, d.y);
                (0..mounting.quarter_turns).fold(start, |d, _| DVec2::new(-d.y, d.x))
            };
            let seen = DVec2::new(0.3, -0.2);
            let there = put_upright(own.distortion().distort(seen));
            let expected = upright.distortion.distort(put_upright(seen));
            assert!((there - expected).length() < 1e-9, "{mounting:?}");
            // Of an unknown size the camera's own width is told by its own focal length.
            let untold = View {
                size: [0; 2],
                ..upright
            };
            let half = (640.0_f32 / LENS.fx).atan().to_degrees();
            let found = lens(sent(&run, &untold)).fov_degrees();
            assert!((found - 2.0 * half).abs() < 3.0, "{mounting:?}: {found}");
        }
    }

    #[test]
    fn a_camera_is_asked_for_the_size_of_its_calibration() {
        let mut run = RunArgs::default();
        let asked = |run: &RunArgs, size| {
            let size = sent(run, &view(size, LENS)).input.capture_size;
            size.map(|s| s.to_string())
        };
        let large = asked(&run, [1920, 1080]);
        assert_eq!(large.as_deref(), Some("1920x1080"));
        assert_eq!(asked(&run, [0; 2]), None);
        run.input.capture_size = "640x360".parse().ok();
        let typed = asked(&run, [1920, 1080]);
        assert_eq!(typed.as_deref(), Some("640x360"));
    }
}

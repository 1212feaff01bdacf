//! `edgecap multiview`: several calibrated views of the same people in, bodies with shape, pose and mesh out.

mod background;
mod inputs;
mod masks;
mod one_view;
mod order;
mod read;
mod store;
mod sync;
mod write;

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use self::masks::MaskFolder;
use self::read::Scene;
use self::store::Store;
use self::sync::Sync;
use super::apart::Apart;
use super::exit::{self, Failure};
use super::export::Exports;
use super::progress;
use super::say;
use super::threads::ThreadsArgs;
use super::views::told;
use crate::body::mesh::MeshBody;
use crate::bounded;
use crate::camera::{View, calibration};
use crate::joints::{L_HIP, NECK, R_HIP};
use crate::multiview::{
    Detections, Masks, MultiviewOptions, Run, Step, fit, fit_tracks, matched, report,
};
pub(super) use read::expect_few;

/// The word for masks from films.
const BACKGROUND: &str = "background";

/// Options of `edgecap multiview`.
#[derive(Debug, Clone, clap::Args)]
pub struct MultiviewArgs {
    /// Calibration: Pose2Sim's or Anipose's Calib.toml, QTM's .qca.txt, OpenCV's .yml, or a folder of EasyMocap, COLMAP
    /// or one OpenCV file a camera; one view does without, its bodies are in camera axes
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// What a camera saw: the JSON lines or record of 'infer', or a film; once for every camera. Files are called like
    /// their camera, or CAMERA=FILE says which it is, or they come in the calibration's order
    #[arg(long, value_name = "[CAMERA=]FILE", required = true)]
    pub view: Vec<String>,
    /// Body model in SMPL's format (.npz) in place of the program's own
    #[arg(long, value_name = "FILE")]
    pub body: Option<PathBuf>,
    /// Do not smooth: every frame stands for itself
    #[arg(long)]
    pub no_dct: bool,
    /// Folder of who every pixel shows: CAMERA/000000.png and so on, one grey picture a frame, 0 where nobody is, one
    /// value a person; as 'synth --views --masks' makes them. 'background' (a folder of this name is ./background):
    /// what in films of cameras that stand still differs from where nobody is
    #[arg(long, value_name = "FOLDER|background")]
    pub masks: Option<PathBuf>,
    /// With --masks background: the film of a camera whose --view is a record of it, frame by frame; may be given for
    /// every camera
    #[arg(long, value_name = "CAMERA=FILE", requires = "masks")]
    pub film: Vec<String>,
    /// Measure a camera against the bodies that the others give, without using it; may be given several times
    #[arg(long, value_name = "CAMERA")]
    pub hold_out: Vec<String>,
    /// Frames whose meshes are written as OBJ, such as 0,25,50 or 'all'
    #[arg(long, value_name = "FRAMES")]
    pub obj: Option<String>,
    /// Frames a second [default: by the times in the files]
    #[arg(long, value_name = "RATE", value_parser = rate)]
    pub fps: Option<f64>,
    /// How views that were not started together are brought to one time
    #[arg(long, value_enum, default_value_t = Sync::Auto)]
    pub sync: Sync,
    /// Write the bodies as a file of another program, too, as 'edgecap export' does: .bvh, .glb, .trc, .csv, .npz or
    /// .svg; may be given several times
    #[arg(long, value_name = "FILE")]
    pub export: Vec<PathBuf>,
    /// New or empty folder for bodies.npz, bodies.jsonl, joints.trc, report.json and meshes. What is computed lies in
    /// its folder 'resume' until they are written: a run that was broken off goes on when the same is given again
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    #[command(flatten)]
    pub threads: ThreadsArgs,
}

/// Reads a rate.
///
/// # Errors
/// One line for anything that is none.
pub(super) fn rate(text: &str) -> Result<f64, String> {
    let rate = text
        .parse()
        .map_err(|_| "expected frames a second, such as 30".to_owned())?;
    if (0.1..=10_000.0).contains(&rate) {
        Ok(rate)
    } else {
        Err("expected 0.1 to 10000 frames a second".into())
    }
}

/// Runs the verb.
///
/// # Errors
/// When calibration, views or body cannot be read or do not go together, or when the folder cannot be written.
pub fn multiview(args: MultiviewArgs) -> anyhow::Result<()> {
    args.threads.run(|| fit_views(&args))
}

fn fit_views(args: &MultiviewArgs) -> anyhow::Result<()> {
    expect_few(args.view.len())?;
    write::expect_empty(&args.out)?;
    let chosen = write::frames(args.obj.as_deref())?;
    let exports = Exports::new(&args.export)?;
    apart(args).check()?;
    let own;
    let body = match &args.body {
        None => MeshBody::shipped(),
        Some(path) => {
            let bytes =
                bounded::read(path, bounded::DATA).map_err(|e| Failure::no_input(path, &e))?;
            let read = MeshBody::read(std::io::Cursor::new(bytes));
            own = read.map_err(|e| Failure::data(format!("{}: {e}", path.display())))?;
            &own
        }
    };
    let store = Store::open(&args.out, inputs::inputs(args))?;
    let (scene, alone) = if args.view.len() == 1 {
        let (scene, tracks) = one_view::scene(args, &store)?;
        (scene, Some(tracks))
    } else {
        let path = args.calibration.as_ref().ok_or_else(|| {
            Failure::usage(
                "expected --calibration for several views, found none; 'calibrate' makes one",
            )
        })?;
        (read::scene(args, calibration::read(path)?, &store)?, None)
    };
    for note in &scene.notes {
        say::err(note);
    }
    let (views, frames) = (&scene.views, &scene.frames);
    chosen.expect_within(frames.len())?;
    let used: Vec<bool> = views
        .iter()
        .map(|v| !args.hold_out.contains(&v.name))
        .collect();
    let options = MultiviewOptions {
        rate: scene.rate,
        paths: !args.no_dct,
        hierarchy: true,
    };
    let mut films = None;
    let mut folder = match &args.masks {
        Some(path) if path.as_os_str() == BACKGROUND => {
            films = Some(background::films(&args.film, &scene, &used)?);
            None
        }
        Some(path) => {
            if let Some(film) = args.film.first() {
                return Err(Failure::usage(format!(
                    "expected --masks background where --film {film} is given, found --masks {}",
                    path.display()
                ))
                .into());
            }
            Some(MaskFolder::open(path, &scene)?)
        }
        None => None,
    };
    store.begin()?;
    if let Some(films) = films {
        folder = Some(background::masks(&films, &scene, &store)?);
    }
    let read = |frame: usize, view: usize| folder.as_ref()?.mask(frame, view);
    let masks: Option<&Masks<'_>> = args.masks.is_some().then_some(&read);
    let bar = progress::bar(1, "steps");
    let [planned, restored, said] = [0, 0, 0].map(AtomicUsize::new);
    let progress = |step: Step| match step {
        Step::Planned(steps) => {
            planned.store(steps, Ordering::Relaxed);
            bar.set_length(steps as u64);
        }
        Step::Restored(steps) => {
            restored.fetch_add(steps, Ordering::Relaxed);
            bar.inc(steps as u64);
        }
        Step::Settled => {}
        Step::Placed | Step::Outlined | Step::Smoothed => {
            let before = restored.load(Ordering::Relaxed);
            if before > 0 && said.swap(1, Ordering::Relaxed) == 0 {
                let all = planned.load(Ordering::Relaxed);
                let line = format!("goes on: {before} of {all} steps of the fit were done before");
                bar.suspend(|| say::err(&line));
            }
            bar.inc(1);
        }
    };
    let run = Run {
        masks,
        progress: &progress,
        kept: &store,
    };
    let fitted = match alone {
        Some(tracks) => fit_tracks(body, views, vec![1.0], tracks, options, run),
        None => fit(body, views, &used, frames, options, run),
    };
    bar.finish_and_clear();
    // A mask that cannot be read counts as none: bodies are written all the same.
    let masked = folder.as_ref().map_or(Ok(()), MaskFolder::whole);
    // So they are of what could be read of a film; what is wrong with it has been said.
    let seen = match scene.are_whole {
        true => Ok(()),
        false => Err(Failure::silent(exit::DATA).into()),
    };
    if fitted.people.is_empty() {
        masked?;
        return Err(nobody(&scene, &used));
    }
    let other = |v: usize, f: usize, all: &[_]| matched(&views[v], &frames[f][v], all);
    let mut report = report(body, views, &fitted, frames.len(), scene.rate, &other);
    let unused = folder.iter().flat_map(|f| f.without_use(&report));
    let late: Vec<String> = unused
        .chain(write::crowded(&fitted))
        .chain(write::without_mesh(&fitted, &chosen))
        .collect();
    for note in &late {
        say::err(note);
    }
    report.notes = [&scene.notes[..], &late[..]].concat();
    for (line, offset) in report.views.iter_mut().zip(&scene.offsets) {
        line.offset_s = *offset;
    }
    for (v, line) in report.views.iter_mut().enumerate() {
        line.told = frames.iter().map(|f| f[v].len()).sum();
    }
    let take = write::run((&args.out, store), body, &scene, &fitted, &report, &chosen)?;
    let told = say::whole(&write::table(&report));
    let (lines, exported) = exports.write(&take);
    for line in lines {
        say::out(&line);
    }
    exported.and(masked).and(seen).and(told)
}

/// Results of its own that an export can have the name of.
const RESULTS: [&str; 3] = ["bodies.npz", "joints.trc", "meshes.glb"];

/// What is read and written; the folder for results is empty.
fn apart(args: &MultiviewArgs) -> Apart {
    let files = |all: &[String]| -> Vec<PathBuf> {
        let file = |given: &String| told(given).map_or(given.as_str(), |(_, path)| path).into();
        all.iter().map(file).collect()
    };
    let mut apart = Apart::default()
        .may_read("--calibration", args.calibration.as_deref())
        .may_read("--body", args.body.as_deref())
        .writes_exports(&args.export);
    for name in RESULTS {
        apart = apart.writes("--out", &args.out.join(name));
    }
    for (option, all) in [("--view", &args.view), ("--film", &args.film)] {
        for file in files(all) {
            apart = apart.reads(option, &file);
        }
    }
    apart
}

/// The greatest distance between two cameras, metres.
fn farthest(views: &[View]) -> f64 {
    let pairs = views.iter().enumerate();
    let apart = pairs.flat_map(|(k, a)| views[..k].iter().map(|b| a.position.distance(b.position)));
    apart.fold(0.0, f64::max)
}

/// Neck and hips: of somebody new they have to be known in space.
const TRUNK: [usize; 3] = [NECK, R_HIP, L_HIP];

/// Whether two of the `used` views see somebody in the same frame, and never every joint of a trunk, whoever's it is.
fn lacks_trunks(frames: &[Vec<Detections>], used: &[bool]) -> bool {
    let sees = |view: &Detections, j: usize| view.iter().any(|s| s.rays[j].is_some());
    let shown = |frame: &[Detections], by: &dyn Fn(&Detections) -> bool| {
        let views = frame.iter().zip(used).filter(|(_, used)| **used);
        views.filter(|(view, _)| by(view)).count() > 1
    };
    let is_whole = |frame: &[Detections]| {
        let mut joints = TRUNK.iter();
        joints.all(|j| shown(frame, &|view| sees(view, *j)))
    };
    let is_met = |frame: &[Detections]| shown(frame, &|view| !view.is_empty());
    frames.iter().any(|frame| is_met(frame)) && !frames.iter().any(|frame| is_whole(frame))
}

/// Why there is nothing to write.
fn nobody(scene: &Scene, used: &[bool]) -> anyhow::Error {
    let (views, frames) = (&scene.views, scene.frames.len());
    let wanted = match &views[..] {
        [view] => format!(
            "expected somebody in the view of camera {}, found nobody who stays in {frames} frames",
            view.name
        ),
        _ if lacks_trunks(&scene.frames, used) => format!(
            "expected somebody whose neck and hips two cameras see, found nobody in {frames} frames; turn or move cameras so that they show people down to the hips"
        ),
        _ => format!(
            "expected somebody whom two cameras see in the same place, found nobody in {frames} frames; check that views are of one moment, the calibration is theirs, and its unit the metre: by it cameras are up to {:.2} m apart",
            farthest(views)
        ),
    };
    Failure::data(wanted).into()
}

//! How well one view knows what the others see: several calibrated videos of one person, no other truth.
//!
//! ```text
//! cargo run --release --features mp4 --example multiview_check -- --calibration single/calibration/Calib.qca.txt \
//!     --videos single/videos [--model models/edgecap.ecm] [--program target/release/edgecap]
//! cargo run --release --example multiview_check -- --calibration Calib.qca.txt --observations cam01.jsonl cam02.jsonl cam03.jsonl cam04.jsonl
//! cargo run --release --example multiview_check -- --calibration Calib.qca.txt --observations … --truth other01.jsonl other02.jsonl other03.jsonl other04.jsonl
//! ```
//!
//! With `--videos` every view goes through `edgecap infer` with its own camera first; videos are named after the
//! calibration's cameras. The views but one are triangulated, reprojected into the one left out, and compared with that
//! view's own 2D and with the fit to that view alone; Stage II and Stage III against the triangulated joints in space.
//! With `--truth` another detector's 2D of all views (`tests/reference/blazepose.py`) takes the place of the others'
//! own.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use clap::Parser;
use edgecap::camera::View;
use edgecap::camera::calibration::read_qtm;
use edgecap::capture::{self, InputSpec, OpenOptions};
use edgecap::fit::{FitConfig, Fitter};
use edgecap::lab::eval::multiview::MultiviewCheck;
use edgecap::message::{BodyFrame, ObservationFrame};
use edgecap::record::{CameraSource, ObservationReader};

#[derive(Debug, Parser)]
struct Args {
    /// QTM calibration (.qca.txt).
    #[arg(long)]
    calibration: PathBuf,
    /// Folder of synchronised videos, one a camera, named like the calibration's cameras.
    #[arg(long, required_unless_present = "observations")]
    videos: Option<PathBuf>,
    /// What `infer --jsonl` wrote, one file a camera in the calibration's order.
    #[arg(long, num_args = 2.., conflicts_with = "videos")]
    observations: Vec<PathBuf>,
    /// What another detector saw, as lines of `infer --jsonl`, one file a camera in the calibration's order.
    #[arg(long, num_args = 2..)]
    truth: Vec<PathBuf>,
    /// Network for --videos [default: the program's own].
    #[arg(long)]
    model: Option<PathBuf>,
    /// The program that --videos runs.
    #[arg(long, default_value = "target/release/edgecap")]
    program: PathBuf,
    /// Pixels within which views must agree on a joint.
    #[arg(long, default_value_t = 25.0)]
    agree: f64,
}

/// What one view saw and what the fit made of it.
type Moment = (ObservationFrame, BodyFrame);

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let name = args.calibration.display().to_string();
    let text = std::fs::read_to_string(&args.calibration)
        .with_context(|| format!("cannot read {name}"))?;
    let views = read_qtm(&text, &name)?;
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let files = match &args.videos {
        Some(videos) => views
            .iter()
            .map(|v| infer(&args, v, videos, folder.path()))
            .collect::<anyhow::Result<Vec<_>>>()?,
        None => args.observations.clone(),
    };
    for (what, given) in [("observation", &files), ("truth", &args.truth)] {
        ensure!(
            given.len() == views.len() || what == "truth" && given.is_empty(),
            "expected one {what} file for each of the {} cameras of {name}, found {}",
            views.len(),
            given.len()
        );
    }
    let truth = views
        .iter()
        .zip(&args.truth)
        .map(|(view, file)| observed(view, file, |_| ()))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let (views, streams): (Vec<_>, Vec<_>) = views
        .iter()
        .zip(&files)
        .map(|(view, file)| fitted(view, file))
        .collect::<anyhow::Result<Vec<_>>>()?
        .into_iter()
        .unzip();
    let seen = streams.iter().map(|s| numbers(s));
    let all: Vec<_> = seen.chain(truth.iter().map(|(_, t)| numbers(t))).collect();
    let mut check = MultiviewCheck::new(views, args.agree);
    for places in common(&all) {
        let (own, theirs) = places.split_at(streams.len());
        let moment: Vec<_> = streams.iter().zip(own).map(|(s, k)| s[*k]).collect();
        if truth.is_empty() {
            check.add(&moment);
        } else {
            let truth = truth.iter().zip(theirs).map(|((_, t), k)| t[*k].0);
            check.add_against(&truth.collect::<Vec<_>>(), &moment);
        }
    }
    print!("{}", check.finish());
    Ok(())
}

/// The numbers of a view's frames, in order.
fn numbers<T>(stream: &[(ObservationFrame, T)]) -> Vec<u64> {
    stream.iter().map(|(seen, _)| seen.sequence).collect()
}

/// Of every frame that all views have the place in each: a view may lack frames, so that lines say nothing. Views have
/// frame numbers, in order of the file.
fn common(views: &[Vec<u64>]) -> Vec<Vec<usize>> {
    let places: Vec<HashMap<u64, usize>> = views
        .iter()
        .map(|numbers| numbers.iter().copied().zip(0..).collect())
        .collect();
    let first = views.first().into_iter().flatten();
    let everywhere = |number: &u64| places.iter().map(|p| p.get(number).copied()).collect();
    first.filter_map(everywhere).collect()
}

/// The view as its pictures show it.
fn pictured(view: &View, size: [u32; 2], pictures: &Path) -> anyhow::Result<View> {
    view.for_pictures(size).with_context(|| {
        let ([w, h], [found_w, found_h]) = (view.size, size);
        format!(
            "expected pictures of {w}x{h} pixels as {} is calibrated for, found {found_w}x{found_h} in {}",
            view.name,
            pictures.display()
        )
    })
}

/// Runs a view's video through the network and says where the observations are.
fn infer(args: &Args, view: &View, videos: &Path, folder: &Path) -> anyhow::Result<PathBuf> {
    let video = videos.join(format!("{}.mp4", view.name));
    let first = capture::open(&InputSpec::Path(video.clone()), &OpenOptions::default())?.next()?;
    let first = first.with_context(|| format!("no picture in {}", video.display()))?;
    let view = pictured(view, [first.width, first.height], &video)?;
    let camera = folder.join(format!("{}.toml", view.name));
    let lens = view.intrinsics();
    let mut file = File::create(&camera)?;
    writeln!(
        file,
        "fx = {}\nfy = {}\ncx = {}\ncy = {}\nwidth = {}\nheight = {}",
        lens.fx, lens.fy, lens.cx, lens.cy, view.size[0], view.size[1]
    )?;
    let out = folder.join(format!("{}.jsonl", view.name));
    let mut command = Command::new(&args.program);
    command.arg("infer").arg("--camera").arg(&camera);
    command.arg("--input").arg(video).arg("--jsonl").arg(&out);
    if let Some(model) = &args.model {
        command.arg("--model").arg(model);
    }
    let status = command
        .status()
        .with_context(|| format!("cannot run {}", args.program.display()))?;
    if !status.success() {
        bail!("{command:?} ended with {status}");
    }
    Ok(out)
}

/// A view as its pictures show it, and every frame with the fit to it alone.
fn fitted(view: &View, path: &Path) -> anyhow::Result<(View, Vec<Moment>)> {
    let mut fitter = Fitter::new(FitConfig::default())?;
    let mut bodies = BodyFrame::default();
    observed(view, path, |seen| {
        fitter.update(seen, &mut bodies);
        bodies
    })
}

/// A view as its pictures show it, and every frame with what `then` makes of it.
fn observed<T>(
    view: &View,
    path: &Path,
    mut then: impl FnMut(&ObservationFrame) -> T,
) -> anyhow::Result<(View, Vec<(ObservationFrame, T)>)> {
    let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    let intrinsics = view.intrinsics();
    let given = |_: u32, _: u32| Ok(intrinsics);
    let camera = CameraSource::Given(&given);
    let mut reader =
        ObservationReader::new(BufReader::new(file), path.display().to_string(), camera);
    let mut seen = ObservationFrame::default();
    let mut frames = Vec::new();
    let mut view = view.clone();
    while reader.read(&mut seen)? {
        let size = [seen.width, seen.height];
        if size != view.size {
            view = pictured(&view, size, path)?;
        }
        let made = then(&seen);
        frames.push((seen, made));
    }
    Ok((view, frames))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_one_number_go_together() {
        let views = [vec![0, 1, 2, 4], vec![1, 2, 3, 4], vec![0, 2, 4, 5]];
        assert_eq!(common(&views), [[2, 1, 1], [3, 3, 2]]);
        assert!(common(&[]).is_empty());
    }
}

//! Several cameras round one scene: films, their truth, their calibration, masks and observations in one folder.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use indicatif::ProgressBar;
use rayon::prelude::*;

use super::strip::{Room, render};
use super::{SynthArgs, expect_empty, jpeg, truth};
use crate::camera::calibration::write_pose2sim;
use crate::capture::AviWriter;
use crate::commands::exit::Failure;
use crate::lab::synth::TruthFrame;
use crate::lab::synth::detector::{Detector, Flaws};
use crate::lab::synth::shoot::Reel;
use crate::lab::synth::studio::{Studio, name};
use crate::lab::synth::survey::Survey;
use crate::lab::synth::world::{FORMAT, VERSION, WorldTruth};
use crate::output::AtomicFolder;
use crate::record::{Format, ObservationsRow, RecordWriter};

/// Writes the folder, which appears only when it is complete: all views as far as the film of one before has room.
pub(super) fn write(args: &SynthArgs, views: usize, out: &Path) -> anyhow::Result<()> {
    expect_empty(out)?;
    let size = (args.width, args.height);
    let (people, fps) = (args.people as usize, args.fps as f32);
    let studio = Studio::new(args.seed, size, views, people, args.frames, fps);
    let folder = AtomicFolder::create(out).map_err(|e| Failure::output(out, &e))?;
    let failed = |e: io::Error| Failure::output(out, &e);
    let at = |name: &str| folder.beside().join(name);
    std::fs::write(at("Calib.toml"), write_pose2sim(&studio.views())).map_err(failed)?;
    let shown = args.masks || !args.truth_only;
    if shown {
        studio.prepare();
    }
    let bar = ProgressBar::new(args.frames * views as u64);
    let (mut wanted, mut longest) = (args.frames, 0);
    let mut ended = Ok(());
    for view in 0..views {
        let camera = name(view);
        // Named also where it is not made: frame numbers of one camera's truth are no other one's.
        let clip = format!("{camera}.avi");
        let frames = if shown {
            let reel = Reel::of(studio.seen_by(view));
            let (frames, room) = film(args, folder.beside(), &camera, (&reel, wanted), &bar)?;
            ended = ended.and(room.ended(&out.join(&clip)));
            frames
        } else {
            let frames = (0..wanted).into_par_iter();
            frames.map(|k| studio.outline(view, k)).collect()
        };
        wanted = frames.len() as u64;
        longest = wanted.max(longest);
        if args.observed {
            let path = at(&format!("{camera}.jsonl"));
            observe(args, &path, (view, &clip), &frames)?;
        }
        let text = truth(args, Some(Path::new(&clip)), frames).to_text();
        std::fs::write(at(&format!("{camera}.truth.json")), text).map_err(failed)?;
    }
    let world = WorldTruth {
        format: FORMAT.to_owned(),
        version: VERSION,
        seed: args.seed,
        fps,
        frames: (0..longest).map(|k| studio.world(k)).collect(),
    };
    std::fs::write(at("world.json"), serde_json::to_vec(&world)?).map_err(failed)?;
    bar.finish_and_clear();
    folder.finish().map_err(failed)?;
    ended
}

/// One camera's film and masks, so many frames and as far as they are wanted, and the truth about them.
fn film(
    args: &SynthArgs,
    folder: &Path,
    camera: &str,
    (reel, wanted): (&Reel, u64),
    bar: &ProgressBar,
) -> anyhow::Result<(Vec<TruthFrame>, Room)> {
    let path = folder.join(format!("{camera}.avi"));
    let failed = |e: io::Error| Failure::output(&path, &e);
    let mut avi = if args.truth_only {
        None
    } else {
        let file = BufWriter::new(File::create(&path).map_err(failed)?);
        let rate = (args.fps, 1);
        Some(AviWriter::new(file, args.width, args.height, rate).map_err(failed)?)
    };
    let masks = folder.join("masks").join(camera);
    if args.masks {
        std::fs::create_dir_all(&masks).map_err(failed)?;
    }
    let ids: Vec<u8> = (1..=args.people as u8).collect();
    let mask_of = |k: u64| masks.join(format!("{k:06}.png"));
    let one = |k: u64| {
        let (picture, survey, known) = if args.truth_only {
            let (survey, known) = reel.survey(k);
            (Vec::new(), survey, known)
        } else {
            let shot = reel.shot(k);
            let picture = jpeg(&shot.frame, args.quality.unwrap_or(60))?;
            (picture, shot.picture.survey, shot.truth)
        };
        if args.masks {
            mask(args, &survey, &ids, &mask_of(k))?;
        }
        bar.inc(1);
        Ok((picture, known))
    };
    let (frames, room) = render(wanted, avi.as_mut(), one, failed)?;
    if let Some(avi) = avi {
        avi.finish().map_err(failed)?;
    }
    for k in room.beyond().filter(|_| args.masks) {
        std::fs::remove_file(mask_of(k)).map_err(failed)?;
    }
    Ok((frames, room))
}

fn mask(args: &SynthArgs, survey: &Survey, ids: &[u8], path: &Path) -> anyhow::Result<()> {
    let failed = |e: io::Error| Failure::output(path, &e);
    let mut file = BufWriter::new(File::create(path).map_err(failed)?);
    PngEncoder::new(&mut file).write_image(
        &survey.owners(ids),
        args.width,
        args.height,
        image::ExtendedColorType::L8,
    )?;
    file.flush().map_err(failed)?;
    Ok(())
}

/// Writes what a detector tells of a view.
fn observe(
    args: &SynthArgs,
    path: &Path,
    (view, clip): (usize, &str),
    frames: &[TruthFrame],
) -> anyhow::Result<()> {
    let seed = args.seed.wrapping_mul(64).wrapping_add(view as u64);
    let mut detector = Detector::new(Flaws::MEASURED, args.fps as f32, seed);
    let mut file = RecordWriter::<ObservationsRow>::create(path, Format::Jsonl)?;
    for frame in frames {
        file.write(&detector.observe(frame, [args.width, args.height]), clip)?;
    }
    file.finish()?;
    Ok(())
}

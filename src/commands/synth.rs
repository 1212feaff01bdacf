//! `edgecap synth`: renders synthetic people with exact truth.

use std::path::PathBuf;

use anyhow::Context;
use rayon::prelude::*;

use crate::capture::Frame;
use crate::synth::noise::Dice;
use crate::synth::render::Backdrop;
use crate::synth::truth::{FORMAT, VERSION};
use crate::synth::{Truth, TruthFrame, measure, render, sensor, stills};

/// Renders moving, overlapping people with exact truth about them.
#[derive(Debug, Clone, clap::Args)]
pub struct SynthArgs {
    /// Folder for the pictures and truth.json; must not exist or be empty.
    #[arg(long)]
    pub out: PathBuf,
    /// Number of frames.
    #[arg(long, default_value_t = 150)]
    pub frames: u64,
    /// People in the scene (with --stills: at most).
    #[arg(long, default_value_t = 4)]
    pub people: usize,
    /// Equal seeds give equal pictures.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Pixels across.
    #[arg(long, default_value_t = 512)]
    pub width: u32,
    /// Pixels down.
    #[arg(long, default_value_t = 320)]
    pub height: u32,
    /// Frames per second.
    #[arg(long, default_value_t = 15.0)]
    pub fps: f32,
    /// Every frame is an independent scene, for training and evaluation.
    #[arg(long)]
    pub stills: bool,
}

fn still(args: &SynthArgs, index: u64) -> (Frame, TruthFrame, u8) {
    let size = (args.width, args.height);
    let (scene, stances) = stills::still(args.seed, index, size, args.people);
    let backdrop = Backdrop::new(&scene);
    let picture = render::render(&scene, &backdrop, &stances);
    let truth = measure::measure(&scene, &stances, &picture, index, 0);
    let level = sensor::mean_level(&picture.light);
    let frame = sensor::develop(&picture.light, size, &scene.sensor, level, &mut Dice::new(scene.seed, index));
    (frame, truth, scene.sensor.quality)
}

/// Runs the verb.
pub fn synth(args: SynthArgs) -> anyhow::Result<()> {
    std::fs::create_dir_all(&args.out)?;
    let frames: Vec<TruthFrame> = (0..args.frames)
        .into_par_iter()
        .map(|k| -> anyhow::Result<TruthFrame> {
            let (frame, mut truth, quality) = still(&args, k);
            let name = format!("{k:06}.jpg");
            let mut bytes = Vec::new();
            image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality).encode(
                &frame.rgb, frame.width, frame.height, image::ExtendedColorType::Rgb8,
            )?;
            std::fs::write(args.out.join(&name), bytes).context("write")?;
            truth.file = Some(name);
            Ok(truth)
        })
        .collect::<anyhow::Result<_>>()?;
    let truth = Truth {
        format: FORMAT.to_owned(),
        version: VERSION,
        seed: args.seed,
        width: args.width,
        height: args.height,
        fps: 0.0,
        frames,
    };
    std::fs::write(args.out.join("truth.json"), truth.to_text())?;
    Ok(())
}

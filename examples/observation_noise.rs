//! What Stage I and II get wrong on synthetic pictures with exact truth: prints the statistics and the profile that
//! `tests/fit/scene` makes its observations by.
//!
//! ```text
//! edgecap synth --clip /tmp/noise/clip.avi --frames 600 --seed 3
//! edgecap infer --input /tmp/noise/clip.avi --jsonl /tmp/noise/observations.jsonl
//! cargo run --release --example observation_noise -- --observations /tmp/noise/observations.jsonl --truth /tmp/noise/clip.truth.json
//! ```
//!
//! Give the clip's true camera to `infer` (`--camera`) where Stage II's view matters; pixels are compared with the
//! truth's own.

use std::collections::HashMap;
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Parser;
use edgecap::lab::eval::{Noise, NoiseMeter};
use edgecap::lab::synth::Truth;
use edgecap::lab::synth::truth::TruthFrame;
use edgecap::message::ObservationFrame;
use edgecap::record::{CameraSource, ObservationReader};

#[derive(Debug, Parser)]
struct Args {
    /// What `infer --jsonl` wrote about a clip.
    #[arg(long)]
    observations: PathBuf,
    /// The clip's truth.json.
    #[arg(long)]
    truth: PathBuf,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let truth = Truth::load(&args.truth)?;
    if truth.fps <= 0.0 {
        bail!(
            "expected the truth of a clip, found that of stills in {}; make one with `edgecap synth --clip`",
            args.truth.display()
        );
    }
    let by_number: HashMap<u64, &TruthFrame> = truth.frames.iter().map(|f| (f.frame, f)).collect();
    let file = File::open(&args.observations)
        .with_context(|| format!("cannot read {}", args.observations.display()))?;
    let camera = CameraSource::Recorded { fov_degrees: 60.0 };
    let name = args.observations.display().to_string();
    let mut reader = ObservationReader::new(BufReader::new(file), name, camera);
    let mut frame = ObservationFrame::default();
    let mut meter = NoiseMeter::default();
    while reader.read(&mut frame)? {
        let Some(known) = by_number.get(&frame.sequence) else {
            bail!(
                "expected frames 0 to {}, found frame {} in {}; give the truth of the same clip",
                truth.frames.len().saturating_sub(1),
                frame.sequence,
                args.observations.display()
            );
        };
        meter.add(&frame, known);
    }
    let Some(noise) = meter.finish(f64::from(truth.fps)) else {
        bail!(
            "nobody in {} is near anybody of the truth: nothing to measure",
            args.observations.display()
        );
    };
    print(&noise, f64::from(truth.fps));
    Ok(())
}

/// `fps`: pictures a second of what was measured.
fn print(n: &Noise, fps: f64) {
    let [asked, found] = n.people;
    println!("people who could be seen           {asked}, found {found}");
    println!(
        "  away for more than 0.27 s        {:.1} %",
        100.0 * n.absent
    );
    for (name, s) in [("2D", &n.plane), ("3D where seen", &n.space)] {
        println!(
            "{name:<14} error per axis        {:.1} mm ({:.1} % of the stature): {:.1} slow (τ {:.2} s), {:.1} white",
            1e3 * s.whole(),
            100.0 * s.whole() / 1.7,
            1e3 * s.slow,
            s.time,
            1e3 * s.white
        );
    }
    let [seen, hidden] = n.space_mean;
    println!(
        "3D mean distance                   {:.1} mm seen, {:.1} mm hidden",
        1e3 * seen,
        1e3 * hidden
    );
    println!(
        "people who are not there            {:.2} a frame",
        n.phantom
    );
    println!("\nProfile for tests/fit/scene:\n");
    println!(
        "        slow2d: {:.4},\n        white2d: {:.4},",
        n.plane.slow, n.plane.white
    );
    println!("        time2d: {:.2},", n.plane.time);
    println!(
        "        slow3d: {:.4},\n        white3d: {:.4},",
        n.space.slow, n.space.white
    );
    println!("        time3d: {:.2},", n.space.time);
    println!("        hidden3d: {:.2},", hidden / seen);
    println!(
        "        miss: {:.4},\n        burst: {:.4},",
        n.miss, n.burst
    );
    println!(
        "        lost: {:.4},\n        outlier: {:.4},",
        n.lost, n.outlier
    );
    println!(
        "        hidden: {:.4},\n        swap: {:.4},",
        n.hidden, n.swap
    );
    println!("        phantom: {:.4},", n.phantom.min(1.0));
    println!("\nAnd for edgecap::lab::synth::detector::Flaws:\n");
    println!("        bias: [");
    for [left, up, forward] in n.bias {
        println!("            [{left:.4}, {up:.4}, {forward:.4}],");
    }
    println!("        ],");
    for (name, s) in [("plane", &n.plane), ("space", &n.space)] {
        println!(
            "        {name}: [{:.4}, {:.4}, {:.2}],",
            s.slow, s.white, s.time
        );
    }
    println!(
        "        lost: {:.4},\n        outlier: {:.4},",
        n.lost, n.outlier
    );
    println!("        miss: {:.4},", n.miss + fps / 6.0 * n.burst);
    println!("        exchanged: {:.4},", 0.5 * n.swap);
    println!("        exchanged_time: {:.2},", n.swap_time);
}

//! Our place in the comparison with other engines; `worker.py` is the peers'. One of
//!
//! - `contract NETWORK`: prints the metadata that random weights of a network need so that we import them;
//! - `quantise WEIGHTS NETWORK PICTURES HEIGHT WIDTH MODEL`: safetensors and pictures in (bytes, `[n, height, width,
//!   3]`), int8 model out;
//! - `worker MODEL NETWORK PRECISION THREADS HEIGHT WIDTH`: runs what it is told, one JSON per line, as `worker.py`
//!   says.

use std::io::{BufRead, Write};
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, bail};
use edgecap::engine::model::Calibration;
use edgecap::engine::{
    CalibrationOptions, Engine, EngineOptions, HEAD2D_CHANNELS, HEAD3D_CHANNELS, Model, Network,
    Precision,
};
use serde_json::{Value, json};

fn main() -> anyhow::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match args[..] {
        ["contract", network] => contract(network),
        ["quantise", weights, network, pictures, height, width, to] => quantise(
            weights,
            network,
            pictures,
            (width.parse()?, height.parse()?),
            to,
        ),
        ["worker", model, network, precision, threads, height, width] => {
            let start = Instant::now();
            let options = EngineOptions {
                width: width.parse()?,
                height: height.parse()?,
                threads: threads.parse()?,
                precision: match precision {
                    "int8" => Precision::Int8,
                    "f32" => Precision::F32,
                    other => bail!("expected int8 or f32, found {other}"),
                },
                ..EngineOptions::default()
            };
            let model = Model::open_any(Path::new(model), Network::shipped(network)?)?;
            let engine = Engine::new(&model, options)?;
            drop(model);
            worker(engine, start)
        }
        _ => bail!(
            "expected contract, quantise or worker with their arguments, found {args:?}; see the head of ours.rs"
        ),
    }
}

fn contract(network: &str) -> anyhow::Result<()> {
    let model = Model::random(Network::shipped(network)?, 0);
    println!("{}", serde_json::to_string(model.contract())?);
    Ok(())
}

fn quantise(
    weights: &str,
    network: &str,
    pictures: &str,
    size: (usize, usize),
    to: &str,
) -> anyhow::Result<()> {
    let model = Model::open_any(Path::new(weights), Network::shipped(network)?)?;
    let bytes = std::fs::read(pictures).with_context(|| pictures.to_owned())?;
    let pictures = bytes.chunks_exact(3 * size.0 * size.1).map(<[u8]>::to_vec);
    let options = CalibrationOptions {
        size,
        ..CalibrationOptions::default()
    };
    let calibration = Calibration::observe(&model, pictures, options)?;
    Ok(model.quantise(Some(&calibration))?.save(Path::new(to))?)
}

fn worker(mut engine: Engine, start: Instant) -> anyhow::Result<()> {
    let EngineOptions { width, height, .. } = *engine.options();
    let mut picture: Vec<u8> = (0..3 * width * height)
        .map(|i| (i * 31 % 251) as u8)
        .collect();
    engine.run(&picture);
    say(&json!({ "ready": {
        "version": env!("CARGO_PKG_VERSION"),
        "note": format!("kernels {}", engine.isa()),
        "first_ms": start.elapsed().as_secs_f64() * 1e3,
    }}))?;
    for line in std::io::stdin().lock().lines() {
        let ask: Value = serde_json::from_str(&line?)?;
        if let Some(runs) = ask["run"].as_u64() {
            let (mut ms, mut cpu_ms) = (Vec::new(), Vec::new());
            for _ in 0..runs {
                let (wall, processor) = (Instant::now(), processor_ms());
                engine.run(&picture);
                ms.push(wall.elapsed().as_secs_f64() * 1e3);
                cpu_ms.push(processor_ms() - processor);
            }
            say(&json!({ "ms": ms, "cpu_ms": cpu_ms, "peak_mb": peak_mb() }))?;
        } else if let (Some(from), Some(to)) = (ask["maps"].as_str(), ask["to"].as_str()) {
            let bytes = std::fs::read(from).with_context(|| from.to_owned())?;
            let mut out = Vec::new();
            for p in bytes.chunks_exact(picture.len()) {
                picture.copy_from_slice(p);
                let maps = engine.run(&picture);
                let cells = maps.head2d.chunks_exact(HEAD2D_CHANNELS);
                for (a, b) in cells.zip(maps.head3d.chunks_exact(HEAD3D_CHANNELS)) {
                    out.extend(a.iter().chain(b).flat_map(|v| v.to_le_bytes()));
                }
            }
            std::fs::write(to, out).with_context(|| to.to_owned())?;
            say(&json!({ "maps": bytes.len() / picture.len() }))?;
        } else {
            bail!("expected run or maps, found {ask}");
        }
    }
    Ok(())
}

fn say(value: &Value) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{value}")?;
    Ok(out.flush()?)
}

/// Processor time of all threads so far, milliseconds.
fn processor_ms() -> f64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 / 1e6
}

/// Peak resident memory so far, megabytes of 2²⁰ bytes.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib / 1024.0)
}

//! Subjects and options go in, the [`Certificate`] comes out.

use std::time::Duration;

use edgecap_kernels::{ConvShape, Isa, KernelError};

use super::sample::{Samples, quantile};
use super::subject::{Subject, picture};
use super::{Certificate, LayerTime, Machine, NetworkSpeed, Ratio, peak, people};
use crate::engine::{Engine, EngineError, EngineOptions, Maps, Precision, trim_memory};
use crate::lift::LiftError;
use crate::machine::{peak_memory_mb, reset_peak_memory};

/// Numbers of people for the stages after the network.
const CROWDS: [usize; 4] = [1, 5, 10, 20];
/// Every network's time is spent in this many turns, so that a slow minute of the machine falls on all of them.
const TURNS: u32 = 4;
/// Runs of the layer table.
const LAYER_RUNS: usize = 15;
const PRECISIONS: [(Precision, &str); 2] = [(Precision::Int8, "int8"), (Precision::F32, "f32")];

/// What to measure.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchOptions {
    /// Network input, pixels across and down; multiples of 16.
    pub size: (usize, usize),
    /// Numbers of threads.
    pub threads: Vec<usize>,
    /// Time for each network, precision and number of threads.
    pub time: Duration,
    /// Time of every layer too.
    pub layers: bool,
}

/// A certificate cannot be made. The words are those of the cause, which stays in the chain of errors: it has an exit
/// code of its own.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// An engine refuses.
    #[error("{0}")]
    Engine(#[from] EngineError),
    /// The machine's peak cannot be measured.
    #[error("{0}")]
    Kernel(#[from] KernelError),
    /// Stage II refuses.
    #[error("{0}")]
    Lift(#[from] LiftError),
}

/// Measures everything; `progress` is told what comes next.
///
/// # Errors
/// When an engine cannot be built at this size.
pub fn certify(
    subjects: &[Subject],
    options: &BenchOptions,
    mut progress: impl FnMut(&str),
) -> Result<Certificate, BenchError> {
    let isa = Isa::detect().map_err(EngineError::from)?;
    let mut c = Certificate {
        version: crate::BUILD,
        machine: Machine::here(isa),
        size: options.size,
        peaks: Vec::new(),
        networks: Vec::new(),
        ratios: Vec::new(),
        people: Vec::new(),
        left_out: Vec::new(),
    };
    for &threads in &options.threads {
        progress(&format!("peak of the machine, {threads} threads"));
        c.peaks.push(peak::measure(isa, threads)?);
        let speeds = networks(subjects, options, (threads, c.machine.cores), &mut progress)?;
        c.networks.extend(speeds);
    }
    set_shares(&mut c);
    c.ratios = ratios(&c.networks);
    let (width, height) = options.size;
    let cells = (width / Maps::STRIDE, height / Maps::STRIDE);
    for count in CROWDS {
        progress(&format!("{count} people"));
        match people::speed(count, cells, isa, options.time / 8)? {
            Some(speed) => c.people.push(speed),
            None => c.left_out.push(count),
        }
    }
    Ok(c)
}

/// One engine under measurement.
struct Entry {
    engine: Engine,
    samples: Samples,
    speed: NetworkSpeed,
}

/// All networks and precisions with the same number of threads, turn by turn.
fn networks(
    subjects: &[Subject],
    options: &BenchOptions,
    (threads, cores): (usize, usize),
    progress: &mut impl FnMut(&str),
) -> Result<Vec<NetworkSpeed>, BenchError> {
    let picture = picture(options.size);
    let mut entries = Vec::new();
    for subject in subjects {
        for precision in PRECISIONS {
            entries.push(entry(subject, precision, options, threads, &picture)?);
        }
    }
    for turn in 1..=TURNS {
        for e in &mut entries {
            let s = &e.speed;
            progress(&format!(
                "{} {}, {threads} threads, turn {turn} of {TURNS}",
                s.network, s.precision
            ));
            // The first run of a turn finds the caches full of the turn before.
            e.engine.run(&picture);
            let run = || {
                e.engine.run(&picture);
            };
            e.samples.add(options.time / TURNS, 1, run);
        }
    }
    let finish = |mut e: Entry| {
        let s = &mut e.speed;
        s.timing = e.samples.timing();
        s.processor_ms = e.samples.processor_ms();
        // More threads than cores take turns.
        s.busy = e.samples.busy(threads.min(cores));
        s.fps = 1e3 / s.timing.median_ms;
        s.gmacs = s.gmac * s.fps;
        if options.layers {
            s.layers = layers(&mut e.engine, &picture);
        }
        e.speed
    };
    Ok(entries.into_iter().map(finish).collect())
}

fn entry(
    subject: &Subject,
    (precision, name): (Precision, &'static str),
    options: &BenchOptions,
    threads: usize,
    picture: &[u8],
) -> Result<Entry, BenchError> {
    let engine_options = EngineOptions {
        width: options.size.0,
        height: options.size.1,
        threads,
        precision,
        ..EngineOptions::default()
    };
    // The allocator keeps what others freed, and an engine built of that would seem to need nothing. Not all of it can
    // be given back: only engines of the first number of threads show what they need.
    let before = if threads == options.threads[0] {
        trim_memory();
        reset_peak_memory()
    } else {
        None
    };
    let mut engine = Engine::new(&subject.model, engine_options)?;
    engine.run(picture);
    let memory_mb = peak_memory_mb()
        .zip(before)
        .map(|(peak, before)| peak - before);
    let speed = NetworkSpeed {
        network: subject.name().to_owned(),
        weights: subject.weights.clone(),
        precision: name,
        threads: engine.threads(),
        timing: Samples::default().timing(),
        fps: 0.0,
        gmac: engine.macs() as f64 / 1e9,
        gmacs: 0.0,
        saved: saved(engine.macs(), engine.executed_macs()),
        utilisation: None,
        processor_ms: 0.0,
        busy: 0.0,
        memory_mb,
        activation_bytes: engine.activation_bytes(),
        layers: Vec::new(),
    };
    Ok(Entry {
        engine,
        samples: Samples::default(),
        speed,
    })
}

/// Median time of every layer over some runs.
fn layers(engine: &mut Engine, picture: &[u8]) -> Vec<LayerTime> {
    let mut runs = Vec::new();
    for _ in 0..LAYER_RUNS {
        engine.run(picture);
        runs.push(engine.profile());
    }
    let layer = |(i, l): (usize, &crate::engine::LayerProfile)| {
        let mut ms: Vec<f64> = runs.iter().map(|r| r[i].ns as f64 / 1e6).collect();
        ms.sort_by(f64::total_cmp);
        let ms = quantile(&ms, 0.5);
        LayerTime {
            name: l.name.clone(),
            kernel: l.kernel.to_string(),
            shape: l.shape.as_ref().map_or_else(|| "pool".into(), shape),
            output: l.output,
            ms,
            gmacs: l.macs as f64 / 1e6 / ms.max(1e-9),
            saved: saved(l.macs, l.work),
            utilisation: None,
        }
    };
    runs[0].iter().enumerate().map(layer).collect()
}

/// A convolution in short.
fn shape(s: &ConvShape) -> String {
    let mut text = format!(
        "{}→{} {k}x{k}",
        s.in_channels(),
        s.out_channels(),
        k = s.kernel()
    );
    if s.stride() != 1 {
        text += &format!(" s{}", s.stride());
    }
    if s.groups() != 1 {
        text += &format!(" g{}", s.groups());
    }
    if s.transposed() {
        text += " transposed";
    }
    text
}

/// The share of `macs` that is not executed, below 0 where more is; of none (pooling) nothing is saved.
fn saved(macs: u64, executed: u64) -> f64 {
    (macs as f64 - executed as f64) / macs.max(1) as f64
}

fn set_shares(c: &mut Certificate) {
    let mut networks = std::mem::take(&mut c.networks);
    for n in &mut networks {
        let peak = c.peak(n.precision, n.threads);
        let share = |gmacs: f64, saved: f64| peak.map(|p| (gmacs * (1.0 - saved) / p).min(1.0));
        n.utilisation = share(n.gmacs, n.saved);
        for l in n.layers.iter_mut().filter(|l| l.gmacs > 0.0) {
            l.utilisation = share(l.gmacs, l.saved);
        }
    }
    c.networks = networks;
}

/// ResNet-50 over SelecSLS wherever both were measured alike.
fn ratios(networks: &[NetworkSpeed]) -> Vec<Ratio> {
    let of = |name: &'static str| networks.iter().filter(move |n| n.network == name);
    let pair = |s: &NetworkSpeed| {
        let alike = |r: &&NetworkSpeed| (r.precision, r.threads) == (s.precision, s.threads);
        let r = of("resnet50").find(alike)?;
        Some(Ratio {
            precision: s.precision,
            threads: s.threads,
            resnet50_over_selecsls: r.timing.median_ms / s.timing.median_ms,
        })
    };
    of("selecsls").filter_map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::saved;

    #[test]
    fn pooling_saves_nothing_and_tiles_beyond_the_edge_cost() {
        assert_eq!(saved(0, 0), 0.0);
        assert_eq!(saved(200, 100), 0.5);
        assert_eq!(saved(100, 150), -0.5);
    }
}

//! What was measured, in the order of the report.

use serde::Serialize;

use super::Machine;

/// Everything that one `edgecap bench` found out.
#[derive(Debug, Clone, Serialize)]
pub struct Certificate {
    /// Which build of the program ([`crate::BUILD`]).
    pub version: &'static str,
    /// Where it ran.
    pub machine: Machine,
    /// Network input, pixels across and down.
    pub size: (usize, usize),
    /// What the machine can do at most, per number of threads.
    pub peaks: Vec<PeakSpeed>,
    /// The networks, as measured.
    pub networks: Vec<NetworkSpeed>,
    /// ResNet-50 over SelecSLS, per precision and number of threads.
    pub ratios: Vec<Ratio>,
    /// What comes after Stage I.
    pub people: Vec<PeopleSpeed>,
    /// Numbers of people that were left out of it, because that many cannot be told apart in a picture of this size.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<usize>,
}

/// The greatest speed seen of multiply-accumulate chains that read only registers, giga-MAC per second, all threads
/// together.
#[derive(Debug, Clone, Serialize)]
pub struct PeakSpeed {
    /// Threads at work at once.
    pub threads: usize,
    /// int8 products, i32 sums.
    pub int8_gmacs: f64,
    /// f32 fused multiply-add.
    pub f32_gmacs: f64,
}

/// Distribution of one measurement, milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Timing {
    /// Half of the runs took longer.
    pub median_ms: f64,
    /// One run in a hundred took longer; with fewer runs, the longest.
    pub p99_ms: f64,
    /// Runs.
    pub runs: usize,
}

/// One network, precision and number of threads.
#[derive(Debug, Clone, Serialize)]
pub struct NetworkSpeed {
    /// Its name.
    pub network: String,
    /// Where the weights come from.
    pub weights: String,
    /// `int8` or `f32`.
    pub precision: &'static str,
    /// Threads.
    pub threads: usize,
    /// Time of one picture.
    #[serde(flatten)]
    pub timing: Timing,
    /// Pictures per second at the median.
    pub fps: f64,
    /// Giga multiply-accumulates of one picture, as a direct convolution counts them.
    pub gmac: f64,
    /// Giga-MAC per second at the median.
    pub gmacs: f64,
    /// Which share of them algorithms save.
    pub saved: f64,
    /// What is executed per second as a share of the measured peak of the same precision and number of threads, at
    /// most 1.
    pub utilisation: Option<f64>,
    /// Mean processor time of one picture, all threads together, milliseconds; other programs disturb it less than the
    /// median.
    pub processor_ms: f64,
    /// Processor time over wall time and threads, those alone for which there is a core: well under 1 means that other
    /// programs had the cores.
    pub busy: f64,
    /// By how much the process's resident memory rose at most while this engine was built and ran, MB of 10⁶ bytes;
    /// measured with the first number of threads only.
    pub memory_mb: Option<f64>,
    /// Bytes of activation buffers.
    pub activation_bytes: usize,
    /// Time of every layer, where asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub layers: Vec<LayerTime>,
}

/// One layer of a network.
#[derive(Debug, Clone, Serialize)]
pub struct LayerTime {
    /// Its name.
    pub name: String,
    /// The kernel that computes it.
    pub kernel: String,
    /// Geometry in short, e.g. `128→64 3x3 g2`.
    pub shape: String,
    /// Output rows and columns.
    pub output: (usize, usize),
    /// Median time, milliseconds.
    pub ms: f64,
    /// Giga-MAC per second, as a direct convolution counts them.
    pub gmacs: f64,
    /// Which share of them the algorithm saves.
    pub saved: f64,
    /// What is executed per second as a share of the peak, at most 1.
    pub utilisation: Option<f64>,
}

/// How much longer the baseline takes than SelecSLS.
#[derive(Debug, Clone, Serialize)]
pub struct Ratio {
    /// `int8` or `f32`.
    pub precision: &'static str,
    /// Threads.
    pub threads: usize,
    /// Median of ResNet-50 over median of SelecSLS.
    pub resnet50_over_selecsls: f64,
}

/// Association and Stage II on one thread.
#[derive(Debug, Clone, Serialize)]
pub struct PeopleSpeed {
    /// People in the maps, all of whom were found.
    pub people: usize,
    /// Maps to people.
    pub association: Timing,
    /// People to full 3D, with the colours of their torsos in a picture as a camera takes it.
    pub stage2: Timing,
}

impl Certificate {
    /// The paper's figure for a CPU, XNect §6.3.
    pub const PAPER_RATIO: f64 = 1.8;

    /// The peak measured with `threads` threads, giga-MAC per second.
    pub fn peak(&self, precision: &str, threads: usize) -> Option<f64> {
        let p = self.peaks.iter().find(|p| p.threads == threads)?;
        Some(if precision == "int8" {
            p.int8_gmacs
        } else {
            p.f32_gmacs
        })
    }
}

//! Float convolutions and activation ranges go in, int8 convolutions come out.
//!
//! Weights: per output channel, symmetric, ±127, of the weights already multiplied by the scale of the activation that
//! each input channel carries; so every channel, and every slice of a concatenation, keeps its own scale at no cost.
//! Activations: 7 bits, zero point 0 after ReLU.

use super::FloatConv;
use super::contract::ACTIVATION_LEVELS;
use crate::engine::network::{Node, Op};

/// Greatest weight.
const WEIGHT_MAX: f32 = 127.0;

/// Weights and bias of one int8 convolution. `real = scale[o] * (Σ weight * q + …)`, `q` the stored activations.
#[derive(Debug, Clone, PartialEq)]
pub struct QuantConv {
    /// `[out_channels, in_channels / groups, kernel, kernel]`, ±127.
    pub weight: Vec<i8>,
    /// `[out_channels]`, real units per step of the accumulator.
    pub scale: Vec<f32>,
    /// `[out_channels]`, real units.
    pub bias: Vec<f32>,
}

/// How a value of the network is stored in int8: channel c of it is `steps[c] * (q - zero)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    /// Real units per step, of every channel.
    pub steps: Vec<f32>,
    /// Stored number of real 0; need not be whole.
    pub zero: f32,
}

/// Steps above zero of a signed value, which is stored around the middle of 0..=127.
pub(super) const SIGNED_LEVELS: u32 = 63;

impl Scale {
    /// The picture's bytes: x / 255 - 0.5.
    pub fn picture() -> Self {
        Self {
            steps: vec![1.0 / 255.0; 3],
            zero: 127.5,
        }
    }

    /// Channels in 0..=range.
    pub fn unsigned(ranges: &[f32]) -> Self {
        Self {
            steps: ranges
                .iter()
                .map(|r| r / ACTIVATION_LEVELS as f32)
                .collect(),
            zero: 0.0,
        }
    }

    /// Channels in ±range (a convolution without ReLU that a residual sum reads).
    pub fn signed(ranges: &[f32]) -> Self {
        Self {
            steps: ranges.iter().map(|r| r / SIGNED_LEVELS as f32).collect(),
            zero: SIGNED_LEVELS as f32 + 1.0,
        }
    }

    /// The stored number of real 0, which halos hold.
    pub fn padding(&self) -> u8 {
        self.zero.round() as u8
    }
}

/// (step, zero) of every channel that goes into `node`, in order.
pub(crate) fn input_scales<'a>(
    node: &'a Node,
    scales: &'a [Option<Scale>],
) -> impl Iterator<Item = (f32, f32)> + 'a {
    // Values that feed convolutions always have a scale: the quantiser and the reader check it.
    let scale = |&v: &usize| scales[v].as_ref();
    let channels = |s: &'a Scale| s.steps.iter().map(|&step| (step, s.zero));
    node.inputs.iter().filter_map(scale).flat_map(channels)
}

/// Rounds one convolution. `means`, the mean of every input channel, corrects the bias for what rounding the weights
/// shifts.
pub(crate) fn quantise(
    node: &Node,
    conv: &FloatConv,
    scales: &[Option<Scale>],
    means: Option<&[f32]>,
) -> QuantConv {
    let Op::Conv { shape, .. } = &node.op else {
        unreachable!("only convolutions have weights");
    };
    let inputs: Vec<f32> = input_scales(node, scales).map(|s| s.0).collect();
    let (gi, go) = (
        shape.in_channels() / shape.groups(),
        shape.out_channels() / shape.groups(),
    );
    let taps = shape.kernel() * shape.kernel();
    let mut q = QuantConv {
        weight: Vec::with_capacity(conv.weight.len()),
        scale: Vec::with_capacity(shape.out_channels()),
        bias: conv.bias.clone(),
    };
    for (o, row) in conv.weight.chunks_exact(gi * taps).enumerate() {
        let first = o / go * gi;
        let input = |i: usize| first + i / taps;
        let scaled: Vec<f32> = (0..row.len()).map(|i| row[i] * inputs[input(i)]).collect();
        let max = scaled.iter().fold(0.0, |m: f32, w| m.max(w.abs()));
        // The bias must fit the accumulator too: a channel with hardly any weight keeps a coarser step.
        let step = (max / WEIGHT_MAX)
            .max(conv.bias[o].abs() * 1e-9)
            .max(f32::MIN_POSITIVE * 1e6);
        let mut shift = 0.0;
        for (i, &w) in scaled.iter().enumerate() {
            let rounded = (w / step).round().clamp(-WEIGHT_MAX, WEIGHT_MAX);
            q.weight.push(rounded as i8);
            if let Some(means) = means {
                shift += (w - rounded * step) / inputs[input(i)] * means[input(i)];
            }
        }
        q.scale.push(step);
        q.bias[o] += shift;
    }
    q
}

/// What the int8 weights stand for.
pub(crate) fn dequantise(node: &Node, q: &QuantConv, scales: &[Option<Scale>]) -> FloatConv {
    let Op::Conv { shape, .. } = &node.op else {
        unreachable!("only convolutions have weights");
    };
    let inputs: Vec<f32> = input_scales(node, scales).map(|s| s.0).collect();
    let (gi, go) = (
        shape.in_channels() / shape.groups(),
        shape.out_channels() / shape.groups(),
    );
    let taps = shape.kernel() * shape.kernel();
    let mut weight = Vec::with_capacity(q.weight.len());
    for (o, row) in q.weight.chunks_exact(gi * taps).enumerate() {
        let first = o / go * gi;
        let real = |(i, &w): (usize, &i8)| f32::from(w) * q.scale[o] / inputs[first + i / taps];
        weight.extend(row.iter().enumerate().map(real));
    }
    FloatConv {
        weight,
        bias: q.bias.clone(),
    }
}

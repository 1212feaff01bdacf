//! Float convolutions and activation ranges go in, int8 convolutions come out.
//!
//! Weights: per output channel, symmetric, ±127, of the weights already multiplied by the scale of the activation that each
//! input channel carries; so slices of a concatenation keep their own scales at no cost. Activations: per value, 7 bits,
//! zero point 0 after ReLU.

use serde::{Deserialize, Serialize};

use super::FloatConv;
use super::contract::ACTIVATION_LEVELS;
use crate::engine::network::{Graph, Node, Op};

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

/// How a value of the network is stored in int8: `real = scale * (q - zero)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    /// Real units per step.
    pub scale: f32,
    /// Steps at real 0.
    pub zero: f32,
}

impl Scale {
    /// The picture's bytes: x / 255 - 0.5.
    pub const PICTURE: Self = Self {
        scale: 1.0 / 255.0,
        zero: 127.5,
    };

    /// A value in 0..=`range`.
    pub fn unsigned(range: f32) -> Self {
        Self {
            scale: range / ACTIVATION_LEVELS as f32,
            zero: 0.0,
        }
    }

    /// A value in ±`range` (a convolution without ReLU that a residual sum reads).
    pub fn signed(range: f32) -> Self {
        Self {
            scale: range / 63.0,
            zero: 64.0,
        }
    }

    /// The stored number of real 0, which halos hold.
    pub fn padding(self) -> u8 {
        self.zero.round() as u8
    }
}

/// The scale of every channel that goes into `node`, in order.
pub(crate) fn input_scales<'a>(
    graph: &'a Graph,
    node: &'a Node,
    scales: &'a [Option<Scale>],
) -> impl Iterator<Item = Scale> + 'a {
    node.inputs.iter().flat_map(|&v| {
        // Values that feed convolutions always have a scale: the quantiser and the reader check it.
        let s = scales[v].unwrap_or(Scale {
            scale: 1.0,
            zero: 0.0,
        });
        std::iter::repeat_n(s, graph.values[v].channels)
    })
}

/// Rounds one convolution. `means`, the mean of every input channel, corrects the bias for what rounding the weights shifts.
pub(crate) fn quantise(
    graph: &Graph,
    node: &Node,
    conv: &FloatConv,
    scales: &[Option<Scale>],
    means: Option<&[f32]>,
) -> QuantConv {
    let Op::Conv { shape, .. } = &node.op else {
        unreachable!("only convolutions have weights");
    };
    let inputs: Vec<f32> = input_scales(graph, node, scales).map(|s| s.scale).collect();
    let (gi, go) = (
        shape.in_channels / shape.groups,
        shape.out_channels / shape.groups,
    );
    let taps = shape.kernel * shape.kernel;
    let mut q = QuantConv {
        weight: Vec::with_capacity(conv.weight.len()),
        scale: Vec::with_capacity(shape.out_channels),
        bias: conv.bias.clone(),
    };
    for (o, row) in conv.weight.chunks_exact(gi * taps).enumerate() {
        let first = o / go * gi;
        let scaled = |i: usize| row[i] * inputs[first + i / taps];
        let max = (0..row.len()).map(|i| scaled(i).abs()).fold(0.0, f32::max);
        // The bias must fit the accumulator too: a channel with hardly any weight keeps a coarser step.
        let step = (max / WEIGHT_MAX)
            .max(conv.bias[o].abs() * 1e-9)
            .max(f32::MIN_POSITIVE * 1e6);
        let mut shift = 0.0;
        for i in 0..row.len() {
            let w = (scaled(i) / step).round().clamp(-WEIGHT_MAX, WEIGHT_MAX);
            q.weight.push(w as i8);
            if let Some(means) = means {
                let channel = first + i / taps;
                shift += (row[i] - w * step / inputs[channel]) * means[channel];
            }
        }
        q.scale.push(step);
        q.bias[o] += shift;
    }
    q
}

/// What the int8 weights stand for.
pub(crate) fn dequantise(
    graph: &Graph,
    node: &Node,
    q: &QuantConv,
    scales: &[Option<Scale>],
) -> FloatConv {
    let Op::Conv { shape, .. } = &node.op else {
        unreachable!("only convolutions have weights");
    };
    let inputs: Vec<f32> = input_scales(graph, node, scales).map(|s| s.scale).collect();
    let (gi, go) = (
        shape.in_channels / shape.groups,
        shape.out_channels / shape.groups,
    );
    let taps = shape.kernel * shape.kernel;
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

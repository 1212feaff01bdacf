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

/// Rounds one convolution. `means`, the mean of every input channel in real units, corrects the bias for what rounding
/// the weights shifts on average over the output.
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
    let (gi, go) = (shape.group_in(), shape.group_out());
    let taps = shape.kernel() * shape.kernel();
    // Every output of a convolution sees all taps of its channel; those of a transposed one share them out among the
    // stride² outputs that an input makes.
    let outputs = match shape.transposed() {
        true => (shape.stride() * shape.stride()) as f32,
        false => 1.0,
    };
    // The zero points of the residual and of the output are added to the bias when kernels are packed.
    let shifted = node.residual.iter().chain([&node.output]);
    let shifted: Vec<&Scale> = shifted.filter_map(|&v| scales[v].as_ref()).collect();
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
        // What is added to the products must fit the accumulator too, and f32 after it, which has 24 bits: a channel
        // with hardly any weight keeps a coarser step.
        let zero = |s: &Scale| s.steps[o] * s.zero;
        let added = conv.bias[o].abs() + shifted.iter().copied().map(zero).sum::<f32>();
        let step = (max / WEIGHT_MAX)
            .max(added * (f32::EPSILON / 2.0))
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
        q.bias[o] += shift / outputs;
    }
    q
}

/// What the int8 weights stand for.
pub(crate) fn dequantise(node: &Node, q: &QuantConv, scales: &[Option<Scale>]) -> FloatConv {
    let Op::Conv { shape, .. } = &node.op else {
        unreachable!("only convolutions have weights");
    };
    let inputs: Vec<f32> = input_scales(node, scales).map(|s| s.0).collect();
    let (gi, go) = (shape.group_in(), shape.group_out());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::model::{Model, Weights};
    use crate::engine::network::Network;

    /// Mean of channel `o` over all outputs but those at the border, of an input that is `means` everywhere.
    fn mean_output(node: &Node, conv: &FloatConv, means: &[f32], o: usize) -> f64 {
        let shape = node.conv().expect("a convolution");
        let (stride, kernel) = (shape.stride(), shape.kernel());
        let (gi, go) = (shape.group_in(), shape.group_out());
        // The outputs of a transposed convolution differ by which taps reach them.
        let phases = if shape.transposed() { stride } else { 1 };
        let mut sum = 0.0;
        for phase in 0..phases * phases {
            sum += f64::from(conv.bias[o]);
            for (i, mean) in means[o / go * gi..][..gi].iter().enumerate() {
                for tap in 0..kernel * kernel {
                    let reaches = |at: usize, phase: usize| at % phases == phase;
                    if reaches(tap / kernel, phase / phases)
                        && reaches(tap % kernel, phase % phases)
                    {
                        let weight = conv.weight[(o * gi + i) * kernel * kernel + tap];
                        sum += f64::from(weight) * f64::from(*mean);
                    }
                }
            }
        }
        sum / (phases * phases) as f64
    }

    #[test]
    fn corrected_biases_keep_the_mean_of_every_kind_of_layer() {
        let network = Network::parse(
            r#"
            name = "tiny"
            about = "layers of both kinds"
            input = { channels = 3, multiple = 16 }
            output = { a = "last" }
            layers = [
              { kind = "conv", name = "first", out = 16, kernel = 3, stride = 2 },
              { kind = "conv", name = "grouped", out = 8, kernel = 3, groups = 2 },
              { kind = "deconv", name = "up", out = 16, kernel = 4, stride = 2, groups = 2 },
              { kind = "deconv", name = "uneven", out = 16, kernel = 5, stride = 3 },
              { kind = "deconv", name = "level", out = 16, kernel = 3, stride = 1 },
              { kind = "conv", name = "last", out = 4, kernel = 1 },
            ]
            "#,
        );
        let model = Model::random(network.unwrap(), 7);
        let Weights::Float(convs) = &model.weights else {
            panic!("random weights are floats");
        };
        let graph = model.network.graph();
        let scale = |v: &crate::engine::network::Value| {
            let ranges: Vec<f32> = (0..v.channels).map(|c| 1.0 + 0.1 * c as f32).collect();
            Some(Scale::unsigned(&ranges))
        };
        let scales: Vec<_> = graph.values.iter().map(scale).collect();
        for (node, conv) in graph.nodes.iter().zip(convs) {
            let conv = conv.as_ref().unwrap();
            let channels = graph.values[node.inputs[0]].channels;
            let means: Vec<f32> = (0..channels).map(|c| 0.3 + 0.05 * c as f32).collect();
            // Root mean square over channels.
            let error = |corrected: bool| {
                let q = quantise(node, conv, &scales, corrected.then_some(&means[..]));
                let real = dequantise(node, &q, &scales);
                let of = |o| {
                    let expected = mean_output(node, conv, &means, o);
                    (mean_output(node, &real, &means, o) - expected).powi(2)
                };
                let outs = graph.values[node.output].channels;
                ((0..outs).map(of).sum::<f64>() / outs as f64).sqrt()
            };
            let (with, without) = (error(true), error(false));
            assert!(with < 0.01 * without, "{}: {with} {without}", node.name);
        }
    }
}

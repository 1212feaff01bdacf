//! A batch of input rows goes in, a batch of output rows comes out.

use super::weights::{LinearLayer, Stage2Weights};

/// Outputs computed together: two vectors of four on the least machine.
const WIDE: usize = 8;
/// Rows computed together, so that every weight that is loaded is used this often.
const TALL: usize = 4;

/// A layer with its weights in panels `[outputs / WIDE][inputs][WIDE]`, zero-padded.
#[derive(Debug, Clone)]
struct Packed {
    inputs: usize,
    outputs: usize,
    panels: Vec<f32>,
    bias: Vec<f32>,
    relu: bool,
}

impl Packed {
    fn new(layer: &LinearLayer) -> Self {
        let count = layer.outputs.div_ceil(WIDE);
        let mut panels = vec![0.0; count * layer.inputs * WIDE];
        for (o, row) in layer.weights.chunks_exact(layer.inputs).enumerate() {
            for (i, w) in row.iter().enumerate() {
                panels[(o / WIDE * layer.inputs + i) * WIDE + o % WIDE] = *w;
            }
        }
        let mut bias = layer.bias.clone();
        bias.resize(count * WIDE, 0.0);
        Self {
            inputs: layer.inputs,
            outputs: layer.outputs,
            panels,
            bias,
            relu: layer.relu,
        }
    }

    /// `x` `[TALL, inputs]` → `y` `[TALL, outputs]`.
    fn run(&self, x: &[f32], y: &mut [f32]) {
        let rows: [&[f32]; TALL] =
            std::array::from_fn(|r| &x[r * self.inputs..(r + 1) * self.inputs]);
        let panels = self.panels.chunks_exact(self.inputs * WIDE);
        for (p, (panel, bias)) in panels.zip(self.bias.chunks_exact(WIDE)).enumerate() {
            let mut sum = [[0.0_f32; WIDE]; TALL];
            for (i, w) in panel.chunks_exact(WIDE).enumerate() {
                for (acc, row) in sum.iter_mut().zip(rows) {
                    for (a, w) in acc.iter_mut().zip(w) {
                        *a += row[i] * w;
                    }
                }
            }
            let end = WIDE.min(self.outputs - p * WIDE);
            for (r, acc) in sum.iter().enumerate() {
                let to = &mut y[r * self.outputs + p * WIDE..][..end];
                for ((to, a), b) in to.iter_mut().zip(acc).zip(bias) {
                    let v = a + b;
                    *to = if self.relu { v.max(0.0) } else { v };
                }
            }
        }
    }
}

/// Stage II's layers, ready to run on a batch.
#[derive(Debug, Clone)]
pub(crate) struct Mlp {
    layers: Vec<Packed>,
    from: Vec<f32>,
    to: Vec<f32>,
}

impl Mlp {
    /// Packs the layers.
    pub fn new(weights: &Stage2Weights) -> Self {
        let layers: Vec<Packed> = weights.layers().iter().map(Packed::new).collect();
        let widest = layers
            .iter()
            .map(|l| l.inputs.max(l.outputs))
            .max()
            .unwrap_or(0);
        Self {
            layers,
            from: vec![0.0; TALL * widest],
            to: vec![0.0; TALL * widest],
        }
    }

    /// `input` `[n, inputs]` → `output` `[n, outputs]`. Allocates nothing.
    pub fn run(&mut self, input: &[f32], output: &mut [f32]) {
        let (Some(first), Some(last)) = (self.layers.first(), self.layers.last()) else {
            return;
        };
        let (inputs, outputs) = (first.inputs, last.outputs);
        let blocks = input.chunks(TALL * inputs);
        for (x, y) in blocks.zip(output.chunks_mut(TALL * outputs)) {
            // A last block of fewer rows computes on what is left from earlier ones; those rows are not copied out.
            self.from[..x.len()].copy_from_slice(x);
            for layer in &self.layers {
                layer.run(&self.from, &mut self.to);
                std::mem::swap(&mut self.from, &mut self.to);
            }
            y.copy_from_slice(&self.from[..y.len()]);
        }
    }
}

//! A batch of input rows goes in, a batch of output rows comes out.

use std::sync::Arc;

use edgecap_kernels::{Isa, Linear};

use super::{INPUTS, LiftError, LinearLayer, Stage2Weights};

/// Stage II's layers, packed for the CPU, with the buffers between them.
///
/// Training supervises an encoding only at the joints of its bone (SPEC §4) and leaves the weights of all others in the
/// first layer at zero: 141 of the shipped model's 924 inputs have any. Only those are packed and read.
#[derive(Debug, Clone)]
pub(crate) struct Mlp {
    /// The inputs that the first layer gives weight.
    weighted: Vec<usize>,
    /// Packed once; clones share them.
    layers: Arc<[Linear]>,
    from: Vec<f32>,
    to: Vec<f32>,
}

impl Mlp {
    /// Packs the layers for `isa`.
    pub fn new(weights: &Stage2Weights, isa: Isa) -> Result<Self, LiftError> {
        let mut layers = weights.layers().to_vec();
        // There is one: `Stage2Weights` starts at INPUTS and ends at OUTPUTS.
        let weighted = weighted_inputs(&layers[0]);
        layers[0] = narrowed(&layers[0], &weighted);
        let pack =
            |l: &LinearLayer| Linear::new(isa, l.inputs, l.outputs, &l.weights, &l.bias, l.relu);
        Ok(Self {
            weighted,
            layers: layers.iter().map(pack).collect::<Result<_, _>>()?,
            from: Vec::new(),
            to: Vec::new(),
        })
    }

    /// `input` `[batch, INPUTS]` → `[batch, OUTPUTS]`. Allocates only for a batch larger than any before.
    pub fn run(&mut self, batch: usize, input: &[f32]) -> Result<&[f32], LiftError> {
        self.from.clear();
        for row in input.chunks_exact(INPUTS) {
            self.from.extend(self.weighted.iter().map(|&k| row[k]));
        }
        for layer in self.layers.iter() {
            self.to.resize(batch * layer.outputs(), 0.0);
            layer.run(batch, &self.from, &mut self.to)?;
            std::mem::swap(&mut self.from, &mut self.to);
        }
        Ok(&self.from)
    }
}

/// The inputs that `layer` gives any weight; one at least.
fn weighted_inputs(layer: &LinearLayer) -> Vec<usize> {
    let mut any = vec![false; layer.inputs];
    for row in layer.weights.chunks_exact(layer.inputs) {
        for (any, w) in any.iter_mut().zip(row) {
            *any |= *w != 0.0;
        }
    }
    let mut weighted: Vec<usize> = (0..layer.inputs).filter(|&k| any[k]).collect();
    if weighted.is_empty() {
        weighted.push(0);
    }
    weighted
}

/// `layer` with these inputs only.
fn narrowed(layer: &LinearLayer, inputs: &[usize]) -> LinearLayer {
    let rows = layer.weights.chunks_exact(layer.inputs);
    LinearLayer {
        inputs: inputs.len(),
        weights: rows
            .flat_map(|row| inputs.iter().map(|&k| row[k]))
            .collect(),
        ..layer.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lift::OUTPUTS;

    /// One layer that gives weight to every `every`-th input.
    fn sparse(every: usize) -> Stage2Weights {
        let weight = |k: usize| ((k * 7 % 11) as f32 - 5.5) * 0.01;
        let weights = (0..INPUTS * OUTPUTS).map(|k| {
            let counts = (k % INPUTS).is_multiple_of(every);
            if counts { weight(k) } else { 0.0 }
        });
        Stage2Weights::new(vec![LinearLayer {
            inputs: INPUTS,
            outputs: OUTPUTS,
            weights: weights.collect(),
            bias: vec![0.25; OUTPUTS],
            relu: false,
        }])
        .expect("the layer fits")
    }

    #[test]
    fn inputs_without_weight_are_left_out() {
        let isa = Isa::detect().expect("a tier");
        for (every, counting) in [(1, INPUTS), (7, INPUTS / 7), (INPUTS, 1)] {
            let weights = sparse(every);
            let mut mlp = Mlp::new(&weights, isa).expect("a tier of this CPU");
            assert_eq!(mlp.layers[0].inputs(), counting);
            let input: Vec<f32> = (0..2 * INPUTS)
                .map(|k| {
                    let counts = (k % INPUTS).is_multiple_of(every);
                    if counts { (k % 13) as f32 } else { f32::NAN }
                })
                .collect();
            let output = mlp.run(2, &input).expect("the lengths fit").to_vec();
            let rows = weights.layers()[0].weights.chunks_exact(INPUTS);
            let rows: Vec<&[f32]> = rows.collect();
            for (person, x) in input.chunks_exact(INPUTS).enumerate() {
                for (o, w) in rows.iter().enumerate() {
                    let terms = (0..INPUTS).step_by(every).map(|k| w[k] * x[k]);
                    let expected = 0.25 + terms.sum::<f32>();
                    let found = output[person * OUTPUTS + o];
                    assert!((found - expected).abs() < 1e-2, "{found} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_layer_without_weights_gives_its_bias() {
        let mut weights = sparse(1).layers().to_vec();
        weights[0].weights.fill(0.0);
        let weights = Stage2Weights::new(weights).expect("the layer fits");
        let isa = Isa::detect().expect("a tier");
        let mut mlp = Mlp::new(&weights, isa).expect("a tier of this CPU");
        let output = mlp.run(1, &[1.0; INPUTS]).expect("the lengths fit");
        assert_eq!(output, [0.25; OUTPUTS]);
    }
}

//! A batch of input rows goes in, a batch of output rows comes out.

use std::sync::Arc;

use edgecap_kernels::{Isa, Linear};

use super::{INPUTS, LiftError, weights};
use crate::engine::model;

/// Stage II's layers, packed for the CPU, with the buffers between them.
///
/// Training supervises an encoding only at the joints of its bone (XNect §4.1.2) and leaves the weights of all others
/// in the first layer at zero: 141 of the shipped model's 924 inputs have any. Only those are packed and read.
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
    /// Checks the layers and packs them for `isa`.
    pub fn new(layers: &[model::Linear], isa: Isa) -> Result<Self, LiftError> {
        weights::check(layers)?;
        // There is a first one: layers begin at INPUTS and end at OUTPUTS.
        let weighted = weighted_inputs(&layers[0]);
        let first = narrowed(&layers[0], &weighted);
        let all = std::iter::once(&first).chain(&layers[1..]);
        let pack =
            |l: &model::Linear| Linear::new(isa, l.inputs, l.outputs, &l.weight, &l.bias, l.relu);
        Ok(Self {
            weighted,
            layers: all.map(pack).collect::<Result<_, _>>()?,
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
fn weighted_inputs(layer: &model::Linear) -> Vec<usize> {
    let mut any = vec![false; layer.inputs];
    for row in layer.weight.chunks_exact(layer.inputs) {
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
fn narrowed(layer: &model::Linear, inputs: &[usize]) -> model::Linear {
    let rows = layer.weight.chunks_exact(layer.inputs);
    model::Linear {
        inputs: inputs.len(),
        outputs: layer.outputs,
        weight: rows
            .flat_map(|row| inputs.iter().map(|&k| row[k]))
            .collect(),
        bias: layer.bias.clone(),
        relu: layer.relu,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lift::OUTPUTS;

    /// One layer that gives weight to every `every`-th input.
    fn sparse(every: usize) -> model::Linear {
        let number = |k: usize| ((k * 7 % 11) as f32 - 5.5) * 0.01;
        let weight = (0..INPUTS * OUTPUTS).map(|k| {
            let counts = (k % INPUTS).is_multiple_of(every);
            if counts { number(k) } else { 0.0 }
        });
        model::Linear {
            inputs: INPUTS,
            outputs: OUTPUTS,
            weight: weight.collect(),
            bias: vec![0.25; OUTPUTS],
            relu: false,
        }
    }

    #[test]
    fn inputs_without_weight_are_left_out() {
        let isa = Isa::detect().expect("a tier");
        for (every, counting) in [(1, INPUTS), (7, INPUTS / 7), (INPUTS, 1)] {
            let layer = sparse(every);
            let layers = std::slice::from_ref(&layer);
            let mut mlp = Mlp::new(layers, isa).expect("a layer that fits");
            assert_eq!(mlp.layers[0].inputs(), counting);
            let input: Vec<f32> = (0..2 * INPUTS)
                .map(|k| {
                    let counts = (k % INPUTS).is_multiple_of(every);
                    if counts { (k % 13) as f32 } else { f32::NAN }
                })
                .collect();
            let output = mlp.run(2, &input).expect("the lengths fit").to_vec();
            let rows = layer.weight.chunks_exact(INPUTS);
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
        let mut layer = sparse(1);
        layer.weight.fill(0.0);
        let isa = Isa::detect().expect("a tier");
        let mut mlp = Mlp::new(&[layer], isa).expect("a layer that fits");
        let output = mlp.run(1, &[1.0; INPUTS]).expect("the lengths fit");
        assert_eq!(output, [0.25; OUTPUTS]);
    }
}

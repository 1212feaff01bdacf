//! A batch of input rows goes in, a batch of output rows comes out.

use edgecap_kernels::{Isa, Linear};

use super::{LiftError, Stage2Weights};

/// Stage II's layers, packed for the CPU, with the buffers between them.
#[derive(Debug, Clone)]
pub(crate) struct Mlp {
    layers: Vec<Linear>,
    from: Vec<f32>,
    to: Vec<f32>,
}

impl Mlp {
    /// Packs the layers for `isa`.
    pub fn new(weights: &Stage2Weights, isa: Isa) -> Result<Self, LiftError> {
        let pack = |l: &super::LinearLayer| {
            Linear::new(isa, l.inputs, l.outputs, &l.weights, &l.bias, l.relu)
        };
        let layers = weights
            .layers()
            .iter()
            .map(pack)
            .collect::<Result<_, _>>()?;
        Ok(Self {
            layers,
            from: Vec::new(),
            to: Vec::new(),
        })
    }

    /// `input` `[batch, inputs]` → `[batch, outputs]`. Allocates only for a batch larger than any before.
    pub fn run(&mut self, batch: usize, input: &[f32]) -> Result<&[f32], LiftError> {
        self.from.clear();
        self.from.extend_from_slice(input);
        for layer in &self.layers {
            self.to.resize(batch * layer.outputs(), 0.0);
            layer.run(batch, &self.from, &mut self.to)?;
            std::mem::swap(&mut self.from, &mut self.to);
        }
        Ok(&self.from)
    }
}

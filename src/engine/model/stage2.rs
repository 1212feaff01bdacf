//! Stage II's layers with batch norm folded in (XNect §4.2).

use super::tensors::Tensors;
use super::{ModelError, Stage2Contract};

/// One fully connected layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Linear {
    /// Numbers that go in.
    pub inputs: usize,
    /// Numbers that come out.
    pub outputs: usize,
    /// `[outputs, inputs]`.
    pub weight: Vec<f32>,
    /// `[outputs]`.
    pub bias: Vec<f32>,
    /// ReLU follows.
    pub relu: bool,
}

/// Stage II: `[924]` → `[63]`, metres at canonical stature.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage2 {
    /// What the weights mean.
    pub contract: Stage2Contract,
    /// The layers in order.
    pub layers: Vec<Linear>,
}

impl Stage2 {
    /// Widths of SPEC §4.
    pub const WIDTHS: [usize; 6] = [924, 160, 256, 256, 128, 63];

    /// Imports the training recipe's safetensors.
    pub fn from_safetensors(bytes: &[u8]) -> Result<Self, ModelError> {
        let mut t = Tensors::parse(bytes)?;
        let contract = Stage2Contract::parse(super::contract_of(&t)?)?;
        let mut layers = Vec::new();
        for (i, w) in Self::WIDTHS.windows(2).enumerate() {
            let (inputs, outputs) = (w[0], w[1]);
            let name = format!("fc{}", i + 1);
            let mut weight = t.floats(&format!("{name}.0.weight"), &[outputs, inputs])?;
            let last = i + 2 == Self::WIDTHS.len();
            let bias = if last {
                t.floats(&format!("{name}.0.bias"), &[outputs])?
            } else {
                let mut read = |what: &str| t.floats(&format!("{name}.1.{what}"), &[outputs]);
                let (gamma, beta) = (read("weight")?, read("bias")?);
                let (mean, var) = (read("running_mean")?, read("running_var")?);
                let mut bias = beta;
                for (o, row) in weight.chunks_exact_mut(inputs).enumerate() {
                    let a = gamma[o] / (var[o].max(0.0) + contract.common.batchnorm_eps).sqrt();
                    row.iter_mut().for_each(|w| *w *= a);
                    bias[o] -= mean[o] * a;
                }
                bias
            };
            layers.push(Linear {
                inputs,
                outputs,
                weight,
                bias,
                relu: !last,
            });
        }
        t.finish(|n| n.ends_with("num_batches_tracked"))?;
        Ok(Self { contract, layers })
    }

    /// Reads the layers of a model file.
    pub(super) fn read(t: &mut Tensors<'_>, contract: Stage2Contract) -> Result<Self, ModelError> {
        contract.check()?;
        let mut layers = Vec::new();
        for (i, w) in Self::WIDTHS.windows(2).enumerate() {
            let (inputs, outputs) = (w[0], w[1]);
            layers.push(Linear {
                inputs,
                outputs,
                weight: t.floats(&format!("stage2.fc{}.weight", i + 1), &[outputs, inputs])?,
                bias: t.floats(&format!("stage2.fc{}.bias", i + 1), &[outputs])?,
                relu: i + 2 < Self::WIDTHS.len(),
            });
        }
        Ok(Self { contract, layers })
    }
}

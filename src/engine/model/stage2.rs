//! Stage II's layers with batch norm folded in (XNect §4.2).

use super::float::{refused, variances};
use super::tensors::{Tensors, is_counter};
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

/// Everything that [`Stage2::from_safetensors`] could say of the tensors.
pub(super) fn mismatches(t: &mut Tensors<'_>) -> Vec<ModelError> {
    let widths = match Stage2::widths(t, |layer| format!("fc{layer}.0.weight")) {
        Ok(widths) => widths,
        // The widths of the others cannot be known.
        Err(e) => return vec![e],
    };
    let mut all = Vec::new();
    for (i, w) in widths.windows(2).enumerate() {
        let (name, out) = (format!("fc{}", i + 1), vec![w[1]]);
        let mut wanted = vec![(format!("{name}.0.weight"), vec![w[1], w[0]])];
        if i + 2 == Stage2::WIDTHS.len() {
            wanted.push((format!("{name}.0.bias"), out));
        } else {
            let parts = ["weight", "bias", "running_mean", "running_var"];
            wanted.extend(parts.map(|part| (format!("{name}.1.{part}"), out.clone())));
        }
        all.extend(refused(t, &wanted));
    }
    all
}

impl Stage2 {
    /// Widths of the network that the training recipe makes. A file may have other hidden layers, but as many.
    pub const WIDTHS: [usize; 6] = [924, 384, 384, 384, 192, 63];

    /// Imports the training recipe's safetensors.
    ///
    /// # Errors
    /// [`Damaged`](ModelError::Damaged) or [`Checkpoint`](ModelError::Checkpoint) where the bytes are no safetensors;
    /// [`Contract`](ModelError::Contract), [`Missing`](ModelError::Missing), [`Tensor`](ModelError::Tensor),
    /// [`Values`](ModelError::Values) or [`Unused`](ModelError::Unused) where they are not weights of Stage II.
    pub fn from_safetensors(bytes: &[u8]) -> Result<Self, ModelError> {
        let mut t = Tensors::parse(bytes)?;
        let contract = Stage2Contract::parse(super::contract_of(&t)?)?;
        let mut layers = Vec::new();
        let widths = Self::widths(&t, |layer| format!("fc{layer}.0.weight"))?;
        for (i, w) in widths.windows(2).enumerate() {
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
                variances(&format!("{name}.1.running_var"), &var)?;
                let mut bias = beta;
                for (o, row) in weight.chunks_exact_mut(inputs).enumerate() {
                    let a = gamma[o] / (var[o] + contract.common.batchnorm_eps).sqrt();
                    row.iter_mut().for_each(|w| *w *= a);
                    bias[o] -= mean[o] * a;
                    if !(bias[o].is_finite() && row.iter().all(|w| w.is_finite())) {
                        return Err(ModelError::Values {
                            name: format!("{name}.0.weight"),
                            found: format!(
                                "weights of channel {o} that the batch norm `{name}.1` makes infinite"
                            ),
                        });
                    }
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
        t.finish(is_counter)?;
        Ok(Self { contract, layers })
    }

    /// The widths of the file's network: input and output are given, hidden layers are as wide as their weights (`name`
    /// of the layer, from 1) have rows.
    fn widths(t: &Tensors<'_>, name: impl Fn(usize) -> String) -> Result<[usize; 6], ModelError> {
        let mut widths = Self::WIDTHS;
        for (layer, width) in widths[..5].iter_mut().enumerate().skip(1) {
            *width = t.rows(&name(layer))?;
        }
        Ok(widths)
    }

    /// Reads the layers of a model file.
    pub(super) fn read(t: &mut Tensors<'_>, contract: Stage2Contract) -> Result<Self, ModelError> {
        contract.check()?;
        let mut layers = Vec::new();
        let widths = Self::widths(t, |layer| format!("stage2.fc{layer}.weight"))?;
        for (i, w) in widths.windows(2).enumerate() {
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

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use safetensors::tensor::{Dtype, TensorView};

    use super::*;
    use crate::engine::Model;

    /// A file as the recipe writes it, all weights 0, with these hidden layers.
    fn file(hidden: [usize; 4]) -> Vec<u8> {
        let shipped = include_bytes!("../../../models/weights/stage2.safetensors");
        let (_, meta) = safetensors::SafeTensors::read_metadata(shipped).unwrap();
        let mut shapes: HashMap<String, Vec<usize>> = HashMap::new();
        let widths = [924, hidden[0], hidden[1], hidden[2], hidden[3], 63];
        for (i, w) in widths.windows(2).enumerate() {
            shapes.insert(format!("fc{}.0.weight", i + 1), vec![w[1], w[0]]);
            if i == 4 {
                shapes.insert("fc5.0.bias".into(), vec![w[1]]);
            } else {
                for what in ["weight", "bias", "running_mean", "running_var"] {
                    shapes.insert(format!("fc{}.1.{what}", i + 1), vec![w[1]]);
                }
            }
        }
        let zeros = vec![0_u8; 4 * 924 * widths.iter().max().unwrap()];
        let views = shapes.iter().map(|(name, shape)| {
            let bytes = 4 * shape.iter().product::<usize>();
            let view = TensorView::new(Dtype::F32, shape.clone(), &zeros[..bytes]).unwrap();
            (name.as_str(), view)
        });
        safetensors::serialize(views, meta.metadata().clone()).unwrap()
    }

    #[test]
    fn hidden_layers_are_as_wide_as_their_weights() {
        let widths = |hidden| -> Vec<usize> {
            let network = Stage2::from_safetensors(&file(hidden)).unwrap();
            network.layers.iter().map(|l| l.outputs).collect()
        };
        assert_eq!(widths([7, 5, 9, 3]), [7, 5, 9, 3, 63]);
        assert_eq!(widths([160, 256, 256, 128]), [160, 256, 256, 128, 63]);
    }

    #[test]
    fn a_negative_variance_is_refused_as_in_stage_one() {
        let mut bytes = file([7, 5, 9, 3]);
        let header = 8 + u64::from_le_bytes(*bytes.first_chunk().unwrap()) as usize;
        let found = safetensors::SafeTensors::read_metadata(&bytes).unwrap().1;
        let (from, _) = found.info("fc2.1.running_var").unwrap().data_offsets;
        bytes[header + from + 4..][..4].copy_from_slice(&(-1.0_f32).to_le_bytes());
        let said = Stage2::from_safetensors(&bytes).unwrap_err().to_string();
        assert!(
            said.contains("`fc2.1.running_var`") && said.contains("variance -1 of channel 1"),
            "{said}"
        );
        let all = Model::stage2_mismatches(&bytes).unwrap();
        assert!(
            all.len() == 1 && all[0].to_string() == said,
            "{all:?} instead of {said}"
        );
    }

    #[test]
    fn a_batch_norm_that_makes_weights_infinite_is_refused_as_in_stage_one() {
        let mut bytes = file([7, 5, 9, 3]);
        let header = 8 + u64::from_le_bytes(*bytes.first_chunk().unwrap()) as usize;
        let found = safetensors::SafeTensors::read_metadata(&bytes).unwrap().1;
        // All variances are 0: what a channel is divided by is as small as it can be.
        for (tensor, value) in [("fc2.1.weight", 3e38_f32), ("fc2.0.weight", 1.0)] {
            let (from, to) = found.info(tensor).unwrap().data_offsets;
            for at in (from..to).step_by(4) {
                bytes[header + at..][..4].copy_from_slice(&value.to_le_bytes());
            }
        }
        let said = Stage2::from_safetensors(&bytes).unwrap_err().to_string();
        assert!(
            said.contains("`fc2.0.weight`")
                && said.contains("channel 0")
                && said.contains("`fc2.1`"),
            "{said}"
        );
        let all = Model::stage2_mismatches(&bytes).unwrap();
        assert!(
            all.len() == 1 && all[0].to_string() == said,
            "{all:?} instead of {said}"
        );
    }

    #[test]
    fn a_layer_of_no_width_is_refused() {
        let error = Stage2::from_safetensors(&file([7, 0, 9, 3])).unwrap_err();
        let line = error.to_string();
        assert!(
            line.contains("fc2.0.weight") && line.contains("[0, 7]"),
            "{line}"
        );
    }
}

//! Stage II's weights, batch norm folded.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS};

use super::LiftError;
use crate::engine::HEAD3D_CHANNELS;
use crate::engine::model::{Linear, Stage2};

/// Numbers per evidence joint in Stage II's input: u, v, confidence, then the encoding.
pub const JOINT_INPUTS: usize = 3 + HEAD3D_CHANNELS;
/// Numbers in Stage II's input.
pub const INPUTS: usize = EVIDENCE_JOINTS * JOINT_INPUTS;
/// Numbers in Stage II's output: x, y, z of every body joint.
pub const OUTPUTS: usize = 3 * BODY_JOINTS;

/// One fully connected layer, `y = W x + b`, optionally cut off at 0.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearLayer {
    /// Numbers in.
    pub inputs: usize,
    /// Numbers out.
    pub outputs: usize,
    /// `[outputs, inputs]`, row-major.
    pub weights: Vec<f32>,
    /// `[outputs]`.
    pub bias: Vec<f32>,
    /// Negative outputs become 0.
    pub relu: bool,
}

/// The layers of Stage II in order; XNect §4.2. The training recipe's network is 924 → 384 → 384 → 384 → 192 → 63.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage2Weights {
    layers: Vec<LinearLayer>,
}

impl Stage2Weights {
    /// Checks that the layers fit each other, Stage II's input and its output.
    pub fn new(layers: Vec<LinearLayer>) -> Result<Self, LiftError> {
        let mut width = INPUTS;
        for (index, layer) in layers.iter().enumerate() {
            let found = (layer.inputs, layer.weights.len(), layer.bias.len());
            let expected = (width, width * layer.outputs, layer.outputs);
            if found != expected {
                return Err(LiftError::Layer {
                    index: index + 1,
                    expected,
                    found,
                });
            }
            let mut values = layer.weights.iter().chain(&layer.bias);
            if !values.all(|w| w.is_finite()) {
                return Err(LiftError::NotFinite { index: index + 1 });
            }
            width = layer.outputs;
        }
        if width != OUTPUTS {
            return Err(LiftError::Outputs { found: width });
        }
        Ok(Self { layers })
    }

    /// The layers.
    pub fn layers(&self) -> &[LinearLayer] {
        &self.layers
    }
}

impl TryFrom<&Stage2> for Stage2Weights {
    type Error = LiftError;

    /// The layers of a model file, checked.
    fn try_from(stage2: &Stage2) -> Result<Self, LiftError> {
        let layer = |l: &Linear| LinearLayer {
            inputs: l.inputs,
            outputs: l.outputs,
            weights: l.weight.clone(),
            bias: l.bias.clone(),
            relu: l.relu,
        };
        Self::new(stage2.layers.iter().map(layer).collect())
    }
}

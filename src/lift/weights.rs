//! Stage II's layers go in, whether they fit each other comes out.

use edgecap_client::joints::{BODY_JOINTS, EVIDENCE_JOINTS};

use super::LiftError;
use crate::engine::HEAD3D_CHANNELS;
use crate::engine::model::Linear;

/// Numbers per evidence joint in Stage II's input: u, v, confidence, then the encoding.
pub const JOINT_INPUTS: usize = 3 + HEAD3D_CHANNELS;
/// Numbers in Stage II's input.
pub const INPUTS: usize = EVIDENCE_JOINTS * JOINT_INPUTS;
/// Numbers in Stage II's output: x, y, z of every body joint.
pub const OUTPUTS: usize = 3 * BODY_JOINTS;

/// Checks that the layers fit each other, Stage II's input and its output, so that there is one at least.
pub(crate) fn check(layers: &[Linear]) -> Result<(), LiftError> {
    let mut width = INPUTS;
    for (index, layer) in layers.iter().enumerate() {
        let found = (layer.inputs, layer.weight.len(), layer.bias.len());
        let expected = (width, width * layer.outputs, layer.outputs);
        if found != expected {
            return Err(LiftError::Layer {
                index: index + 1,
                expected,
                found,
            });
        }
        let mut values = layer.weight.iter().chain(&layer.bias);
        if !values.all(|w| w.is_finite()) {
            return Err(LiftError::NotFinite { index: index + 1 });
        }
        width = layer.outputs;
    }
    if width != OUTPUTS {
        return Err(LiftError::Outputs { found: width });
    }
    Ok(())
}

//! PyTorch weights go in, convolutions with batch norm folded in come out.

use edgecap_kernels::ConvShape;

use super::tensors::Tensors;
use super::{Contract, ModelError};
use crate::engine::network::{Network, Op, ParamNames};

/// Weights and bias of one convolution, batch norm folded.
#[derive(Debug, Clone, PartialEq)]
pub struct FloatConv {
    /// `[out_channels, in_channels / groups, kernel, kernel]`, also where transposed.
    pub weight: Vec<f32>,
    /// `[out_channels]`.
    pub bias: Vec<f32>,
}

/// Reads every convolution of `network`, in the order of its nodes (`None` where a node has no weights).
pub(crate) fn import(
    tensors: &mut Tensors<'_>,
    network: &Network,
    contract: &Contract,
) -> Result<Vec<Option<FloatConv>>, ModelError> {
    let read = |op: &Op| match op {
        Op::Conv { shape, params, .. } => {
            conv(tensors, shape, params, contract.common.batchnorm_eps).map(Some)
        }
        Op::MaxPool { .. } => Ok(None),
    };
    network
        .graph()
        .nodes
        .iter()
        .map(|n| &n.op)
        .map(read)
        .collect()
}

fn conv(
    tensors: &mut Tensors<'_>,
    s: &ConvShape,
    names: &ParamNames,
    eps: f32,
) -> Result<FloatConv, ModelError> {
    let (k, out) = (s.kernel(), s.out_channels());
    let mut weight = if s.transposed() {
        let stored = [s.in_channels(), out / s.groups(), k, k];
        out_major(&tensors.floats(&names.weight, &stored)?, s)
    } else {
        tensors.floats(&names.weight, &[out, s.in_channels() / s.groups(), k, k])?
    };
    let mut bias = match &names.bias {
        Some(name) => tensors.floats(name, &[out])?,
        None => vec![0.0; out],
    };
    if let Some(norm) = &names.norm {
        let mut read = |what: &str| tensors.floats(&format!("{norm}.{what}"), &[out]);
        let (gamma, beta) = (read("weight")?, read("bias")?);
        let (mean, var) = (read("running_mean")?, read("running_var")?);
        if let Some(o) = var.iter().position(|&v| v < 0.0) {
            return Err(ModelError::Values {
                name: format!("{norm}.running_var"),
                found: format!("the negative variance {} of channel {o}", var[o]),
            });
        }
        let per = weight.len() / out;
        for (o, w) in weight.chunks_exact_mut(per).enumerate() {
            let a = gamma[o] / (var[o] + eps).sqrt();
            w.iter_mut().for_each(|w| *w *= a);
            bias[o] = beta[o] + (bias[o] - mean[o]) * a;
        }
    }
    Ok(FloatConv { weight, bias })
}

/// PyTorch stores transposed convolutions `[in, out / groups, k, k]`; ours are `[out, in / groups, k, k]`.
fn out_major(w: &[f32], s: &ConvShape) -> Vec<f32> {
    let (gi, go, taps) = (
        s.in_channels() / s.groups(),
        s.out_channels() / s.groups(),
        s.kernel() * s.kernel(),
    );
    let mut to = Vec::with_capacity(w.len());
    for o in 0..s.out_channels() {
        let group = o / go;
        for i in 0..gi {
            let at = ((group * gi + i) * go + o % go) * taps;
            to.extend_from_slice(&w[at..at + taps]);
        }
    }
    to
}

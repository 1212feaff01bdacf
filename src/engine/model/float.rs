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

/// Everything that [`import`] could say of the tensors of `network`.
pub(crate) fn mismatches(tensors: &mut Tensors<'_>, network: &Network) -> Vec<ModelError> {
    let mut all = Vec::new();
    for node in &network.graph().nodes {
        let Op::Conv { shape, params, .. } = &node.op else {
            continue;
        };
        let out = vec![shape.out_channels()];
        let mut wanted = vec![(params.weight.clone(), stored(shape))];
        wanted.extend(params.bias.iter().map(|b| (b.clone(), out.clone())));
        if let Some(norm) = &params.norm {
            let parts = ["weight", "bias", "running_mean", "running_var"];
            wanted.extend(parts.map(|part| (format!("{norm}.{part}"), out.clone())));
        }
        all.extend(refused(tensors, &wanted));
    }
    all
}

/// What is wrong with tensors of these names and shapes.
pub(super) fn refused(
    tensors: &mut Tensors<'_>,
    wanted: &[(String, Vec<usize>)],
) -> Vec<ModelError> {
    let mut wrong = |(name, shape): &(String, Vec<usize>)| {
        let values = tensors.floats(name, shape);
        let checked = values.and_then(|values| match name.ends_with(".running_var") {
            true => variances(name, &values),
            false => Ok(()),
        });
        checked.err()
    };
    wanted.iter().filter_map(&mut wrong).collect()
}

/// The shape of a convolution's weights in a PyTorch state dict.
fn stored(s: &ConvShape) -> Vec<usize> {
    let k = s.kernel();
    match s.transposed() {
        true => vec![s.in_channels(), s.group_out(), k, k],
        false => s.weight_shape().to_vec(),
    }
}

/// Variances are not negative.
pub(super) fn variances(name: &str, values: &[f32]) -> Result<(), ModelError> {
    match values.iter().position(|&v| v < 0.0) {
        None => Ok(()),
        Some(o) => Err(ModelError::Values {
            name: name.into(),
            found: format!("the negative variance {} of channel {o}", values[o]),
        }),
    }
}

fn conv(
    tensors: &mut Tensors<'_>,
    s: &ConvShape,
    names: &ParamNames,
    eps: f32,
) -> Result<FloatConv, ModelError> {
    let out = s.out_channels();
    let mut weight = tensors.floats(&names.weight, &stored(s))?;
    if s.transposed() {
        weight = out_major(&weight, s);
    }
    let mut bias = match &names.bias {
        Some(name) => tensors.floats(name, &[out])?,
        None => vec![0.0; out],
    };
    if let Some(norm) = &names.norm {
        let mut read = |what: &str| tensors.floats(&format!("{norm}.{what}"), &[out]);
        let (gamma, beta) = (read("weight")?, read("bias")?);
        let (mean, var) = (read("running_mean")?, read("running_var")?);
        variances(&format!("{norm}.running_var"), &var)?;
        let per = weight.len() / out;
        for (o, w) in weight.chunks_exact_mut(per).enumerate() {
            let a = gamma[o] / (var[o] + eps).sqrt();
            w.iter_mut().for_each(|w| *w *= a);
            bias[o] = beta[o] + (bias[o] - mean[o]) * a;
        }
        let is_finite = |o: &usize| {
            bias[*o].is_finite() && weight[o * per..][..per].iter().all(|w| w.is_finite())
        };
        if let Some(o) = (0..out).find(|o| !is_finite(o)) {
            return Err(ModelError::Values {
                name: names.weight.clone(),
                found: format!(
                    "weights of channel {o} that the batch norm `{norm}` makes infinite"
                ),
            });
        }
    }
    Ok(FloatConv { weight, bias })
}

/// PyTorch stores transposed convolutions `[in, out / groups, k, k]`; ours are `[out, in / groups, k, k]`.
fn out_major(w: &[f32], s: &ConvShape) -> Vec<f32> {
    let (gi, go, taps) = (s.group_in(), s.group_out(), s.kernel() * s.kernel());
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

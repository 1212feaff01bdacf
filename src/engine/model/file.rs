//! The model file (`.ecm`): safetensors layout; the metadata key `edgecap` holds one JSON [`Header`]; the header holds
//! the BLAKE3 digest of the whole file in which the digest's own 64 digits are zeros.

use std::collections::{BTreeMap, HashMap};
use std::io::Write;
use std::path::Path;

use safetensors::{Dtype, tensor::TensorView};
use serde::{Deserialize, Serialize};

use super::contract::{ACTIVATION_LEVELS, Contract, Stage2Contract};
use super::tensors::Tensors;
use super::{CONTRACT, ModelError, QuantConv, Scale, Stage2, Weights};
use crate::engine::Model;
use crate::engine::network::{Graph, Network, Node, Op};
use crate::output::AtomicFile;

const KEY: &str = "edgecap";
const FORMAT: &str = "edgecap-model";
const VERSION: u32 = 1;
const NUMERICS: &str = "i8 weights per channel, u7 activations";
/// In place of the digest while it is computed.
const BLANK: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// What every version of the header has: the rest may be others' keys.
#[derive(Debug, Deserialize)]
struct Kind {
    format: String,
    version: u64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    format: String,
    version: u32,
    blake3: String,
    numerics: String,
    /// How the activation ranges were found.
    calibration: String,
    /// What was done to the weights, oldest first.
    history: Vec<String>,
    contract: Contract,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    stage2: Option<Stage2Contract>,
    /// Settings of the association, TOML, where the weights have their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    association: Option<String>,
    /// Value name → stored number of real 0; the steps of its channels are the tensor `NAME.step`.
    zeros: BTreeMap<String, f32>,
    /// The network file's text.
    network: String,
}

/// Whether these bytes begin like a model file of ours rather than plain safetensors.
pub(crate) fn is_model(tensors: &Tensors<'_>) -> bool {
    tensors.metadata(KEY).is_some()
}

/// The bytes of a model file; the model must be int8.
pub(crate) fn write(model: &Model) -> Result<Vec<u8>, ModelError> {
    let Weights::Int8 { convs, scales } = &model.weights else {
        return Err(ModelError::NoRange("input".into()));
    };
    let graph = model.network.graph();
    let stored = || {
        let named = graph.values.iter().map(|v| &v.name).zip(scales);
        named
            .skip(1)
            .filter_map(|(n, s)| s.as_ref().map(|s| (n, s)))
    };
    let header = Header {
        format: FORMAT.into(),
        version: VERSION,
        blake3: BLANK.into(),
        numerics: NUMERICS.into(),
        calibration: model.calibration.clone(),
        history: model.history.clone(),
        contract: model.contract.clone(),
        stage2: model.stage2.as_ref().map(|s| s.contract.clone()),
        association: model.association.clone(),
        zeros: stored().map(|(n, s)| (n.clone(), s.zero)).collect(),
        network: model.network.source().into(),
    };
    let mut blobs: BTreeMap<String, (Dtype, Vec<usize>, Vec<u8>)> = BTreeMap::new();
    let floats = |v: &[f32]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    for (node, conv) in graph.nodes.iter().zip(convs) {
        let (Op::Conv { shape: s, .. }, Some(q)) = (&node.op, conv) else {
            continue;
        };
        let shape = s.weight_shape().to_vec();
        let weight = q.weight.iter().map(|&w| w as u8).collect();
        let n = &node.name;
        blobs.insert(format!("{n}.weight"), (Dtype::I8, shape, weight));
        let out = vec![s.out_channels()];
        blobs.insert(
            format!("{n}.scale"),
            (Dtype::F32, out.clone(), floats(&q.scale)),
        );
        blobs.insert(format!("{n}.bias"), (Dtype::F32, out, floats(&q.bias)));
    }
    for (name, s) in stored() {
        let tensor = (Dtype::F32, vec![s.steps.len()], floats(&s.steps));
        blobs.insert(format!("{name}.step"), tensor);
    }
    for (i, l) in model.stage2.iter().flat_map(|s| &s.layers).enumerate() {
        let n = format!("stage2.fc{}", i + 1);
        let shape = vec![l.outputs, l.inputs];
        blobs.insert(
            format!("{n}.weight"),
            (Dtype::F32, shape, floats(&l.weight)),
        );
        blobs.insert(
            format!("{n}.bias"),
            (Dtype::F32, vec![l.outputs], floats(&l.bias)),
        );
    }
    let mut views = Vec::new();
    for (name, (dtype, shape, data)) in &blobs {
        let view = TensorView::new(*dtype, shape.clone(), data).map_err(ModelError::damaged)?;
        views.push((name.as_str(), view));
    }
    let json = serde_json::to_string(&header).map_err(ModelError::damaged)?;
    let metadata = Some(HashMap::from([(KEY.to_string(), json)]));
    let mut bytes = safetensors::serialize(views, metadata).map_err(ModelError::damaged)?;
    let at = find_digest(&bytes, BLANK)?;
    let digest = blake3::hash(&bytes).to_hex();
    bytes[at..at + 64].copy_from_slice(digest.as_bytes());
    Ok(bytes)
}

/// Reads a model file and checks digest, shapes and ranges.
pub(crate) fn read(bytes: &[u8]) -> Result<Model, ModelError> {
    let mut t = Tensors::parse(bytes)?;
    let json = t.metadata(KEY).ok_or_else(|| match t.metadata(CONTRACT) {
        Some(_) => ModelError::Floats,
        None => ModelError::Damaged("the file has no `edgecap` metadata".into()),
    })?;
    let kind: Kind = serde_json::from_str(json).map_err(ModelError::damaged)?;
    let known = |key: &str, expected: String, found: String| {
        if expected == found {
            return Ok(());
        }
        Err(ModelError::Contract {
            key: key.into(),
            expected,
            found,
        })
    };
    known("format", FORMAT.into(), kind.format)?;
    if kind.version > VERSION.into() {
        return Err(ModelError::Newer {
            expected: VERSION,
            found: kind.version,
        });
    }
    known("version", VERSION.to_string(), kind.version.to_string())?;
    let header: Header = serde_json::from_str(json).map_err(ModelError::damaged)?;
    known("numerics", NUMERICS.into(), header.numerics)?;
    check_digest(bytes, &header.blake3)?;

    let network = Network::parse(&header.network)?;
    header.contract.check(&network)?;
    let graph = network.graph();
    let mut scales: Vec<Option<Scale>> = vec![None; graph.values.len()];
    scales[Graph::INPUT] = Some(Scale::picture());
    for (v, value) in graph.values.iter().enumerate().skip(1) {
        let name = format!("{}.step", value.name);
        let is_output = graph.outputs.iter().any(|(_, o)| *o == v);
        // The engine's steps rely on it: outputs are f32, all other values have a scale.
        let zero = match (header.zeros.get(&value.name), is_output) {
            (None, true) => continue,
            (None, false) => {
                let found = format!("the header has no zero point for `{}`", value.name);
                return Err(ModelError::Damaged(found));
            }
            (Some(_), true) => {
                let found = format!(
                    "the header has a zero point for the output `{}`",
                    value.name
                );
                return Err(ModelError::Damaged(found));
            }
            (Some(&zero), false) => zero,
        };
        let steps = t.floats(&name, &[value.channels])?;
        // Kernels take values of 7 bits, and halos hold the zero point.
        if steps.iter().any(|&s| s <= 0.0) || !(0.0..=ACTIVATION_LEVELS as f32).contains(&zero) {
            return Err(ModelError::Values {
                name,
                found: format!(
                    "a step that is not positive, or the zero point {zero} is not in 0..={ACTIVATION_LEVELS}"
                ),
            });
        }
        scales[v] = Some(Scale { steps, zero });
    }
    for node in &graph.nodes {
        check_scale(graph, node, &scales)?;
    }
    let mut convs = Vec::new();
    for node in &graph.nodes {
        let Op::Conv { shape: s, .. } = &node.op else {
            convs.push(None);
            continue;
        };
        let n = &node.name;
        let out = [s.out_channels()];
        let q = QuantConv {
            weight: t.bytes(&format!("{n}.weight"), &s.weight_shape())?,
            scale: t.floats(&format!("{n}.scale"), &out)?,
            bias: t.floats(&format!("{n}.bias"), &out)?,
        };
        if q.weight.contains(&-128) {
            return Err(ModelError::Values {
                name: format!("{n}.weight"),
                found: "-128, which the kernels exclude".into(),
            });
        }
        if q.scale.iter().any(|&s| s <= 0.0) {
            return Err(ModelError::Values {
                name: format!("{n}.scale"),
                found: "a scale that is not positive".into(),
            });
        }
        convs.push(Some(q));
    }
    let stage2 = match header.stage2 {
        Some(c) => Some(Stage2::read(&mut t, c)?),
        None => None,
    };
    t.finish(|_| false)?;
    Ok(Model {
        network,
        contract: header.contract,
        weights: Weights::Int8 { convs, scales },
        stage2,
        association: header.association,
        calibration: header.calibration,
        history: header.history,
        digest: Some(header.blake3),
    })
}

/// What int8 kernels take for granted: pools hand on stored numbers, and ReLU ends at the stored number 0.
fn check_scale(graph: &Graph, node: &Node, scales: &[Option<Scale>]) -> Result<(), ModelError> {
    // The network's outputs have none.
    let Some(scale) = &scales[node.output] else {
        return Ok(());
    };
    let found = match &node.op {
        Op::MaxPool { .. } if scales[node.inputs[0]].as_ref() != Some(scale) => format!(
            "a scale other than that of `{}`, which it pools",
            graph.values[node.inputs[0]].name
        ),
        Op::Conv { relu: true, .. } if scale.zero != 0.0 => {
            format!("the zero point {} behind ReLU, where it is 0", scale.zero)
        }
        _ => return Ok(()),
    };
    Err(ModelError::Values {
        name: format!("{}.step", node.name),
        found,
    })
}

/// Writes the file; `path` is whole or as it was, even after a power cut. What [`read`] would refuse is not written.
pub(crate) fn save(model: &Model, path: &Path) -> Result<(), ModelError> {
    let bytes = write(model)?;
    read(&bytes)?;
    let write = || -> std::io::Result<()> {
        let mut file = AtomicFile::create(path)?;
        file.write_all(&bytes)?;
        file.sync()?;
        file.finish()
    };
    write().map_err(|source| ModelError::Io {
        action: "write",
        path: path.into(),
        source,
    })
}

/// Where the 64 digits of `digest` lie: once, in the header.
fn find_digest(bytes: &[u8], digest: &str) -> Result<usize, ModelError> {
    let header = bytes
        .first_chunk::<8>()
        .map_or(0, |n| u64::from_le_bytes(*n) as usize);
    let end = header.saturating_add(8).min(bytes.len());
    let mut found = bytes[..end]
        .windows(64)
        .enumerate()
        .filter(|(_, w)| *w == digest.as_bytes());
    match (found.next(), found.next()) {
        (Some((at, _)), None) => Ok(at),
        _ => Err(ModelError::Damaged("the header has no digest".into())),
    }
}

fn check_digest(bytes: &[u8], expected: &str) -> Result<(), ModelError> {
    let at = find_digest(bytes, expected)?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes[..at]);
    hasher.update(BLANK.as_bytes());
    hasher.update(&bytes[at + 64..]);
    let found = hasher.finalize().to_hex().to_string();
    if found == expected {
        return Ok(());
    }
    Err(ModelError::Digest {
        expected: expected.into(),
        found,
    })
}

//! A model: a network with its weights, what they mean, and Stage II's layers. Files come in, a [`Model`] goes to the
//! engine.

mod completed;
mod contract;
mod error;
mod file;
mod float;
mod mismatch;
mod quant;
mod random;
mod ranges;
mod shipped;
mod stage2;
mod tensors;

use std::path::Path;

pub use contract::{Common, Contract, Input, Stage2Contract};
pub use error::ModelError;
pub use float::FloatConv;
pub use quant::{QuantConv, Scale};
pub(crate) use quant::{dequantise, input_scales};
pub use ranges::{Observed, RangeChoice};
pub use stage2::{Linear, Stage2};

use super::network::{Graph, Network, Op};
use crate::bounded;
use contract::ACTIVATION_LEVELS;
use quant::SIGNED_LEVELS;
use tensors::{Tensors, is_counter};

/// Weights of every node of the network, in order; `None` where a node has none.
#[derive(Debug, Clone, PartialEq)]
pub enum Weights {
    /// As trained, batch norm folded.
    Float(Vec<Option<FloatConv>>),
    /// Quantised.
    Int8 {
        /// Weights of every node.
        convs: Vec<Option<QuantConv>>,
        /// How every value is stored; `None` for the network's outputs, which are f32.
        scales: Vec<Option<Scale>>,
    },
}

/// A network that can run.
#[derive(Debug, Clone)]
pub struct Model {
    pub(crate) network: Network,
    pub(crate) contract: Contract,
    pub(crate) weights: Weights,
    pub(crate) stage2: Option<Stage2>,
    pub(crate) association: Option<String>,
    pub(crate) calibration: String,
    pub(crate) history: Vec<String>,
    pub(crate) digest: Option<String>,
}

/// What calibration saw of every value of the network, and how to choose ranges from it.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// Per value, in the order of [`Graph::values`].
    pub observed: Vec<Observed>,
    /// How ranges are chosen.
    pub choice: RangeChoice,
    /// 0: one range per value; 1: a range of its own for every channel; between: see [`Observed::channel_ranges`].
    pub own_ranges: f32,
    /// Correct biases for the mean error of rounded weights.
    pub correct_bias: bool,
    /// Pictures seen, for the file's record.
    pub pictures: usize,
    /// Pictures left out because the network runs wild on them.
    pub left_out: usize,
}

fn read_file(path: &Path) -> Result<Vec<u8>, ModelError> {
    bounded::read(path, bounded::DATA).map_err(|source| ModelError::Io {
        action: "read",
        path: path.into(),
        source,
    })
}

/// Which values have one range for all channels: those that a residual sum makes or adds, since it has one factor, and
/// what pools make such a value of, since they store what they read.
fn summed(graph: &Graph) -> Vec<bool> {
    let mut summed = vec![false; graph.values.len()];
    // What reads a value comes behind what writes it.
    for node in graph.nodes.iter().rev() {
        if let Some(added) = node.residual {
            summed[added] = true;
            summed[node.output] = true;
        }
        if matches!(node.op, Op::MaxPool { .. }) && summed[node.output] {
            summed[node.inputs[0]] = true;
        }
    }
    summed
}

/// The metadata that says what float weights mean.
const CONTRACT: &str = "contract";

fn contract_of<'a>(t: &'a Tensors<'_>) -> Result<&'a str, ModelError> {
    t.metadata(CONTRACT).ok_or_else(|| ModelError::Contract {
        key: CONTRACT.into(),
        expected: "metadata that says what the weights mean (`edgecap model contract` prints it, models/train/convert.py puts it there)".into(),
        found: "none".into(),
    })
}

impl Model {
    /// Reads a model file (`.ecm`).
    ///
    /// # Errors
    /// [`ModelError::Io`] where the file cannot be read; those of [`from_bytes`](Self::from_bytes).
    pub fn open(path: &Path) -> Result<Self, ModelError> {
        Self::from_bytes(&read_file(path)?)
    }

    /// Reads the bytes of a model file: digest, names, shapes and ranges are checked.
    ///
    /// # Errors
    /// [`Damaged`](ModelError::Damaged), [`Digest`](ModelError::Digest) or [`Checkpoint`](ModelError::Checkpoint) where
    /// the bytes are no whole model file, [`Floats`](ModelError::Floats) where they are weights to import,
    /// [`Newer`](ModelError::Newer) where a later version wrote them. [`Contract`](ModelError::Contract),
    /// [`Network`](ModelError::Network), [`Missing`](ModelError::Missing), [`Tensor`](ModelError::Tensor),
    /// [`Values`](ModelError::Values) or [`Unused`](ModelError::Unused) where this program cannot run what they hold.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        file::read(bytes)
    }

    /// The weights that ship with the program.
    ///
    /// # Errors
    /// [`ModelError::NotShipped`] in a build without weights; those of [`from_bytes`](Self::from_bytes).
    pub fn shipped() -> Result<Self, ModelError> {
        match shipped::BYTES {
            Some(bytes) => Self::from_bytes(bytes),
            None => Err(ModelError::NotShipped),
        }
    }

    /// BLAKE3 digest of the file that ships with the program.
    ///
    /// # Errors
    /// [`ModelError::NotShipped`] in a build without weights.
    pub fn shipped_digest() -> Result<String, ModelError> {
        let bytes = shipped::BYTES.ok_or(ModelError::NotShipped)?;
        Ok(blake3::hash(bytes).to_hex().to_string())
    }

    /// Imports PyTorch weights in safetensors for `network`; they stay floats until [`quantise`](Self::quantise).
    ///
    /// # Errors
    /// [`Damaged`](ModelError::Damaged) or [`Checkpoint`](ModelError::Checkpoint) where the bytes are no safetensors;
    /// one of those that [`mismatches`](Self::mismatches) lists where they are not weights of `network`.
    pub fn from_safetensors(bytes: &[u8], network: Network) -> Result<Self, ModelError> {
        let mut t = Tensors::parse(bytes)?;
        let contract = Contract::parse(contract_of(&t)?, &network)?;
        let convs = float::import(&mut t, &network, &contract)?;
        t.finish(is_counter)?;
        let history = vec![format!(
            "imported safetensors with digest {}",
            blake3::hash(bytes).to_hex()
        )];
        Ok(Self {
            network,
            contract,
            weights: Weights::Float(convs),
            stage2: None,
            association: None,
            calibration: "none".into(),
            history,
            digest: None,
        })
    }

    /// Opens a model file or safetensors, whichever `path` is; `network` is for the latter.
    ///
    /// # Errors
    /// [`ModelError::Io`] where the file cannot be read; those of [`from_any`](Self::from_any).
    pub fn open_any(path: &Path, network: Network) -> Result<Self, ModelError> {
        Self::from_any(&read_file(path)?, network)
    }

    /// As [`open_any`](Self::open_any), of a file's bytes.
    ///
    /// # Errors
    /// Those of [`from_bytes`](Self::from_bytes) or [`from_safetensors`](Self::from_safetensors).
    pub fn from_any(bytes: &[u8], network: Network) -> Result<Self, ModelError> {
        match Self::is_model_file(bytes)? {
            true => Self::from_bytes(bytes),
            false => Self::from_safetensors(bytes, network),
        }
    }

    /// Whether a file's bytes are a model file's, and not other safetensors'.
    ///
    /// # Errors
    /// [`Damaged`](ModelError::Damaged) or [`Checkpoint`](ModelError::Checkpoint) where the bytes are no safetensors.
    pub fn is_model_file(bytes: &[u8]) -> Result<bool, ModelError> {
        Ok(file::is_model(&Tensors::parse(bytes)?))
    }

    /// Adds Stage II from the training recipe's safetensors.
    ///
    /// # Errors
    /// Those of [`Stage2::from_safetensors`].
    pub fn with_stage2(mut self, bytes: &[u8]) -> Result<Self, ModelError> {
        self.stage2 = Some(Stage2::from_safetensors(bytes)?);
        self.history.push(format!(
            "stage II from safetensors with digest {}",
            blake3::hash(bytes).to_hex()
        ));
        Ok(self)
    }

    /// Adds settings of the association that were fitted to these weights, TOML as in `models/association.toml`. They
    /// are not read here: whoever associates knows what they mean.
    pub fn with_association(mut self, text: String) -> Self {
        self.history.push(format!(
            "association with digest {}",
            blake3::hash(text.as_bytes()).to_hex()
        ));
        self.association = Some(text);
        self
    }

    /// Rounds float weights to int8 with ranges from calibration, or from the weights' own contract.
    ///
    /// # Errors
    /// [`ModelError::NoRange`] where there is no calibration and the contract has no range of some layer. int8 weights
    /// are left as they are.
    pub fn quantise(mut self, calibration: Option<&Calibration>) -> Result<Self, ModelError> {
        let Weights::Float(floats) = &self.weights else {
            return Ok(self);
        };
        let graph = self.network.graph();
        let mut scales: Vec<Option<Scale>> = vec![None; graph.values.len()];
        scales[Graph::INPUT] = Some(Scale::picture());
        let is_output = |v| graph.outputs.iter().any(|(_, o)| *o == v);
        let is_summed = summed(graph);
        for node in &graph.nodes {
            if is_output(node.output) {
                continue;
            }
            scales[node.output] = match &node.op {
                Op::MaxPool { .. } => scales[node.inputs[0]].clone(),
                Op::Conv { relu, shape, .. } => {
                    let levels = if *relu {
                        ACTIVATION_LEVELS
                    } else {
                        SIGNED_LEVELS
                    };
                    let ranges = match calibration {
                        Some(c) => {
                            let own = if is_summed[node.output] {
                                0.0
                            } else {
                                c.own_ranges
                            };
                            c.observed[node.output].channel_ranges(c.choice, levels, own)
                        }
                        None => vec![self.contract_range(&node.name)?; shape.out_channels()],
                    };
                    Some(if *relu {
                        Scale::unsigned(&ranges)
                    } else {
                        Scale::signed(&ranges)
                    })
                }
            };
        }
        let correct = calibration.filter(|c| c.correct_bias);
        let convs = graph.nodes.iter().zip(floats).map(|(node, conv)| {
            let means: Option<Vec<f32>> = correct.map(|c| {
                let of = |&v: &usize| c.observed[v].means();
                node.inputs.iter().flat_map(of).collect()
            });
            let round = |c| quant::quantise(node, c, &scales, means.as_deref());
            conv.as_ref().map(round)
        });
        let convs = convs.collect();
        self.calibration = match calibration {
            Some(c) => format!(
                "{}, channels' own share {}, over {} pictures ({} wild ones left out){}",
                c.choice,
                c.own_ranges,
                c.pictures,
                c.left_out,
                if c.correct_bias {
                    ", biases corrected"
                } else {
                    ""
                }
            ),
            None => "ranges of the training recipe".into(),
        };
        self.history
            .push(format!("quantised: {}", self.calibration));
        self.weights = Weights::Int8 { convs, scales };
        Ok(self)
    }

    fn contract_range(&self, node: &str) -> Result<f32, ModelError> {
        let ranges = self.contract.activation_max.as_ref();
        match ranges.and_then(|r| r.get(&format!("{node}.2"))) {
            Some(r) if *r > 0.0 && r.is_finite() => Ok(*r),
            _ => Err(ModelError::NoRange(node.into())),
        }
    }

    /// The bytes of a model file.
    ///
    /// # Errors
    /// [`ModelError::NoRange`] where the weights are floats.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelError> {
        file::write(self)
    }

    /// Writes a model file beside `path`, then renames it.
    ///
    /// # Errors
    /// [`ModelError::NoRange`] where the weights are floats, [`ModelError::Io`] where the file cannot be written; those
    /// of [`from_bytes`](Self::from_bytes) where the file could not be read again. `path` is as it was then.
    pub fn save(&self, path: &Path) -> Result<(), ModelError> {
        file::save(self, path)
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// What the weights mean.
    pub fn contract(&self) -> &Contract {
        &self.contract
    }

    /// The weights.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// Whether the weights are int8.
    pub fn is_quantised(&self) -> bool {
        matches!(self.weights, Weights::Int8 { .. })
    }

    /// Stage II's layers, where the file has them.
    pub fn stage2(&self) -> Option<&Stage2> {
        self.stage2.as_ref()
    }

    /// Settings of the association that the file has of its own.
    pub fn association(&self) -> Option<&str> {
        self.association.as_deref()
    }

    /// Whether the 3D head was trained; where not, Stage II must be fed zeros in place of encodings.
    pub fn encodings_trained(&self) -> bool {
        self.contract.encodings_trained
    }

    /// How activation ranges were found.
    pub fn calibration(&self) -> &str {
        &self.calibration
    }

    /// What was done to the weights, oldest first.
    pub fn history(&self) -> &[String] {
        &self.history
    }

    /// BLAKE3 digest in the file it was read from.
    pub fn digest(&self) -> Option<&str> {
        self.digest.as_deref()
    }
}

//! What weights mean, as their exporter wrote it into the file's metadata; what this program does not know is refused.

use std::collections::BTreeMap;

use edgecap_client::joints::{
    BODY_JOINTS, CANONICAL_STATURE, EVIDENCE_JOINTS, JOINT_NAMES, LIMB_JOINTS, PARENTS,
};
use serde::{Deserialize, Serialize};

use super::ModelError;
use super::completed::completed;
use crate::engine::Maps;
use crate::engine::network::Network;

const FRAME: &str = "x right, y down, z forward, metres, relative to the pelvis, person rescaled to canonical_stature_m";
const VIEW_ALIGNED: &str = "; view-aligned: turn by the least rotation that takes +z to the viewing ray through the neck to get camera axes";
const CELL_CENTRE: &str = "px = 8*c + 3.5 (pixel centres are integers)";
const FORMULA: &str = "x/255-0.5";
const STAGE2_INPUT: &str = "14 x (u, v, confidence, 63 encodings), joint after joint; all zero where a joint is not seen. (u, v): pixels relative to the neck, divided by the RMS distance of the seen joints from it";
const STAGE2_OUTPUT: &str = "21 x (x, y, z) metres";
const HEAD2D: &str =
    "0..13 heatmaps (peak 1), then 13 x (dx, dy): unit vector child -> parent, of `limbs`";
const HEAD3D: &str =
    "21 x (x, y, z): joint minus its parent, metres, read at the joints in bones_at";
/// In a template, for whoever trained the weights.
const ORIGIN: &str = "say here on what, and under which terms";
/// Steps of a 7-bit activation.
pub const ACTIVATION_LEVELS: u32 = 127;

/// What both stages' weights say about themselves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Common {
    /// Training steps taken.
    pub step: u64,
    /// Pictures (or poses) seen in training.
    pub images: u64,
    /// Trained with rounding in the loop.
    pub quantised: bool,
    /// Evidence joints.
    pub joints: Vec<String>,
    /// Body joints.
    pub joints3d: Vec<String>,
    /// Parent of every body joint.
    pub parents3d: Vec<usize>,
    /// Stature that 3D outputs are scaled to, metres.
    pub canonical_stature_m: f32,
    /// Frame of 3D outputs.
    pub frame3d: String,
    /// Data and terms.
    pub trained_on: String,
    /// Added to the variance in batch norm.
    pub batchnorm_eps: f32,
}

/// Contract of Stage I's weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Contract {
    /// What both stages say.
    #[serde(flatten)]
    pub common: Common,
    /// The picture that goes in.
    pub input: Input,
    /// Input pixels per cell of the maps.
    pub stride: usize,
    /// Where cells lie.
    pub cell_centre: String,
    /// (child, parent) of every part affinity field.
    pub limbs: Vec<(usize, usize)>,
    /// Module table of SelecSLS networks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub modules: Option<Vec<[usize; 5]>>,
    /// Rule of the groups, for people; shapes are checked against the network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub groups3x3: Option<String>,
    /// Channels of the heads, for people.
    pub outputs: BTreeMap<String, String>,
    /// Bones that are supervised at each evidence joint.
    pub bones_at: Vec<Vec<usize>>,
    /// Greatest activation of every ReLU, by PyTorch module name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activation_max: Option<BTreeMap<String, f32>>,
    /// Bits of activations in training with rounding.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub activation_bits: Option<u32>,
    /// Whether the 3D head was trained; where false, its output is noise and Stage II must not see it.
    #[serde(default = "yes")]
    pub encodings_trained: bool,
    #[serde(flatten, skip_serializing)]
    unknown: BTreeMap<String, serde_json::Value>,
}

/// The picture that goes in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Memory order in training.
    pub layout: String,
    /// Channel order.
    pub colour: String,
    /// From bytes to the network's numbers.
    pub formula: String,
    /// Width and height are multiples of it.
    pub size_multiple: usize,
    /// Width and height trained for, pixels.
    pub reference_size: [usize; 2],
}

/// Contract of Stage II's weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage2Contract {
    /// What both stages say.
    #[serde(flatten)]
    pub common: Common,
    /// Order and units of the input.
    pub input: String,
    /// Order and units of the output.
    pub output: String,
    /// Held-out errors, for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub report: Option<serde_json::Value>,
    #[serde(flatten, skip_serializing)]
    unknown: BTreeMap<String, serde_json::Value>,
}

fn yes() -> bool {
    true
}

/// A mismatch, unless both are the same.
fn expect<T: PartialEq + std::fmt::Debug>(key: &str, expected: T, found: &T) -> Option<ModelError> {
    (expected != *found).then(|| ModelError::Contract {
        key: key.into(),
        expected: format!("{expected:?}"),
        found: format!("{found:?}"),
    })
}

fn unknown_keys(
    unknown: &BTreeMap<String, serde_json::Value>,
) -> impl Iterator<Item = ModelError> + '_ {
    unknown.iter().map(|(key, value)| ModelError::Contract {
        key: key.clone(),
        expected: "no such key".into(),
        found: value.to_string().chars().take(80).collect(),
    })
}

fn first(mismatches: Vec<ModelError>) -> Result<(), ModelError> {
    mismatches.into_iter().next().map_or(Ok(()), Err)
}

impl Common {
    fn mismatches(&self) -> impl Iterator<Item = ModelError> {
        let names = |n: usize| JOINT_NAMES[..n].iter().map(|s| s.to_string()).collect();
        let is_small = self.batchnorm_eps > 0.0 && self.batchnorm_eps < 0.1;
        let eps = (!is_small).then(|| ModelError::Contract {
            key: "batchnorm_eps".into(),
            expected: "a small positive number".into(),
            found: self.batchnorm_eps.to_string(),
        });
        let all = [
            expect("joints", names(EVIDENCE_JOINTS), &self.joints),
            expect("joints3d", names(BODY_JOINTS), &self.joints3d),
            expect("parents3d", PARENTS.to_vec(), &self.parents3d),
            expect(
                "canonical_stature_m",
                CANONICAL_STATURE,
                &self.canonical_stature_m,
            ),
            expect("frame3d", format!("{FRAME}{VIEW_ALIGNED}"), &self.frame3d),
            eps,
        ];
        all.into_iter().flatten()
    }

    /// A contract that says what this program computes, for weights made here (random ones of tests and speed
    /// measurements).
    fn ours(origin: &str) -> Self {
        let names = |n: usize| JOINT_NAMES[..n].iter().map(|s| s.to_string()).collect();
        Self {
            step: 0,
            images: 0,
            quantised: false,
            joints: names(EVIDENCE_JOINTS),
            joints3d: names(BODY_JOINTS),
            parents3d: PARENTS.to_vec(),
            canonical_stature_m: CANONICAL_STATURE,
            frame3d: format!("{FRAME}{VIEW_ALIGNED}"),
            trained_on: origin.into(),
            batchnorm_eps: 1e-5,
        }
    }
}

impl Contract {
    /// Reads the JSON of the `contract` metadata and checks that this program computes what it says with `network`.
    ///
    /// # Errors
    /// The first of [`read`](Self::read)'s.
    pub fn parse(json: &str, network: &Network) -> Result<Self, ModelError> {
        Self::read(json, network).map_err(|mut all| all.swap_remove(0))
    }

    /// As [`parse`](Self::parse).
    ///
    /// # Errors
    /// Everything that is missing, of another type, unknown, or not what this program computes.
    pub fn read(json: &str, network: &Network) -> Result<Self, Vec<ModelError>> {
        let (contract, mut all) = completed(json, &Self::template(network));
        let Some(contract) = contract else {
            return Err(all);
        };
        all.extend(contract.mismatches(network));
        match all.is_empty() {
            true => Ok(contract),
            false => Err(all),
        }
    }

    pub(crate) fn check(&self, network: &Network) -> Result<(), ModelError> {
        first(self.mismatches(network))
    }

    fn mismatches(&self, network: &Network) -> Vec<ModelError> {
        let (input, multiple) = (&self.input, network.input().multiple);
        let modules = self.modules.as_ref();
        let few = self.bones_at.len() != EVIDENCE_JOINTS;
        let bones = (few || self.bones_at.iter().flatten().any(|&b| b >= BODY_JOINTS)).then(|| {
            ModelError::Contract {
                key: "bones_at".into(),
                expected: format!("{EVIDENCE_JOINTS} lists of bones below {BODY_JOINTS}"),
                found: format!("{:?}", self.bones_at),
            }
        });
        let is_side = |side: &usize| (1..=Maps::MOST_SIDE).contains(side);
        let size = (!input.reference_size.iter().all(is_side)).then(|| ModelError::Contract {
            key: "input.reference_size".into(),
            expected: format!("a width and a height of 1 to {} pixels", Maps::MOST_SIDE),
            found: format!("{:?}", input.reference_size),
        });
        let all = [
            expect("input.layout", "NCHW".into(), &input.layout),
            expect("input.colour", "RGB".into(), &input.colour),
            expect("input.formula", FORMULA.into(), &input.formula),
            expect("input.size_multiple", multiple, &input.size_multiple),
            size,
            expect("stride", Maps::STRIDE, &self.stride),
            expect("cell_centre", CELL_CENTRE.into(), &self.cell_centre),
            expect("limbs", LIMB_JOINTS.to_vec(), &self.limbs),
            modules.and_then(|m| expect("modules", network.modules().to_vec(), m)),
            bones,
            self.activation_bits
                .and_then(|bits| expect("activation_bits", 7, &bits)),
        ];
        unknown_keys(&self.unknown)
            .chain(self.common.mismatches())
            .chain(all.into_iter().flatten())
            .collect()
    }

    /// A contract that says what this program computes; `origin` tells where the weights come from.
    pub(crate) fn ours(origin: &str, network: &Network) -> Self {
        Self {
            common: Common::ours(origin),
            input: Input {
                layout: "NCHW".into(),
                colour: "RGB".into(),
                formula: FORMULA.into(),
                size_multiple: network.input().multiple,
                reference_size: [512, 320],
            },
            stride: Maps::STRIDE,
            cell_centre: CELL_CENTRE.into(),
            limbs: LIMB_JOINTS.to_vec(),
            modules: None,
            groups3x3: None,
            outputs: BTreeMap::new(),
            bones_at: vec![Vec::new(); EVIDENCE_JOINTS],
            activation_max: None,
            activation_bits: None,
            encodings_trained: false,
            unknown: BTreeMap::new(),
        }
    }

    /// What weights of `network` must say to be imported; whoever trained them fills in what is theirs to tell.
    pub fn template(network: &Network) -> Self {
        let at = |joint| (0..BODY_JOINTS).filter(move |&b| b == joint || PARENTS[b] == joint);
        let modules = network.modules().to_vec();
        let outputs = [("head2d", HEAD2D), ("head3d", HEAD3D)];
        Self {
            modules: (!modules.is_empty()).then_some(modules),
            outputs: outputs.map(|(k, v)| (k.into(), v.into())).into(),
            bones_at: (0..EVIDENCE_JOINTS).map(|j| at(j).collect()).collect(),
            encodings_trained: true,
            ..Self::ours(ORIGIN, network)
        }
    }
}

impl Stage2Contract {
    /// Reads the JSON of the `contract` metadata and checks that this program computes what it says.
    ///
    /// # Errors
    /// The first of [`read`](Self::read)'s.
    pub fn parse(json: &str) -> Result<Self, ModelError> {
        Self::read(json).map_err(|mut all| all.swap_remove(0))
    }

    /// As [`parse`](Self::parse).
    ///
    /// # Errors
    /// Everything that is missing, of another type, unknown, or not what this program computes.
    pub fn read(json: &str) -> Result<Self, Vec<ModelError>> {
        let (contract, mut all) = completed(json, &Self::template());
        let Some(contract) = contract else {
            return Err(all);
        };
        all.extend(contract.mismatches());
        match all.is_empty() {
            true => Ok(contract),
            false => Err(all),
        }
    }

    pub(crate) fn check(&self) -> Result<(), ModelError> {
        first(self.mismatches())
    }

    fn mismatches(&self) -> Vec<ModelError> {
        let all = [
            expect("input", STAGE2_INPUT.into(), &self.input),
            expect("output", STAGE2_OUTPUT.into(), &self.output),
        ];
        unknown_keys(&self.unknown)
            .chain(self.common.mismatches())
            .chain(all.into_iter().flatten())
            .collect()
    }

    /// What weights of Stage II must say to be imported; whoever trained them fills in what is theirs to tell.
    pub fn template() -> Self {
        Self {
            common: Common::ours(ORIGIN),
            input: STAGE2_INPUT.into(),
            output: STAGE2_OUTPUT.into(),
            report: None,
            unknown: BTreeMap::new(),
        }
    }
}

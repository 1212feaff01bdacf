//! Other people's weights: what they must say of themselves, and everything that is wrong with them at once.

mod calibration;
mod contracts;
mod files;
mod import;

use std::collections::HashMap;
use std::process::{Command, Output};

use edgecap::engine::Network;
use edgecap::engine::model::Contract;
use edgecap::engine::network::Op;
use safetensors::tensor::{Dtype, TensorView};
use serde_json::Value;

/// Shapes of all tensors that a network's state dict has, by name.
fn shapes(network: &Network) -> HashMap<String, Vec<usize>> {
    let mut shapes = HashMap::new();
    for node in &network.graph().nodes {
        let Op::Conv { shape, params, .. } = &node.op else {
            continue;
        };
        let (k, out, inputs) = (shape.kernel(), shape.out_channels(), shape.in_channels());
        let weight = match shape.transposed() {
            true => vec![inputs, out / shape.groups(), k, k],
            false => vec![out, inputs / shape.groups(), k, k],
        };
        shapes.insert(params.weight.clone(), weight);
        if let Some(bias) = &params.bias {
            shapes.insert(bias.clone(), vec![out]);
        }
        if let Some(norm) = &params.norm {
            for part in ["weight", "bias", "running_mean", "running_var"] {
                shapes.insert(format!("{norm}.{part}"), vec![out]);
            }
        }
    }
    shapes
}

/// Safetensors of zeros.
fn file(shapes: &HashMap<String, Vec<usize>>, contract: Option<&Value>) -> Vec<u8> {
    let most = shapes.values().map(|s| s.iter().product::<usize>()).max();
    let zeros = vec![0_u8; 4 * most.unwrap_or(0)];
    let views = shapes.iter().map(|(name, shape)| {
        let bytes = 4 * shape.iter().product::<usize>();
        let view = TensorView::new(Dtype::F32, shape.clone(), &zeros[..bytes]).unwrap();
        (name.as_str(), view)
    });
    let metadata = contract.map(|c| HashMap::from([("contract".into(), c.to_string())]));
    safetensors::serialize(views, metadata).unwrap()
}

fn template(network: &Network) -> Value {
    serde_json::to_value(Contract::template(network)).unwrap()
}

fn edgecap(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_edgecap"))
        .args(args)
        .output()
        .unwrap()
}

fn lines(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    text.lines().map(ToOwned::to_owned).collect()
}

/// A layer at an eighth of the picture, and both heads.
const SMALL: &str = r#"
    name = "small"
    about = "calibrated in no time"
    input = { channels = 3, multiple = 16 }
    output = { head2d = "head2d.out", head3d = "head3d.out" }
    layers = [
      { kind = "conv", name = "core", out = 4, kernel = 1, stride = 8 },
      { kind = "conv", name = "head2d.out", out = 40, kernel = 1, norm = false, relu = false },
      { kind = "conv", name = "head3d.out", from = ["core"], out = 63, kernel = 1, norm = false, relu = false },
    ]
"#;

/// A network of its own in a folder, its file and weights of zeros for it.
struct Own {
    folder: tempfile::TempDir,
    arch: String,
    weights: String,
}

impl Own {
    fn new(text: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let network = Network::parse(text).unwrap();
        let (arch, weights) = (path("own.toml"), path("w"));
        std::fs::write(&arch, text).unwrap();
        let bytes = file(&shapes(&network), Some(&template(&network)));
        std::fs::write(&weights, bytes).unwrap();
        Self {
            folder,
            arch,
            weights,
        }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn import(&self, more: &[&str]) -> Output {
        let own = ["model", "import", &self.weights, "--arch", &self.arch];
        edgecap(&[&own[..], more].concat())
    }
}

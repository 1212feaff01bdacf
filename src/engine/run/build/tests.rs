//! Weights that trained networks have and random ones do not, and those that only a mistake makes.

use std::thread::Builder;

use edgecap_kernels::{Algorithm, Algorithms};

use super::shared_out;
use crate::engine::model::{Calibration, Weights};
use crate::engine::{
    CalibrationOptions, Engine, EngineError, EngineOptions, Maps, Model, Network, Precision,
};

const SIZE: (usize, usize) = (48, 32);

/// A block with a downsample, whose output is signed and added, and one without.
fn network() -> Network {
    let text = r#"
        name = "small"
        about = "residual sums"
        input = { channels = 3, multiple = 16 }
        output = { head2d = "head2d.out", head3d = "head3d.out" }
        layers = [
          { kind = "conv", name = "stem", out = 8, kernel = 3, stride = 2 },
          { kind = "conv", name = "down", out = 8, kernel = 3, stride = 2 },
          { kind = "bottlenecks", name = "res", width = 8, out = 16, blocks = 2, stride = 2 },
          { kind = "conv", name = "head2d.out", out = 40, kernel = 1, norm = false, relu = false },
          { kind = "conv", name = "head3d.out", from = ["res"], out = 63, kernel = 1, norm = false, relu = false },
        ]
    "#;
    Network::parse(text).unwrap()
}

fn picture(seed: usize) -> Vec<u8> {
    let wave = |i: usize| (i as f32 / (11.0 + seed as f32)).sin();
    (0..3 * SIZE.0 * SIZE.1)
        .map(|i| (128.0 + 100.0 * wave(i)) as u8)
        .collect()
}

fn quantised(model: &Model) -> Model {
    let options = CalibrationOptions {
        size: SIZE,
        ..CalibrationOptions::default()
    };
    let calibration = Calibration::observe(model, (0..4).map(picture), options).unwrap();
    model.clone().quantise(Some(&calibration)).unwrap()
}

fn engine(model: &Model, precision: Precision) -> Result<Engine, EngineError> {
    let options = EngineOptions {
        width: SIZE.0,
        height: SIZE.1,
        threads: 1,
        precision,
        ..EngineOptions::default()
    };
    Engine::new(model, options)
}

/// Number of the node of this name.
fn node(model: &Model, name: &str) -> usize {
    let nodes = &model.network.graph().nodes;
    nodes.iter().position(|n| n.name == name).unwrap()
}

#[test]
fn channels_with_hardly_any_weight_are_near_f32_beside_signed_values() {
    for layers in [
        &["res.0.downsample"][..],
        &["res.0.conv3"],
        &["res.1.conv3"],
        &["res.0.downsample", "res.0.conv3"],
    ] {
        // Batch norm's gamma of such a channel is 0, or nearly.
        for factor in [0.0, 1e-9] {
            let mut model = Model::random(network(), 3);
            for layer in layers {
                let node = node(&model, layer);
                let Weights::Float(convs) = &mut model.weights else {
                    panic!("random weights are floats");
                };
                let conv = convs[node].as_mut().unwrap();
                let per = conv.weight.len() / conv.bias.len();
                for (o, bias) in [(3, 0.0), (5, 0.1), (6, -0.1)] {
                    let row = &mut conv.weight[o * per..(o + 1) * per];
                    row.iter_mut().for_each(|w| *w *= factor);
                    conv.bias[o] = bias;
                }
            }
            let numbers = |maps: &Maps| [&maps.head2d[..], &maps.head3d[..]].concat();
            let mut float = engine(&model, Precision::F32).unwrap();
            let expected = numbers(float.run(&picture(9)));
            let mut int8 = engine(&quantised(&model), Precision::Int8).unwrap();
            let found = numbers(int8.run(&picture(9)));
            let squares =
                |values: &mut dyn Iterator<Item = f32>| values.map(|v| v * v).sum::<f32>();
            let off = squares(&mut expected.iter().zip(&found).map(|(a, b)| a - b));
            let error = (off / squares(&mut expected.iter().copied())).sqrt();
            assert!(error < 0.1, "{layers:?} times {factor}: {error}");
        }
    }
}

#[test]
fn biases_that_no_accumulator_holds_are_refused() {
    let mut model = quantised(&Model::random(network(), 3));
    let down = node(&model, "down");
    let Weights::Int8 { convs, .. } = &mut model.weights else {
        panic!("quantised weights are int8");
    };
    let conv = convs[down].as_mut().unwrap();
    let per = conv.weight.len() / conv.bias.len();
    // Without weights nothing but the bias fills the accumulator.
    conv.weight[2 * per..3 * per].fill(0);
    (conv.scale[2], conv.bias[2]) = (1e-12, 0.1);
    let said = engine(&model, Precision::Int8).err().unwrap().to_string();
    assert!(
        said.contains("layer `down`") && said.contains("found 1.00e11 steps"),
        "{said}"
    );
}

#[test]
fn a_small_network_that_asks_for_much_memory_is_refused() {
    // A weight of a group of one output is padded to vectors of them.
    let text = r#"
        name = "wide"
        about = "four million weights"
        input = { channels = 3, multiple = 16 }
        output = { head2d = "head2d.out" }
        layers = [
          { kind = "conv", name = "stem", out = 1024, kernel = 1, stride = 16 },
          { kind = "conv", name = "wide", out = 1024, kernel = 64, groups = 1024 },
          { kind = "conv", name = "head2d.out", out = 40, kernel = 1, norm = false, relu = false },
        ]
    "#;
    let model = Model::random(Network::parse(text).unwrap(), 1);
    let said = engine(&model, Precision::F32).err().unwrap();
    assert!(matches!(said, EngineError::Packed { .. }), "{said}");
}

#[test]
fn shipped_networks_are_all_definition_where_that_is_chosen() {
    for name in Network::names() {
        let network = Network::shipped(name).unwrap();
        for node in &network.graph().nodes {
            let taken = node.conv().map(|shape| Algorithms::Direct.of(shape));
            assert!(
                taken.is_none_or(|taken| taken == Algorithm::Direct),
                "{name}: {}",
                node.name
            );
        }
    }
}

/// A stack that no machine has room for stands in for a system that starts no more threads.
#[test]
fn layers_are_packed_without_threads_that_cannot_be_had() {
    let none = || Builder::new().stack_size(1 << 60);
    assert!(none().spawn(|| ()).is_err());
    let expected: Vec<usize> = (0..100).map(|i| 3 * i).collect();
    for threads in [0, 1, 4] {
        assert_eq!(shared_out(100, threads, none, |i| 3 * i), expected);
        assert_eq!(shared_out(100, threads, Builder::new, |i| 3 * i), expected);
    }
    assert!(shared_out(0, 4, Builder::new, |i| i).is_empty());
}

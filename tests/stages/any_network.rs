//! Networks that nobody has designed, layers of all kinds read and joined at random, against a reference in which every
//! value has memory of its own: where buffers are shared that may not be, numbers differ.

use std::collections::HashSet;

use edgecap::engine::model::{Calibration, RangeChoice, Weights};
use edgecap::engine::{
    CalibrationOptions, Engine, EngineError, EngineOptions, Maps, Model, Network, Precision,
};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use crate::engine::error;
use crate::tiny_network::{naive, picture};

/// Of pictures. Tiles of kernels end with the rows and columns of one, and not with those of the other.
const SIZES: [(usize, usize); 2] = [(64, 32), (56, 40)];
/// Networks that are tried.
const NETWORKS: u64 = 40;
/// Layers of one besides its heads, at most.
const LAYERS: usize = 12;
/// What the heads' size is to the picture's.
const SCALE: usize = 8;

/// A layer that others may read.
#[derive(Clone)]
struct Layer {
    name: String,
    /// How many times smaller than the picture it is.
    scale: usize,
    channels: usize,
    is_positive: bool,
}

/// A network in the making.
struct Draft {
    random: SmallRng,
    layers: Vec<Layer>,
    /// Layers that some layer reads beside others.
    joined: HashSet<String>,
    text: String,
}

impl Draft {
    fn of(seed: u64) -> String {
        let input = Layer {
            name: "input".into(),
            scale: 1,
            channels: 3,
            is_positive: false,
        };
        let mut draft = Self {
            random: SmallRng::seed_from_u64(seed),
            layers: vec![input],
            joined: HashSet::new(),
            text: String::new(),
        };
        for _ in 0..draft.random.random_range(3..=LAYERS) {
            draft.layer();
        }
        while draft.layers.iter().all(|layer| layer.scale < SCALE) {
            draft.layer();
        }
        let last: Vec<Layer> = draft.at(SCALE);
        for (head, channels) in [("head2d", 40), ("head3d", 63)] {
            let from = draft.some_of(&last);
            let whole = format!("out = {channels}, kernel = 1, norm = false, relu = false");
            draft.text +=
                &format!(r#"{{ kind = "conv", name = "{head}.out", from = {from:?}, {whole} }},"#);
        }
        format!(
            r#"
            name = "any"
            about = "made at random"
            input = {{ channels = 3, multiple = 8 }}
            output = {{ head2d = "head2d.out", head3d = "head3d.out" }}
            layers = [{}]
            "#,
            draft.text
        )
    }

    /// Layers of this scale.
    fn at(&self, scale: usize) -> Vec<Layer> {
        let those = self.layers.iter().filter(|layer| layer.scale == scale);
        those.cloned().collect()
    }

    /// Names of one to three of these layers. One that has been joined is seldom joined again: that needs the same
    /// place in both, or a copy.
    fn some_of(&mut self, layers: &[Layer]) -> Vec<String> {
        let count = match self.random.random_bool(0.5) {
            true => 1,
            false => self.random.random_range(2..=3),
        };
        let mut some = Vec::new();
        for _ in 0..count {
            let one = &layers[self.random.random_range(0..layers.len())].name;
            let is_free = !self.joined.contains(one) || self.random.random_bool(0.2);
            if !some.contains(one) && (some.is_empty() || is_free) {
                some.push(one.clone());
            }
        }
        if some.len() > 1 {
            self.joined.extend(some.iter().cloned());
        }
        some
    }

    fn channels(&mut self, names: &[String]) -> usize {
        let of = |name: &String| self.layers.iter().find(|layer| layer.name == *name);
        names
            .iter()
            .filter_map(of)
            .map(|layer| layer.channels)
            .sum()
    }

    /// Adds a layer of any kind.
    fn layer(&mut self) {
        let name = format!("l{}", self.layers.len());
        let newest = self.layers.len() - 1;
        let first = self.random.random_range(newest.saturating_sub(3)..=newest);
        let Layer { scale, .. } = self.layers[first];
        let here = self.at(scale);
        let mut from = self.some_of(&here);
        let stride = match scale < SCALE && self.random.random_bool(0.5) {
            true => 2,
            false => 1,
        };
        let mut channels = self.random.random_range(1..=9);
        let mut is_positive = true;
        let mut scale_after = scale * stride;
        let layer = match self.random.random_range(0..8) {
            0 if scale > 1 => {
                scale_after = scale / 2;
                format!(r#"kind = "deconv", out = {channels}, kernel = 4, stride = 2"#)
            }
            1 if here.iter().any(|layer| layer.is_positive) => {
                let positive: Vec<Layer> = here.into_iter().filter(|l| l.is_positive).collect();
                let one = &positive[self.random.random_range(0..positive.len())];
                (channels, from) = (one.channels, vec![one.name.clone()]);
                format!(r#"kind = "maxpool", kernel = 3, stride = {stride}"#)
            }
            2 => {
                let width = self.random.random_range(1..=6);
                let blocks = self.random.random_range(1..=2);
                format!(
                    r#"kind = "bottlenecks", width = {width}, out = {channels}, blocks = {blocks}, stride = {stride}"#
                )
            }
            3 => {
                let (cin, k) = (self.channels(&from), 2 * self.random.random_range(1..=4));
                let first = [cin, 0, k, channels, stride];
                let second = [channels, channels, k, channels, 1];
                format!(r#"kind = "selecsls", modules = [{first:?}, {second:?}]"#)
            }
            _ => {
                let kernel = [1, 3, 3, 5, 7][self.random.random_range(0..5)];
                is_positive = self.random.random_bool(0.7);
                let own = self.channels(&from);
                let groups = match own {
                    2 | 4 | 6 | 8 if self.random.random_bool(0.5) => 2,
                    _ => 1,
                };
                channels = channels.next_multiple_of(groups);
                let whole = format!("out = {channels}, kernel = {kernel}, stride = {stride}");
                format!(r#"kind = "conv", {whole}, groups = {groups}, relu = {is_positive}"#)
            }
        };
        self.text += &format!(r#"{{ name = "{name}", from = {from:?}, {layer} }},"#);
        self.layers.push(Layer {
            name,
            scale: scale_after,
            channels,
            is_positive,
        });
    }
}

/// What the engine computes of the first picture, with another one between.
fn twice(engine: &mut Engine, pictures: &[Vec<u8>]) -> [Maps; 2] {
    let first = engine.run(&pictures[0]).clone();
    engine.run(&pictures[1]);
    [first, engine.run(&pictures[0]).clone()]
}

#[test]
fn values_of_any_network_stay_what_they_are_until_nobody_reads_them() {
    let mut planned = 0;
    for (seed, size) in (0..NETWORKS).zip(SIZES.into_iter().cycle()) {
        let text = Draft::of(seed);
        let model = Model::random(Network::parse(&text).unwrap(), seed);
        let options = |precision| EngineOptions {
            width: size.0,
            height: size.1,
            threads: 2,
            precision,
            ..EngineOptions::default()
        };
        let mut float = match Engine::new(&model, options(Precision::F32)) {
            Ok(engine) => engine,
            // A join that asks for a copy.
            Err(EngineError::Plan(_)) => continue,
            Err(e) => panic!("{seed}: {e} {text}"),
        };
        let Weights::Float(weights) = model.weights() else {
            panic!("random weights are floats");
        };
        let pictures = [picture(size, seed), picture(size, seed + 1)];
        let expected = naive(model.network().graph(), weights, &pictures[0], size);
        for found in twice(&mut float, &pictures) {
            let e = error(&expected, &found);
            assert!(e < 1e-4, "{seed}: {e} {text}");
        }
        let calibration = CalibrationOptions {
            size,
            choice: RangeChoice::Max,
            own_ranges: 0.5,
            correct_bias: false,
        };
        let seen = Calibration::observe(&model, &pictures, calibration).unwrap();
        let rounded = model.clone().quantise(Some(&seen)).unwrap();
        // What can be negative has another padding, so that it may not share every buffer that it does in f32.
        let Ok(mut int8) = Engine::new(&rounded, options(Precision::Int8)) else {
            continue;
        };
        for found in twice(&mut int8, &pictures) {
            let e = error(&expected, &found);
            assert!(e < 0.15, "{seed}: {e} in int8 {text}");
        }
        planned += 1;
    }
    assert!(
        planned >= NETWORKS / 4,
        "{planned} of {NETWORKS} have a plan"
    );
}

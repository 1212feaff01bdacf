//! Random weights for tests and for measuring the speed of networks nobody has trained.

use rand::{Rng, SeedableRng, rngs::SmallRng};

use super::{Contract, FloatConv, Model, Weights};
use crate::engine::network::{Network, Op};

impl Model {
    /// A network with random weights that keep activations in range (He et al. 2015); its contract says so.
    pub fn random(network: Network, seed: u64) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed);
        let mut uniform = |a: f32| rng.random_range(-a..=a);
        let convs = network.graph().nodes.iter().map(|n| match &n.op {
            Op::MaxPool { .. } => None,
            Op::Conv { shape: s, .. } => {
                let upsampling = if s.transposed() {
                    s.stride() * s.stride()
                } else {
                    1
                };
                let fan_in = s.weight_len() / s.out_channels() / upsampling;
                // Uniform in ±a has variance a²/3; He asks for 2 / fan in.
                let a = (6.0 / fan_in as f32).sqrt();
                Some(FloatConv {
                    weight: (0..s.weight_len()).map(|_| uniform(a)).collect(),
                    bias: (0..s.out_channels()).map(|_| uniform(0.1)).collect(),
                })
            }
        });
        let convs = convs.collect();
        Self {
            contract: Contract::ours("nothing: random weights", &network),
            network,
            weights: Weights::Float(convs),
            stage2: None,
            association: None,
            calibration: "none".into(),
            history: vec![format!("random weights, seed {seed}")],
            digest: None,
        }
    }
}

//! The networks to measure: a name and perhaps a model go in, weights in both precisions come out.

use rand::{Rng, SeedableRng, rngs::SmallRng};

use crate::engine::model::{Calibration, RangeChoice};
use crate::engine::{CalibrationOptions, EngineError, Model, ModelError, Network, NetworkError};

/// Seed of weights that nobody trained.
const SEED: u64 = 1;

/// A network with its weights.
#[derive(Debug, Clone)]
pub struct Subject {
    /// int8 weights; the f32 engine runs the numbers these stand for.
    pub model: Model,
    /// Where the weights come from.
    pub weights: String,
}

/// A network cannot be made ready.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SubjectError {
    /// No such network.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// Random weights cannot be quantised.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The calibration run.
    #[error(transparent)]
    Engine(#[from] EngineError),
}

impl Subject {
    /// A trained model; `digest` is that of its file.
    pub fn trained(model: Model, origin: &str, digest: &str) -> Self {
        let weights = format!("{origin}, file {}", &digest[..digest.len().min(16)]);
        Self { model, weights }
    }

    /// A shipped network with random weights, quantised by the same quantiser on one random picture. Results mean
    /// nothing. Speed depends on the shapes; on x86 CPUs without VNNI in int8 on the weights, too, and uniform ones are
    /// the slowest.
    ///
    /// # Errors
    /// When there is no network of this name, or it cannot run at this size.
    pub fn random(name: &str, size: (usize, usize)) -> Result<Self, SubjectError> {
        let model = Model::random(Network::shipped(name)?, SEED);
        let options = CalibrationOptions {
            size,
            choice: RangeChoice::Max,
            correct_bias: false,
            ..CalibrationOptions::default()
        };
        let calibration = Calibration::observe(&model, [picture(size)], options)?;
        Ok(Self {
            model: model.quantise(Some(&calibration))?,
            weights: format!("random, seed {SEED}"),
        })
    }

    /// The network's name.
    pub fn name(&self) -> &str {
        self.model.network().name()
    }
}

/// A picture of random bytes, `[height, width, 3]`.
pub(super) fn picture((width, height): (usize, usize)) -> Vec<u8> {
    let mut bytes = vec![0; 3 * width * height];
    SmallRng::seed_from_u64(SEED).fill(&mut bytes[..]);
    bytes
}

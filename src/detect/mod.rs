//! Association: Stage I's maps go in, people come out. XNect §4.1.1.

mod associator;
mod confidence;
mod config;
mod detection;
mod limb;
mod looks;
mod peaks;
mod person;
mod score;

pub use associator::Associator;
pub use confidence::Confidence;
pub use config::AssociationConfig;
pub use detection::Detection;
pub use looks::{Lately, SIDES, join_turned, joined, leaning, lone_lying_score};
pub use score::{FEATURES, PersonScore, features};

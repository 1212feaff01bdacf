//! Ways to compute a convolution that differ in their numerics.

use crate::ConvShape;

/// How an int8 convolution is computed. Results are bit-identical on every tier within one algorithm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Algorithm {
    /// Every product of the definition, exact in i32.
    #[default]
    Direct,
}

impl Algorithm {
    /// The algorithms that can compute `shape`, the plainest first.
    pub fn candidates(_shape: &ConvShape) -> &'static [Algorithm] {
        &[Algorithm::Direct]
    }
}

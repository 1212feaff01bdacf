//! Ways to compute a convolution that differ in their numerics.

use crate::ConvShape;

/// How an int8 convolution is computed. Results are bit-identical on every tier within one algorithm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Algorithm {
    /// Every product of the definition, exact in i32.
    #[default]
    Direct,
    /// Winograd F(4×4, 3×3) with i16 weights and inputs: a quarter of the products, each on half as many lanes. Inputs
    /// are exact; rounding of the transformed weights is far below that of the i8 weights themselves.
    Winograd,
}

impl Algorithm {
    /// The algorithms that can compute `shape`, the plainest first.
    pub fn candidates(shape: &ConvShape) -> &'static [Algorithm] {
        if shape.kernel() == 3 && shape.stride() == 1 && !shape.transposed() {
            &[Algorithm::Direct, Algorithm::Winograd]
        } else {
            &[Algorithm::Direct]
        }
    }

    /// The algorithm to use where nothing was measured. It depends on the shape alone, so that results do not depend on
    /// the machine.
    pub fn preferred(shape: &ConvShape) -> Algorithm {
        let depth = shape.group_in();
        if depth >= 16 && Self::candidates(shape).contains(&Algorithm::Winograd) {
            Algorithm::Winograd
        } else {
            Algorithm::Direct
        }
    }
}

//! What can be wrong with Stage II.

use edgecap_kernels::KernelError;

use super::weights::OUTPUTS;

/// Stage II cannot be built or run.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LiftError {
    /// A layer does not fit the one before it, or itself.
    #[error(
        "layer {index} of stage II: expected {} inputs, {} weights and {} biases, found {}, {} and {}; import the model again from its training output",
        expected.0, expected.1, expected.2, found.0, found.1, found.2
    )]
    Layer {
        /// Counted from 1.
        index: usize,
        /// Inputs, weights, biases.
        expected: (usize, usize, usize),
        /// Inputs, weights, biases.
        found: (usize, usize, usize),
    },
    /// The last layer does not give the body joints.
    #[error(
        "stage II gives {found} numbers, expected {OUTPUTS} (x, y, z of every body joint); import the model again from its training output"
    )]
    Outputs {
        /// Outputs of the last layer.
        found: usize,
    },
    /// A weight is NaN or infinite.
    #[error(
        "layer {index} of stage II: expected finite weights, found NaN or infinity; the model file is damaged, import it again"
    )]
    NotFinite {
        /// Counted from 1.
        index: usize,
    },
    /// A kernel cannot be built or run.
    #[error("stage II: {0}")]
    Kernel(#[from] KernelError),
}

//! Why an engine cannot be built.

use edgecap_kernels::{AlgorithmsError, IsaError, KernelError};

use crate::engine::model::ModelError;
use crate::engine::plan::PlanError;
use crate::engine::{Maps, WILD};

/// An engine cannot be built as asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EngineError {
    /// The input size does not fit the network.
    #[error(
        "expected a network input of multiples of {multiple} pixels up to {}, found {width}x{height}; choose e.g. {}x{}",
        Maps::MOST_SIDE,
        512_usize.next_multiple_of(*.multiple),
        320_usize.next_multiple_of(*.multiple)
    )]
    Size {
        /// What sides are multiples of.
        multiple: usize,
        /// Asked for.
        width: usize,
        /// Asked for.
        height: usize,
    },
    /// int8 was asked of float weights.
    #[error(
        "int8 was asked for, but the weights are floats: quantise them with `edgecap model import`, or ask for f32"
    )]
    NotQuantised,
    /// The network's outputs are not Stage I's.
    #[error(
        "expected outputs head2d [40] and head3d [63] at 1/8 of the input, found {0}; choose another network"
    )]
    Outputs(String),
    /// A layer does what int8 kernels do not.
    #[error(
        "layer `{0}` is an output with ReLU, residual sum or pooling, which has no int8 kernel; let the network file end without"
    )]
    Layer(String),
    /// A layer's values overflow.
    #[error(
        "expected finite values on the calibration pictures, found others in layer `{0}`: its weights, or those before it, are too large"
    )]
    Overflow(String),
    /// Too few pictures are left to calibrate on.
    #[error(
        "expected to calibrate on half of the {pictures} pictures or more, found {left} that can be used: on the others \
         some value is beyond {} times its median; give more pictures, like those that the network will see",
        WILD
    )]
    Wild {
        /// Pictures that are not wild.
        left: usize,
        /// All of them.
        pictures: usize,
    },
    /// Threads cannot be had.
    #[error("cannot start {0} threads: {1}; ask for fewer")]
    Threads(usize, std::io::Error),
    /// The model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Buffers cannot be placed.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The weights cannot be packed in reasonable memory.
    #[error(
        "expected a network whose packed weights take at most {most} MB, found up to {found} MB; give its layers fewer channels, or fewer groups"
    )]
    Packed {
        /// Megabytes (10⁶ bytes) at most.
        most: usize,
        /// Megabytes that they could take.
        found: usize,
    },
    /// A kernel refuses a layer.
    #[error("layer `{layer}`: {source}")]
    Kernel {
        /// Its name.
        layer: String,
        /// Why.
        source: KernelError,
    },
    /// The instruction set asked for.
    #[error("{0}")]
    Isa(String),
    /// The algorithms asked for.
    #[error("{0}")]
    Algorithms(String),
}

impl From<IsaError> for EngineError {
    fn from(e: IsaError) -> Self {
        Self::Isa(e.to_string())
    }
}

impl From<AlgorithmsError> for EngineError {
    fn from(e: AlgorithmsError) -> Self {
        Self::Algorithms(e.to_string())
    }
}

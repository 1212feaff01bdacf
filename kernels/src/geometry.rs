//! Shapes and layouts that kernels may trust: every value was checked when it was made and cannot be changed.
//!
//! What is checked is that no index, length or packed form of it can leave `isize`, so that all later arithmetic is
//! exact in release builds, too.

mod conv_shape;
mod layout;
mod pool_shape;

pub use conv_shape::{ConvDims, ConvShape};
pub use layout::Layout;
pub use pool_shape::PoolShape;

/// Most elements that a tensor may span: its bytes fit `isize` for every element type.
pub(crate) const MAX_ELEMENTS: usize = isize::MAX as usize / 8;
/// Largest kernel or pooling window, and largest stride.
pub(crate) const MAX_WINDOW: usize = 64;
/// Most channels of a convolution.
pub(crate) const MAX_CHANNELS: usize = 1 << 20;

//! Geometry of a pool.

use super::conv_shape::{check_window, window_output_len};
use crate::KernelError;

/// A square pooling window, its stride and symmetric padding, whose numbers fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct PoolShape {
    kernel: usize,
    stride: usize,
    padding: usize,
}

impl PoolShape {
    /// A window of `kernel` × `kernel`.
    ///
    /// # Errors
    /// When kernel or stride are 0 or above 64, or the padding reaches the kernel.
    pub fn new(kernel: usize, stride: usize, padding: usize) -> Result<Self, KernelError> {
        check_window("pool", kernel, stride, padding)?;
        Ok(Self {
            kernel,
            stride,
            padding,
        })
    }

    /// Window height and width.
    pub fn kernel(&self) -> usize {
        self.kernel
    }

    /// Stride.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Padding on every side.
    pub fn padding(&self) -> usize {
        self.padding
    }

    /// Output rows or columns for `n` input rows or columns; 0 where the input with its padding is smaller than the
    /// window.
    pub fn output_len(&self, n: usize) -> usize {
        window_output_len(n, self.kernel, self.stride, self.padding)
    }
}

//! Geometry of a convolution.

/// A square 2D convolution, NHWC, symmetric padding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ConvShape {
    /// Input channels over all groups.
    pub in_channels: usize,
    /// Output channels over all groups.
    pub out_channels: usize,
    /// Groups; divides both channel counts.
    pub groups: usize,
    /// Kernel height and width.
    pub kernel: usize,
    /// Stride (up-sampling factor when transposed).
    pub stride: usize,
    /// Padding on every side.
    pub padding: usize,
    /// A transposed convolution (deconvolution).
    pub transposed: bool,
}

impl ConvShape {
    /// Output rows or columns for `n` input rows or columns.
    pub fn output_len(&self, n: usize) -> usize {
        if self.transposed {
            (n - 1) * self.stride + self.kernel - 2 * self.padding
        } else {
            (n + 2 * self.padding - self.kernel) / self.stride + 1
        }
    }

    /// Multiply-accumulates for an input of `height` × `width`.
    pub fn macs(&self, height: usize, width: usize) -> u64 {
        let taps = self.kernel * self.kernel * (self.in_channels / self.groups) * self.out_channels;
        let sites = if self.transposed {
            height * width
        } else {
            self.output_len(height) * self.output_len(width)
        };
        taps as u64 * sites as u64
    }

    /// Weights: `[out_channels, in_channels / groups, kernel, kernel]`; a transposed convolution is stored the same way
    /// (out-channel major), not in PyTorch's in-major order.
    pub fn weight_len(&self) -> usize {
        self.out_channels * (self.in_channels / self.groups) * self.kernel * self.kernel
    }

    /// Padding pixels the input must have readable on every side.
    pub fn input_halo(&self) -> usize {
        if self.transposed {
            (self.kernel - 1).saturating_sub(self.padding) / self.stride
        } else {
            self.padding
        }
    }
}

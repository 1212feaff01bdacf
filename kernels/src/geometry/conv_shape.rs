//! Geometry of a convolution.

use super::{MAX_CHANNELS, MAX_WINDOW};
use crate::KernelError;

/// The numbers of a [`ConvShape`], not yet checked.
///
/// ```
/// use edgecap_kernels::{ConvDims, ConvShape};
///
/// let dims = ConvDims { in_channels: 64, out_channels: 32, kernel: 3, padding: 1, ..ConvDims::default() };
/// let shape = ConvShape::new(dims)?;
/// assert_eq!(shape.output_len(20), 20);
/// assert!(ConvShape::new(ConvDims { groups: 5, ..dims }).is_err());
/// # Ok::<(), edgecap_kernels::KernelError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ConvDims {
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

impl Default for ConvDims {
    /// One 1 × 1 kernel.
    fn default() -> Self {
        Self {
            in_channels: 1,
            out_channels: 1,
            groups: 1,
            kernel: 1,
            stride: 1,
            padding: 0,
            transposed: false,
        }
    }
}

/// A square 2D convolution, NHWC, symmetric padding, whose numbers fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ConvShape {
    dims: ConvDims,
}

/// Refuses a window (of a convolution or a pool) that no kernel runs.
pub(crate) fn check_window(
    what: &str,
    kernel: usize,
    stride: usize,
    padding: usize,
) -> Result<(), KernelError> {
    let sides = 1..=MAX_WINDOW;
    if sides.contains(&kernel) && sides.contains(&stride) && padding < kernel {
        return Ok(());
    }
    Err(KernelError::Shape(format!(
        "{what}: expected kernel and stride in 1..={MAX_WINDOW} and padding below the kernel, found kernel {kernel}, stride {stride}, padding {padding}; correct the network file"
    )))
}

impl ConvShape {
    /// Checks that the numbers fit together and that every size derived from them fits memory.
    ///
    /// # Errors
    /// When channels are missing, too many (2²⁰) or not divided by the groups; when kernel or stride are 0 or above 64,
    /// or the padding reaches the kernel; when a transposed convolution has a stride above its kernel or a padding of
    /// half of it.
    pub fn new(dims: ConvDims) -> Result<Self, KernelError> {
        let ConvDims {
            in_channels,
            out_channels,
            groups,
            kernel,
            stride,
            padding,
            transposed,
        } = dims;
        let channels = 1..=MAX_CHANNELS;
        let divides = |count: usize| count.checked_rem(groups) == Some(0);
        let counted = channels.contains(&in_channels) && channels.contains(&out_channels);
        if !counted || !divides(in_channels) || !divides(out_channels) {
            return Err(KernelError::Shape(format!(
                "expected 1 to {MAX_CHANNELS} channels and groups that divide them, found {groups} groups for {in_channels} -> {out_channels} channels; correct the network file"
            )));
        }
        check_window("convolution", kernel, stride, padding)?;
        if transposed && (stride > kernel || 2 * padding >= kernel) {
            return Err(KernelError::Shape(format!(
                "transposed convolution: expected stride <= kernel and 2 * padding < kernel, found kernel {kernel}, stride {stride}, padding {padding}; correct the network file"
            )));
        }
        let shape = Self { dims };
        if shape.most_packed_bytes() > isize::MAX as usize {
            return Err(KernelError::Shape(format!(
                "expected weights that fit memory, found {in_channels} -> {out_channels} channels of {kernel}x{kernel}; correct the network file"
            )));
        }
        Ok(shape)
    }

    /// The numbers it was made of.
    pub fn dims(&self) -> ConvDims {
        self.dims
    }

    /// Input channels over all groups.
    pub fn in_channels(&self) -> usize {
        self.dims.in_channels
    }

    /// Output channels over all groups.
    pub fn out_channels(&self) -> usize {
        self.dims.out_channels
    }

    /// Groups; divides both channel counts.
    pub fn groups(&self) -> usize {
        self.dims.groups
    }

    /// Kernel height and width.
    pub fn kernel(&self) -> usize {
        self.dims.kernel
    }

    /// Stride (up-sampling factor when transposed).
    pub fn stride(&self) -> usize {
        self.dims.stride
    }

    /// Padding on every side.
    pub fn padding(&self) -> usize {
        self.dims.padding
    }

    /// Whether it is a transposed convolution (deconvolution).
    pub fn transposed(&self) -> bool {
        self.dims.transposed
    }

    /// Input channels of a group.
    pub fn group_in(&self) -> usize {
        self.dims.in_channels / self.dims.groups
    }

    /// Output channels of a group.
    pub fn group_out(&self) -> usize {
        self.dims.out_channels / self.dims.groups
    }

    /// Output rows or columns for `n` input rows or columns; 0 where the input with its padding is smaller than the
    /// kernel.
    pub fn output_len(&self, n: usize) -> usize {
        let ConvDims {
            kernel,
            stride,
            padding,
            ..
        } = self.dims;
        if !self.dims.transposed {
            return window_output_len(n, kernel, stride, padding);
        }
        let steps = n.checked_sub(1).map(|n| n.saturating_mul(stride));
        steps.map_or(0, |n| n.saturating_add(kernel - 2 * padding))
    }

    /// Multiply-accumulates for an input of `height` × `width`.
    pub fn macs(&self, height: usize, width: usize) -> u64 {
        let (rows, columns) = if self.dims.transposed {
            (height, width)
        } else {
            (self.output_len(height), self.output_len(width))
        };
        (self.weight_len() as u64)
            .saturating_mul(rows as u64)
            .saturating_mul(columns as u64)
    }

    /// Shape of the weights: `[out_channels, in_channels / groups, kernel, kernel]`; a transposed convolution is stored
    /// the same way (out-channel major), not in PyTorch's in-major order.
    pub fn weight_shape(&self) -> [usize; 4] {
        let ConvDims {
            out_channels,
            kernel,
            ..
        } = self.dims;
        [out_channels, self.group_in(), kernel, kernel]
    }

    /// Weights there are.
    pub fn weight_len(&self) -> usize {
        self.weight_shape().iter().product()
    }

    /// No kernel's packed weights take more bytes. Outputs of a group are padded to whole vectors and blocks, so that
    /// it can be many times [`weight_len`](Self::weight_len) where groups have few outputs.
    pub fn most_packed_bytes(&self) -> usize {
        // Winograd's weights take 16 bytes for one in f32, 8 in int8.
        let bytes = self.dims.kernel * self.dims.kernel * 16;
        let outs = self.group_out().next_multiple_of(64) * self.dims.groups;
        outs.saturating_mul(self.group_in()).saturating_mul(bytes)
    }

    /// Phases: sets of output pixels that sum the same kernel elements. A transposed convolution has stride² of them,
    /// by the remainders of row and column; every other one has one.
    pub fn phases(&self) -> usize {
        match self.dims.transposed {
            true => self.dims.stride * self.dims.stride,
            false => 1,
        }
    }

    /// The phase, counted row by row, that sums kernel element (`ky`, `kx`).
    pub fn phase_of(&self, ky: usize, kx: usize) -> usize {
        let ConvDims {
            stride,
            padding,
            transposed,
            ..
        } = self.dims;
        // Output o takes input i through kernel element o + padding - i * stride.
        let along = |k: usize| (k + padding * (stride - 1)) % stride;
        match transposed {
            true => along(ky) * stride + along(kx),
            false => 0,
        }
    }

    /// Padding pixels the input must have readable on every side.
    pub fn input_halo(&self) -> usize {
        let ConvDims {
            kernel,
            stride,
            padding,
            transposed,
            ..
        } = self.dims;
        if transposed {
            (kernel - 1 - padding) / stride
        } else {
            padding
        }
    }
}

/// Output rows or columns of a window that slides over `n` and `padding` on both sides; 0 where it does not fit.
pub(crate) fn window_output_len(n: usize, kernel: usize, stride: usize, padding: usize) -> usize {
    let padded = n.saturating_add(2 * padding);
    padded
        .checked_sub(kernel)
        .map_or(0, |room| room / stride + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_do_not_fit_together_are_refused() {
        let good = ConvDims {
            in_channels: 8,
            out_channels: 12,
            groups: 4,
            kernel: 4,
            stride: 2,
            padding: 1,
            transposed: true,
        };
        assert!(ConvShape::new(good).is_ok());
        let huge = usize::MAX;
        for bad in [
            ConvDims { groups: 0, ..good },
            ConvDims { groups: 3, ..good },
            ConvDims { kernel: 0, ..good },
            ConvDims {
                kernel: huge,
                ..good
            },
            ConvDims {
                kernel: 4611686018427387905,
                ..good
            },
            ConvDims { stride: 0, ..good },
            ConvDims { stride: 5, ..good },
            ConvDims {
                stride: huge,
                ..good
            },
            ConvDims { padding: 2, ..good },
            ConvDims {
                padding: huge,
                ..good
            },
            ConvDims {
                in_channels: 0,
                ..good
            },
            ConvDims {
                in_channels: huge - 3,
                ..good
            },
            ConvDims {
                out_channels: 1 << 40,
                ..good
            },
        ] {
            assert!(ConvShape::new(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn what_packing_may_take_grows_with_the_groups_of_few_outputs() {
        let dims = ConvDims {
            in_channels: 64,
            out_channels: 64,
            kernel: 3,
            padding: 1,
            ..ConvDims::default()
        };
        let bytes = |groups| {
            let shape = ConvShape::new(ConvDims { groups, ..dims }).unwrap();
            (shape.weight_len(), shape.most_packed_bytes())
        };
        assert_eq!(bytes(1), (64 * 64 * 9, 16 * 64 * 64 * 9));
        assert_eq!(bytes(64), (64 * 9, 16 * 64 * 64 * 9));
    }

    #[test]
    fn lengths_do_not_wrap() {
        let dims = ConvDims {
            kernel: 3,
            padding: 1,
            ..ConvDims::default()
        };
        let shape = ConvShape::new(dims).unwrap();
        assert_eq!((shape.output_len(0), shape.output_len(1)), (0, 1));
        assert!(shape.output_len(usize::MAX) > usize::MAX / 2);
        let up = ConvDims {
            kernel: 4,
            stride: 2,
            transposed: true,
            ..dims
        };
        let up = ConvShape::new(up).unwrap();
        assert_eq!((up.output_len(0), up.output_len(5)), (0, 10));
        assert_eq!(up.output_len(usize::MAX), usize::MAX);
    }
}

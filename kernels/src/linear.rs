//! Fully connected f32 layer over a small batch: `y = relu(x Wᵀ + b)`.

use crate::conv_check::check_length;
use crate::{ConvShape, FConv, FConvParams, Isa, KernelError, Layout, Scratch, Tensor, TensorMut};

/// A packed fully connected layer.
#[derive(Debug, Clone)]
pub struct Linear {
    conv: FConv,
}

impl Linear {
    /// Packs `weights` `[outputs, inputs]`, row-major, and `bias` `[outputs]`.
    ///
    /// # Errors
    /// When the CPU lacks `isa` or a length does not fit.
    pub fn new(
        isa: Isa,
        inputs: usize,
        outputs: usize,
        weights: &[f32],
        bias: &[f32],
        relu: bool,
    ) -> Result<Self, KernelError> {
        let shape = ConvShape {
            in_channels: inputs,
            out_channels: outputs,
            groups: 1,
            kernel: 1,
            stride: 1,
            padding: 0,
            transposed: false,
        };
        let conv = FConv::new(
            isa,
            &FConvParams {
                shape,
                weights,
                bias,
                relu,
                residual: false,
            },
        )?;
        Ok(Self { conv })
    }

    /// Numbers per row of the input.
    pub fn inputs(&self) -> usize {
        self.conv.shape().in_channels
    }

    /// Numbers per row of the output.
    pub fn outputs(&self) -> usize {
        self.conv.shape().out_channels
    }

    /// `input` `[batch, inputs]` → `output` `[batch, outputs]`, both row-major. Allocates nothing.
    ///
    /// # Errors
    /// When a slice has the wrong length.
    pub fn run(&self, batch: usize, input: &[f32], output: &mut [f32]) -> Result<(), KernelError> {
        check_length("inputs", batch * self.inputs(), input.len())?;
        check_length("outputs", batch * self.outputs(), output.len())?;
        if batch == 0 {
            return Ok(());
        }
        self.conv.run(
            Tensor::new(input, Layout::dense(1, batch, self.inputs(), 0)),
            None,
            TensorMut::new(output, Layout::dense(1, batch, self.outputs(), 0)),
            &mut Scratch::default(),
        )
    }
}

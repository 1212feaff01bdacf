//! Fully connected f32 layer over a small batch: `y = relu(x Wᵀ + b)`.

use crate::{
    Algorithm, ConvDims, ConvShape, FConv, FConvParams, Isa, KernelError, Layout, Scratch, Tensor,
    TensorMut,
};

/// A packed fully connected layer.
///
/// ```
/// use edgecap_kernels::{Isa, Linear};
///
/// let layer = Linear::new(Isa::detect()?, 2, 3, &[1., 2., 3., 4., -5., 6.], &[0., 1., 2.], true)?;
/// let mut output = [0.0; 6];
/// layer.run(2, &[1., 1., 2., 0.], &mut output)?;
/// assert_eq!(output, [3., 8., 3., 2., 7., 0.]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Linear {
    conv: FConv,
}

impl Linear {
    /// Packs `weights` `[outputs, inputs]`, row-major, and `bias` `[outputs]`.
    ///
    /// # Errors
    /// When the CPU lacks `isa`, a length does not fit, or inputs or outputs are 0 or more than 2²⁰.
    pub fn new(
        isa: Isa,
        inputs: usize,
        outputs: usize,
        weights: &[f32],
        bias: &[f32],
        relu: bool,
    ) -> Result<Self, KernelError> {
        let shape = ConvShape::new(ConvDims {
            in_channels: inputs,
            out_channels: outputs,
            ..ConvDims::default()
        })?;
        let conv = FConv::new(
            isa,
            &FConvParams {
                shape,
                weights,
                bias,
                relu,
                residual: false,
                algorithm: Algorithm::Direct,
            },
        )?;
        Ok(Self { conv })
    }

    /// Numbers per row of the input.
    pub fn inputs(&self) -> usize {
        self.conv.shape().in_channels()
    }

    /// Numbers per row of the output.
    pub fn outputs(&self) -> usize {
        self.conv.shape().out_channels()
    }

    /// `input` `[batch, inputs]` → `output` `[batch, outputs]`, both row-major. Allocates nothing.
    ///
    /// # Errors
    /// When a slice has the wrong length.
    pub fn run(&self, batch: usize, input: &[f32], output: &mut [f32]) -> Result<(), KernelError> {
        check_rows("input", batch, self.inputs(), input.len())?;
        check_rows("output", batch, self.outputs(), output.len())?;
        if batch == 0 {
            return Ok(());
        }
        let from = Layout::dense(1, batch, self.inputs(), 0)?;
        let to = Layout::dense(1, batch, self.outputs(), 0)?;
        self.conv.run(
            Tensor::new(input, from),
            None,
            TensorMut::new(output, to),
            &mut Scratch::default(),
        )
    }
}

/// Refuses a slice that is not `batch` rows of `width` numbers.
fn check_rows(role: &str, batch: usize, width: usize, found: usize) -> Result<(), KernelError> {
    if batch.checked_mul(width) == Some(found) {
        return Ok(());
    }
    Err(KernelError::Tensor(format!(
        "{role}: expected {batch} rows of {width} numbers, found {found} numbers; pass whole rows"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_are_not_whole_are_called_so() {
        let layer = Linear::new(Isa::Scalar, 2, 1, &[1.0, 2.0], &[0.0], false).unwrap();
        let mut output = [0.0; 2];
        let said = layer.run(2, &[1.0; 3], &mut output).unwrap_err();
        assert_eq!(
            said.to_string(),
            "input: expected 2 rows of 2 numbers, found 3 numbers; pass whole rows"
        );
        let said = layer.run(0, &[], &mut output).unwrap_err();
        assert!(said.to_string().starts_with("output: expected 0 rows"));
        assert!(layer.run(usize::MAX, &[1.0; 2], &mut output).is_err());
        assert!(layer.run(0, &[], &mut []).is_ok());
    }
}

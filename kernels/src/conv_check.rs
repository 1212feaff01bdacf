//! Checks shared by the int8 and f32 convolutions.

use crate::tensor::Expected;
use crate::{Algorithm, ConvShape, Isa, KernelError, Layout, Scratch};

/// Refuses what cannot be packed: a tier that the CPU lacks, an algorithm that is none for the shape, weights of the
/// wrong length.
pub(crate) fn check_params(
    isa: Isa,
    algorithm: Algorithm,
    shape: &ConvShape,
    weights: usize,
) -> Result<(), KernelError> {
    if !isa.is_available() {
        return Err(KernelError::Unsupported(isa));
    }
    if !Algorithm::candidates(shape).contains(&algorithm) {
        return Err(KernelError::Shape(format!(
            "expected a 3x3 convolution of stride 1 for {algorithm:?}, found {shape:?}; take one of Algorithm::candidates()"
        )));
    }
    check_length("weights", shape.weight_len(), weights)
}

/// Refuses a scratch with less than `needed` bytes.
pub(crate) fn check_scratch(needed: usize, scratch: &Scratch) -> Result<(), KernelError> {
    if scratch.len() >= needed {
        return Ok(());
    }
    Err(KernelError::Tensor(format!(
        "expected {needed} bytes of scratch, found {}; make it with Scratch::new(scratch_bytes())",
        scratch.len()
    )))
}

/// Refuses arrays of parameters of the wrong length.
pub(crate) fn check_length(
    what: &'static str,
    expected: usize,
    found: usize,
) -> Result<(), KernelError> {
    if expected == found {
        Ok(())
    } else {
        Err(KernelError::Length {
            what,
            expected,
            found,
        })
    }
}

/// Checks one layout per role, with the length of its buffer.
pub(crate) fn check_tensors(
    shape: &ConvShape,
    input: (&Layout, usize),
    residual: Option<(&Layout, usize)>,
    output: (&Layout, usize),
) -> Result<(), KernelError> {
    let (height, width) = (input.0.height(), input.0.width());
    if shape.output_len(height.min(width)) == 0 {
        return Err(KernelError::Tensor(format!(
            "input: expected at least {} rows and columns with padding, found {height}x{width}; use a larger picture",
            shape.kernel()
        )));
    }
    Expected {
        role: "input",
        height,
        width,
        channels: shape.in_channels(),
        halo: shape.input_halo(),
    }
    .check(input.0, input.1)?;
    let out = Expected {
        role: "output",
        height: shape.output_len(height),
        width: shape.output_len(width),
        channels: shape.out_channels(),
        halo: 0,
    };
    out.check(output.0, output.1)?;
    if let Some((layout, len)) = residual {
        Expected {
            role: "residual",
            ..out
        }
        .check(layout, len)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_remedy_is_that_of_what_is_wrong() {
        let said = check_scratch(64, &Scratch::default())
            .unwrap_err()
            .to_string();
        assert!(
            said.contains("64 bytes of scratch, found 0; make it with Scratch::new"),
            "{said}"
        );
        assert!(check_scratch(0, &Scratch::default()).is_ok());
        let said = check_length("biases", 3, 2).unwrap_err().to_string();
        assert!(said.contains("one array per convolution"), "{said}");
    }
}

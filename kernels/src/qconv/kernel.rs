//! Which kernel runs an int8 convolution, chosen once when it is packed.

use super::run::Run;
use super::{Epilogue, QConv, QConvParams};
use crate::winograd::int8::TransformedWeights;
use crate::{Algorithm, Isa, KernelError, Scratch};

/// The packed form.
#[derive(Debug, Clone)]
pub(super) enum Kernel {
    /// The scalar reference on the weights as given.
    Reference { weights: Vec<i8>, bias: Vec<i32> },
    /// The scalar reference of Winograd.
    WinogradReference(TransformedWeights),
    /// A kernel of a vector tier.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    Vector(Box<super::vector::Vector>),
}

/// Least t of a Winograd convolution: below it the rounding of weights would be felt.
const LEAST_FACTOR: i32 = 32;

impl Kernel {
    /// Packs for `isa`; the reference where no vector kernel fits the shape. The epilogue is the one for this kernel's
    /// accumulators.
    ///
    /// # Errors
    /// When the algorithm cannot compute these weights.
    pub fn new(isa: Isa, params: &QConvParams) -> Result<(Self, Epilogue), KernelError> {
        let QConvParams {
            shape,
            weights,
            bias,
            ..
        } = params;
        let _ = isa;
        match params.algorithm {
            Algorithm::Direct => {
                #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
                if let Some(vector) = super::vector::Vector::direct(isa, params) {
                    return Ok((Kernel::Vector(Box::new(vector)), params.epilogue.clone()));
                }
                let reference = Kernel::Reference {
                    weights: weights.to_vec(),
                    bias: bias.to_vec(),
                };
                Ok((reference, params.epilogue.clone()))
            }
            Algorithm::Winograd => {
                let transformed = TransformedWeights::new(shape, weights, bias, params.input_max);
                if transformed.factor.iter().any(|&t| t < LEAST_FACTOR) {
                    return Err(KernelError::Value(
                        "expected sums that leave room for Winograd's factor, found an output channel with too many or too large weights; use Algorithm::Direct".to_owned(),
                    ));
                }
                let epilogue = params.epilogue.divided_by(&transformed.factor);
                #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
                if let Some(vector) =
                    super::vector::Vector::winograd(isa, shape, &transformed, &epilogue)
                {
                    return Ok((Kernel::Vector(Box::new(vector)), epilogue));
                }
                Ok((Kernel::WinogradReference(transformed), epilogue))
            }
        }
    }

    pub fn name(&self) -> &'static str {
        match self {
            Kernel::Reference { .. } => "qs8_direct__scalar",
            Kernel::WinogradReference(_) => "qs8_winograd4__scalar",
            #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
            Kernel::Vector(vector) => vector.name(),
        }
    }

    pub fn scratch_bytes(&self) -> usize {
        match self {
            Kernel::Reference { .. } | Kernel::WinogradReference(_) => 0,
            #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
            Kernel::Vector(vector) => vector.scratch_bytes(),
        }
    }
}

impl QConv {
    /// # Safety
    /// As [`QConv::run_part`].
    pub(super) unsafe fn dispatch(&self, run: &Run, scratch: &mut Scratch) {
        let _ = &scratch;
        // SAFETY: the caller's contract is the kernels'.
        unsafe {
            match &self.kernel {
                Kernel::Reference { weights, bias } => self.run_reference(weights, bias, run),
                Kernel::WinogradReference(weights) => self.run_winograd_reference(weights, run),
                #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
                Kernel::Vector(vector) => vector.run(&self.epilogue, run, scratch),
            }
        }
    }
}

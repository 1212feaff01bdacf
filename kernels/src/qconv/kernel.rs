//! Which kernel runs an int8 convolution, chosen once when it is packed.

use super::epilogue::Output;
use super::{QConv, QConvParams};
use crate::{Isa, Layout, Part};

/// The packed form.
#[derive(Debug, Clone)]
pub(super) enum Kernel {
    /// The scalar reference on the weights as given.
    Reference { weights: Vec<i8>, bias: Vec<i32> },
    /// A direct kernel of a vector tier.
    #[cfg(target_arch = "x86_64")]
    Direct(super::direct::Direct),
}

impl Kernel {
    /// Packs for `isa`; the reference where no vector kernel fits the shape.
    pub fn new(isa: Isa, params: &QConvParams) -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(direct) = super::direct::Direct::new(isa, params) {
            return Kernel::Direct(direct);
        }
        let _ = isa;
        Kernel::Reference {
            weights: params.weights.to_vec(),
            bias: params.bias.to_vec(),
        }
    }

    pub fn name(&self) -> &'static str {
        match self {
            Kernel::Reference { .. } => "qs8_direct__scalar",
            #[cfg(target_arch = "x86_64")]
            Kernel::Direct(direct) => direct.name(),
        }
    }
}

/// The tensors of one run.
pub(super) struct Run<'a> {
    pub input: *const u8,
    pub in_layout: &'a Layout,
    pub residual: Option<(*const u8, &'a Layout)>,
    pub output: Output,
    pub out_layout: &'a Layout,
    pub part: &'a Part,
}

impl QConv {
    /// # Safety
    /// As [`QConv::run_part`].
    pub(super) unsafe fn dispatch(&self, run: &Run) {
        // SAFETY: the caller's contract is the kernels'.
        unsafe {
            match &self.kernel {
                Kernel::Reference { weights, bias } => self.run_reference(weights, bias, run),
                #[cfg(target_arch = "x86_64")]
                Kernel::Direct(direct) => direct.run(&self.epilogue, run),
            }
        }
    }
}

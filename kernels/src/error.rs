//! What can be wrong with a kernel's parameters or tensors.

use std::fmt;

use crate::Isa;

/// A kernel cannot be built or run as asked. Every message says what was expected, what was found, what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum KernelError {
    /// The instruction set is not available on this CPU.
    Unsupported(Isa),
    /// The convolution's own numbers do not fit together.
    Shape(String),
    /// An array of parameters has the wrong length.
    Length {
        /// Which array.
        what: &'static str,
        /// Elements expected.
        expected: usize,
        /// Elements found.
        found: usize,
    },
    /// A value is out of the range the kernel is exact for.
    Value(String),
    /// A tensor does not fit the operation or its buffer.
    Tensor(String),
}

impl fmt::Display for KernelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsupported(isa) => write!(
                f,
                "kernels for {} were asked for, which this CPU does not have; take one of Isa::available()",
                isa.name()
            ),
            Self::Shape(text) | Self::Value(text) | Self::Tensor(text) => f.write_str(text),
            Self::Length {
                what,
                expected,
                found,
            } => write!(
                f,
                "expected {expected} {what}, found {found}; pass one array per convolution in the documented order"
            ),
        }
    }
}

impl std::error::Error for KernelError {}

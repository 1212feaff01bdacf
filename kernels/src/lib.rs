//! int8 and f32 kernels: packing, micro-kernels per instruction set, scalar reference beside them, run-time dispatch.
//!
//! No I/O, no threads, no dependencies.

mod conv;
mod layout;

pub use conv::ConvShape;
pub use layout::Layout;

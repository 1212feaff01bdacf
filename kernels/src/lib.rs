//! int8 and f32 kernels: packing, micro-kernels per instruction set, scalar reference beside them, run-time dispatch.
//!
//! No I/O; libc alone. Operations start no threads; [`Peak::together`], which measures the CPU, does.
//!
//! Every operation is built once (weights packed for one [`Isa`]), then run without allocating. `run` is safe and takes
//! separate buffers; `run_part` takes pointers, so that input and output can be channel slices of one buffer and
//! threads can each compute their [`Part`].

// Tiles are loops over constant bounds that index several arrays at once; iterators would hide that they unroll.
#![allow(clippy::needless_range_loop)]

mod algorithm;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod arch;
mod conv_check;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod direct;
mod error;
mod fconv;
mod geometry;
mod isa;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod kernel;
mod linear;
mod maxpool;
mod naive;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod packed;
mod part;
mod peak;
mod phase;
mod pool;
mod qconv;
mod scratch;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod segments;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod simd;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod slab;
mod tensor;
mod winograd;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod writers;

pub use algorithm::{ALGORITHM_VARIABLE, Algorithm, Algorithms, AlgorithmsError};
pub use error::KernelError;
pub use fconv::{FConv, FConvParams};
pub use geometry::{ConvDims, ConvShape, Layout, PoolShape};
pub use isa::{ISA_VARIABLE, Isa, IsaError};
pub use linear::Linear;
pub use maxpool::{MaxPool, PoolElement};
pub use part::Part;
pub use peak::Peak;
pub use qconv::{Epilogue, OutElement, QConv, QConvParams};
pub use scratch::Scratch;
pub use tensor::{Element, Tensor, TensorMut};

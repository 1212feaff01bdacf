//! f32 convolution with bias, optional residual and optional ReLU.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod direct;
mod reference;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod winograd;

use crate::conv_check::{check_length, check_params, check_scratch, check_tensors};
use crate::phase::Phase;
use crate::winograd::float::{Points, transform_weights};
use crate::{Algorithm, ConvShape, Isa, KernelError, Layout, Part, Scratch, Tensor, TensorMut};

/// What an f32 convolution is made of.
#[derive(Debug, Clone)]
pub struct FConvParams<'a> {
    /// Geometry.
    pub shape: ConvShape,
    /// `[out_channels, in_channels / groups, kernel, kernel]`.
    pub weights: &'a [f32],
    /// One per output channel.
    pub bias: &'a [f32],
    /// `max(·, 0)` at the end.
    pub relu: bool,
    /// Whether a tensor of the output's size is added before ReLU (ResNet).
    pub residual: bool,
    /// How to compute it; one of [`Algorithm::candidates`].
    pub algorithm: Algorithm,
}

/// A packed f32 convolution for one instruction set: `relu(bias + Σ weight · input + residual)`.
///
/// Tiers differ in the order and fusing of sums: of random numbers they agree with scalar to
/// `1e-5 · (|bias| + |residual| + Σ|weight · input|)`, by [`Algorithm::Winograd`] to
/// `1e-5 · (|bias| + |residual| + Σ|weight| · max|input|)`, of the 6 × 6 input pixels of a tile, and with the
/// definition as well. Sums of thousands of equal products all round one way: with 2,592 of them the definition is up
/// to 4e-5 of that off, Winograd a tenth of it. An input that is not finite spoils all outputs of its tiles.
#[derive(Debug, Clone)]
pub struct FConv {
    shape: ConvShape,
    isa: Isa,
    relu: bool,
    residual: bool,
    algorithm: Algorithm,
    phases: Vec<Phase>,
    kernel: Kernel,
}

/// The packed form.
#[derive(Debug, Clone)]
enum Kernel {
    /// The scalar reference on the weights as given.
    Reference { weights: Vec<f32>, bias: Vec<f32> },
    /// The scalar reference of Winograd.
    WinogradReference {
        weights: Vec<Points>,
        bias: Vec<f32>,
    },
    /// A direct kernel of a vector tier.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    Direct(direct::Direct),
    /// A Winograd kernel of a vector tier.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    Winograd(winograd::Winograd),
}

impl Kernel {
    fn new(isa: Isa, params: &FConvParams) -> Self {
        let _ = isa;
        match params.algorithm {
            Algorithm::Direct => {
                #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
                if let Some(direct) = direct::Direct::new(isa, params) {
                    return Kernel::Direct(direct);
                }
                Kernel::Reference {
                    weights: params.weights.to_vec(),
                    bias: params.bias.to_vec(),
                }
            }
            Algorithm::Winograd => {
                let weights = transform_weights(params.weights);
                #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
                if let Some(winograd) = winograd::Winograd::new(isa, params, &weights) {
                    return Kernel::Winograd(winograd);
                }
                Kernel::WinogradReference {
                    weights,
                    bias: params.bias.to_vec(),
                }
            }
        }
    }
}

impl FConv {
    /// Packs a convolution for `isa`.
    ///
    /// # Errors
    /// When the CPU lacks `isa`, or lengths, shape or algorithm do not fit.
    pub fn new(isa: Isa, params: &FConvParams) -> Result<Self, KernelError> {
        let FConvParams {
            shape,
            weights,
            bias,
            ..
        } = params;
        check_params(isa, params.algorithm, shape, weights.len())?;
        check_length("biases", shape.out_channels(), bias.len())?;
        Ok(Self {
            shape: *shape,
            isa,
            relu: params.relu,
            residual: params.residual,
            algorithm: params.algorithm,
            phases: Phase::of(shape),
            kernel: Kernel::new(isa, params),
        })
    }

    /// Geometry.
    pub fn shape(&self) -> &ConvShape {
        &self.shape
    }

    /// The tier it was packed for.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// How it is computed.
    pub fn algorithm(&self) -> Algorithm {
        self.algorithm
    }

    /// The kernel's name, for logs and benches.
    pub fn name(&self) -> &'static str {
        match &self.kernel {
            Kernel::Reference { .. } => "f32_direct__scalar",
            Kernel::WinogradReference { .. } => "f32_winograd4__scalar",
            #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
            Kernel::Direct(direct) => direct.name(),
            #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
            Kernel::Winograd(winograd) => winograd.name(),
        }
    }

    /// Bytes of [`Scratch`] that a run needs, per thread.
    pub fn scratch_bytes(&self) -> usize {
        match &self.kernel {
            #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
            Kernel::Winograd(winograd) => winograd.scratch_bytes(),
            _ => 0,
        }
    }

    /// Share `index` of `count` of the work, as even as this kernel can divide it.
    ///
    /// # Panics
    /// Unless `index < count`.
    pub fn part(&self, out_height: usize, index: usize, count: usize) -> Part {
        let row_block = self.algorithm.row_block();
        Part::share(out_height, self.shape.groups(), row_block, index, count)
    }

    /// Checks layouts and buffer lengths (elements) for a run; call once at plan time before
    /// [`run_part`](Self::run_part).
    ///
    /// # Errors
    /// When a tensor does not fit the shape or its buffer, or a residual is missing or not expected.
    pub fn check(
        &self,
        input: (&Layout, usize),
        residual: Option<(&Layout, usize)>,
        output: (&Layout, usize),
    ) -> Result<(), KernelError> {
        if residual.is_some() != self.residual {
            return Err(KernelError::Tensor(format!(
                "residual: expected {}, found {}; pass a tensor exactly when FConvParams::residual is set",
                self.residual,
                residual.is_some()
            )));
        }
        check_tensors(&self.shape, input, residual, output)
    }

    /// Runs over separate buffers.
    ///
    /// # Errors
    /// When a tensor or the scratch does not fit.
    pub fn run(
        &self,
        input: Tensor<f32>,
        residual: Option<Tensor<f32>>,
        output: TensorMut<f32>,
        scratch: &mut Scratch,
    ) -> Result<(), KernelError> {
        self.check(
            (&input.layout, input.data.len()),
            residual.as_ref().map(|r| (&r.layout, r.data.len())),
            (&output.layout, output.data.len()),
        )?;
        check_scratch(self.scratch_bytes(), scratch)?;
        let part = Part::whole(output.layout.height(), self.shape.groups());
        // SAFETY: every access lies within the layouts, whose `buffer_len` is at most the slices' lengths (checked
        // above); the borrows keep the buffers separate.
        unsafe {
            self.run_part(
                input.data.as_ptr(),
                &input.layout,
                residual.as_ref().map(|r| (r.data.as_ptr(), &r.layout)),
                output.data.as_mut_ptr(),
                &output.layout,
                &part,
                scratch,
            );
        }
        Ok(())
    }

    /// Runs one share over buffers that may be the same one. Allocates nothing, but for Winograd's scalar
    /// reference.
    ///
    /// # Panics
    /// When the scratch is too small.
    ///
    /// # Safety
    /// The contract of [`QConv::run_part`](crate::QConv::run_part), with [`check`](Self::check) of this type.
    #[allow(clippy::too_many_arguments)]
    pub unsafe fn run_part(
        &self,
        input: *const f32,
        in_layout: &Layout,
        residual: Option<(*const f32, &Layout)>,
        output: *mut f32,
        out_layout: &Layout,
        part: &Part,
        scratch: &mut Scratch,
    ) {
        assert!(scratch.len() >= self.scratch_bytes(), "scratch");
        let run = Run {
            input,
            in_layout,
            residual,
            output,
            out_layout,
            part,
        };
        // SAFETY: the caller's contract is the kernels'.
        unsafe {
            match &self.kernel {
                Kernel::Reference { weights, bias } => self.run_reference(weights, bias, &run),
                #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
                Kernel::Direct(direct) => direct.run(self.relu, &run),
                Kernel::WinogradReference { weights, bias } => {
                    self.run_winograd_reference(weights, bias, &run);
                }
                #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
                Kernel::Winograd(winograd) => winograd.run(self.relu, &run, scratch),
            }
        }
    }
}

/// The tensors of one run.
struct Run<'a> {
    input: *const f32,
    in_layout: &'a Layout,
    residual: Option<(*const f32, &'a Layout)>,
    output: *mut f32,
    out_layout: &'a Layout,
    part: &'a Part,
}

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
impl<'a> Run<'a> {
    /// What becomes of this run's sums.
    fn writer(&self, relu: bool) -> crate::writers::Float<'a> {
        crate::writers::Float {
            relu,
            residual: self.residual,
            output: self.output,
            layout: self.out_layout,
        }
    }
}

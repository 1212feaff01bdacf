//! int8 convolution: u8 activations in, u8 activations or f32 maps out.

mod epilogue;
mod kernel;
mod reference;
mod run;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod vector;

pub use epilogue::{Epilogue, OutElement};

use crate::conv_check::{check_length, check_params, check_scratch, check_tensors};
use crate::phase::Phase;
use crate::{Algorithm, ConvShape, Isa, KernelError, Layout, Part, Scratch, Tensor, TensorMut};
use kernel::Kernel;
use run::Run;

/// What an int8 convolution is made of.
#[derive(Debug, Clone)]
pub struct QConvParams<'a> {
    /// Geometry.
    pub shape: ConvShape,
    /// `[out_channels, in_channels / groups, kernel, kernel]`, each in −127..=127.
    pub weights: &'a [i8],
    /// In units of the accumulator, one per output channel; or as many for each of [`ConvShape::phases`] in turn: what
    /// is folded in may depend on the kernel elements that a phase sums.
    pub bias: &'a [i32],
    /// Largest activation the input can hold: 127 behind a layer of ours, 255 for a picture.
    pub input_max: u8,
    /// What becomes of the accumulators.
    pub epilogue: Epilogue,
    /// How to compute it; one of [`Algorithm::candidates`].
    pub algorithm: Algorithm,
}

/// A packed int8 convolution for one instruction set.
///
/// `acc[oc] = bias[oc] + Σ weight · activation` in i32, `bias` being the phase's, exact or by [`Algorithm::Winograd`];
/// then the [`Epilogue`]. Every tier gives the same bits.
#[derive(Debug, Clone)]
pub struct QConv {
    shape: ConvShape,
    isa: Isa,
    algorithm: Algorithm,
    epilogue: Epilogue,
    phases: Vec<Phase>,
    kernel: Kernel,
}

impl QConv {
    /// Packs a convolution for `isa`.
    ///
    /// # Errors
    /// When the CPU lacks `isa`, lengths or shape do not fit, a weight is −128, or an accumulator could overflow i32.
    pub fn new(isa: Isa, params: &QConvParams) -> Result<Self, KernelError> {
        let QConvParams {
            shape,
            weights,
            bias,
            input_max,
            epilogue,
            algorithm,
        } = params;
        check_params(isa, *algorithm, shape, weights.len())?;
        let channels = shape.out_channels();
        let biases = match bias.len() > channels {
            true => channels * shape.phases(),
            false => channels,
        };
        check_length("biases", biases, bias.len())?;
        epilogue.check(shape.out_channels())?;
        check_range(shape, weights, bias, *input_max)?;
        let (kernel, epilogue) = Kernel::new(isa, params)?;
        Ok(Self {
            shape: *shape,
            isa,
            algorithm: *algorithm,
            epilogue,
            phases: Phase::of(shape),
            kernel,
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
        self.kernel.name()
    }

    /// Bytes of [`Scratch`] that a run needs, per thread.
    pub fn scratch_bytes(&self) -> usize {
        self.kernel.scratch_bytes()
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
        self.epilogue.check_residual(residual.is_some())?;
        check_tensors(&self.shape, input, residual, output)
    }

    /// Runs over separate buffers.
    ///
    /// # Errors
    /// When a tensor, the scratch or the element type does not fit.
    pub fn run<O: OutElement>(
        &self,
        input: Tensor<u8>,
        residual: Option<Tensor<u8>>,
        output: TensorMut<O>,
        scratch: &mut Scratch,
    ) -> Result<(), KernelError> {
        self.check(
            (&input.layout, input.data.len()),
            residual.as_ref().map(|r| (&r.layout, r.data.len())),
            (&output.layout, output.data.len()),
        )?;
        self.epilogue.check_element::<O>()?;
        check_scratch(self.scratch_bytes(), scratch)?;
        let part = Part::whole(output.layout.height(), self.shape.groups());
        // SAFETY: every access lies within the layouts, whose `buffer_len` is at most the slices' lengths (checked
        // above); the borrows keep the buffers separate; the element type and the scratch are checked above.
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
    /// When `O` is not the epilogue's element type, the scratch is too small, or a residual is missing or too many.
    ///
    /// # Safety
    /// - [`check`](Self::check) has accepted these layouts for the buffers that the pointers are the start of.
    /// - While this runs nobody writes the channels of the input (halo of `shape().input_halo()` included) or of the
    ///   residual, and nobody else reads or writes the output elements of `part`. Input, residual and output may be
    ///   disjoint channel slices of one buffer. The residual may be the output itself.
    /// - `part` lies within the output's rows and the shape's groups.
    #[allow(clippy::too_many_arguments)]
    pub unsafe fn run_part<O: OutElement>(
        &self,
        input: *const u8,
        in_layout: &Layout,
        residual: Option<(*const u8, &Layout)>,
        output: *mut O,
        out_layout: &Layout,
        part: &Part,
        scratch: &mut Scratch,
    ) {
        assert!(scratch.len() >= self.scratch_bytes(), "scratch");
        assert!(self.epilogue.check_element::<O>().is_ok(), "element type");
        let given = residual.is_some();
        assert!(self.epilogue.check_residual(given).is_ok(), "residual");
        let run = Run {
            input,
            in_layout,
            residual,
            output: O::output(output),
            out_layout,
            part,
        };
        // SAFETY: the caller's contract.
        unsafe { self.dispatch(&run, scratch) }
    }
}

/// Refuses weights of −128 and sums that could leave i32: `|bias| + input_max · Σ|w| ≤ i32::MAX`, of the greatest bias
/// of a channel, makes every partial sum exact.
fn check_range(
    shape: &ConvShape,
    weights: &[i8],
    bias: &[i32],
    input_max: u8,
) -> Result<(), KernelError> {
    let channels = shape.out_channels();
    let per_output = shape.weight_len() / channels;
    for (oc, weights) in weights.chunks_exact(per_output).enumerate() {
        let biases = bias.iter().skip(oc).step_by(channels);
        let bias = biases.map(|&b| i64::from(b).abs()).max().unwrap_or(0);
        if weights.contains(&i8::MIN) {
            return Err(KernelError::Value(format!(
                "expected weights in -127..=127, found -128 in output channel {oc}; quantise symmetrically"
            )));
        }
        let sum: i64 = weights.iter().map(|&w| i64::from(w).abs()).sum();
        let worst = bias + sum * i64::from(input_max);
        if worst > i64::from(i32::MAX) {
            return Err(KernelError::Value(format!(
                "expected accumulators within i32, found up to {worst} in output channel {oc}; use smaller weights or bias"
            )));
        }
    }
    Ok(())
}

//! What becomes of an i32 accumulator.

use crate::KernelError;
use crate::conv_check::check_length;
use crate::tensor::Element;

/// The last step of an int8 convolution, per output channel.
#[derive(Debug, Clone, PartialEq)]
pub enum Epilogue {
    /// `clamp(rne(acc · scale + residual · residual_scale), 0, max)`; product and sum are each rounded to f32, never
    /// fused. ReLU is the clamp at 0.
    U8 {
        /// One per output channel.
        scale: Vec<f32>,
        /// Largest output: 127 where a layer of ours reads it.
        max: u8,
        /// Scale of a u8 tensor that is added before rounding (ResNet); none when there is no such tensor.
        residual_scale: Option<f32>,
    },
    /// `acc · scale`, without ReLU: the heads' last layers.
    F32 {
        /// One per output channel.
        scale: Vec<f32>,
    },
}

/// Element type an int8 convolution can put out: `u8` for [`Epilogue::U8`], `f32` for [`Epilogue::F32`].
pub trait OutElement: Element {
    #[doc(hidden)]
    fn output(pointer: *mut Self) -> Output;
}

/// Where the output begins.
#[doc(hidden)]
#[derive(Debug, Clone, Copy)]
pub enum Output {
    U8(*mut u8),
    F32(*mut f32),
}

impl OutElement for u8 {
    fn output(pointer: *mut u8) -> Output {
        Output::U8(pointer)
    }
}

impl OutElement for f32 {
    fn output(pointer: *mut f32) -> Output {
        Output::F32(pointer)
    }
}

impl Epilogue {
    pub(super) fn scale(&self) -> &[f32] {
        match self {
            Epilogue::U8 { scale, .. } | Epilogue::F32 { scale } => scale,
        }
    }

    pub(super) fn residual_scale(&self) -> Option<f32> {
        match self {
            Epilogue::U8 { residual_scale, .. } => *residual_scale,
            Epilogue::F32 { .. } => None,
        }
    }

    /// The epilogue for accumulators that are `factor` times as large.
    pub(super) fn divided_by(&self, factor: &[i32]) -> Self {
        let mut epilogue = self.clone();
        let (Epilogue::U8 { scale, .. } | Epilogue::F32 { scale }) = &mut epilogue;
        for (scale, &factor) in scale.iter_mut().zip(factor) {
            *scale = (f64::from(*scale) / f64::from(factor)) as f32;
        }
        epilogue
    }

    pub(super) fn check(&self, out_channels: usize) -> Result<(), KernelError> {
        check_length("output scales", out_channels, self.scale().len())?;
        let all = self.scale().iter().copied().chain(self.residual_scale());
        for scale in all {
            if !scale.is_finite() || scale.abs() > 1e20 {
                return Err(KernelError::Value(format!(
                    "expected finite output scales of reasonable size, found {scale}; calibrate again"
                )));
            }
        }
        Ok(())
    }

    /// Whether the result is clamped to 0..=127 and no value before clamping can leave ±2³¹, as |acc| ≤ 2³¹.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    pub(super) fn is_narrow(&self) -> bool {
        let residual = self.residual_scale().unwrap_or(0.0).abs() * 255.0;
        let all_small = self.scale().iter().all(|scale| scale.abs() <= 0.5);
        matches!(self, Epilogue::U8 { max: 127, .. }) && all_small && residual <= 1e9
    }

    /// The formula of [`Epilogue::U8`] for one accumulator.
    pub(super) fn to_u8(&self, channel: usize, acc: i32, residual: u8) -> u8 {
        let Epilogue::U8 {
            scale,
            max,
            residual_scale,
        } = self
        else {
            unreachable!("the element type was checked");
        };
        let mut value = acc as f32 * scale[channel];
        if let Some(residual_scale) = residual_scale {
            value += f32::from(residual) * residual_scale;
        }
        // Clamping before rounding is the same, as both bounds are integers, and keeps every value convertible.
        value.max(0.0).min(f32::from(*max)).round_ties_even() as u8
    }

    /// The formula of [`Epilogue::F32`] for one accumulator.
    pub(super) fn to_f32(&self, channel: usize, acc: i32) -> f32 {
        acc as f32 * self.scale()[channel]
    }

    pub(super) fn check_element<O: OutElement>(&self) -> Result<(), KernelError> {
        let expected = match self {
            Epilogue::U8 { .. } => u8::NAME,
            Epilogue::F32 { .. } => f32::NAME,
        };
        if expected == O::NAME {
            return Ok(());
        }
        Err(KernelError::Tensor(format!(
            "output: expected a buffer of {expected} for this epilogue, found {}; match the buffer to the epilogue",
            O::NAME
        )))
    }

    pub(super) fn check_residual(&self, given: bool) -> Result<(), KernelError> {
        if given == self.residual_scale().is_some() {
            return Ok(());
        }
        let text = if given {
            "residual: expected none, as the epilogue has no residual scale, found one; set residual_scale"
        } else {
            "residual: expected a tensor, as the epilogue has a residual scale, found none; pass the tensor"
        };
        Err(KernelError::Tensor(text.to_owned()))
    }
}

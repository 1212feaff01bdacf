//! Pictures go in, what every activation of a network did on them comes out.

use super::model::{Calibration, Model, Observed, RangeChoice};
use super::run::{Engine, EngineError, EngineOptions, Precision};

/// How to calibrate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationOptions {
    /// Width and height that pictures come in; multiples of 16.
    pub size: (usize, usize),
    /// How ranges are chosen.
    pub choice: RangeChoice,
    /// 0: one range per value; 1: a range of its own for every channel.
    pub own_ranges: f32,
    /// Correct biases for the mean error of rounded weights.
    pub correct_bias: bool,
}

impl Default for CalibrationOptions {
    /// 512×320; all but one value in 20,000 within the range; channels halfway to a range of their own; biases corrected.
    fn default() -> Self {
        Self {
            size: (512, 320),
            choice: RangeChoice::Percentile(0.99995),
            own_ranges: 0.5,
            correct_bias: true,
        }
    }
}

impl Calibration {
    /// Runs the f32 network over `pictures` (row-major `[height, width, 3]`, RGB) and observes every value.
    ///
    /// # Errors
    /// When the network cannot run at this size.
    ///
    /// # Panics
    /// When a picture is not of `options.size`.
    pub fn observe(
        model: &Model,
        pictures: impl IntoIterator<Item = Vec<u8>>,
        options: CalibrationOptions,
    ) -> Result<Self, EngineError> {
        let mut engine = Engine::new(
            model,
            EngineOptions {
                width: options.size.0,
                height: options.size.1,
                threads: 1,
                precision: Precision::F32,
                ..EngineOptions::default()
            },
        )?;
        let values = &model.network().graph().values;
        let mut observed: Vec<_> = values.iter().map(|v| Observed::new(v.channels)).collect();
        let mut count = 0;
        for picture in pictures {
            engine.observe(&picture, &mut observed);
            count += 1;
        }
        Ok(Self {
            observed,
            choice: options.choice,
            own_ranges: options.own_ranges,
            correct_bias: options.correct_bias,
            pictures: count,
        })
    }
}

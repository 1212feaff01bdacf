//! Pictures go in, what every activation of a network did on them comes out.

use edgecap_kernels::Algorithms;

use super::model::{Calibration, Model, Observed, RangeChoice};
use super::run::{Engine, EngineError, EngineOptions, Precision};

/// A picture with a maximum beyond so many times the median is left out.
pub const WILD: f32 = 4.0;

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
    /// 512×320; the greatest values seen (wild pictures are left out anyway); channels halfway to a range of their own;
    /// biases corrected.
    fn default() -> Self {
        Self {
            size: (512, 320),
            choice: RangeChoice::Max,
            own_ranges: 0.5,
            correct_bias: true,
        }
    }
}

/// One way of quantising and what it cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// How ranges were chosen.
    pub choice: RangeChoice,
    /// How far channels had ranges of their own.
    pub own_ranges: f32,
    /// Whether biases were corrected.
    pub correct_bias: bool,
    /// Median over pictures of the 2D maps' error: root mean square of int8 - f32, over that of f32.
    pub error: f32,
}

impl Calibration {
    /// The engine that observes pictures of this size, pixels across and down.
    ///
    /// # Errors
    /// When the network cannot run at it.
    pub fn engine(model: &Model, (width, height): (usize, usize)) -> Result<Engine, EngineError> {
        let options = EngineOptions {
            width,
            height,
            threads: 1,
            precision: Precision::F32,
            // Winograd turns an overflow into no number, and ReLU that into 0, where nobody would see it.
            algorithms: Some(Algorithms::Direct),
            ..EngineOptions::default()
        };
        Engine::new(model, options)
    }

    /// Runs the f32 network over `pictures` (row-major `[height, width, 3]`, RGB) and observes every value. Pictures on
    /// which the network runs wild (some value's maximum is beyond [`WILD`] times the median over pictures) are left
    /// out: following them would cost all others their resolution. `pictures` are gone through twice, and one is held
    /// at a time.
    ///
    /// # Errors
    /// When the network cannot run at this size, a value overflows, or fewer than half of the pictures, or none, are
    /// left.
    ///
    /// # Panics
    /// When a picture is not of `options.size`.
    pub fn observe(
        model: &Model,
        pictures: impl IntoIterator<Item: AsRef<[u8]>, IntoIter: Clone>,
        options: CalibrationOptions,
    ) -> Result<Self, EngineError> {
        let mut engine = Self::engine(model, options.size)?;
        let graph = model.network().graph();
        let values = &graph.values;
        let nothing = || values.iter().map(|v| Observed::new(v.channels)).collect();
        // Heads are as unlike as those whom pictures show.
        let is_head = |v: usize| graph.outputs.iter().any(|(_, o)| *o == v);
        let inner: Vec<usize> = (0..values.len()).filter(|&v| !is_head(v)).collect();
        let pictures = pictures.into_iter();
        let mut maxima = Vec::new();
        for picture in pictures.clone() {
            let mut one: Vec<Observed> = nothing();
            engine.observe(picture.as_ref(), &mut one);
            maxima.push(inner.iter().map(|&v| one[v].max()).collect());
        }
        let wild = wild(&maxima);
        let left_out = wild.iter().filter(|w| **w).count();
        let left = wild.len() - left_out;
        // What most pictures do is not wild: the median says nothing of them, and ranges of the rest would clip them.
        if left == 0 || left < left_out {
            return Err(EngineError::Wild {
                left,
                pictures: wild.len(),
            });
        }
        let mut observed: Vec<Observed> = nothing();
        for (picture, _) in pictures.zip(&wild).filter(|(_, wild)| !**wild) {
            engine.observe(picture.as_ref(), &mut observed);
        }
        for node in &graph.nodes {
            if observed[node.output].max().is_infinite() {
                return Err(EngineError::Overflow(node.name.clone()));
            }
        }
        Ok(Self {
            observed,
            choice: options.choice,
            own_ranges: options.own_ranges,
            correct_bias: options.correct_bias,
            pictures: left,
            left_out,
        })
    }

    /// Tries ways of choosing ranges and keeps the one whose int8 maps come nearest to f32 on `pictures`, which should
    /// look as they will in use. Returns all trials, best first.
    ///
    /// # Errors
    /// When the network cannot run at this size.
    ///
    /// # Panics
    /// When a picture is not of `size`, or there is none.
    pub fn select(
        &mut self,
        model: &Model,
        pictures: &[Vec<u8>],
        (width, height): (usize, usize),
    ) -> Result<Vec<Trial>, EngineError> {
        assert!(!pictures.is_empty(), "trials need pictures");
        let options = |precision| EngineOptions {
            width,
            height,
            precision,
            ..EngineOptions::default()
        };
        let mut float = Engine::new(model, options(Precision::F32))?;
        let expected = pictures.iter().map(|p| float.run(p).head2d.clone());
        let expected: Vec<Vec<f32>> = expected.collect();
        drop(float);
        let mut trials = Vec::new();
        for choice in [
            RangeChoice::Max,
            RangeChoice::Percentile(0.99999),
            RangeChoice::Percentile(0.9999),
            RangeChoice::Percentile(0.9997),
            RangeChoice::Percentile(0.999),
            RangeChoice::Mse,
        ] {
            for (own_ranges, correct_bias) in [(0.0, true), (0.5, true), (0.5, false), (0.75, true)]
            {
                (self.choice, self.own_ranges, self.correct_bias) =
                    (choice, own_ranges, correct_bias);
                let int8 = model.clone().quantise(Some(self))?;
                let mut engine = Engine::new(&int8, options(Precision::Int8))?;
                let errors = pictures.iter().zip(&expected);
                let mut errors: Vec<f32> = errors
                    .map(|(p, e)| relative_error(e, &engine.run(p).head2d))
                    .collect();
                trials.push(Trial {
                    choice,
                    own_ranges,
                    correct_bias,
                    error: median(&mut errors),
                });
            }
        }
        trials.sort_by(|a, b| a.error.total_cmp(&b.error));
        let best = trials[0];
        (self.choice, self.own_ranges, self.correct_bias) =
            (best.choice, best.own_ranges, best.correct_bias);
        Ok(trials)
    }
}

/// Which pictures have a value whose maximum is beyond [`WILD`] times the median over pictures. `maxima` is
/// `[picture][value]`.
fn wild(maxima: &[Vec<f32>]) -> Vec<bool> {
    let values = maxima.first().map_or(0, Vec::len);
    let median_of = |v: usize| {
        let mut all: Vec<f32> = maxima.iter().map(|m| m[v]).collect();
        median(&mut all)
    };
    let medians: Vec<f32> = (0..values).map(median_of).collect();
    let is_wild = |m: &Vec<f32>| m.iter().zip(&medians).any(|(m, median)| *m > WILD * median);
    maxima.iter().map(is_wild).collect()
}

/// The middle value (the upper one of two); 0 of none.
fn median(values: &mut [f32]) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Root mean square of the difference over that of `expected`.
fn relative_error(expected: &[f32], found: &[f32]) -> f32 {
    let difference = expected.iter().zip(found).map(|(a, b)| (a - b).powi(2));
    let scale = expected.iter().map(|a| a.powi(2)).sum::<f32>();
    (difference.sum::<f32>() / scale.max(f32::MIN_POSITIVE)).sqrt()
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::engine::Network;
    use crate::engine::model::{FloatConv, Weights};

    /// Four layers in a row, of which the last is also read by the second head.
    fn in_a_row() -> Model {
        let text = r#"
            name = "tiny"
            about = "layers in a row"
            input = { channels = 3, multiple = 16 }
            output = { head2d = "head2d.out", head3d = "head3d.out" }
            layers = [
              { kind = "conv", name = "a", out = 8, kernel = 3, stride = 2 },
              { kind = "conv", name = "b", out = 8, kernel = 3, stride = 2 },
              { kind = "conv", name = "c", out = 8, kernel = 3, stride = 2 },
              { kind = "conv", name = "head2d.out", out = 40, kernel = 1, norm = false, relu = false },
              { kind = "conv", name = "head3d.out", from = ["c"], out = 63, kernel = 1, norm = false, relu = false },
            ]
        "#;
        Model::random(Network::parse(text).unwrap(), 3)
    }

    fn convs(model: &mut Model) -> impl Iterator<Item = &mut FloatConv> {
        let Weights::Float(convs) = &mut model.weights else {
            panic!("random weights are floats");
        };
        convs.iter_mut().flatten()
    }

    fn observe(
        model: &Model,
        pictures: impl IntoIterator<Item = [u8; 3], IntoIter: Clone>,
    ) -> Result<Calibration, EngineError> {
        let options = CalibrationOptions {
            size: (32, 16),
            ..CalibrationOptions::default()
        };
        let pictures = pictures.into_iter().map(|colour| colour.repeat(32 * 16));
        Calibration::observe(model, pictures, options)
    }

    #[test]
    fn a_layer_that_overflows_is_named() {
        let mut model = in_a_row();
        for conv in convs(&mut model).take(3) {
            conv.weight.fill(1e19);
        }
        let found = observe(&model, [[200; 3]]);
        let said = found.expect_err("it overflows").to_string();
        assert!(said.contains("`b`") || said.contains("`c`"), "{said}");
    }

    #[test]
    fn an_overflow_that_winograd_would_hide_is_named() {
        let text = r#"
            name = "overflow"
            about = "a layer that Winograd could compute, the last one with ReLU"
            input = { channels = 3, multiple = 16 }
            output = { head2d = "head2d.out", head3d = "head3d.out" }
            layers = [
              { kind = "conv", name = "a", out = 16, kernel = 1, stride = 8 },
              { kind = "conv", name = "b", out = 16, kernel = 3 },
              { kind = "conv", name = "head2d.out", from = ["b"], out = 40, kernel = 1, relu = false },
              { kind = "conv", name = "head3d.out", from = ["b"], out = 63, kernel = 1, relu = false },
            ]
        "#;
        let mut model = Model::random(Network::parse(text).unwrap(), 3);
        for conv in convs(&mut model).take(2) {
            conv.weight.fill(1e19);
        }
        let found = observe(&model, [[200; 3]]);
        let said = found.expect_err("it overflows").to_string();
        assert!(said.contains("`b`"), "{said}");
    }

    #[test]
    fn a_head_that_overflows_is_named() {
        for (head, name) in [(3, "`head2d.out`"), (4, "`head3d.out`")] {
            let mut model = in_a_row();
            observe(&model, [[200; 3]]).unwrap();
            for (i, conv) in convs(&mut model).enumerate() {
                if i == 2 {
                    conv.bias.fill(100.0);
                }
                if i == head {
                    conv.weight.fill(1e38);
                }
            }
            let found = observe(&model, [[200; 3]]);
            let said = found.expect_err("it overflows").to_string();
            assert!(said.contains(name), "{said}");
        }
    }

    #[test]
    fn pictures_of_which_most_are_wild_give_no_ranges() {
        let text = r#"
            name = "colours"
            about = "a layer for each colour of the picture"
            input = { channels = 3, multiple = 16 }
            output = { head2d = "head2d.out", head3d = "head3d.out" }
            layers = [
              { kind = "conv", name = "r", out = 4, kernel = 1, stride = 8 },
              { kind = "conv", name = "g", from = ["input"], out = 4, kernel = 1, stride = 8 },
              { kind = "conv", name = "b", from = ["input"], out = 4, kernel = 1, stride = 8 },
              { kind = "conv", name = "head2d.out", from = ["r", "g", "b"], out = 40, kernel = 1, relu = false },
              { kind = "conv", name = "head3d.out", from = ["r", "g", "b"], out = 63, kernel = 1, relu = false },
            ]
        "#;
        let mut model = Model::random(Network::parse(text).unwrap(), 3);
        for (colour, conv) in convs(&mut model).take(3).enumerate() {
            let one = |i: usize| if i % 3 == colour { 1.0 } else { 0.0 };
            conv.weight = (0..conv.weight.len()).map(one).collect();
            conv.bias.fill(0.5);
        }
        let colours = [[255, 10, 10], [10, 255, 10], [10, 10, 255]];
        let said = observe(&model, colours).unwrap_err().to_string();
        assert!(
            said.contains("half of the 3 pictures or more, found 0")
                && said.contains("beyond 4 times"),
            "{said}"
        );
        let with = |dark: usize| observe(&model, colours.into_iter().chain(vec![[10; 3]; dark]));
        assert!(matches!(
            with(2),
            Err(EngineError::Wild {
                left: 2,
                pictures: 5
            })
        ));
        let half = with(3).unwrap();
        assert_eq!((half.pictures, half.left_out), (3, 3));
        assert!(observe(&model, []).is_err());
    }

    /// A picture that is counted while there is one.
    struct Counted<'a> {
        pixels: Vec<u8>,
        alive: &'a Cell<usize>,
    }

    impl AsRef<[u8]> for Counted<'_> {
        fn as_ref(&self) -> &[u8] {
            &self.pixels
        }
    }

    impl Drop for Counted<'_> {
        fn drop(&mut self) {
            self.alive.set(self.alive.get() - 1);
        }
    }

    #[test]
    fn one_picture_is_held_at_a_time() {
        let (alive, most, asked) = (Cell::new(0), Cell::new(0), Cell::new(0));
        let pictures = [90; 4].into_iter().map(|grey| {
            asked.set(asked.get() + 1);
            alive.set(alive.get() + 1);
            most.set(most.get().max(alive.get()));
            Counted {
                pixels: vec![grey; 3 * 32 * 16],
                alive: &alive,
            }
        });
        let options = CalibrationOptions {
            size: (32, 16),
            ..CalibrationOptions::default()
        };
        let seen = Calibration::observe(&in_a_row(), pictures, options).unwrap();
        assert_eq!((seen.pictures, asked.get(), most.get()), (4, 8, 1));
    }

    #[test]
    fn one_wild_picture_is_seen() {
        let mut maxima = vec![vec![1.0, 2.0, 0.0]; 9];
        maxima[3][1] = 9.0;
        maxima[5][1] = 7.0;
        let mut expected = vec![false; 9];
        expected[3] = true;
        assert_eq!(wild(&maxima), expected);
        assert!(wild(&[]).is_empty());
    }
}

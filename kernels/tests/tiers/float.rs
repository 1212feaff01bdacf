//! f32 convolutions: close to scalar, and scalar close to the definition.

use edgecap_kernels::{Algorithm, FConv, FConvParams, Isa, Layout, Scratch, Tensor, TensorMut};
use proptest::prelude::*;

use super::{Case, Numbers, Values, any_case, conv, layer_shapes, sliced, tiers_beside_scalar};
use crate::guarded::Guarded;

/// `Σ` in another order and with fused products: within 4 · 2⁻²⁴ · √terms… bounded here by 1e-5 of the sum of
/// magnitudes. Winograd's is that of a tile: what some of its outputs do not see cancels only nearly in them.
const F32_TOLERANCE: f32 = 1e-5;

/// An f32 convolution over buffers that end where the memory does.
struct FloatRun<'a> {
    case: &'a Case,
    in_layout: Layout,
    out_layout: Layout,
    weights: Vec<f32>,
    bias: Vec<f32>,
    input: Vec<f32>,
    residual: Vec<f32>,
}

impl<'a> FloatRun<'a> {
    /// Elements outside of the output.
    const UNTOUCHED: f32 = 99.0;

    fn new(case: &'a Case) -> Self {
        let Case { shape, around, .. } = *case;
        let mut numbers = Numbers(case.seed | 1);
        let weights = (0..shape.weight_len()).map(|_| numbers.float()).collect();
        let bias = (0..shape.out_channels()).map(|_| numbers.float()).collect();
        let channels = shape.in_channels();
        let halo = shape.input_halo();
        let in_layout = sliced(case.height, case.width, channels, around, halo);
        let input = (0..in_layout.buffer_len())
            .map(|_| match case.values {
                // Few and large ones, beside which most outputs see nothing.
                Values::Ends if numbers.within(0, 19) > 0 => 0.0,
                _ => numbers.float(),
            })
            .collect();
        let out_layout = sliced(
            shape.output_len(case.height),
            shape.output_len(case.width),
            shape.out_channels(),
            around,
            case.parts % 2,
        );
        let len = out_layout.buffer_len();
        let residual = (0..len).map(|_| numbers.float()).collect();
        Self {
            case,
            in_layout,
            out_layout,
            weights,
            bias,
            input,
            residual,
        }
    }

    /// `|bias| + Σ|w·x| + |residual|` of every element of the output. In Winograd's, x is the greatest of the inputs
    /// that the output's tile has of a channel.
    fn magnitudes(&self, algorithm: Algorithm) -> Vec<f32> {
        if algorithm == Algorithm::Winograd {
            return self.magnitudes_of_tiles();
        }
        let of = |values: &[f32]| values.iter().map(|v| v.abs()).collect();
        let absolute = Self {
            weights: of(&self.weights),
            bias: of(&self.bias),
            input: of(&self.input),
            residual: of(&self.residual),
            ..*self
        };
        absolute.run(Isa::Scalar, Algorithm::Direct, false)
    }

    /// Of tiles of 4 × 4 outputs from 6 × 6 inputs each, on a grid that begins at output (0, 0).
    fn magnitudes_of_tiles(&self) -> Vec<f32> {
        let (shape, layout, out) = (&self.case.shape, &self.in_layout, &self.out_layout);
        let padding = shape.padding() as isize;
        let inputs = |tile: usize, side: usize| {
            let first = 4 * tile as isize - padding;
            first..(first + 6).min(side as isize + padding)
        };
        let outputs = |tile: usize, side: usize| 4 * tile..(4 * tile + 4).min(side);
        let depth = shape.group_in();
        let kernels = self.weights.chunks_exact(9);
        let kernels: Vec<f32> = kernels.map(|k| k.iter().map(|w| w.abs()).sum()).collect();
        let mut sizes = vec![0.0; out.buffer_len()];
        for ty in 0..out.height().div_ceil(4) {
            for tx in 0..out.width().div_ceil(4) {
                let mut greatest = vec![0f32; layout.channels()];
                for y in inputs(ty, layout.height()) {
                    for x in inputs(tx, layout.width()) {
                        let pixel = &self.input[layout.index(y, x)..][..layout.channels()];
                        for (greatest, x) in greatest.iter_mut().zip(pixel) {
                            *greatest = greatest.max(x.abs());
                        }
                    }
                }
                for oc in 0..out.channels() {
                    let of_group = &greatest[oc / shape.group_out() * depth..];
                    let products = of_group.iter().zip(&kernels[oc * depth..][..depth]);
                    let sum = self.bias[oc].abs() + products.map(|(x, w)| x * w).sum::<f32>();
                    for y in outputs(ty, out.height()) {
                        for x in outputs(tx, out.width()) {
                            let at = out.index(y as isize, x as isize) + oc;
                            let added = self.case.residual.then(|| self.residual[at].abs());
                            sizes[at] = sum + added.unwrap_or(0.0);
                        }
                    }
                }
            }
        }
        sizes
    }

    fn run(&self, isa: Isa, algorithm: Algorithm, relu: bool) -> Vec<f32> {
        let conv = FConv::new(
            isa,
            &FConvParams {
                shape: self.case.shape,
                weights: &Guarded::new(&self.weights),
                bias: &Guarded::new(&self.bias),
                relu,
                residual: self.case.residual,
                algorithm,
            },
        )
        .unwrap();
        let (input, residual) = (Guarded::new(&self.input), Guarded::new(&self.residual));
        let mut output = Guarded::new(&vec![Self::UNTOUCHED; residual.len()]);
        let mut scratch = Scratch::new(conv.scratch_bytes());
        let residual_layout = self.case.residual.then_some(&self.out_layout);
        conv.check(
            (&self.in_layout, input.len()),
            residual_layout.map(|layout| (layout, residual.len())),
            (&self.out_layout, output.len()),
        )
        .unwrap();
        for index in 0..self.case.parts {
            let part = conv.part(self.out_layout.height(), index, self.case.parts);
            // SAFETY: checked above; the buffers are separate and nobody else touches them.
            unsafe {
                conv.run_part(
                    input.as_ptr(),
                    &self.in_layout,
                    residual_layout.map(|layout| (residual.as_ptr(), layout)),
                    output.as_mut_ptr(),
                    &self.out_layout,
                    &part,
                    &mut scratch,
                );
            }
        }
        output.to_vec()
    }
}

pub fn check_f(case: &Case) {
    let float = FloatRun::new(case);
    let definition = float.run(Isa::Scalar, Algorithm::Direct, case.to_f32);
    for &algorithm in Algorithm::candidates(&case.shape) {
        let expected = match algorithm {
            Algorithm::Direct => definition.clone(),
            other => float.run(Isa::Scalar, other, case.to_f32),
        };
        let bound = float.magnitudes(algorithm);
        let close = |found: &[f32], expected: &[f32], what: &str| {
            for i in 0..found.len() {
                let untouched = expected[i] == FloatRun::UNTOUCHED;
                let allowed = if untouched {
                    0.0
                } else {
                    bound[i] * F32_TOLERANCE
                };
                assert!(
                    (found[i] - expected[i]).abs() <= allowed,
                    "{what} {algorithm:?} at {i}: {} for {}, {case:?}",
                    found[i],
                    expected[i]
                );
            }
        };
        close(&expected, &definition, "scalar");
        for isa in tiers_beside_scalar() {
            let found = float.run(isa, algorithm, case.to_f32);
            close(&found, &expected, isa.name());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn f32_of_any_shape_is_close_to_scalar(case in any_case()) {
        check_f(&case);
    }
}

#[test]
#[cfg_attr(
    miri,
    ignore = "hours under Miri; small_layers_equal_scalar is the same on small shapes"
)]
fn f32_layers_are_close_to_scalar() {
    for (i, shape) in layer_shapes().into_iter().enumerate() {
        check_f(&Case {
            shape,
            height: 7,
            width: 9,
            input_max: 0,
            values: Values::Any,
            around: i % 3,
            residual: i % 2 == 0,
            to_f32: i % 3 == 0,
            parts: 1 + i % 3,
            seed: 1 + i as u64,
        });
    }
}

#[test]
fn relu_of_what_is_no_number_is_zero() {
    let shape = conv(2, 9, 1, 1, 1);
    let layout = |channels| Layout::dense(1, 9, channels, 0).unwrap();
    let mut input = vec![1.0f32; layout(2).buffer_len()];
    input[2 * 5] = f32::NAN;
    for isa in Isa::available() {
        let params = FConvParams {
            shape,
            weights: &[0.5; 18],
            bias: &[0.0; 9],
            relu: true,
            residual: false,
            algorithm: Algorithm::Direct,
        };
        let conv = FConv::new(isa, &params).unwrap();
        let mut output = vec![-1.0f32; layout(9).buffer_len()];
        conv.run(
            Tensor::new(&input, layout(2)),
            None,
            TensorMut::new(&mut output, layout(9)),
            &mut Scratch::new(conv.scratch_bytes()),
        )
        .unwrap();
        for (i, found) in output.iter().enumerate() {
            let expected = if i / 9 == 5 { 0.0 } else { 1.0 };
            assert_eq!(*found, expected, "{isa} at {i}");
        }
    }
}

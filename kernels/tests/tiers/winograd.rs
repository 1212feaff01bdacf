//! Winograd in both precisions: as scalar, and near the definition.

use edgecap_kernels::{
    Algorithm, ConvDims, ConvShape, Epilogue, FConv, FConvParams, Isa, Layout, QConv, QConvParams,
    Scratch, Tensor, TensorMut,
};
use proptest::prelude::*;

use super::float::check_f;
use super::int8::check_algorithm;
use super::{Case, Numbers, Values, conv};

/// Winograd in several chunks of tiles, whose last tile of a register block is full, half full or nearly empty; the
/// first with so many weights that chunks are as large as they get.
#[test]
#[cfg_attr(miri, ignore = "hours under Miri")]
fn winograd_of_many_tiles_is_as_scalar() {
    for (channels, outs, height, width) in [
        (256, 256, 17, 37),
        (32, 17, 25, 39),
        (72, 24, 21, 35),
        (192, 33, 13, 20),
    ] {
        let case = Case {
            shape: conv(channels, outs, 1, 3, 1),
            height,
            width,
            input_max: 127,
            values: Values::Small,
            around: 1,
            residual: true,
            to_f32: false,
            parts: 1,
            seed: 1,
        };
        check_algorithm(&case, Algorithm::Winograd);
        check_f(&case);
    }
}

prop_compose! {
    /// Layers that Winograd computes: tiles cut by every edge and by parts, channels around the vectors' widths.
    fn winograd_case()(
        groups in 1usize..4,
        depth in prop_oneof![1usize..6, 7usize..10, 15usize..19, Just(32), 47usize..50],
        outs in prop_oneof![1usize..20, 30usize..50],
        padding in 0usize..3,
    )(
        shape in Just(ConvShape::new(ConvDims {
            in_channels: groups * depth,
            out_channels: groups * outs,
            groups,
            kernel: 3,
            padding,
            ..ConvDims::default()
        }).unwrap()),
        height in 3usize..14,
        width in prop_oneof![3usize..15, 15usize..40],
        values in prop_oneof![Just(Values::Any), Just(Values::Ends)],
        around in 0usize..6,
        residual in any::<bool>(),
        to_f32 in any::<bool>(),
        parts in 1usize..5,
        seed in any::<u64>(),
    ) -> Case {
        Case { shape, height, width, input_max: 127, values, around, residual, to_f32, parts, seed }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    #[cfg_attr(miri, ignore = "hours under Miri; small_layers_equal_scalar is the same on small shapes")]
    fn winograd_of_any_shape_is_as_scalar(case in winograd_case()) {
        check_algorithm(&case, Algorithm::Winograd);
        check_f(&case);
    }
}

/// Winograd against the definition: outputs of 7 bits differ by at most one step, and few of them differ.
#[test]
#[cfg_attr(miri, ignore = "accuracy, not memory")]
fn winograd_is_within_one_step_of_direct() {
    for (channels, outs, groups) in [
        (16, 16, 1),
        (64, 32, 1),
        (72, 72, 1),
        (144, 48, 2),
        (192, 40, 1),
    ] {
        let shape = conv(channels, outs, groups, 3, 1);
        let mut numbers = Numbers(channels as u64);
        let weights: Vec<i8> = (0..shape.weight_len())
            .map(|_| numbers.within(-127, 127) as i8)
            .collect();
        let bias: Vec<i32> = (0..outs)
            .map(|_| numbers.within(-9000, 9000) as i32)
            .collect();
        let layout = Layout::dense(13, 22, channels, 1).unwrap();
        let input: Vec<u8> = (0..layout.buffer_len())
            .map(|_| numbers.within(0, 127) as u8)
            .collect();
        let out_layout = Layout::dense(13, 22, outs, 0).unwrap();
        // Two standard deviations of the sum fill the range.
        let depth = (channels / groups * 9) as f32;
        let scale = vec![127.0 / (2.0 * depth.sqrt() * 73.0 * 73.0); outs];
        let run = |algorithm| {
            let conv = QConv::new(
                Isa::Scalar,
                &QConvParams {
                    shape,
                    weights: &weights,
                    bias: &bias,
                    input_max: 127,
                    epilogue: Epilogue::U8 {
                        scale: scale.clone(),
                        max: 127,
                        residual_scale: None,
                    },
                    algorithm,
                },
            )
            .unwrap();
            let mut output = vec![0u8; out_layout.buffer_len()];
            conv.run(
                Tensor::new(&input, layout),
                None,
                TensorMut::new(&mut output, out_layout),
                &mut Scratch::new(conv.scratch_bytes()),
            )
            .unwrap();
            output
        };
        let (direct, winograd) = (run(Algorithm::Direct), run(Algorithm::Winograd));
        let used = direct.iter().filter(|&&v| v > 0 && v < 127).count();
        assert!(
            used * 3 > direct.len(),
            "{used} of {} outputs within the range",
            direct.len()
        );
        let different = direct.iter().zip(&winograd).filter(|(a, b)| a != b).count();
        assert!(
            direct
                .iter()
                .zip(&winograd)
                .all(|(a, b)| a.abs_diff(*b) <= 1),
            "{shape:?}"
        );
        println!("{shape:?}: {different} of {} differ by one", direct.len());
        assert!(
            different * 33 < direct.len(),
            "{different} of {} differ",
            direct.len()
        );
    }
}

/// Winograd in f32 against the definition in f64, of dense inputs and bell-shaped weights: in parts of the sum of
/// magnitudes.
#[test]
#[cfg_attr(miri, ignore = "accuracy, not memory")]
fn winograd_in_f32_loses_little() {
    for (channels, outs) in [(8, 16), (64, 32), (288, 24)] {
        let shape = conv(channels, outs, 1, 3, 1);
        let mut numbers = Numbers(channels as u64);
        let mut bell = |n: usize| -> Vec<f32> {
            let mut one = || (0..6).map(|_| numbers.float()).sum::<f32>();
            (0..n).map(|_| one()).collect()
        };
        let weights = bell(shape.weight_len());
        let layout = Layout::dense(13, 22, channels, 1).unwrap();
        // As behind ReLU; the halo as well, which is nothing to a kernel.
        let mut input = bell(layout.buffer_len());
        input.iter_mut().for_each(|v| *v = v.max(0.0));
        let out_layout = Layout::dense(13, 22, outs, 0).unwrap();
        let mut exact = vec![(0f64, 0f64); out_layout.buffer_len()];
        for (i, (sum, size)) in exact.iter_mut().enumerate() {
            let (pixel, oc) = (i / outs, i % outs);
            for k in 0..9 {
                let (y, x) = (pixel / 22 + k / 3, pixel % 22 + k % 3);
                let at = layout.index(y as isize - 1, x as isize - 1);
                for ic in 0..channels {
                    let weight = weights[(oc * channels + ic) * 9 + k];
                    let product = f64::from(input[at + ic]) * f64::from(weight);
                    *sum += product;
                    *size += product.abs();
                }
            }
        }
        for isa in Isa::available() {
            let mut errors = Vec::new();
            for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
                let params = FConvParams {
                    shape,
                    weights: &weights,
                    bias: &vec![0.0; outs],
                    relu: false,
                    residual: false,
                    algorithm,
                };
                let conv = FConv::new(isa, &params).unwrap();
                let mut output = vec![0f32; out_layout.buffer_len()];
                conv.run(
                    Tensor::new(&input, layout),
                    None,
                    TensorMut::new(&mut output, out_layout),
                    &mut Scratch::new(conv.scratch_bytes()),
                )
                .unwrap();
                let off = output
                    .iter()
                    .zip(&exact)
                    .map(|(&found, (sum, size))| (f64::from(found) - sum).abs() / size);
                errors.push(off.fold(0.0, f64::max));
            }
            println!(
                "{isa} {channels}->{outs}: direct {:.1e}, Winograd {:.1e}",
                errors[0], errors[1]
            );
            assert!(errors[1] < 1e-6, "{isa} {channels}->{outs}: {errors:?}");
        }
    }
}

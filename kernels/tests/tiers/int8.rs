//! int8 convolutions: the same bits from every tier.

use edgecap_kernels::{
    Algorithm, ConvDims, ConvShape, Epilogue, Isa, Layout, Part, QConv, QConvParams, Scratch,
    Tensor, TensorMut,
};
use proptest::prelude::*;

use super::float::check_f;
use super::{
    Case, Numbers, Values, any_case, conv, deconv, layer_shapes, sliced, tiers_beside_scalar,
};
use crate::guarded::Guarded;

/// Every buffer ends where its tensor does, and the memory with it.
fn run_q(isa: Isa, algorithm: Algorithm, case: &Case) -> (Vec<u8>, Vec<f32>) {
    let Case {
        shape,
        height,
        width,
        around,
        ..
    } = *case;
    let mut numbers = Numbers(case.seed | 1);
    let weights: Vec<i8> = (0..shape.weight_len())
        .map(|_| match case.values {
            Values::Any => numbers.within(-127, 127) as i8,
            Values::Small => numbers.within(-20, 20) as i8,
            Values::Most => 127,
            Values::Least => -127,
            Values::Ends => numbers.within(0, 1) as i8 * -127 + numbers.within(0, 1) as i8 * 127,
        })
        .collect();
    // One per channel, or one per phase and channel.
    let phases = match case.seed % 2 {
        0 => shape.phases(),
        _ => 1,
    };
    let bias: Vec<i32> = (0..phases * shape.out_channels())
        .map(|_| numbers.within(-100_000, 100_000) as i32)
        .collect();
    let depth = (shape.weight_len() / shape.out_channels().max(1)) as f32;
    let scale: Vec<f32> = (0..shape.out_channels())
        .map(|_| 1.0 / (depth * 40.0) * (1.0 + numbers.float() / 4.0))
        .collect();
    let epilogue = if case.to_f32 {
        Epilogue::F32 { scale }
    } else {
        Epilogue::U8 {
            scale,
            // Below 127 the narrowing instructions do not clamp by themselves.
            max: if case.seed.is_multiple_of(3) { 90 } else { 127 },
            residual_scale: case.residual.then_some(0.71),
        }
    };
    let conv = QConv::new(
        isa,
        &QConvParams {
            shape,
            weights: &Guarded::new(&weights),
            bias: &Guarded::new(&bias),
            input_max: case.input_max,
            epilogue,
            algorithm,
        },
    )
    .unwrap();
    let in_layout = sliced(
        height,
        width,
        shape.in_channels(),
        around,
        shape.input_halo(),
    );
    let max = i64::from(case.input_max);
    let input: Vec<u8> = (0..in_layout.buffer_len())
        .map(|_| match case.values {
            Values::Any | Values::Small => numbers.within(0, max),
            Values::Most | Values::Least => max,
            Values::Ends => numbers.within(0, 1) * max,
        } as u8)
        .collect();
    let out_layout = sliced(
        shape.output_len(height),
        shape.output_len(width),
        shape.out_channels(),
        around,
        case.parts % 2,
    );
    let len = out_layout.buffer_len();
    let residual: Vec<u8> = (0..len).map(|_| numbers.within(0, 127) as u8).collect();
    let (input, residual) = (Guarded::new(&input), Guarded::new(&residual));
    let mut bytes = Guarded::new(&vec![222u8; len]);
    let mut floats = Guarded::new(&vec![-7.5f32; len]);
    let mut scratch = Scratch::new(conv.scratch_bytes());
    if case.to_f32 {
        conv.run(
            Tensor::new(&input, in_layout),
            None,
            TensorMut::new(&mut floats, out_layout),
            &mut scratch,
        )
        .unwrap();
    } else {
        let residual_layout = case.residual.then_some(&out_layout);
        conv.check(
            (&in_layout, input.len()),
            residual_layout.map(|layout| (layout, residual.len())),
            (&out_layout, bytes.len()),
        )
        .unwrap();
        for index in 0..case.parts {
            let part = conv.part(out_layout.height(), index, case.parts);
            // SAFETY: checked above; the buffers are separate and nobody else touches them.
            unsafe {
                conv.run_part(
                    input.as_ptr(),
                    &in_layout,
                    residual_layout.map(|layout| (residual.as_ptr(), layout)),
                    bytes.as_mut_ptr(),
                    &out_layout,
                    &part,
                    &mut scratch,
                );
            }
        }
    }
    (bytes.to_vec(), floats.to_vec())
}

fn check_q(case: &Case) {
    for &algorithm in Algorithm::candidates(&case.shape) {
        check_algorithm(case, algorithm);
    }
}

pub fn check_algorithm(case: &Case, algorithm: Algorithm) {
    let expected = run_q(Isa::Scalar, algorithm, case);
    for isa in tiers_beside_scalar() {
        let found = run_q(isa, algorithm, case);
        assert!(
            found == expected,
            "{isa} {algorithm:?} differs from scalar: {case:?}"
        );
    }
}

#[test]
#[cfg_attr(
    miri,
    ignore = "hours under Miri; small_layers_equal_scalar is the same on small shapes"
)]
fn int8_layers_equal_scalar() {
    for (i, shape) in layer_shapes().into_iter().enumerate() {
        for values in [
            Values::Any,
            Values::Small,
            Values::Most,
            Values::Least,
            Values::Ends,
        ] {
            let picture = shape.in_channels() == 4;
            check_q(&Case {
                shape,
                height: 3 + i % 4,
                width: [1, 4, 5, 9, 11, 16, 17, 33, 39][i % 9].max(if shape.kernel() == 7 {
                    7
                } else {
                    1
                }),
                input_max: if picture { 255 } else { 127 },
                values,
                around: i % 3,
                residual: i % 2 == 0,
                to_f32: i % 5 == 4,
                parts: 1 + i % 3,
                seed: 1 + i as u64,
            });
        }
    }
}

/// Few and small enough for Miri, which runs a tier that the CPU lacks (README).
#[test]
fn small_layers_equal_scalar() {
    let shapes = [
        conv(8, 17, 1, 3, 1),
        conv(4, 8, 1, 3, 2),
        conv(16, 33, 1, 1, 1),
        deconv(8, 6, 2),
    ];
    for (i, shape) in shapes.into_iter().enumerate() {
        let case = Case {
            shape,
            height: 3,
            width: 5,
            input_max: if shape.in_channels() == 4 { 255 } else { 127 },
            values: Values::Ends,
            around: i % 3,
            residual: i % 2 == 0,
            to_f32: i == 3,
            parts: 1,
            seed: 3 + i as u64,
        };
        check_q(&case);
        // Both algorithms; Miri takes minutes for each shape.
        if i == 0 {
            check_f(&case);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn int8_of_any_shape_equals_scalar(case in any_case()) {
        check_q(&case);
    }
}

prop_compose! {
    /// Layers deep enough for tiles: chunks that share groups, rows around 16 pixels, one to five vectors of outputs.
    fn deep_case()(
        groups in 1usize..3,
        depth in (3usize..50).prop_map(|n| 4 * n),
        outs in 1usize..72,
        kernel in 1usize..4,
        stride in 1usize..3,
        padding in 0usize..2,
        transposed in any::<bool>(),
    )(
        shape in Just(ConvShape::new(ConvDims {
            in_channels: groups * depth,
            out_channels: groups * outs,
            groups,
            kernel: kernel.max(if transposed { stride } else { 1 }),
            stride,
            padding: padding.min(kernel - 1) / if transposed { 2 } else { 1 },
            transposed,
        }).unwrap()),
        height in 3usize..6,
        width in prop_oneof![3usize..15, 15usize..18, 30usize..36],
        values in prop_oneof![Just(Values::Any), Just(Values::Small), Just(Values::Most), Just(Values::Least), Just(Values::Ends)],
        input_max in prop_oneof![Just(127u8), Just(255u8)],
        around in prop_oneof![Just(0usize), 1usize..70],
        residual in any::<bool>(),
        to_f32 in any::<bool>(),
        parts in 1usize..4,
        seed in any::<u64>(),
    ) -> Case {
        Case { shape, height, width, input_max, values, around, residual, to_f32, parts, seed }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    #[cfg_attr(miri, ignore = "Miri runs no tiles, and hours at the rest")]
    fn int8_of_deep_shapes_equals_scalar(case in deep_case()) {
        // Winograd refuses the worst sums of so many channels.
        check_algorithm(&case, Algorithm::Direct);
    }
}

#[test]
fn input_and_output_can_be_slices_of_one_buffer() {
    let shape = conv(16, 24, 1, 3, 1);
    let mut numbers = Numbers(5);
    let weights: Vec<i8> = (0..shape.weight_len())
        .map(|_| numbers.within(-127, 127) as i8)
        .collect();
    let whole = Layout::dense(8, 8, 40, 1).unwrap();
    let (in_layout, out_layout) = (whole.channel_slice(24, 16), whole.channel_slice(0, 24));
    let start: Vec<u8> = (0..whole.buffer_len())
        .map(|_| numbers.within(0, 127) as u8)
        .collect();
    let mut all = Vec::new();
    for isa in Isa::available() {
        let conv = QConv::new(
            isa,
            &QConvParams {
                shape,
                weights: &weights,
                bias: &[7; 24],
                input_max: 127,
                epilogue: Epilogue::U8 {
                    scale: vec![1e-3; 24],
                    max: 127,
                    residual_scale: None,
                },
                algorithm: Algorithm::Direct,
            },
        )
        .unwrap();
        let mut data = start.clone();
        let part = Part::whole(8, 1);
        let mut scratch = Scratch::new(conv.scratch_bytes());
        conv.check((&in_layout, data.len()), None, (&out_layout, data.len()))
            .unwrap();
        let pointer = data.as_mut_ptr();
        // SAFETY: checked above; the slices are disjoint channels, nobody else touches the buffer.
        unsafe {
            conv.run_part(
                pointer,
                &in_layout,
                None,
                pointer,
                &out_layout,
                &part,
                &mut scratch,
            );
        }
        all.push(data);
    }
    assert!(all.iter().all(|data| *data == all[0]));
    assert!(all[0] != start);
}

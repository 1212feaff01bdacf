//! The scalar kernels against definitions written in another way.

use edgecap_kernels::{
    Algorithm, ConvDims, ConvShape, Epilogue, FConv, FConvParams, Isa, Layout, Linear, MaxPool,
    PoolShape, QConv, QConvParams, Scratch, Tensor, TensorMut,
};

/// Small numbers from a counter, the same in every run.
fn numbers(count: usize, modulus: i64, shift: i64) -> Vec<i64> {
    (0..count as i64)
        .map(|i| (i * 7919 + i * i * 31) % modulus - shift)
        .collect()
}

/// Convolution by scattering every input element through the kernel, on plain `[y][x][c]` arrays without halo.
fn scatter(
    shape: &ConvShape,
    height: usize,
    width: usize,
    input: &[i64],
    weights: &[i64],
) -> Vec<i64> {
    let (out_height, out_width) = (shape.output_len(height), shape.output_len(width));
    // Asked for once: Miri takes longer for a call than for a product.
    let (channels, out_channels, kernel) =
        (shape.in_channels(), shape.out_channels(), shape.kernel());
    let mut output = vec![0; out_height * out_width * out_channels];
    let depth = channels / shape.groups();
    let per_group = out_channels / shape.groups();
    let land = |i: usize, k: usize, len: usize| -> Option<usize> {
        let at = if shape.transposed() {
            (i * shape.stride() + k).checked_sub(shape.padding())?
        } else {
            let reach = (i + shape.padding()).checked_sub(k)?;
            if reach % shape.stride() != 0 {
                return None;
            }
            reach / shape.stride()
        };
        (at < len).then_some(at)
    };
    for y in 0..height {
        for x in 0..width {
            for ky in 0..kernel {
                for kx in 0..kernel {
                    let (Some(oy), Some(ox)) = (land(y, ky, out_height), land(x, kx, out_width))
                    else {
                        continue;
                    };
                    for oc in 0..out_channels {
                        let from = (y * width + x) * channels + oc / per_group * depth;
                        let mut sum = 0;
                        for ic in 0..depth {
                            let weight = ((oc * depth + ic) * kernel + ky) * kernel + kx;
                            sum += input[from + ic] * weights[weight];
                        }
                        output[(oy * out_width + ox) * out_channels + oc] += sum;
                    }
                }
            }
        }
    }
    output
}

fn shapes() -> Vec<ConvShape> {
    let base = ConvDims {
        in_channels: 8,
        out_channels: 12,
        groups: 2,
        kernel: 3,
        padding: 1,
        ..ConvDims::default()
    };
    let all = [
        base,
        ConvDims { stride: 2, ..base },
        ConvDims {
            kernel: 1,
            padding: 0,
            groups: 1,
            ..base
        },
        ConvDims {
            kernel: 1,
            padding: 0,
            stride: 2,
            ..base
        },
        ConvDims {
            kernel: 7,
            padding: 3,
            stride: 2,
            in_channels: 4,
            groups: 1,
            ..base
        },
        ConvDims {
            kernel: 4,
            stride: 2,
            groups: 4,
            transposed: true,
            ..base
        },
        ConvDims {
            kernel: 3,
            stride: 3,
            padding: 0,
            transposed: true,
            ..base
        },
    ];
    all.map(|dims| ConvShape::new(dims).unwrap()).to_vec()
}

/// Places plain `[y][x][c]` values in a layout with a halo of zeros.
fn place<T: Copy + Default>(layout: &Layout, values: &[T]) -> Vec<T> {
    let mut data = vec![T::default(); layout.buffer_len()];
    for (i, &value) in values.iter().enumerate() {
        let (pixel, c) = (i / layout.channels(), i % layout.channels());
        let at = layout.index(
            (pixel / layout.width()) as isize,
            (pixel % layout.width()) as isize,
        );
        data[at + c] = value;
    }
    data
}

#[test]
fn int8_equals_scattered_definition() {
    // Miri takes a minute for the larger ones.
    let (height, width) = if cfg!(miri) { (4, 5) } else { (9, 8) };
    for shape in shapes() {
        let input = numbers(height * width * shape.in_channels(), 128, 0);
        let weights = numbers(shape.weight_len(), 255, 127);
        let expected = scatter(&shape, height, width, &input, &weights);
        let weights: Vec<i8> = weights.iter().map(|&w| w as i8).collect();
        let channels = shape.out_channels();
        let bytes: Vec<u8> = input.iter().map(|&v| v as u8).collect();
        let in_layout =
            Layout::dense(height, width, shape.in_channels(), shape.input_halo()).unwrap();
        let data = place(&in_layout, &bytes);
        let (rows, columns) = (shape.output_len(height), shape.output_len(width));
        let out_layout = Layout::dense(rows, columns, channels, 0).unwrap();
        // The same in all phases, and one of its own in each where there are several.
        let mut kinds = vec![1, shape.phases()];
        kinds.dedup();
        for phases in kinds {
            let bias: Vec<i32> = (0..(phases * channels) as i32)
                .map(|i| i * 100 - 300)
                .collect();
            let conv = QConv::new(
                Isa::Scalar,
                &QConvParams {
                    shape,
                    weights: &weights,
                    bias: &bias,
                    input_max: 127,
                    epilogue: Epilogue::F32 {
                        scale: vec![1.0; channels],
                    },
                    algorithm: Algorithm::Direct,
                },
            )
            .unwrap();
            let mut output = vec![0.0f32; out_layout.buffer_len()];
            conv.run(
                Tensor::new(&data, in_layout),
                None,
                TensorMut::new(&mut output, out_layout),
                &mut Scratch::new(conv.scratch_bytes()),
            )
            .unwrap();
            let phase = |pixel: usize| match phases {
                1 => 0,
                _ => {
                    let stride = shape.stride();
                    pixel / columns % stride * stride + pixel % columns % stride
                }
            };
            for (i, &value) in output.iter().enumerate() {
                let bias = bias[phase(i / channels) * channels + i % channels];
                let wanted = expected[i] + i64::from(bias);
                assert_eq!(value, wanted as f32, "{shape:?} at {i}, {phases} phases");
            }
        }
    }
}

#[test]
fn f32_equals_scattered_definition() {
    let (height, width) = if cfg!(miri) { (4, 5) } else { (6, 7) };
    for shape in shapes() {
        let input = numbers(height * width * shape.in_channels(), 64, 32);
        let weights = numbers(shape.weight_len(), 64, 32);
        let expected = scatter(&shape, height, width, &input, &weights);
        let weights: Vec<f32> = weights.iter().map(|&w| w as f32).collect();
        let bias = vec![3.0; shape.out_channels()];
        let conv = FConv::new(
            Isa::Scalar,
            &FConvParams {
                shape,
                weights: &weights,
                bias: &bias,
                relu: true,
                residual: false,
                algorithm: Algorithm::Direct,
            },
        )
        .unwrap();
        let in_layout =
            Layout::dense(height, width, shape.in_channels(), shape.input_halo()).unwrap();
        let values: Vec<f32> = input.iter().map(|&v| v as f32).collect();
        let data = place(&in_layout, &values);
        let out_layout = Layout::dense(
            shape.output_len(height),
            shape.output_len(width),
            shape.out_channels(),
            0,
        )
        .unwrap();
        let mut output = vec![-1.0f32; out_layout.buffer_len()];
        conv.run(
            Tensor::new(&data, in_layout),
            None,
            TensorMut::new(&mut output, out_layout),
            &mut Scratch::default(),
        )
        .unwrap();
        for (i, &value) in output.iter().enumerate() {
            // Integers below 2^24 are exact in f32 whatever the order.
            assert_eq!(
                value,
                (expected[i] as f32 + 3.0).max(0.0),
                "{shape:?} at {i}"
            );
        }
    }
}

#[test]
fn epilogue_rounds_to_even_clamps_and_adds_the_residual() {
    let shape = ConvShape::new(ConvDims::default()).unwrap();
    let conv = QConv::new(
        Isa::Scalar,
        &QConvParams {
            shape,
            weights: &[1],
            bias: &[-5],
            input_max: 127,
            epilogue: Epilogue::U8 {
                scale: vec![0.5],
                max: 20,
                residual_scale: Some(2.0),
            },
            algorithm: Algorithm::Direct,
        },
    )
    .unwrap();
    let layout = Layout::dense(1, 6, 1, 0).unwrap();
    let mut output = [0u8; 6];
    conv.run(
        Tensor::new(&[0, 6, 8, 6, 127, 10], layout),
        Some(Tensor::new(&[0, 0, 0, 1, 3, 9], layout)),
        TensorMut::new(&mut output, layout),
        &mut Scratch::default(),
    )
    .unwrap();
    // −2.5 → 0; 0.5 → 0; 1.5 → 2; 2.5 → 2; 67 → 20; 20.5 → 20.
    assert_eq!(output, [0, 0, 2, 2, 20, 20]);
}

#[test]
fn pool_and_linear() {
    let layout = Layout::dense(3, 3, 1, 1).unwrap();
    let data = place(&layout, &[1u8, 2, 3, 4, 9, 5, 6, 7, 8]);
    let pool = MaxPool::new(Isa::Scalar, PoolShape::new(3, 2, 1).unwrap()).unwrap();
    let mut output = [0u8; 4];
    pool.run(
        Tensor::new(&data, layout),
        TensorMut::new(&mut output, Layout::dense(2, 2, 1, 0).unwrap()),
    )
    .unwrap();
    assert_eq!(output, [9, 9, 9, 9]);

    let linear = Linear::new(
        Isa::Scalar,
        2,
        3,
        &[1., 2., 3., 4., -5., 6.],
        &[0., 1., 2.],
        true,
    )
    .unwrap();
    let mut output = [0.0; 6];
    linear.run(2, &[1., 1., 2., 0.], &mut output).unwrap();
    assert_eq!(output, [3., 8., 3., 2., 7., 0.]);
}

#[test]
fn wrong_parameters_are_refused() {
    let shape = shapes()[0];
    let weights = vec![0i8; shape.weight_len()];
    let bias = vec![0i32; shape.out_channels()];
    let params = QConvParams {
        shape,
        weights: &weights,
        bias: &bias,
        input_max: 127,
        epilogue: Epilogue::F32 {
            scale: vec![1.0; shape.out_channels()],
        },
        algorithm: Algorithm::Direct,
    };
    let refused = |params: &QConvParams| QConv::new(Isa::Scalar, params).is_err();
    assert!(!refused(&params));
    assert!(refused(&QConvParams {
        weights: &weights[1..],
        ..params.clone()
    }));
    let mut low = weights.clone();
    low[3] = -128;
    assert!(refused(&QConvParams {
        weights: &low,
        ..params.clone()
    }));
    let mut huge = weights.clone();
    huge[0] = 1;
    let mut edge = bias.clone();
    edge[0] = i32::MAX;
    assert!(refused(&QConvParams {
        weights: &huge,
        bias: &edge,
        ..params.clone()
    }));

    // Neither one bias per channel nor one per phase and channel.
    let up = shapes()[5];
    let epilogue = Epilogue::F32 {
        scale: vec![1.0; up.out_channels()],
    };
    for (count, is_refused) in [(1, false), (2, true), (4, false), (5, true)] {
        let up = QConvParams {
            shape: up,
            weights: &vec![0; up.weight_len()],
            bias: &vec![0; count * up.out_channels()],
            epilogue: epilogue.clone(),
            ..params.clone()
        };
        assert_eq!(refused(&up), is_refused, "{count} biases per channel");
    }
    // A sum that leaves i32 in the last phase alone.
    let mut edges = vec![0; 4 * up.out_channels()];
    edges[3 * up.out_channels()] = i32::MAX;
    let mut one = vec![0; up.weight_len()];
    one[0] = 1;
    assert!(refused(&QConvParams {
        shape: up,
        weights: &one,
        bias: &edges,
        epilogue,
        ..params.clone()
    }));

    let conv = QConv::new(Isa::Scalar, &params).unwrap();
    let good = Layout::dense(4, 4, 8, 1).unwrap();
    let out = Layout::dense(4, 4, 12, 0).unwrap();
    let ok = |input: Layout, len: usize| {
        conv.check((&input, len), None, (&out, out.buffer_len()))
            .is_ok()
    };
    assert!(ok(good, good.buffer_len()));
    assert!(!ok(good, good.buffer_len() - 1));
    let without_halo = Layout::dense(4, 4, 8, 0).unwrap();
    assert!(!ok(without_halo, good.buffer_len()));
    assert!(!ok(good.channel_slice(0, 7), good.buffer_len()));
}

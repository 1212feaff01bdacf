//! Safe functions given numbers that no honest caller would: refused with an error, in release builds, too.
//!
//! `cargo test` computes with overflow checks, under which a wrapped size would panic before it does harm; so these
//! also run as `cargo test --release -p edgecap-kernels`.

use edgecap_kernels::{
    Algorithm, ConvDims, ConvShape, Epilogue, FConv, FConvParams, Isa, Layout, Linear, MaxPool,
    PoolShape, QConv, QConvParams, Scratch, Tensor, TensorMut,
};

/// Numbers whose products and sums wrap.
const WILD: [usize; 9] = [
    0,
    1 << 31,
    1 << 32,
    1 << 62,
    (1 << 62) + 1,
    1 << 63,
    (1 << 63) + 1,
    usize::MAX - 1,
    usize::MAX,
];

#[test]
fn a_batch_that_wraps_is_refused() {
    // 2⁶³ · 2 is 0 modulo 2⁶⁴: an empty slice would seem to fit.
    for isa in Isa::available() {
        for outputs in [1, 2, 4, 8] {
            let weights = vec![1.0; 2 * outputs];
            let bias = vec![0.0; outputs];
            let layer = Linear::new(isa, 2, outputs, &weights, &bias, false).unwrap();
            assert_eq!(layer.run(0, &[], &mut []), Ok(()));
            for batch in &WILD[1..] {
                assert!(layer.run(*batch, &[], &mut []).is_err(), "{isa} {batch}");
            }
        }
        for wild in WILD {
            assert!(Linear::new(isa, wild, 2, &[], &[0.0; 2], false).is_err());
            assert!(Linear::new(isa, 2, wild, &[], &[], false).is_err());
        }
    }
}

#[test]
fn windows_that_wrap_are_refused() {
    for wild in WILD {
        assert!(PoolShape::new(wild, 1, 0).is_err());
        assert!(PoolShape::new(3, wild, 0).is_err());
        assert!(wild == 0 || PoolShape::new(3, 1, wild).is_err());
    }
    assert!(PoolShape::new(4611686018427387905, 2, 2305843009213693952).is_err());
}

#[test]
fn shapes_that_wrap_are_refused() {
    let good = ConvDims {
        in_channels: 8,
        out_channels: 8,
        kernel: 3,
        padding: 1,
        ..ConvDims::default()
    };
    let mut refused = 0;
    for transposed in [false, true] {
        for wild in WILD {
            for bad in [
                ConvDims {
                    in_channels: wild,
                    ..good
                },
                ConvDims {
                    out_channels: wild,
                    ..good
                },
                ConvDims {
                    groups: wild,
                    ..good
                },
                ConvDims {
                    kernel: wild,
                    ..good
                },
                ConvDims {
                    stride: wild,
                    ..good
                },
                ConvDims {
                    padding: wild.max(3),
                    ..good
                },
                ConvDims {
                    kernel: wild,
                    stride: wild,
                    padding: wild,
                    ..good
                },
            ] {
                let dims = ConvDims { transposed, ..bad };
                refused += u32::from(ConvShape::new(dims).is_err());
            }
        }
    }
    assert_eq!(refused, 2 * 9 * 7);
}

#[test]
fn layouts_that_wrap_are_refused() {
    for wild in WILD {
        assert!(Layout::dense(wild, 1 << 32, 1 << 31, 0).is_err());
        assert!(Layout::dense(1 << 32, wild, 1 << 31, 0).is_err());
        assert!(Layout::dense(1 << 32, 1 << 31, wild, 0).is_err());
        assert!(wild == 0 || Layout::dense(1 << 31, 1, 1, wild).is_err());
    }
}

/// What asks for no memory is answered, however much is asked: with the most that the number can hold, and at once.
#[test]
fn shares_and_counts_of_wild_sizes_are_exact() {
    let shape = ConvShape::new(ConvDims {
        in_channels: 8,
        out_channels: 8,
        groups: 2,
        kernel: 3,
        padding: 1,
        ..ConvDims::default()
    })
    .unwrap();
    for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
        let wild = algorithm.work(&shape, usize::MAX, usize::MAX);
        assert_eq!(wild, u64::MAX, "{algorithm:?}");
        let conv = FConv::new(
            Isa::Scalar,
            &FConvParams {
                shape,
                weights: &vec![1.0; shape.weight_len()],
                bias: &[0.0; 8],
                relu: false,
                residual: false,
                algorithm,
            },
        )
        .unwrap();
        for rows in WILD {
            // Three shares are bands of rows: two slices of groups would leave more to the slowest.
            let shares = [0, 1, 2].map(|i| conv.part(rows, i, 3));
            assert_eq!((shares[0].rows.start, shares[2].rows.end), (0, rows));
            for (a, b) in [(0, 1), (1, 2)] {
                assert_eq!(shares[a].rows.end, shares[b].rows.start, "{rows}");
            }
            let most = shares.iter().map(|share| share.rows.len()).max();
            assert!(most <= Some(rows / 3 + 4), "{rows}: {shares:?}");
            for index in [0, 1, usize::MAX / 2, usize::MAX - 1] {
                let one = conv.part(rows, index, usize::MAX);
                assert!(one.rows.len() <= 4, "{rows}, share {index}: {one:?}");
            }
        }
        assert!(conv.part(8, 0, usize::MAX).rows.len() <= 4);
    }
    let pool = MaxPool::new(Isa::Scalar, PoolShape::new(3, 1, 1).unwrap()).unwrap();
    assert_eq!(pool.part(usize::MAX, 2, 3).rows.end, usize::MAX);
    assert!(pool.part(8, 0, usize::MAX).rows.len() <= 1);
}

/// Every combination of buffers one element too short, and layouts of another size: no kernel may touch anything.
#[test]
fn buffers_that_do_not_hold_their_tensor_are_refused() {
    let shape = ConvShape::new(ConvDims {
        in_channels: 8,
        out_channels: 8,
        kernel: 3,
        padding: 1,
        ..ConvDims::default()
    })
    .unwrap();
    let input = Layout::dense(4, 5, 8, 1).unwrap();
    let output = Layout::dense(4, 5, 8, 0).unwrap();
    let taller = Layout::dense(1 << 30, 5, 8, 1).unwrap();
    let huge = Layout::dense(1 << 30, 1 << 20, 8, 0).unwrap();
    let bytes = vec![1u8; input.buffer_len()];
    let floats = vec![1.0f32; input.buffer_len()];
    for isa in Isa::available() {
        let int8 = QConv::new(
            isa,
            &QConvParams {
                shape,
                weights: &vec![1; shape.weight_len()],
                bias: &[0; 8],
                input_max: 127,
                epilogue: Epilogue::U8 {
                    scale: vec![0.01; 8],
                    max: 127,
                    residual_scale: None,
                },
                algorithm: Algorithm::Direct,
            },
        )
        .unwrap();
        let floats_by = |algorithm| {
            FConv::new(
                isa,
                &FConvParams {
                    shape,
                    weights: &vec![1.0; shape.weight_len()],
                    bias: &[0.0; 8],
                    relu: false,
                    residual: false,
                    algorithm,
                },
            )
            .unwrap()
        };
        let float = [Algorithm::Direct, Algorithm::Winograd].map(floats_by);
        let pool = MaxPool::new(isa, PoolShape::new(3, 1, 1).unwrap()).unwrap();
        let (mut q, mut f) = ([0u8; 160], [0.0f32; 160]);
        let needed = float.iter().map(FConv::scratch_bytes).max().unwrap_or(0);
        let mut scratch = Scratch::new(needed.max(int8.scratch_bytes()));
        for (from, to, short) in [
            (input, output, 1),
            (taller, output, 0),
            (input, huge, 0),
            (taller, taller, 0),
        ] {
            let len = bytes.len() - short;
            let (x, y) = (
                Tensor::new(&bytes[..len], from),
                Tensor::new(&floats[..len], from),
            );
            let result = int8.run(x, None, TensorMut::new(&mut q, to), &mut scratch);
            assert!(result.is_err(), "{isa}");
            for float in &float {
                let result = float.run(y, None, TensorMut::new(&mut f, to), &mut scratch);
                assert!(result.is_err(), "{isa} {}", float.name());
            }
            assert!(pool.run(x, TensorMut::new(&mut q, to)).is_err(), "{isa}");
        }
        let (x, y) = (Tensor::new(&bytes, input), Tensor::new(&floats, input));
        let short = TensorMut::new(&mut q[..159], output);
        assert!(int8.run(x, None, short, &mut scratch).is_err());
        for float in &float {
            let short = TensorMut::new(&mut f[..159], output);
            assert!(float.run(y, None, short, &mut scratch).is_err());
            if float.scratch_bytes() > 0 {
                let mut little = Scratch::new(float.scratch_bytes() - 64);
                let whole = TensorMut::new(&mut f, output);
                assert!(float.run(y, None, whole, &mut little).is_err(), "{isa}");
            }
        }
        let short = TensorMut::new(&mut q[..159], output);
        assert!(pool.run(x, short).is_err());
        assert!(q.iter().all(|&v| v == 0) && f.iter().all(|&v| v == 0.0));
    }
}

/// Winograd reads what only layers of 3 × 3 and stride 1 have.
#[test]
fn algorithms_that_cannot_compute_a_shape_are_refused() {
    let good = ConvDims {
        in_channels: 8,
        out_channels: 8,
        kernel: 3,
        padding: 1,
        ..ConvDims::default()
    };
    let (wider, strided, upwards) = (
        ConvDims { kernel: 5, ..good },
        ConvDims { stride: 2, ..good },
        ConvDims {
            transposed: true,
            ..good
        },
    );
    for isa in Isa::available() {
        for (dims, fits) in [
            (good, true),
            (wider, false),
            (strided, false),
            (upwards, false),
        ] {
            let shape = ConvShape::new(dims).unwrap();
            let params = FConvParams {
                shape,
                weights: &vec![1.0; shape.weight_len()],
                bias: &[0.0; 8],
                relu: false,
                residual: false,
                algorithm: Algorithm::Winograd,
            };
            assert_eq!(FConv::new(isa, &params).is_ok(), fits, "{isa} {dims:?}");
        }
    }
}

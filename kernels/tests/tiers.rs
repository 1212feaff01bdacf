//! Every tier of this CPU against scalar: int8 with `==` over the whole buffer, f32 within a stated tolerance.

use edgecap_kernels::{
    Algorithm, ConvDims, ConvShape, Epilogue, FConv, FConvParams, Isa, Layout, MaxPool, Part,
    PoolShape, QConv, QConvParams, Scratch, Tensor, TensorMut,
};
use proptest::prelude::*;

use guarded::Guarded;

mod guarded;

/// A small generator, so that a failing case is named by its seed alone.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// In `low..=high`.
    fn within(&mut self, low: i64, high: i64) -> i64 {
        low + (self.next() >> 33) as i64 % (high - low + 1)
    }

    fn float(&mut self) -> f32 {
        self.within(-1000, 1000) as f32 / 500.0
    }
}

/// How extreme the numbers are.
#[derive(Debug, Clone, Copy)]
enum Values {
    /// Anything in range: `vpmaddubsw` can sum one group, seldom two.
    Any,
    /// Any activation, weights so small that many groups can be summed in i16.
    Small,
    /// Every activation and weight at the end of its range, same signs: the worst sums.
    Most,
    /// Every weight −127.
    Least,
    /// Ends of the ranges at random.
    Ends,
}

#[derive(Debug, Clone)]
struct Case {
    shape: ConvShape,
    height: usize,
    width: usize,
    input_max: u8,
    values: Values,
    /// Channels of the concat buffer before and behind the input's and the output's slices.
    around: usize,
    residual: bool,
    to_f32: bool,
    parts: usize,
    seed: u64,
}

/// A layout that is a channel slice of a wider buffer, with halo.
fn sliced(height: usize, width: usize, channels: usize, around: usize, halo: usize) -> Layout {
    Layout::dense(height, width, channels + 2 * around, halo)
        .unwrap()
        .channel_slice(around, channels)
}

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

fn check_algorithm(case: &Case, algorithm: Algorithm) {
    let expected = run_q(Isa::Scalar, algorithm, case);
    for isa in Isa::available() {
        let found = run_q(isa, algorithm, case);
        assert!(
            found == expected,
            "{isa} {algorithm:?} differs from scalar: {case:?}"
        );
    }
}

fn conv(
    in_channels: usize,
    out_channels: usize,
    groups: usize,
    kernel: usize,
    stride: usize,
) -> ConvShape {
    ConvShape::new(ConvDims {
        in_channels,
        out_channels,
        groups,
        kernel,
        stride,
        padding: (kernel - 1) / 2,
        transposed: false,
    })
    .unwrap()
}

fn deconv(in_channels: usize, out_channels: usize, groups: usize) -> ConvShape {
    let dims = ConvDims {
        padding: 1,
        transposed: true,
        ..conv(in_channels, out_channels, groups, 4, 2).dims()
    };
    ConvShape::new(dims).unwrap()
}

/// The kinds of layers that the networks are made of, narrowed, and channel counts around the vectors' widths.
fn layer_shapes() -> Vec<ConvShape> {
    let mut shapes = vec![
        conv(4, 32, 1, 3, 2),
        conv(4, 64, 1, 7, 2),
        conv(32, 64, 1, 3, 2),
        conv(64, 32, 1, 3, 1),
        conv(72, 72, 1, 3, 1),
        conv(144, 144, 2, 3, 1),
        conv(288, 288, 4, 3, 2),
        conv(64, 256, 1, 1, 2),
        conv(36, 40, 1, 3, 1),
        conv(36, 63, 1, 3, 1),
        // Chunks of tiles: one and two, even and sharing a group; one, two and three vectors of outputs.
        conv(68, 17, 1, 3, 1),
        conv(136, 48, 1, 1, 1),
        conv(128, 96, 2, 3, 2),
        conv(576, 33, 1, 1, 1),
        deconv(256, 192, 4),
        deconv(8, 6, 2),
        conv(3, 5, 1, 3, 1),
        conv(6, 4, 2, 3, 1),
        conv(4, 1, 1, 1, 1),
    ];
    for channels in [
        7, 8, 9, 15, 16, 17, 23, 24, 25, 31, 32, 33, 47, 48, 49, 63, 64, 65,
    ] {
        shapes.push(conv(8, channels, 1, 1, 1));
    }
    shapes
}

#[test]
fn tiers_that_are_tested_here() {
    for isa in Isa::ALL {
        if !isa.is_available() {
            println!("skipped: this CPU lacks {isa}");
        }
    }
    // `.ci/kernels` says what an emulated CPU has: less would leave kernels untested, more would be a wrong guess.
    if let Ok(expected) = std::env::var("EDGECAP_TEST_TIERS") {
        let found: Vec<&str> = Isa::available().map(|isa| isa.name()).collect();
        assert_eq!(found.join(" "), expected, "tiers of this CPU");
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

prop_compose! {
    fn any_case()(
        groups in 1usize..4,
        depth in prop_oneof![1usize..6, Just(4), Just(8), Just(12), Just(32), Just(36)],
        outs in prop_oneof![1usize..20, 30usize..50],
        kernel in 1usize..5,
        stride in 1usize..4,
        padding in 0usize..4,
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
        height in 4usize..8,
        width in prop_oneof![4usize..20, 20usize..50],
        input_max in prop_oneof![Just(127u8), Just(255u8)],
        values in prop_oneof![Just(Values::Any), Just(Values::Small), Just(Values::Most), Just(Values::Least), Just(Values::Ends)],
        around in 0usize..6,
        residual in any::<bool>(),
        to_f32 in any::<bool>(),
        parts in 1usize..4,
        seed in any::<u64>(),
    ) -> Case {
        Case { shape, height, width, input_max, values, around, residual, to_f32, parts, seed }
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

/// The kernel that a layer of ours runs on, all of whose weights are `weight`.
fn kernel_of(isa: Isa, shape: ConvShape, weight: i8) -> &'static str {
    let params = QConvParams {
        shape,
        weights: &vec![weight; shape.weight_len()],
        bias: &vec![0; shape.out_channels()],
        input_max: 127,
        epilogue: Epilogue::F32 {
            scale: vec![1.0; shape.out_channels()],
        },
        algorithm: Algorithm::Direct,
    };
    QConv::new(isa, &params).unwrap().name()
}

#[test]
fn avx2_sums_in_i16_where_many_groups_fit() {
    if !Isa::available().any(|isa| isa == Isa::Avx2) {
        println!("skipped: this CPU has no AVX2");
        return;
    }
    let name = |weight| kernel_of(Isa::Avx2, conv(64, 64, 1, 1, 1), weight);
    // Two weights of 64 are 128, of which 258 has room for two; two of 65 are 130, which has room for one.
    assert_eq!(name(64), "qs8_direct_4x16c4__avx2");
    assert_eq!(name(65), "qs8_pairs_4x16c4__avx2");
}

#[test]
fn matrix_products_run_where_channels_come_in_eights() {
    if !Isa::NeonI8mm.is_available() {
        println!("skipped: this CPU has no i8mm");
        return;
    }
    for (channels, kernel) in [
        (64, "qs8_direct_8x12c8__neoni8mm"),
        (72, "qs8_direct_8x12c8__neoni8mm"),
        (4, "qs8_direct_8x12c4__neoni8mm"),
        (36, "qs8_direct_8x12c4__neoni8mm"),
    ] {
        assert_eq!(
            kernel_of(Isa::NeonI8mm, conv(channels, 16, 1, 3, 1), 1),
            kernel
        );
    }
}

#[test]
fn tiles_run_where_they_pay() {
    if !Isa::Amx.is_available() {
        println!("skipped: this CPU, or this system, has no tiles");
        return;
    }
    let name = |shape: ConvShape| kernel_of(Isa::Amx, shape, 1);
    for tiled in [
        conv(64, 64, 1, 1, 1),
        conv(64, 8, 4, 3, 2),
        deconv(256, 192, 4),
    ] {
        assert_eq!(name(tiled), "qs8_direct_32x32c4__amx", "{tiled:?}");
    }
    for narrow in [
        conv(4, 32, 1, 3, 2),
        conv(64, 64, 16, 3, 1),
        conv(16, 16, 1, 1, 1),
    ] {
        assert_eq!(name(narrow), "qs8_direct_8x48c4__avx512vnni", "{narrow:?}");
    }
    assert_eq!(name(conv(6, 6, 1, 1, 1)), "qs8_direct__scalar");
}

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

    /// The same of absolute values; of inputs the greatest of those as far as another of a Winograd tile.
    fn magnitudes(&self, algorithm: Algorithm) -> Self {
        let of = |values: &[f32]| values.iter().map(|v| v.abs()).collect::<Vec<_>>();
        let mut input = of(&self.input);
        if algorithm == Algorithm::Winograd {
            let (layout, halo) = (&self.in_layout, self.case.shape.input_halo() as isize);
            let side = |n: usize| -halo..n as isize + halo;
            let near = |at: isize, n: usize| (at - 5).max(-halo)..(at + 6).min(n as isize + halo);
            for y in side(layout.height()) {
                for x in side(layout.width()) {
                    for c in 0..layout.channels() {
                        let all = near(y, layout.height())
                            .flat_map(|y| near(x, layout.width()).map(move |x| (y, x)));
                        let all = all.map(|(y, x)| self.input[layout.index(y, x) + c].abs());
                        input[layout.index(y, x) + c] = all.fold(0.0, f32::max);
                    }
                }
            }
        }
        Self {
            weights: of(&self.weights),
            bias: of(&self.bias),
            input,
            residual: of(&self.residual),
            ..*self
        }
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

fn check_f(case: &Case) {
    let float = FloatRun::new(case);
    for &algorithm in Algorithm::candidates(&case.shape) {
        let expected = float.run(Isa::Scalar, algorithm, case.to_f32);
        let bound = float
            .magnitudes(algorithm)
            .run(Isa::Scalar, Algorithm::Direct, false);
        let definition = float.run(Isa::Scalar, Algorithm::Direct, case.to_f32);
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
        for isa in Isa::available() {
            let found = float.run(isa, algorithm, case.to_f32);
            close(&found, &expected, isa.name());
        }
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

#[test]
fn pool_equals_scalar() {
    for channels in [1, 5, 16, 31, 32, 64, 65, 100] {
        let layout = sliced(9, 7, channels, 2, 1);
        let mut numbers = Numbers(channels as u64 * 2 + 1);
        let bytes: Vec<u8> = (0..layout.buffer_len())
            .map(|_| numbers.within(0, 255) as u8)
            .collect();
        let floats: Vec<f32> = bytes.iter().map(|&b| f32::from(b) / 3.0).collect();
        let mut all = Vec::new();
        for isa in Isa::available() {
            let pool = MaxPool::new(isa, PoolShape::new(3, 2, 1).unwrap()).unwrap();
            let out = sliced(
                pool.shape().output_len(9),
                pool.shape().output_len(7),
                channels,
                1,
                0,
            );
            let (bytes, floats) = (Guarded::new(&bytes), Guarded::new(&floats));
            let mut q = Guarded::new(&vec![1u8; out.buffer_len()]);
            let mut f = Guarded::new(&vec![1.0f32; out.buffer_len()]);
            pool.run(Tensor::new(&bytes, layout), TensorMut::new(&mut q, out))
                .unwrap();
            pool.run(Tensor::new(&floats, layout), TensorMut::new(&mut f, out))
                .unwrap();
            all.push((q.to_vec(), f.to_vec()));
        }
        assert!(all.iter().all(|outputs| *outputs == all[0]));
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

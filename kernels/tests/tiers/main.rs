//! Every tier of this CPU against scalar: int8 with `==` over the whole buffer, f32 within a stated tolerance.

mod choice;
mod float;
mod guarded;
mod int8;
mod pool;
mod winograd;

use edgecap_kernels::{ConvDims, ConvShape, Isa, Layout};
use proptest::prelude::*;

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

/// What is held against scalar: emulators and Miri take minutes for scalar itself, which is slowest.
fn tiers_beside_scalar() -> impl Iterator<Item = Isa> {
    Isa::available().filter(|isa| *isa != Isa::Scalar)
}

/// A layout that is a channel slice of a wider buffer, with halo.
fn sliced(height: usize, width: usize, channels: usize, around: usize, halo: usize) -> Layout {
    Layout::dense(height, width, channels + 2 * around, halo)
        .unwrap()
        .channel_slice(around, channels)
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

//! Which kernel a layer runs on.

use edgecap_kernels::{Algorithm, Algorithms, ConvShape, Epilogue, Isa, QConv, QConvParams};

use super::{conv, deconv};

/// The kernel that a layer of ours, all of whose weights are `weight`, runs on by the definition.
fn kernel_of(isa: Isa, shape: ConvShape, weight: i8) -> &'static str {
    kernel_by(Algorithm::Direct, isa, shape, weight)
}

fn kernel_by(algorithm: Algorithm, isa: Isa, shape: ConvShape, weight: i8) -> &'static str {
    let params = QConvParams {
        shape,
        weights: &vec![weight; shape.weight_len()],
        bias: &vec![0; shape.out_channels()],
        input_max: 127,
        epilogue: Epilogue::F32 {
            scale: vec![1.0; shape.out_channels()],
        },
        algorithm,
    };
    QConv::new(isa, &params).unwrap().name()
}

#[test]
fn avx2_sums_in_i16_whatever_the_weights() {
    if !Isa::available().any(|isa| isa == Isa::Avx2) {
        println!("skipped: this CPU has no AVX2");
        return;
    }
    for weight in [1, 64, 127] {
        let name = kernel_of(Isa::Avx2, conv(64, 64, 1, 1, 1), weight);
        assert_eq!(name, "qs8_direct_4x16c4__avx2", "{weight}");
    }
}

#[test]
fn every_choice_takes_vectors_where_channels_come_in_twos() {
    for isa in Isa::available().filter(|isa| *isa != Isa::Scalar) {
        for algorithms in Algorithms::ALL {
            for channels in [16, 18, 20, 22, 34] {
                let shape = conv(channels, channels, 1, 3, 1);
                let kernel = kernel_by(algorithms.of(&shape), isa, shape, 1);
                assert!(
                    !kernel.ends_with("__scalar"),
                    "{algorithms:?}, {channels} channels: {kernel} on {isa}"
                );
            }
        }
    }
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

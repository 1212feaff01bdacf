//! The layers of SelecSLS at 512×320, and weights like a trained network's.

use edgecap_kernels::{ConvDims, ConvShape};

/// Input height and width, times in the network, shape.
pub fn table() -> Vec<(usize, usize, usize, ConvShape)> {
    let shape = |dims| ConvShape::new(dims).expect("the layer's numbers fit together");
    let dims = |i, o, groups, kernel, stride| ConvDims {
        in_channels: i,
        out_channels: o,
        groups,
        kernel,
        stride,
        padding: (kernel - 1) / 2,
        transposed: false,
    };
    let conv = |i, o, groups, kernel, stride| shape(dims(i, o, groups, kernel, stride));
    let mut all = vec![(320, 512, 1, conv(4, 32, 1, 3, 2))];
    let (h, w) = (80, 128);
    all.push((160, 256, 1, conv(32, 64, 1, 3, 2)));
    all.push((h, w, 1, conv(64, 64, 1, 3, 1)));
    all.push((h, w, 4, conv(64, 32, 1, 3, 1)));
    all.push((h, w, 2, conv(64, 64, 1, 1, 1)));
    all.push((h, w, 2, conv(32, 64, 1, 1, 1)));
    all.push((h, w, 1, conv(128, 64, 1, 1, 1)));
    all.push((h, w, 1, conv(192, 128, 1, 1, 1)));
    let (h, w) = (40, 64);
    all.push((80, 128, 1, conv(128, 128, 2, 3, 2)));
    all.push((h, w, 2, conv(128, 128, 2, 3, 1)));
    all.push((h, w, 6, conv(128, 64, 1, 3, 1)));
    all.push((h, w, 3, conv(128, 128, 1, 1, 1)));
    all.push((h, w, 3, conv(64, 128, 1, 1, 1)));
    all.push((h, w, 1, conv(256, 128, 1, 1, 1)));
    all.push((h, w, 1, conv(384, 128, 1, 1, 1)));
    all.push((h, w, 1, conv(384, 288, 1, 1, 1)));
    let (h, w) = (20, 32);
    all.push((40, 64, 1, conv(288, 288, 4, 3, 2)));
    all.push((h, w, 3, conv(288, 288, 4, 3, 1)));
    all.push((h, w, 8, conv(288, 144, 2, 3, 1)));
    all.push((h, w, 4, conv(288, 288, 1, 1, 1)));
    all.push((h, w, 4, conv(144, 288, 1, 1, 1)));
    all.push((h, w, 1, conv(576, 288, 1, 1, 1)));
    all.push((h, w, 2, conv(864, 288, 1, 1, 1)));
    all.push((h, w, 1, conv(864, 416, 1, 1, 1)));
    all.push((h, w, 2, conv(416, 256, 1, 1, 1)));
    all.push((
        h,
        w,
        2,
        shape(ConvDims {
            padding: 1,
            transposed: true,
            ..dims(256, 192, 4, 4, 2)
        }),
    ));
    let (h, w) = (40, 64);
    all.push((h, w, 1, conv(192, 128, 1, 3, 1)));
    all.push((h, w, 1, conv(128, 96, 4, 3, 1)));
    all.push((h, w, 1, conv(96, 40, 1, 3, 1)));
    all.push((h, w, 1, conv(192, 160, 1, 3, 1)));
    all.push((h, w, 1, conv(288, 160, 1, 1, 1)));
    all.push((h, w, 1, conv(160, 128, 4, 3, 1)));
    all.push((h, w, 1, conv(128, 63, 1, 3, 1)));
    all
}

/// Weights like a trained layer's: bell-shaped, the greatest of each output channel at ±127.
pub fn weights(shape: &ConvShape) -> Vec<i8> {
    let mut state = 88172645463325252u64;
    let mut uniform = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5
    };
    let per_output = shape.weight_len() / shape.out_channels();
    let mut all = Vec::with_capacity(shape.weight_len());
    for _ in 0..shape.out_channels() {
        let bell: Vec<f32> = (0..per_output)
            .map(|_| (0..6).map(|_| uniform()).sum())
            .collect();
        let most = bell.iter().fold(0f32, |most, v| most.max(v.abs()));
        all.extend(bell.iter().map(|v| (v / most * 127.0).round() as i8));
    }
    all
}

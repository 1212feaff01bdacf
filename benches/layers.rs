//! Every kind of layer of SelecSLS at 512×320, one thread, by algorithm: int8 and f32 of the tier in `EDGECAP_ISA`.
//!
//! Every kernel's first rows are compared with the scalar reference before it is timed.

#[path = "../kernels/examples/layers/network.rs"]
mod network;

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use edgecap_kernels::{
    Algorithm, ConvShape, Epilogue, FConv, FConvParams, Isa, Layout, Part, QConv, QConvParams,
    Scratch,
};

/// Output rows compared with scalar.
const CHECKED_ROWS: usize = 2;

fn name(height: usize, width: usize, shape: &ConvShape) -> String {
    format!(
        "{height}x{width}_{}to{}_g{}_k{}s{}{}",
        shape.in_channels(),
        shape.out_channels(),
        shape.groups(),
        shape.kernel(),
        shape.stride(),
        if shape.transposed() { "t" } else { "" }
    )
}

fn int8(c: &mut Criterion) {
    let isa = Isa::detect().expect("EDGECAP_ISA names a tier of this CPU");
    for (height, width, _, shape) in network::table() {
        let mut group = c.benchmark_group(format!("int8/{}", name(height, width, &shape)));
        group.throughput(Throughput::Elements(shape.macs(height, width)));
        let weights = network::weights(&shape);
        let bias = vec![500; shape.out_channels()];
        let input = Layout::dense(height, width, shape.in_channels(), 1).unwrap();
        let data: Vec<u8> = (0..input.buffer_len())
            .map(|i| (i * 37 % 101) as u8)
            .collect();
        let output = Layout::dense(
            shape.output_len(height),
            shape.output_len(width),
            shape.out_channels(),
            1,
        )
        .unwrap();
        for &algorithm in Algorithm::candidates(&shape) {
            let build = |isa| {
                let params = QConvParams {
                    shape,
                    weights: &weights,
                    bias: &bias,
                    input_max: if shape.in_channels() == 4 { 255 } else { 127 },
                    epilogue: Epilogue::U8 {
                        scale: vec![2e-4; shape.out_channels()],
                        max: 127,
                        residual_scale: None,
                    },
                    algorithm,
                };
                QConv::new(isa, &params).expect("the layer can be packed")
            };
            let mut scratch = Scratch::default();
            let mut run = |conv: &QConv, result: &mut [u8], part: &Part| {
                conv.check((&input, data.len()), None, (&output, result.len()))
                    .expect("the tensors fit");
                if scratch.len() < conv.scratch_bytes() {
                    scratch = Scratch::new(conv.scratch_bytes());
                }
                // SAFETY: checked above; the buffers are separate.
                unsafe {
                    conv.run_part(
                        data.as_ptr(),
                        &input,
                        None,
                        result.as_mut_ptr(),
                        &output,
                        part,
                        &mut scratch,
                    );
                }
            };
            let conv = build(isa);
            let mut result = vec![0u8; output.buffer_len()];
            let mut expected = result.clone();
            let first = Part::whole(CHECKED_ROWS.min(output.height()), shape.groups());
            run(&conv, &mut result, &first);
            run(&build(Isa::Scalar), &mut expected, &first);
            assert!(result == expected, "{} differs from scalar", conv.name());
            let whole = Part::whole(output.height(), shape.groups());
            group.bench_function(conv.name(), |b| {
                b.iter(|| run(&conv, black_box(&mut result), &whole));
            });
        }
    }
}

fn f32(c: &mut Criterion) {
    let isa = Isa::detect().expect("EDGECAP_ISA names a tier of this CPU");
    for (height, width, _, shape) in network::table() {
        let mut group = c.benchmark_group(format!("f32/{}", name(height, width, &shape)));
        group.throughput(Throughput::Elements(shape.macs(height, width)));
        let weights: Vec<f32> = network::weights(&shape)
            .iter()
            .map(|&w| f32::from(w) / 127.0)
            .collect();
        let bias = vec![0.1; shape.out_channels()];
        let input = Layout::dense(height, width, shape.in_channels(), 1).unwrap();
        let data: Vec<f32> = (0..input.buffer_len())
            .map(|i| (i * 37 % 101) as f32 / 100.0)
            .collect();
        let output = Layout::dense(
            shape.output_len(height),
            shape.output_len(width),
            shape.out_channels(),
            1,
        )
        .unwrap();
        for &algorithm in Algorithm::candidates(&shape) {
            let build = |isa| {
                let params = FConvParams {
                    shape,
                    weights: &weights,
                    bias: &bias,
                    relu: true,
                    residual: false,
                    algorithm,
                };
                FConv::new(isa, &params).expect("the layer can be packed")
            };
            let mut scratch = Scratch::default();
            let mut run = |conv: &FConv, result: &mut [f32], part: &Part| {
                conv.check((&input, data.len()), None, (&output, result.len()))
                    .expect("the tensors fit");
                if scratch.len() < conv.scratch_bytes() {
                    scratch = Scratch::new(conv.scratch_bytes());
                }
                // SAFETY: checked above; the buffers are separate.
                unsafe {
                    conv.run_part(
                        data.as_ptr(),
                        &input,
                        None,
                        result.as_mut_ptr(),
                        &output,
                        part,
                        &mut scratch,
                    );
                }
            };
            let conv = build(isa);
            let mut result = vec![0f32; output.buffer_len()];
            let mut expected = result.clone();
            let first = Part::whole(CHECKED_ROWS.min(output.height()), shape.groups());
            run(&conv, &mut result, &first);
            run(&build(Isa::Scalar), &mut expected, &first);
            let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-4 * (1.0 + b.abs());
            assert!(
                result.iter().zip(&expected).all(close),
                "{} differs from scalar",
                conv.name()
            );
            let whole = Part::whole(output.height(), shape.groups());
            group.bench_function(conv.name(), |b| {
                b.iter(|| run(&conv, black_box(&mut result), &whole));
            });
        }
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(20)
        .warm_up_time(std::time::Duration::from_millis(200))
        .measurement_time(std::time::Duration::from_secs(1));
    targets = int8, f32
}
criterion_main!(benches);

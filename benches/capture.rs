//! Time from a camera's buffer to the network's input, at 720p.

use std::hint::black_box;
use std::io::Cursor;

use criterion::{Criterion, criterion_group, criterion_main};
use edgecap::capture::{
    AviWriter, Frame, Matrix, PictureDecoder, PixelFormat, Range, RawLayout, Resizer,
};

const SIZE: (u32, u32) = (1280, 720);
const INPUT: (u32, u32) = (512, 320);

/// Smooth waves with some detail, as a camera would see.
fn picture() -> Frame {
    let mut rgb = Vec::new();
    for y in 0..SIZE.1 {
        for x in 0..SIZE.0 {
            let wave = 128.0 + 90.0 * (0.02 * x as f32).sin() * (0.03 * y as f32).cos();
            let grain = (((x * 7919 + y * 104_729) >> 3) & 15) as f32;
            rgb.extend_from_slice(&[wave as u8, (wave * 0.7 + grain) as u8, (255.0 - wave) as u8]);
        }
    }
    Frame {
        width: SIZE.0,
        height: SIZE.1,
        rgb,
        ..Frame::default()
    }
}

/// One JPEG of that picture.
fn jpeg(frame: &Frame) -> Vec<u8> {
    let mut writer = AviWriter::new(Cursor::new(Vec::new()), SIZE.0, SIZE.1, (30, 1)).unwrap();
    writer.write_frame(frame, 85).unwrap();
    let bytes = writer.finish().unwrap().into_inner();
    let start = bytes.windows(2).position(|w| w == [0xFF, 0xD8]).unwrap();
    let end = bytes.windows(2).rposition(|w| w == [0xFF, 0xD9]).unwrap();
    bytes[start..end + 2].to_vec()
}

fn decode(c: &mut Criterion) {
    let frame = picture();
    let noise: Vec<u8> = (0..SIZE.0 * SIZE.1 * 3)
        .map(|k| ((k * 31) >> 4) as u8)
        .collect();
    let jpeg = jpeg(&frame);
    let mut group = c.benchmark_group("decode_720p");
    for (name, format, bytes) in [
        ("yuyv", PixelFormat::Yuyv, &noise),
        ("nv12", PixelFormat::Nv12, &noise),
        ("rgb24", PixelFormat::Rgb24, &noise),
        ("mjpeg", PixelFormat::Mjpeg, &jpeg),
    ] {
        let mut decoder = PictureDecoder::new(RawLayout {
            format,
            width: SIZE.0,
            height: SIZE.1,
            stride: 0,
            matrix: Matrix::Bt601,
            range: Range::Limited,
        })
        .unwrap();
        let mut out = Frame::default();
        group.bench_function(name, |b| {
            b.iter(|| decoder.decode(black_box(bytes), &mut out).unwrap());
        });
    }
    group.finish();
}

fn letterbox(c: &mut Criterion) {
    let frame = picture();
    let mut resizer = Resizer::new(INPUT.0, INPUT.1);
    let mut out = vec![0; resizer.output_bytes()];
    c.bench_function("letterbox_720p_to_512x320", |b| {
        b.iter(|| resizer.run(black_box(&frame), &mut out));
    });
    // The answer is checked by the tests; here only that it is one.
    assert!(out.iter().any(|v| *v != out[0]));
}

criterion_group!(benches, decode, letterbox);
criterion_main!(benches);

//! What cameras send, as pictures: raw formats and Motion JPEG, whole and damaged.

use std::io;

use edgecap::capture::{AviWriter, Brightness, Frame, Matrix, RawDecoder, RawPicture};
use edgecap::capture::{PictureDecoder, PixelFormat, RawLayout};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use proptest::prelude::*;

use super::layout;

const FORMATS: [PixelFormat; 8] = [
    PixelFormat::Yuyv,
    PixelFormat::Uyvy,
    PixelFormat::Nv12,
    PixelFormat::Yu12,
    PixelFormat::Grey,
    PixelFormat::Rgb24,
    PixelFormat::Bgr24,
    PixelFormat::Mjpeg,
];

#[test]
fn raw_buffers_have_a_brightness_without_being_decoded() {
    let mut decoder = RawDecoder::default();
    for format in FORMATS.into_iter().filter(|f| *f != PixelFormat::Mjpeg) {
        for (w, h) in [(1, 1), (3, 5), (200, 100)] {
            let layout = PictureDecoder::new(layout(format, w, h, 0)).unwrap();
            let mut raw = RawPicture {
                layout: layout.layout(),
                // Chroma, red, blue and what follows a row's last pixel are no brightness.
                bytes: vec![33; layout.needed_bytes()],
                ..RawPicture::default()
            };
            let (first, step) = match format {
                PixelFormat::Yuyv => (0, 2),
                PixelFormat::Uyvy => (1, 2),
                PixelFormat::Rgb24 | PixelFormat::Bgr24 => (1, 3),
                _ => (0, 1),
            };
            let stride = raw.layout.stride as usize;
            for row in raw.bytes.chunks_mut(stride).take(h as usize) {
                for pixel in 0..w as usize {
                    row[first + step * pixel] = 90;
                }
            }
            let mut brightness = Brightness::default();
            decoder.brightness(&raw, &mut brightness).unwrap();
            assert!(
                brightness.cells.iter().all(|c| *c == 90.0),
                "{format:?} {w}x{h}"
            );
            raw.bytes.pop();
            let error = decoder.brightness(&raw, &mut brightness).unwrap_err();
            assert!(error.contains("bytes of a picture"), "{error}");
        }
    }
}

#[test]
fn raw_buffers_become_pictures() {
    let mut frame = Frame::default();
    // Rows with padding, the last one cut after its pixels, as drivers may do.
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Rgb24, 2, 2, 8)).unwrap();
    let bytes = [1, 2, 3, 4, 5, 6, 0, 0, 7, 8, 9, 10, 11, 12];
    decoder.decode(&bytes, &mut frame).unwrap();
    assert_eq!(frame.rgb, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);

    // White, black; without chroma.
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Yuyv, 2, 1, 0)).unwrap();
    decoder.decode(&[235, 128, 16, 128], &mut frame).unwrap();
    assert_eq!(frame.rgb, [255, 255, 255, 0, 0, 0]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Nv12, 2, 2, 2)).unwrap();
    decoder
        .decode(&[235, 16, 16, 235, 128, 128], &mut frame)
        .unwrap();
    assert_eq!(frame.rgb[..6], [255, 255, 255, 0, 0, 0]);
    assert_eq!(decoder.layout().stride, 2);

    let mut decoder = PictureDecoder::new(layout(PixelFormat::Uyvy, 2, 1, 0)).unwrap();
    decoder.decode(&[128, 235, 128, 16], &mut frame).unwrap();
    assert_eq!(frame.rgb, [255, 255, 255, 0, 0, 0]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Yu12, 2, 2, 4)).unwrap();
    let planes = [235, 16, 0, 0, 16, 235, 0, 0, 128, 0, 128, 0];
    decoder.decode(&planes, &mut frame).unwrap();
    assert_eq!(frame.rgb, [255, 255, 255, 0, 0, 0, 0, 0, 0, 255, 255, 255]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Grey, 2, 2, 3)).unwrap();
    decoder.decode(&[235, 16, 9, 16, 235], &mut frame).unwrap();
    assert_eq!(frame.rgb, [255, 255, 255, 0, 0, 0, 0, 0, 0, 255, 255, 255]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Bgr24, 2, 1, 0)).unwrap();
    decoder.decode(&[1, 2, 3, 4, 5, 6], &mut frame).unwrap();
    assert_eq!(frame.rgb, [3, 2, 1, 6, 5, 4]);

    for format in FORMATS {
        for (w, h) in [(1, 1), (3, 5), (6, 2)] {
            let mut decoder = PictureDecoder::new(layout(format, w, h, 0)).unwrap();
            let needed = decoder.needed_bytes();
            for bytes in 0..needed {
                let error = decoder.decode(&vec![0; bytes], &mut frame).unwrap_err();
                assert!(error.contains("bytes"), "{error}");
            }
            let whole = decoder.decode(&vec![0; needed], &mut frame);
            assert_eq!(
                whole.is_ok(),
                format != PixelFormat::Mjpeg,
                "{format:?} {w}x{h}"
            );
        }
    }
    assert!(PictureDecoder::new(layout(PixelFormat::Yuyv, 640, 480, 640)).is_err());
    assert!(PictureDecoder::new(layout(PixelFormat::Yuyv, 0, 480, 0)).is_err());
    assert_eq!(PixelFormat::from_fourcc(*b"H264"), None);
}

/// A small JPEG, as a camera would send it.
fn jpeg() -> Vec<u8> {
    let picture = Frame {
        width: 16,
        height: 8,
        rgb: vec![90; 3 * 16 * 8],
        ..Frame::default()
    };
    let mut writer = AviWriter::new(io::Cursor::new(Vec::new()), 16, 8, (30, 1)).unwrap();
    writer.write_frame(&picture, 90).unwrap();
    let avi = writer.finish().unwrap().into_inner();
    let start = avi.windows(2).position(|w| w == [0xFF, 0xD8]).unwrap();
    let end = avi.windows(2).position(|w| w == [0xFF, 0xD9]).unwrap() + 2;
    avi[start..end].to_vec()
}

#[test]
fn motion_jpeg_with_rubbish_behind_it_is_decoded() {
    let mut buffer = jpeg();
    let end = buffer.len();
    buffer.extend_from_slice(&[0; 5000]);
    let mut decoder = PictureDecoder::new(layout(PixelFormat::Mjpeg, 16, 8, 0)).unwrap();
    let mut frame = Frame::default();
    decoder.decode(&buffer, &mut frame).unwrap();
    assert_eq!((frame.width, frame.height), (16, 8));
    assert!(frame.rgb.iter().all(|v| v.abs_diff(90) < 3));
    // Cut short by a lost packet: the picture is drawn as far as it goes.
    decoder.decode(&buffer[..end - 2], &mut frame).unwrap();
}

#[test]
fn motion_jpeg_of_another_size_than_agreed_is_damaged() {
    let mut frame = Frame::default();
    let of_size = |width: u32, height: u32| {
        let mut bytes = Vec::new();
        let rgb = vec![90; 3 * (width * height) as usize];
        JpegEncoder::new(&mut bytes)
            .encode(&rgb, width, height, ExtendedColorType::Rgb8)
            .unwrap();
        bytes
    };
    let agreed = layout(PixelFormat::Mjpeg, 64, 45, 0);
    let mut decoder = PictureDecoder::new(agreed).unwrap();
    // Of a camera that has never kept to the size all are taken.
    assert!(decoder.decode(&of_size(32, 24), &mut frame).is_ok());
    for (width, height, fits) in [
        (64, 45, true),
        // A camera that sends whole blocks, and one that sends less.
        (64, 48, true),
        (72, 40, true),
        (32, 24, false),
        (64, 480, false),
        (640, 45, false),
        (64, 45, true),
    ] {
        let decoded = decoder.decode(&of_size(width, height), &mut frame);
        assert_eq!(decoded.is_ok(), fits, "{width}x{height}");
        if fits {
            let size = (frame.width, frame.height);
            assert_eq!(size, (width.min(64), height.min(45)));
            assert_eq!(frame.rgb.len(), 3 * (size.0 * size.1) as usize);
        }
        if let Err(why) = decoded {
            let expected = format!("expected a picture of 64x45, found one of {width}x{height}");
            assert!(why.contains(&expected), "{why}");
        }
    }
}

#[test]
fn what_fills_up_the_blocks_of_motion_jpeg_is_cut_off() {
    let mut bytes = Vec::new();
    let dark_outside = |k: u32| match k % 48 < 40 && k / 48 < 24 {
        true => [200; 3],
        false => [0; 3],
    };
    let rgb: Vec<u8> = (0..48 * 32).flat_map(dark_outside).collect();
    JpegEncoder::new_with_quality(&mut bytes, 95)
        .encode(&rgb, 48, 32, ExtendedColorType::Rgb8)
        .unwrap();
    let agreed = layout(PixelFormat::Mjpeg, 40, 24, 0);
    let mut frame = Frame::default();
    let mut decoder = PictureDecoder::new(agreed).unwrap();
    decoder.decode(&bytes, &mut frame).unwrap();
    assert_eq!((frame.width, frame.height), (40, 24));
    assert_eq!(frame.rgb.len(), 3 * 40 * 24);
    assert!(frame.rgb.iter().all(|v| *v > 150), "{:?}", frame.rgb);
}

#[test]
fn the_matrix_of_a_layout_is_used() {
    let of = |matrix| {
        let layout = RawLayout {
            matrix,
            ..layout(PixelFormat::Yuyv, 2, 1, 0)
        };
        let mut frame = Frame::default();
        let mut decoder = PictureDecoder::new(layout).unwrap();
        decoder.decode(&[80, 90, 80, 200], &mut frame).unwrap();
        frame.rgb
    };
    let (sd, hd) = (of(Matrix::Bt601), of(Matrix::Bt709));
    // Red by 1.596 and 1.793 times the chroma's 72.
    assert!(
        sd[0].abs_diff(190) <= 1 && hd[0].abs_diff(204) <= 1,
        "{sd:?} {hd:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn damaged_motion_jpeg_never_panics(
        cut in 0usize..2000,
        hits in prop::collection::vec((0usize..2000, any::<u8>()), 0..8),
    ) {
        let mut bytes = jpeg();
        let n = bytes.len();
        for (at, value) in hits {
            bytes[at % n] = value;
        }
        bytes.truncate(cut.clamp(4, n));
        let mut decoder = PictureDecoder::new(layout(PixelFormat::Mjpeg, 16, 8, 0)).unwrap();
        let mut frame = Frame::default();
        if decoder.decode(&bytes, &mut frame).is_ok() {
            prop_assert_eq!(frame.rgb.len(), 3 * (frame.width * frame.height) as usize);
        }
    }
}

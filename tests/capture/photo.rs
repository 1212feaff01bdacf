//! Photos of every kind a user may have: the right picture or one clear error that names the file.

use std::io::Cursor;
use std::path::Path;

use edgecap::capture::{
    Frame, InputSpec, JpegPicture, OpenOptions, Orientation, PhotoDecoder, PhotoSource, Source,
    natural_order, open,
};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageFormat, RgbImage};
use proptest::prelude::*;

use crate::said::said;

/// Four quadrants of different colours, wider than high.
fn quadrants() -> RgbImage {
    RgbImage::from_fn(48, 32, |x, y| {
        image::Rgb(match (x < 24, y < 16) {
            (true, true) => [200, 40, 40],
            (false, true) => [40, 200, 40],
            (true, false) => [40, 40, 200],
            (false, false) => [200, 200, 60],
        })
    })
}

fn jpeg(picture: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 95)
        .encode_image(picture)
        .unwrap();
    bytes
}

fn png(picture: &DynamicImage) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn decode(bytes: &[u8]) -> Result<Frame, String> {
    let mut frame = Frame::default();
    PhotoDecoder::default().decode(bytes, &mut frame)?;
    assert_eq!(frame.rgb.len(), 3 * (frame.width * frame.height) as usize);
    Ok(frame)
}

fn assert_close(frame: &Frame, expected: &RgbImage, tolerance: u8) {
    assert_eq!((frame.width, frame.height), expected.dimensions());
    for (k, (a, b)) in frame.rgb.iter().zip(expected.as_raw()).enumerate() {
        assert!(a.abs_diff(*b) <= tolerance, "byte {k}: {a} and {b}");
    }
}

/// Puts an EXIF block with only an orientation behind the start of a JPEG.
fn with_orientation(jpeg: &[u8], tag: u16, little: bool) -> Vec<u8> {
    let mut exif = b"Exif\0\0".to_vec();
    let (order, words) = if little {
        (
            b"II*\0",
            [8u32.to_le_bytes(), (u32::from(tag)).to_le_bytes()],
        )
    } else {
        (
            b"MM\0*",
            [8u32.to_be_bytes(), (u32::from(tag) << 16).to_be_bytes()],
        )
    };
    let short = |v: u16| {
        if little {
            v.to_le_bytes()
        } else {
            v.to_be_bytes()
        }
    };
    let long = |v: u32| {
        if little {
            v.to_le_bytes()
        } else {
            v.to_be_bytes()
        }
    };
    exif.extend_from_slice(order);
    exif.extend_from_slice(&words[0]);
    exif.extend_from_slice(&short(1));
    exif.extend_from_slice(&short(0x0112));
    exif.extend_from_slice(&short(3));
    exif.extend_from_slice(&long(1));
    exif.extend_from_slice(&words[1]);
    exif.extend_from_slice(&long(0));
    let mut bytes = jpeg[..2].to_vec();
    bytes.extend_from_slice(&[0xFF, 0xE1]);
    bytes.extend_from_slice(&(exif.len() as u16 + 2).to_be_bytes());
    bytes.extend_from_slice(&exif);
    bytes.extend_from_slice(&jpeg[2..]);
    bytes
}

#[test]
fn jpeg_matches_what_was_encoded() {
    assert_close(&decode(&jpeg(&quadrants())).unwrap(), &quadrants(), 40);
    let frame = decode(&jpeg(&quadrants())).unwrap();
    let middle = |x: usize, y: usize| &frame.rgb[3 * (48 * y + x)..][..3];
    for (at, colour) in [
        (middle(8, 8), [200, 40, 40]),
        (middle(40, 24), [200, 200, 60]),
    ] {
        assert!(
            at.iter().zip(colour).all(|(a, b)| a.abs_diff(b) < 4),
            "{at:?}"
        );
    }
}

#[test]
fn every_orientation_is_undone_as_image_does() {
    let stored = jpeg(&quadrants());
    let upright = decode(&stored).unwrap();
    let upright = RgbImage::from_raw(48, 32, upright.rgb).unwrap();
    for tag in 1..=8 {
        let mut expected = DynamicImage::ImageRgb8(upright.clone());
        expected.apply_orientation(image::metadata::Orientation::from_exif(tag as u8).unwrap());
        for little in [true, false] {
            let frame = decode(&with_orientation(&stored, tag, little)).unwrap();
            assert_close(&frame, &expected.to_rgb8(), 0);
        }
    }
}

#[test]
fn png_of_every_colour_type_becomes_rgb() {
    let rgb = DynamicImage::ImageRgb8(quadrants());
    assert_close(&decode(&png(&rgb)).unwrap(), &quadrants(), 0);
    let wide = DynamicImage::ImageRgb16(rgb.to_rgb16());
    assert_close(&decode(&png(&wide)).unwrap(), &quadrants(), 0);
    let grey = DynamicImage::ImageLuma8(rgb.to_luma8());
    let expected = DynamicImage::ImageLuma8(rgb.to_luma8()).to_rgb8();
    assert_close(&decode(&png(&grey)).unwrap(), &expected, 0);
    let grey16 = DynamicImage::ImageLuma16(grey.to_luma16());
    assert_close(&decode(&png(&grey16)).unwrap(), &expected, 0);
    for opaque in [
        DynamicImage::ImageRgba8(rgb.to_rgba8()),
        DynamicImage::ImageRgba16(rgb.to_rgba16()),
    ] {
        assert_close(&decode(&png(&opaque)).unwrap(), &quadrants(), 0);
    }
    for opaque in [
        DynamicImage::ImageLumaA8(grey.to_luma_alpha8()),
        DynamicImage::ImageLumaA16(grey.to_luma_alpha16()),
    ] {
        assert_close(&decode(&png(&opaque)).unwrap(), &expected, 0);
    }
}

#[test]
fn transparent_pixels_show_mid_grey() {
    let picture = image::RgbaImage::from_fn(3, 1, |x, _| {
        image::Rgba([255, 0, 100, [0, 128, 255][x as usize]])
    });
    let frame = decode(&png(&DynamicImage::ImageRgba8(picture))).unwrap();
    assert_eq!(frame.rgb, [128, 128, 128, 192, 64, 114, 255, 0, 100]);
}

/// A PNG of the quadrants, to be turned a quarter clockwise: the EXIF chunk stands ahead of the pixels.
fn png_to_be_turned() -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = PngEncoder::new(&mut bytes);
    let exif = with_orientation(&[0xFF, 0xD8], 6, true)[12..].to_vec();
    encoder.set_exif_metadata(exif).unwrap();
    encoder
        .write_image(quadrants().as_raw(), 48, 32, ExtendedColorType::Rgb8)
        .unwrap();
    bytes
}

/// Cuts the chunk of this kind out of a PNG.
fn cut_out(png: &mut Vec<u8>, kind: &[u8; 4]) -> Vec<u8> {
    let name = png.windows(4).position(|w| w == kind).unwrap();
    let length = u32::from_be_bytes(png[name - 4..name].try_into().unwrap());
    // Length and kind before the contents, a checksum behind.
    png.drain(name - 4..name + 8 + length as usize).collect()
}

#[test]
fn png_with_an_exif_chunk_is_turned() {
    let turned = DynamicImage::ImageRgb8(quadrants()).rotate90().to_rgb8();
    let mut bytes = png_to_be_turned();
    assert_close(&decode(&bytes).unwrap(), &turned, 0);
    let exif = cut_out(&mut bytes, b"eXIf");
    let end = cut_out(&mut bytes, b"IEND");
    // Behind the pixels it counts as well; behind the picture's end nothing does.
    let behind = [&bytes[..], &exif, &end].concat();
    assert_close(&decode(&behind).unwrap(), &turned, 0);
    let beyond = [&bytes[..], &end, &exif].concat();
    assert_close(&decode(&beyond).unwrap(), &quadrants(), 0);
}

/// A JPEG of one 8 × 8 block per component, each of one value. `adobe`: the transform that an APP14 marker names.
fn flat_jpeg(values: &[u8], adobe: Option<u8>, tables: bool) -> Vec<u8> {
    let n = values.len() as u8;
    let mut b = vec![0xFF, 0xD8];
    if let Some(transform) = adobe {
        b.extend_from_slice(&[0xFF, 0xEE, 0, 14]);
        b.extend_from_slice(b"Adobe\0\x64\0\0\0\0");
        b.push(transform);
    }
    b.extend_from_slice(&[0xFF, 0xDB, 0, 67, 0]);
    b.extend_from_slice(&[8; 64]);
    b.extend_from_slice(&[0xFF, 0xC0, 0, 8 + 3 * n, 8, 0, 8, 0, 8, n]);
    for k in 1..=n {
        b.extend_from_slice(&[k, 0x11, 0]);
    }
    if tables {
        // Two codes of 8 and 4 bits are enough for DC categories 0–8 and the end of a block, as in annex K.3.
        b.extend_from_slice(&[0xFF, 0xC4, 0, 31, 0]);
        b.extend_from_slice(&[0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0]);
        b.extend_from_slice(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]);
        b.extend_from_slice(&[0xFF, 0xC4, 0, 30, 0x10]);
        b.extend_from_slice(&[0, 2, 1, 3, 3, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        b.extend_from_slice(&[1, 2, 3, 0, 4, 0x11, 5, 0x12, 0x21, 0x31, 0x41]);
    }
    b.extend_from_slice(&[0xFF, 0xDA, 0, 6 + 2 * n, n]);
    for k in 1..=n {
        b.extend_from_slice(&[k, 0]);
    }
    b.extend_from_slice(&[0, 63, 0]);
    let blocks = values.iter().map(|v| block(i32::from(*v) - 128));
    push_bits(&mut b, blocks.collect());
    b.extend_from_slice(&[0xFF, 0xD9]);
    b
}

/// The bits of a block of one value, as much above the one before it.
fn block(above: i32) -> String {
    let category = 32 - above.unsigned_abs().leading_zeros();
    let mut bits = [
        "00", "010", "011", "100", "101", "110", "1110", "11110", "111110",
    ][category as usize]
        .to_owned();
    if category > 0 {
        let code = if above > 0 {
            above
        } else {
            above + (1 << category) - 1
        };
        bits += &format!("{code:0width$b}", width = category as usize);
    }
    // End of block.
    bits + "1010"
}

/// The data of a scan.
fn push_bits(jpeg: &mut Vec<u8>, mut bits: String) {
    while !bits.len().is_multiple_of(8) {
        bits.push('1');
    }
    for byte in bits.as_bytes().chunks(8) {
        let v = u8::from_str_radix(std::str::from_utf8(byte).unwrap(), 2).unwrap();
        jpeg.push(v);
        if v == 0xFF {
            jpeg.push(0);
        }
    }
}

#[test]
fn four_inks_become_rgb_inverted_or_not() {
    let flat = |bytes: &[u8]| {
        let frame = decode(bytes).unwrap();
        assert_eq!((frame.width, frame.height), (8, 8));
        assert!(frame.rgb.chunks(3).all(|p| p == &frame.rgb[..3]));
        [frame.rgb[0], frame.rgb[1], frame.rgb[2]]
    };
    let near = |a: [u8; 3], b: [u8; 3]| {
        assert!(
            a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 2),
            "{a:?} {b:?}"
        )
    };
    // Plain: full cyan and a quarter of black.
    near(
        flat(&flat_jpeg(&[255, 0, 0, 64], None, true)),
        [0, 191, 191],
    );
    // Adobe's, inverted: light of cyan is missing, three quarters of the light pass the black.
    near(
        flat(&flat_jpeg(&[0, 255, 255, 191], Some(0), true)),
        [0, 191, 191],
    );
    // YCCK: Y = 128 without colour, no black: mid grey, inverted in storage.
    near(
        flat(&flat_jpeg(&[100, 128, 128, 255], Some(2), true)),
        [155, 155, 155],
    );
    // Red of YCC (76, 85, 255) stands for cyan's light: 255 − red.
    near(
        flat(&flat_jpeg(&[76, 85, 255, 255], Some(2), true)),
        [1, 255, 255],
    );
}

#[test]
fn pictures_without_huffman_tables_get_the_standard_ones() {
    let with = decode(&flat_jpeg(&[180], None, true)).unwrap();
    let without = decode(&flat_jpeg(&[180], None, false)).unwrap();
    assert_eq!(with, without);
    assert!(with.rgb.iter().all(|v| *v == 180));
    // The image crate writes the standard tables: taking them away must change nothing.
    let whole = jpeg(&quadrants());
    let mut stripped = whole[..2].to_vec();
    let mut at = 2;
    while whole[at + 1] != 0xDA {
        let length = 2 + usize::from(u16::from_be_bytes([whole[at + 2], whole[at + 3]]));
        if whole[at + 1] != 0xC4 {
            stripped.extend_from_slice(&whole[at..at + length]);
        }
        at += length;
    }
    stripped.extend_from_slice(&whole[at..]);
    assert!(stripped.len() < whole.len() - 300);
    assert_eq!(decode(&stripped).unwrap(), decode(&whole).unwrap());
}

/// How bright a block is.
fn level(column: usize, row: usize) -> u8 {
    (20 + (23 * column + 61 * row) % 200) as u8
}

/// A grey YCbCr picture that is stored component by component, `size` blocks of luma wide and high; `samplings`: across
/// and down (4 bits each).
fn stored_apart(samplings: [u8; 3], size: [usize; 2]) -> Vec<u8> {
    let mut b = flat_jpeg(&[128; 3], None, true);
    let at = |b: &[u8], marker: u8| b.windows(2).position(|w| w == [0xFF, marker]).unwrap();
    b.truncate(at(&b, 0xDA));
    let frame = at(&b, 0xC0);
    b[frame + 5..frame + 7].copy_from_slice(&(8 * size[1] as u16).to_be_bytes());
    b[frame + 7..frame + 9].copy_from_slice(&(8 * size[0] as u16).to_be_bytes());
    let factors = |sampling: u8| [usize::from(sampling >> 4), usize::from(sampling & 15)];
    let most = |k: usize| samplings.map(|s| factors(s)[k]).into_iter().max().unwrap();
    for (k, sampling) in (0..3).zip(samplings) {
        b[frame + 11 + 3 * k] = sampling;
        b.extend_from_slice(&[0xFF, 0xDA, 0, 8, 1, k as u8 + 1, 0, 0, 63, 0]);
        let blocks = |k: usize| size[k] * factors(sampling)[k] / most(k);
        let (mut bits, mut before) = (String::new(), 128);
        for (row, column) in (0..blocks(1)).flat_map(|r| (0..blocks(0)).map(move |c| (r, c))) {
            let value = i32::from(if k == 0 { level(column, row) } else { 128 });
            bits += &block(value - before);
            before = value;
        }
        push_bits(&mut b, bits);
    }
    b.extend_from_slice(&[0xFF, 0xD9]);
    b
}

/// What is said of a picture, by every way to decode it.
fn refusals(bytes: &[u8]) -> Vec<String> {
    let (mut frame, mut luma) = (Frame::default(), Vec::new());
    vec![
        decode(bytes).unwrap_err(),
        JpegPicture::lenient()
            .decode(bytes, &mut frame)
            .unwrap_err(),
        JpegPicture::default()
            .luma(bytes, false, &mut luma)
            .unwrap_err(),
    ]
}

#[test]
fn pictures_stored_component_by_component_are_read_right_or_refused() {
    for (across, columns) in [(0x11, 33), (0x21, 66), (0x41, 132)] {
        let bytes = stored_apart([across, 0x11, 0x11], [columns, 4]);
        let frame = decode(&bytes).unwrap();
        let mut luma = Vec::new();
        let size = JpegPicture::default().luma(&bytes, true, &mut luma);
        let side = 8 * columns;
        assert_eq!(size.unwrap(), Some((side, 32)));
        for (k, (rgb, luma)) in frame.rgb.chunks(3).zip(luma).enumerate() {
            let wanted = level(k % side / 8, k / side / 8);
            assert_eq!((rgb, luma), (&[wanted; 3][..], wanted), "{across:x}: {k}");
        }
    }
    for samplings in [
        [0x22, 0x11, 0x11],
        [0x12, 0x11, 0x11],
        [0x11, 0x12, 0x12],
        [0x11, 0x11, 0x21],
        [0x11, 0x11, 0x22],
        [0x14, 0x12, 0x41],
        [0x11, 0x41, 0x11],
    ] {
        for said in refusals(&stored_apart(samplings, [132, 4])) {
            assert!(
                said.contains("found 1 in the first"),
                "{samplings:x?}: {said}"
            );
        }
    }
    // The last rows are short enough to be read ahead.
    for (across, columns) in [(0x11, 32), (0x21, 64), (0x41, 4)] {
        let bytes = stored_apart([across, 0x11, 0x11], [columns, 4]);
        assert!(refusals(&bytes)[0].contains("expected all 3 components"));
    }
    // Two of three at once, of different widths.
    let mut two = stored_apart([0x21, 0x11, 0x11], [132, 4]);
    let scan = two.windows(2).position(|w| w == [0xFF, 0xDA]).unwrap();
    two.splice(scan + 3..scan + 7, [10, 2, 1, 0, 2, 0]);
    assert!(refusals(&two)[0].contains("found 2 in the first"));
    let mut restarts = stored_apart([0x11; 3], [132, 4]);
    restarts.splice(2..2, [0xFF, 0xDD, 0, 4, 0, 100]);
    assert!(refusals(&restarts)[0].contains("found 1 in the first"));
}

#[test]
fn one_pixel_is_a_picture() {
    let dot = RgbImage::from_pixel(1, 1, image::Rgb([10, 200, 90]));
    assert_close(&decode(&jpeg(&dot)).unwrap(), &dot, 4);
    assert_close(
        &decode(&png(&DynamicImage::ImageRgb8(dot.clone()))).unwrap(),
        &dot,
        0,
    );
}

#[test]
fn huge_pictures_are_read_and_impossible_ones_refused() {
    let side = 8000u32;
    let grey = vec![77; (side * side) as usize];
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::NoFilter)
        .write_image(&grey, side, side, ExtendedColorType::L8)
        .unwrap();
    let frame = decode(&bytes).unwrap();
    assert_eq!((frame.width, frame.height), (side, side));
    assert!(frame.rgb.iter().step_by(4999).all(|v| *v == 77));
    drop(frame);

    let mut bytes = jpeg(&quadrants());
    let sof = bytes.windows(2).position(|w| w == [0xFF, 0xC0]).unwrap();
    bytes[sof + 5..sof + 9].copy_from_slice(&[0x3F, 0xFF, 0x3F, 0xFF]);
    let error = decode(&bytes).unwrap_err();
    assert!(error.contains("16383x16383"), "{error}");
    bytes[sof + 5..sof + 9].copy_from_slice(&[0xFF, 0xFF, 0xFF, 0xFF]);
    assert!(decode(&bytes).is_err());
}

#[test]
fn files_cut_off_anywhere_are_refused() {
    let picture = RgbImage::from_fn(64, 64, |x, y| {
        image::Rgb([(x * y) as u8, (3 * x) as u8, (5 * y) as u8])
    });
    for whole in [jpeg(&picture), png(&DynamicImage::ImageRgb8(picture))] {
        assert!(decode(&whole).is_ok());
        for percent in [0, 1, 10, 50, 90, 99] {
            let cut = whole.len() * percent / 100;
            let error = decode(&whole[..cut]).unwrap_err();
            assert!(!error.is_empty() && !error.contains('\n'), "{error}");
        }
    }
}

#[test]
fn files_are_judged_by_their_bytes_and_named_in_errors() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let open_path = |path: &Path| open(&InputSpec::Path(path.to_owned()), &OpenOptions::default());
    // A PNG that calls itself JPEG is a PNG.
    let png = write("really.jpg", &png(&DynamicImage::ImageRgb8(quadrants())));
    let mut source = open_path(&png).unwrap();
    assert_eq!((source.frame_count(), source.is_live()), (Some(1), false));
    assert_close(&source.next().unwrap().unwrap(), &quadrants(), 0);
    assert!(source.next().unwrap().is_none());

    let cut = write("cut.jpg", &jpeg(&quadrants())[..300]);
    let error = open_path(&cut).unwrap().next().unwrap_err();
    assert_eq!(error.exit_code(), 65);
    assert!(error.to_string().contains("cut.jpg"), "{error}");

    for (path, code) in [
        (write("empty.jpg", b""), 65),
        (write("notes.txt", b"not a picture at all"), 65),
        (folder.path().join("missing.png"), 66),
    ] {
        let error = open_path(&path).err().unwrap();
        assert_eq!(error.exit_code(), code, "{error}");
        assert!(
            error
                .to_string()
                .contains(path.file_name().unwrap().to_str().unwrap())
        );
    }
}

#[test]
fn a_folder_is_read_in_natural_order_and_survives_one_bad_file() {
    let folder = tempfile::tempdir().unwrap();
    let error = PhotoSource::folder(folder.path(), None).err().unwrap();
    assert_eq!(error.exit_code(), 66);
    for (name, level) in [("p10.PNG", 30u8), ("p2.png", 20), ("P1.png", 10)] {
        let picture = RgbImage::from_pixel(4, 4, image::Rgb([level; 3]));
        std::fs::write(
            folder.path().join(name),
            png(&DynamicImage::ImageRgb8(picture)),
        )
        .unwrap();
    }
    std::fs::write(folder.path().join("p3.jpg"), b"\xFF\xD8\xFFbroken").unwrap();
    std::fs::write(folder.path().join(".hidden.png"), b"").unwrap();
    std::fs::write(folder.path().join("readme.txt"), b"hello").unwrap();
    let mut source = PhotoSource::folder(folder.path(), Some(10.0)).unwrap();
    assert_eq!(source.frame_count(), Some(4));
    let mut seen = Vec::new();
    let mut frame = Frame::default();
    loop {
        match source.next_into(&mut frame) {
            Ok(true) => seen.push((frame.rgb[0], frame.sequence, frame.time_ns)),
            Ok(false) => break,
            Err(e) => {
                assert!(e.is_skippable() && e.to_string().contains("p3.jpg"), "{e}");
                seen.push((0, 0, 0));
            }
        }
    }
    assert_eq!(
        seen,
        [
            (10, 0, 0),
            (20, 1, 100_000_000),
            (0, 0, 0),
            (30, 3, 300_000_000)
        ]
    );
}

/// Played like a camera, a folder of a few photos begins anew many times a second.
#[test]
fn a_folder_that_begins_anew_is_looked_at_again_and_says_only_what_is_news() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let photo = png(&DynamicImage::ImageRgb8(quadrants()));
    std::fs::write(at("a.png"), &photo).unwrap();
    std::fs::write(at("b.webp"), "bytes").unwrap();
    let text = said(|| {
        let mut source = PhotoSource::folder(folder.path(), None).unwrap();
        let mut play = || {
            let names = std::iter::from_fn(|| source.next().unwrap().map(|_| source.picture()));
            let names: Vec<String> = names.collect();
            assert!(source.rewind().unwrap());
            names.len()
        };
        assert_eq!([play(), play(), play()], [1; 3]);
        std::fs::write(at("c.png"), &photo).unwrap();
        std::fs::write(at("d.gif"), "bytes").unwrap();
        // What was listed when it began anew last.
        assert_eq!([play(), play(), play()], [1, 2, 2]);
        for name in ["a.png", "c.png"] {
            std::fs::remove_file(at(name)).unwrap();
        }
        assert_eq!(source.rewind().unwrap_err().exit_code(), 66);
    });
    let told: Vec<&str> = text.lines().filter(|l| l.contains("left out")).collect();
    assert_eq!(told.len(), 2, "{text}");
    assert!(told[0].contains("b.webp") && told[1].contains("d.gif"));
}

#[test]
fn a_photo_of_a_folder_that_cannot_be_opened_costs_only_itself() {
    let folder = tempfile::tempdir().unwrap();
    let photo = |name: &str, level: u8| {
        let picture = RgbImage::from_pixel(4, 4, image::Rgb([level; 3]));
        let path = folder.path().join(name);
        std::fs::write(&path, png(&DynamicImage::ImageRgb8(picture))).unwrap();
        path
    };
    photo("1.png", 10);
    let gone = photo("2.png", 20);
    let unreadable = photo("3.png", 30);
    photo("4.png", 40);
    let mut source = PhotoSource::folder(folder.path(), None).unwrap();
    std::fs::remove_file(&gone).unwrap();
    // Reading a folder is refused as a bad sector is.
    std::fs::remove_file(&unreadable).unwrap();
    std::fs::create_dir(&unreadable).unwrap();
    let level = |frame: Option<Frame>| frame.map(|frame| frame.rgb[0]);
    assert_eq!(level(source.next().unwrap()), Some(10));
    for word in ["2.png: no such file", "3.png: Is a directory"] {
        let error = source.next().unwrap_err();
        assert!(error.is_skippable(), "{error}");
        assert_eq!(error.exit_code(), 65);
        assert!(error.to_string().contains(word), "{error}");
    }
    assert_eq!(level(source.next().unwrap()), Some(40));
    assert!(source.next().unwrap().is_none());
    // Of a photo alone the code says what was wrong.
    for (path, code) in [(&gone, 66), (&unreadable, 74)] {
        let error = PhotoSource::file(path, None).next().unwrap_err();
        assert!(!error.is_skippable(), "{error}");
        assert_eq!(error.exit_code(), code);
    }
}

#[test]
fn numbers_in_names_count_by_value() {
    let mut names = [
        "b",
        "a10",
        "a9",
        "A1",
        "a1b",
        "a01",
        "a",
        "a99999999999999999999999",
        "10",
        "9",
    ];
    names.sort_by(|a, b| natural_order(a, b));
    assert_eq!(names[..3], ["9", "10", "a"]);
    assert_eq!(
        names[5..],
        ["a1b", "a9", "a10", "a99999999999999999999999", "b"]
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn natural_order_is_an_order(a in "[a-c0-2]{0,6}", b in "[a-c0-2]{0,6}", c in "[a-c0-2]{0,6}") {
        prop_assert_eq!(natural_order(&a, &b), natural_order(&b, &a).reverse());
        if natural_order(&a, &b).is_le() && natural_order(&b, &c).is_le() {
            prop_assert!(natural_order(&a, &c).is_le());
        }
    }

    #[test]
    fn random_exif_never_panics(mut bytes in prop::collection::vec(any::<u8>(), 0..64), little in any::<bool>()) {
        Orientation::from_exif(&bytes);
        let head: &[u8] = if little { b"II*\0\x08\0\0\0" } else { b"MM\0*\0\0\0\x08" };
        bytes.splice(0..0, head.iter().copied());
        Orientation::from_exif(&bytes);
    }

    #[test]
    fn damaged_photos_never_panic(
        png_file in any::<bool>(),
        cut in 0usize..3000,
        hits in prop::collection::vec((0usize..3000, any::<u8>()), 0..8),
    ) {
        let mut bytes = if png_file {
            png(&DynamicImage::ImageRgb8(quadrants()))
        } else {
            with_orientation(&jpeg(&quadrants()), 6, false)
        };
        let n = bytes.len();
        for (at, value) in hits {
            bytes[at % n] = value;
        }
        bytes.truncate(cut.max(2).min(n));
        let _ = decode(&bytes);
    }
}

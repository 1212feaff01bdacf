//! Films and photos by their bytes and names, from files and from memory.

use std::io::Cursor;

use edgecap::capture::{AviWriter, Frame, InputSpec, OpenOptions, open, open_bytes};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use rustix::fs::{CWD, FileType, Mode, mknodat};

use crate::y4m::film;

#[test]
fn films_open_from_memory_and_from_files() {
    let y4m = film("W6 H4 F30:1", [24, 6, 6], 2);
    let mut writer = AviWriter::new(Cursor::new(Vec::new()), 6, 4, (30, 1)).unwrap();
    let frame = Frame {
        width: 6,
        height: 4,
        rgb: vec![90; 72],
        ..Frame::default()
    };
    writer.write_frame(&frame, 90).unwrap();
    writer.write_frame(&frame, 90).unwrap();
    let avi = writer.finish().unwrap().into_inner();
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in [("a.y4m", y4m), ("b.avi", avi)] {
        // Names do not matter, bytes do.
        let path = folder.path().join(name).with_extension("bin");
        std::fs::write(&path, &bytes).unwrap();
        let from_file = open(&InputSpec::Path(path), &OpenOptions::default()).unwrap();
        let from_memory = open_bytes("demo", bytes.leak()).unwrap();
        for mut source in [from_file, from_memory] {
            assert_eq!(source.frame_count(), Some(2));
            assert!(source.next().unwrap().is_some() && source.next().unwrap().is_some());
            assert!(source.next().unwrap().is_none());
        }
    }
    assert!(open_bytes("demo", b"nothing of the kind").is_err());
}

#[test]
fn jpegs_back_to_back_are_a_film_by_their_name_and_a_photo_without() {
    let jpeg = |value: u8| {
        let mut bytes = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
        let grey = [value; 16 * 8];
        encoder
            .write_image(&grey, 16, 8, ExtendedColorType::L8)
            .unwrap();
        bytes
    };
    let pictures = [40, 90, 140].map(jpeg);
    let folder = tempfile::tempdir().unwrap();
    let opened = |name: &str, bytes: &[u8], fps: Option<f64>| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let options = OpenOptions {
            fps,
            ..OpenOptions::default()
        };
        open(&InputSpec::Path(path), &options).unwrap()
    };
    let film = pictures.concat();
    for (name, fps) in [("a.mjpeg", None), ("a.MJPG", Some(10.0)), ("a.mjp", None)] {
        let mut source = opened(name, &film, fps);
        let rate = fps.unwrap_or(30.0);
        assert_eq!((source.fps(), source.is_stills()), (Some(rate), false));
        for (k, value) in [40_u8, 90, 140].into_iter().enumerate() {
            let frame = source.next().unwrap().unwrap();
            assert_eq!((frame.width, frame.height), (16, 8));
            assert!(frame.rgb.iter().all(|v| v.abs_diff(value) <= 3), "{name}");
            let time_ns = (k as f64 * 1e9 / rate).round() as u64;
            assert_eq!((frame.sequence, frame.time_ns), (k as u64, time_ns));
        }
        assert!(source.next().unwrap().is_none());
    }
    let mut photo = opened("a.jpg", &film, None);
    assert!(photo.is_stills() && photo.next().unwrap().is_some());
    assert!(photo.next().unwrap().is_none());

    let mut cut = opened("cut.mjpeg", &film[..film.len() - 1], None);
    assert!(cut.next().unwrap().is_some() && cut.next().unwrap().is_some());
    let error = cut.next().unwrap_err();
    assert_eq!((error.exit_code(), error.is_skippable()), (65, false));
    assert!(error.to_string().contains("inside frame 2"), "{error}");

    let without_end = &pictures[1][..pictures[1].len() - 2];
    let damaged = [&pictures[0][..], without_end, &pictures[2]].concat();
    let mut damaged = opened("damaged.mjpeg", &damaged, None);
    assert!(damaged.next().unwrap().is_some());
    let error = damaged.next().unwrap_err();
    assert!(
        error.is_skippable() && error.to_string().contains("frame 1"),
        "{error}"
    );
    assert_eq!(damaged.next().unwrap().unwrap().sequence, 2);
    assert!(damaged.next().unwrap().is_none());
}

#[test]
fn paths_that_lead_to_no_file_are_no_input() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("file"), "").unwrap();
    std::os::unix::fs::symlink(at("circle"), at("circle")).unwrap();
    mknodat(CWD, at("socket"), FileType::Socket, Mode::RWXU, 0).unwrap();
    let long = "a".repeat(300);
    for name in ["none.avi", "file/clip.avi", "circle", "socket", &long] {
        let spec = InputSpec::Path(at(name));
        let error = open(&spec, &OpenOptions::default()).err().unwrap();
        assert_eq!(error.exit_code(), 66, "{error}");
        assert!(error.to_string().contains("check the path"), "{error}");
    }
}
